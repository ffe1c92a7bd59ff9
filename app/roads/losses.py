"""What a road import takes away from the drives, and what that changes around.

A segment that is dropped or moved loses all that was measured on it. A pass over a segment that stays is lost
as well where the factor is conditional on a segment that does not: it speaks of heights that no longer exist.

``road_import``, ``road_lost`` and ``road_stray`` are temporary tables of the import's transaction (``app.roads.copy``,
and here). How the roads themselves are merged is in ``app.roads.imports``.
"""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.network.passes import rebuild_evidence
from app.network.solve import refresh_in_regions
from fusion.types import Progress

_FORGET = text("DROP TABLE IF EXISTS pg_temp.road_lost, pg_temp.road_stray")

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

# Passes over segments that stay, conditional on one that does not.
_NOTE_STRAY = text(
    """
    CREATE TEMPORARY TABLE road_stray ON COMMIT DROP AS
    SELECT DISTINCT p.id, p.drive_id, p.segment_id
    FROM drive_passes AS p CROSS JOIN LATERAL unnest(p.segments) AS h (id) JOIN road_lost AS l ON l.id = h.id
    WHERE cardinality(p.segments) > 1 AND p.segment_id NOT IN (SELECT id FROM road_lost)
    """
)

_COUNT = text(
    """
    SELECT count(DISTINCT segment_id), count(DISTINCT drive_id)
    FROM (SELECT e.segment_id, e.drive_id FROM drive_segments AS e JOIN road_lost AS l ON l.id = e.segment_id
          UNION ALL SELECT segment_id, drive_id FROM road_stray) AS measured
    """
)
_DELETE_STRAY = text("DELETE FROM drive_passes AS p USING road_stray AS r WHERE p.id = r.id")

# What a drive says of a segment rests on its passes over it.
_DELETE_ESTIMATES = text(
    """
    DELETE FROM drive_segments AS e USING road_stray AS r
    WHERE e.drive_id = r.drive_id AND e.segment_id = r.segment_id AND NOT EXISTS (
        SELECT FROM drive_passes AS p WHERE p.drive_id = e.drive_id AND p.segment_id = e.segment_id)
    """
)
_STRAY_SEGMENTS = text("SELECT DISTINCT segment_id FROM road_stray ORDER BY segment_id")

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
    session.execute(_NOTE_STRAY)
    segments, drives = session.execute(_COUNT).one()
    return int(segments), int(drives)


def repair_network(session: Session, version: int, progress: Progress) -> None:
    """Drop the passes that lost a segment and solve the network anew around all that changed; after merging."""
    session.execute(_DELETE_STRAY)
    session.execute(_DELETE_ESTIMATES)
    stray = list(session.execute(_STRAY_SEGMENTS).scalars())
    rebuild_evidence(session, stray)
    neighbours = session.execute(_NEIGHBOURS, {"version": version}).scalars()
    refresh_in_regions(session, sorted({*stray, *neighbours}), progress)
