"""What the network says of its segments, as it is stored: ``network_slopes``. How it was found is in ``solve``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from fusion.network.combine import NETWORK_ONLY
from fusion.network.segment_slopes import Adjustment
from fusion.types import Bools, Floats

_NAMES = ("segment_id", "slope_percent", "slope_sigma_percent", "drives", "observations", *NETWORK_ONLY)
_TYPES = {"segment_id": "bigint", "drives": "integer", "observations": "integer"}
_COLUMNS = ", ".join(f"CAST(:{name} AS {_TYPES.get(name, 'float8')}[])" for name in _NAMES)

# Only what moved is written: a solution differs from the last in the last digits wherever nothing happened. Heights
# come as the nodes' (``_node_heights``), which stay to the last digit where they did not move.
_MOVED = " OR ".join(
    f"""coalesce(abs(n.{name} - excluded.{name}) > :tolerance * excluded.{sigma},
                 n.{name} IS DISTINCT FROM excluded.{name})"""
    for name, sigma in (
        ("slope_percent", "slope_sigma_percent"),
        ("slope_sigma_percent", "slope_sigma_percent"),
        ("steepest_percent", "slope_sigma_percent"),
        ("height_sigma_m", "height_sigma_m"),
    )
)
_EXACT = ("drives", "observations", "driven_share", "height_from_m", "height_to_m")
_WRITE = text(f"""
    INSERT INTO network_slopes AS n ({", ".join(_NAMES)}) SELECT * FROM unnest({_COLUMNS})
    ON CONFLICT (segment_id) DO UPDATE SET {", ".join(f"{name} = excluded.{name}" for name in _NAMES[1:])}
    WHERE {_MOVED} OR ({", ".join(f"n.{name}" for name in _EXACT)})
        IS DISTINCT FROM ({", ".join(f"excluded.{name}" for name in _EXACT)})
    RETURNING segment_id
""")  # noqa: S608 - constants
_HEIGHTS = """
    SELECT segment_id, height_from_m, height_to_m FROM network_slopes
    WHERE segment_id = ANY(%(ids)s::bigint[]) AND height_from_m IS NOT NULL
"""
_CLEAR = text(
    "DELETE FROM network_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[])) RETURNING segment_id"
)


def write_slopes(
    session: Session,
    segment_ids: Sequence[int],
    drives: Sequence[int],
    result: Adjustment,
    rows: Bools,
    tolerance_sigmas: float,
) -> list[int]:
    """Store the ``rows`` (a mask) of a solution for these segments, on each of which so many ``drives`` are accepted.

    Returns the segments that are new or moved by more than ``tolerance_sigmas``. Segments that meet and are written
    together have one height where they meet. At the edge of what is written there can be two: that of the new solution
    inside, and an older one outside until its roads are solved again. They differ by what subnetworks leave, which is
    more for heights, which come from far away, than for slopes. ``settle_network`` leaves such edges between cells.
    """
    values: dict[str, Any] = {name: _nullable(getattr(result, name)[rows]) for name in NETWORK_ONLY}
    start, end = _node_heights(session, segment_ids, result, rows, tolerance_sigmas)
    values |= {
        "height_from_m": _nullable(start),
        "height_to_m": _nullable(end),
        "segment_id": np.array(segment_ids, np.int64),
        "drives": np.array(drives, np.int64),
        "slope_percent": result.slope_percent[rows],
        "slope_sigma_percent": result.slope_sigma_percent[rows],
        "observations": result.observations[rows],
        "tolerance": tolerance_sigmas,
    }
    return list(session.execute(_WRITE, values).scalars())


def _node_heights(
    session: Session, segment_ids: Sequence[int], result: Adjustment, rows: Bools, tolerance_sigmas: float
) -> tuple[Floats, Floats]:
    """Heights at both ends of these segments, a number for each node: what stands there, unless it moved.

    A node moved by more than so many sigmas of any of its segments, and one at which two numbers stand, gets that of
    the solution.
    """
    u = result.unknowns
    new = np.concatenate([result.height_from_m[rows], result.height_to_m[rows]])
    sigma = np.tile(result.height_sigma_m[rows], 2)
    stored = {
        segment: ends
        for segment, *ends in fetch_binary(session, _HEIGHTS, {"ids": np.array(segment_ids, np.int64)})
    }
    unknown = (np.nan, np.nan)
    old = np.array([stored.get(segment, unknown) for segment in segment_ids], float).reshape(-1, 2).T.ravel()
    node = np.concatenate([u.start_node[rows], u.end_node[rows]])
    stands = np.full(u.nodes, np.nan)
    stands[node[np.isfinite(old)]] = old[np.isfinite(old)]
    moved = np.isfinite(old) & ((old != stands[node]) | ~(np.abs(new - old) <= tolerance_sigmas * sigma))
    stands[node[moved]] = np.nan
    height = np.where(np.isfinite(new) & np.isfinite(stands[node]), stands[node], new)
    start, end = np.split(height, 2)
    return start, end


def clear_slopes(session: Session, segment_ids: Sequence[int]) -> list[int]:
    """Forget the network's slopes of these segments; returns those that had one."""
    return list(session.execute(_CLEAR, {"ids": segment_ids}).scalars())


def _nullable(values: Floats) -> Floats:
    return np.ma.masked_invalid(values)
