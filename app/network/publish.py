"""Stores what the network says of its segments, and publishes it combined with the estimates of slope-only drives.

``network_slopes`` and ``drive_segments`` -> ``segment_slopes``, the one table of slopes that the map is read from. The
library decides how the parts are combined (``fusion.network.combine``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import bigints, fetch_binary
from fusion.methods.base import OF_TERRAIN
from fusion.network.combine import NETWORK_ONLY, SlopePart, published_slope
from fusion.network.segment_slopes import Adjustment
from fusion.types import Bools, Floats, Ints

_SLOPE = ("slope_percent", "slope_sigma_percent", "drives", "observations")
_NAMES = ("segment_id", *_SLOPE, *NETWORK_ONLY)
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
    of_result = ("slope_percent", "slope_sigma_percent", "observations", *NETWORK_ONLY)
    columns = {name: getattr(result, name)[rows] for name in of_result}
    ends = _node_heights(session, segment_ids, result, rows, tolerance_sigmas)
    columns["height_from_m"], columns["height_to_m"] = ends
    values: dict[str, Any] = {name: np.ma.masked_invalid(column) for name, column in columns.items()}
    values |= {"segment_id": np.array(segment_ids, np.int64), "drives": np.array(drives, np.int64)}
    return list(session.execute(_WRITE, {**values, "tolerance": tolerance_sigmas}).scalars().all())


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
    return list(session.execute(_CLEAR, {"ids": bigints(segment_ids)}).scalars())


# The network's own slope first, then each drive in order, so that the same parts always combine to the same
# bits. The drives of the network are in its slope already.
_PARTS = text(f"""
    SELECT segment_id, {", ".join(_SLOPE)}, drive_id IS NULL AS network, of_terrain, {", ".join(NETWORK_ONLY)}
    FROM (
        SELECT {", ".join(_NAMES)}, NULL AS drive_id, false AS of_terrain
        FROM network_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[]))
        UNION ALL
        SELECT e.segment_id, e.slope_percent, e.slope_sigma_percent, 1, e.observations,
               {", ".join("NULL" for _ in NETWORK_ONLY)}, e.drive_id, p.method = ANY(:of_terrain)
        FROM drive_segments AS e JOIN provenances AS p ON p.id = e.provenance_id
        WHERE e.segment_id = ANY(CAST(:ids AS bigint[])) AND NOT e.in_network
    ) AS part
    ORDER BY segment_id, drive_id NULLS FIRST
""")  # noqa: S608 - constants

# Only rows that differ are written.
_UNLESS_EQUAL = f"""
    ON CONFLICT (segment_id) DO UPDATE SET
        {", ".join(f"{name} = excluded.{name}" for name in _NAMES[1:])}, updated_at = now()
    WHERE ({", ".join(f"a.{name}" for name in _NAMES[1:])}) IS DISTINCT FROM
        ({", ".join(f"excluded.{name}" for name in _NAMES[1:])})
    RETURNING segment_id
"""
_WRITE_AGGREGATES = text(f"""
    INSERT INTO segment_slopes AS a ({", ".join(_NAMES)}) SELECT * FROM unnest({_COLUMNS})
    {_UNLESS_EQUAL}
""")  # noqa: S608 - constants

# A slope of the network alone stays as it is (``published_slope``), so nearly all are copied in one statement.
_MIXED = text(
    "SELECT DISTINCT segment_id FROM drive_segments WHERE segment_id = ANY(:ids) AND NOT in_network ORDER BY 1"
)
_COPY_NETWORK = text(f"""
    INSERT INTO segment_slopes AS a ({", ".join(_NAMES)})
    SELECT {", ".join(_NAMES)} FROM network_slopes WHERE segment_id = ANY(:ids) ORDER BY segment_id
    {_UNLESS_EQUAL}
""")  # noqa: S608 - constants
_CLEAR_WITHOUT = text("""
    DELETE FROM segment_slopes AS a
    WHERE segment_id = ANY(:ids) AND NOT EXISTS (SELECT FROM network_slopes AS n WHERE n.segment_id = a.segment_id)
    RETURNING segment_id
""")

# Slopes of a former model that rest on nothing any more. A drive that waits to be computed may support them again:
# until then they stay.
_LEFT_OVER = text("""
    SELECT a.segment_id FROM segment_slopes AS a
    WHERE NOT EXISTS (SELECT FROM network_slopes AS n WHERE n.segment_id = a.segment_id)
        AND NOT EXISTS (SELECT FROM drive_segments AS e WHERE e.segment_id = a.segment_id AND NOT e.in_network)
        AND NOT EXISTS (
            SELECT FROM drive_segments AS e JOIN drives AS d ON d.id = e.drive_id
            WHERE e.segment_id = a.segment_id AND d.status IN ('queued', 'running'))
    ORDER BY a.segment_id
""")


def refresh_aggregates(session: Session, segment_ids: Iterable[int]) -> list[int]:
    """Publish these segments again from all that is stored; a segment of which nothing is known has no row.

    Returns the segments whose published slope changed. The caller holds their cells (``app.network.cells``).
    """
    ids = np.unique(np.array(list(segment_ids), np.int64))
    if not len(ids):
        return []
    mixed = np.array(session.execute(_MIXED, {"ids": ids}).scalars().all(), np.int64)
    alone = {"ids": np.setdiff1d(ids, mixed)}
    return [
        *session.execute(_CLEAR_WITHOUT, alone).scalars(),
        *session.execute(_COPY_NETWORK, alone).scalars().all(),
        *_combine(session, mixed),
    ]


def _combine(session: Session, ids: Ints) -> list[int]:
    """The same for segments with estimates of slope-only drives, which always have something to publish."""
    if not len(ids):
        return []
    parts = groupby(
        session.execute(_PARTS, {"ids": ids, "of_terrain": list(OF_TERRAIN)}), key=lambda row: row[0]
    )
    combined = {segment_id: published_slope([_part(row) for row in group]) for segment_id, group in parts}
    columns = {name: [getattr(one, name) for one in combined.values()] for name in _NAMES[1:]}
    return list(session.execute(_WRITE_AGGREGATES, {"segment_id": list(combined), **columns}).scalars())


def left_over(session: Session) -> list[int]:
    """Segments whose published slope rests on nothing any more, and on no drive that waits."""
    return list(session.execute(_LEFT_OVER).scalars())


def _part(row: Row[Any]) -> SlopePart:
    values = dict(row._mapping)
    del values["segment_id"]
    return SlopePart(**values)
