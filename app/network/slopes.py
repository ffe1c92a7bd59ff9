"""What the network says of its segments, as it is stored: ``network_slopes``. How it was found is in ``solve``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from fusion.network.combine import NETWORK_ONLY
from fusion.network.published import Adjustment
from fusion.types import Bools, Floats

_NAMES = ("segment_id", "slope_percent", "slope_sigma_percent", "drives", "observations", *NETWORK_ONLY)
_TYPES = {"segment_id": "bigint", "drives": "integer", "observations": "integer"}
_COLUMNS = ", ".join(f"CAST(:{name} AS {_TYPES.get(name, 'float8')}[])" for name in _NAMES)

# Only what moved is written: a solution differs from the last in the last digits wherever nothing happened.
_WRITE = text(
    f"""
    INSERT INTO network_slopes AS n ({", ".join(_NAMES)}) SELECT * FROM unnest({_COLUMNS})
    ON CONFLICT (segment_id) DO UPDATE SET {", ".join(f"{name} = excluded.{name}" for name in _NAMES[1:])}
    WHERE abs(n.slope_percent - excluded.slope_percent) > :tolerance * excluded.slope_sigma_percent
        OR abs(n.slope_sigma_percent - excluded.slope_sigma_percent) > :tolerance * excluded.slope_sigma_percent
        OR (n.drives, n.observations, n.driven_share) IS DISTINCT FROM
           (excluded.drives, excluded.observations, excluded.driven_share)
        OR coalesce(abs(n.height_from_m - excluded.height_from_m) > :tolerance * excluded.height_sigma_m
                    OR abs(n.height_to_m - excluded.height_to_m) > :tolerance * excluded.height_sigma_m,
                    (n.height_from_m, n.height_to_m) IS DISTINCT FROM (excluded.height_from_m, excluded.height_to_m))
    RETURNING segment_id
    """  # noqa: S608 - constants
)
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
    """Store those ``rows`` of a solution, a mask, that are these segments, on which so many drives are heard.

    Returns the segments that are new or moved by more than so many of their sigmas.
    """
    values: dict[str, Any] = {name: _nullable(getattr(result, name)[rows]) for name in NETWORK_ONLY}
    values |= {
        "segment_id": segment_ids,
        "drives": drives,
        "slope_percent": result.slope_percent[rows].tolist(),
        "slope_sigma_percent": result.slope_sigma_percent[rows].tolist(),
        "observations": result.observations[rows].tolist(),
        "tolerance": tolerance_sigmas,
    }
    return list(session.execute(_WRITE, values).scalars())


def clear_slopes(session: Session, segment_ids: Sequence[int]) -> list[int]:
    """Forget the network's slopes of these segments; returns those that had one."""
    return list(session.execute(_CLEAR, {"ids": segment_ids}).scalars())


def _nullable(values: Floats) -> list[float | None]:
    return [None if np.isnan(value) else value for value in values.tolist()]
