"""Publishes slopes: combines the network's slope of a segment with the estimates of slope-only drives.

``network_slopes`` and ``drive_segments`` -> ``segment_slopes``, the one table of slopes that the map is read from. The
library decides how the parts are combined (``fusion.network.combine``).
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from fusion.methods.base import OF_TERRAIN
from fusion.network.combine import NETWORK_ONLY, SlopePart, published_slope
from fusion.types import Ints

_SLOPE = ("slope_percent", "slope_sigma_percent", "drives", "observations")
_NAMES = ("segment_id", *_SLOPE, *NETWORK_ONLY)
_TYPES = {"segment_id": "bigint", "drives": "integer", "observations": "integer"}
_COLUMNS = ", ".join(f"CAST(:{name} AS {_TYPES.get(name, 'float8')}[])" for name in _NAMES)

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
        *session.execute(_COPY_NETWORK, alone).scalars(),
        *_combine(session, mixed),
    ]


def _combine(session: Session, ids: Ints) -> list[int]:
    """The same for segments with estimates of slope-only drives, which always have something to publish."""
    if not len(ids):
        return []
    columns: dict[str, list[Any]] = {name: [] for name in _NAMES}
    for segment_id, group in groupby(
        session.execute(_PARTS, {"ids": ids, "of_terrain": list(OF_TERRAIN)}), key=lambda row: row.segment_id
    ):
        combined = published_slope([_part(row) for row in group])
        columns["segment_id"].append(segment_id)
        for name in _NAMES[1:]:
            columns[name].append(getattr(combined, name))
    return list(session.execute(_WRITE_AGGREGATES, columns).scalars())


def left_over(session: Session) -> list[int]:
    """Segments whose published slope rests on nothing any more, and on no drive that waits."""
    return list(session.execute(_LEFT_OVER).scalars())


def _part(row: Row[Any]) -> SlopePart:
    values = dict(row._mapping)
    del values["segment_id"]
    return SlopePart(**values)
