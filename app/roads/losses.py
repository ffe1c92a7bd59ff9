"""What a road import takes away from the drives, and what that changes around.

A segment that is dropped or moved loses all that was measured on it. A drive's passes over segments that stay stand:
they speak of their own segment and of what the drive carries along, of no other segment.

``road_import`` and ``road_lost`` are temporary tables of the import's transaction (``app.roads.copy``, and here). How
the roads themselves are merged is in ``app.roads.imports``.
"""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.network.cells import OVER
from app.network.marks import append_marks

_FORGET = text("DROP TABLE IF EXISTS pg_temp.road_lost")

# (=) on geometries compares every coordinate bit for bit.
_NOTE_LOST = text(
    """
    CREATE TEMPORARY TABLE road_lost ON COMMIT DROP AS
    SELECT s.id, s.from_node, s.to_node
    FROM segments AS s LEFT JOIN road_import AS i
        ON i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node
    WHERE i.osm_way_id IS NULL OR NOT s.geom = i.geom
    """
)
# The planner knows nothing of a table that was just filled.
_ANALYZE_LOST = text("ANALYZE road_lost")

# The squares where anything that is shown goes, changes or comes.
_CELLS_LOST = text(OVER.format(where="s.id IN (SELECT id FROM road_lost)"))
_CELLS_NEW = text(OVER.format(where="s.road_version_id = :version OR s.id = ANY(CAST(:changed AS bigint[]))"))

_COUNT = text(
    """
    SELECT count(DISTINCT e.segment_id), count(DISTINCT e.drive_id)
    FROM drive_segments AS e JOIN road_lost AS l ON l.id = e.segment_id
    """
)

# Neighbours of what is gone and of what is new: the network's slopes hang together, and gaps open and close.
_NEIGHBOURS = text(
    """
    WITH node AS MATERIALIZED (
        SELECT from_node AS id FROM road_lost UNION SELECT to_node FROM road_lost
        UNION SELECT from_node FROM segments WHERE road_version_id = :version
        UNION SELECT to_node FROM segments WHERE road_version_id = :version
    )
    SELECT s.id FROM network_slopes AS n JOIN segments AS s ON s.id = n.segment_id
    WHERE s.from_node IN (SELECT id FROM node) OR s.to_node IN (SELECT id FROM node)
    """
)


def note_losses(session: Session) -> tuple[int, int]:
    """Note what the import that stands in ``road_import`` will cost; before anything is merged.

    Returns how many segments lose what was measured, and how many drives had measured it.
    """
    session.execute(_FORGET)
    session.execute(_NOTE_LOST)
    session.execute(_ANALYZE_LOST)
    segments, drives = session.execute(_COUNT).one()
    return int(segments), int(drives)


def cells_lost(session: Session) -> set[int]:
    """The squares in which segments were shown that go or move; before merging."""
    return set(session.execute(_CELLS_LOST).scalars())


def cells_new(session: Session, version: int, changed: Sequence[int]) -> set[int]:
    """Those in which segments are shown that came or moved, and ``changed`` ones; after merging."""
    return set(session.execute(_CELLS_NEW, {"version": version, "changed": list(changed)}).scalars())


def mark_repairs(session: Session, version: int) -> None:
    """Let the network be solved anew around all that changed; after merging."""
    append_marks(session, list(session.execute(_NEIGHBOURS, {"version": version}).scalars()))
