"""On how many of its segments each drive is rejected, because it contradicts the other drives there.

The numbers change as other drives come and go, so they are read each time that a drive is shown. This module imports
nothing that solves.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

# Most drives have no rejected pass, and an index knows those that have.
_WITH_REJECTED = text(
    "SELECT DISTINCT drive_id FROM rejected_passes WHERE drive_id = ANY(CAST(:ids AS uuid[])) ORDER BY drive_id"
)
# A drive is accepted on a segment where any of its passes is. A duplicate drive contradicts nobody.
_COUNT = text("""
    SELECT drive_id, count(*) AS segments, count(*) FILTER (WHERE NOT accepted) AS rejected
    FROM (SELECT p.drive_id, bool_or(r.pass_id IS NULL OR d.duplicate_of IS NOT NULL) AS accepted
          FROM drive_passes AS p
          JOIN drives AS d ON d.id = p.drive_id
          LEFT JOIN rejected_passes AS r ON r.segment_id = p.segment_id AND r.pass_id = p.id
          WHERE p.drive_id = ANY(CAST(:ids AS uuid[])) AND p.partition = ANY(ARRAY(
              SELECT DISTINCT unnest(partitions) FROM drive_constants WHERE drive_id = ANY(CAST(:ids AS uuid[]))))
          GROUP BY p.drive_id, p.segment_id) AS one
    GROUP BY drive_id
""")


class Rejections(NamedTuple):
    """On how many segments a drive has passes, and on how many of them all are rejected."""

    segments: int
    rejected: int


def rejections_of(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, Rejections]:
    """How far each of these drives agrees with the others; drives without a rejected pass are left out."""
    if not drive_ids:
        return {}
    ids = list(session.execute(_WITH_REJECTED, {"ids": list(drive_ids)}).scalars())
    rows = session.execute(_COUNT, {"ids": ids}) if ids else ()
    return {row.drive_id: Rejections(row.segments, row.rejected) for row in rows}
