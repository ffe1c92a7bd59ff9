"""Roads come in: the roads of an OpenStreetMap file take the place of the stored network, in one transaction.

The file's roads are copied beside the stored ones (``app.roads.copy``), what that costs is noted and marked for repair
(``app.roads.losses``), and the statements here merge the two. How a file is read is the library's business.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.settings import FilePlace
from app.core.telemetry.events import imported
from app.network.cells import raise_versions
from app.network.locks import own_network
from app.network.swap import solve_all_marked
from app.roads.copy import copy_roads
from app.roads.losses import cells_lost, cells_new, mark_repairs, note_losses
from app.terrain.heights import terrain_under
from app.terrain.store import current_dem
from fusion.errors import RoadsError
from fusion.network.unknowns import knot_positions
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.types import Floats, Progress, no_progress

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ImportCounts:
    """What a road import did: ``kept + moved + added`` is the size of the new network.

    ``measured_lost`` segments, moved and dropped ones, lose what ``drives_affected`` drives had measured on them.
    ``skipped`` counts, by reason, the node pairs of the file that are no segment (``RoadTable.skipped``).
    """

    kept: int
    moved: int
    dropped: int
    added: int
    measured_lost: int = 0
    drives_affected: int = 0
    skipped: Mapping[str, int] = field(default_factory=dict)


@imported("roads")
def import_roads(
    sessions: Sessions, path: Path, dem_dir: FilePlace, progress: Progress = no_progress
) -> ImportCounts:
    """Make the drivable roads of an OpenStreetMap file the whole network (``merge_roads``), and solve what it changes.

    The roads stay where a solution fails: what is marked waits for the workers then.
    Raises ``RoadsError`` for a file that cannot be used, also for one without a single drivable road: it is
    taken for a mistake, since it would drop every segment.
    """
    table = read_roads(path, progress)
    if not len(table):
        raise RoadsError(
            f"{path.name} holds no drivable road, so importing it would empty the map. "
            "Give an extract that covers roads.",
            where=path.name,
        )
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    while (counts := _import(sessions, table, path.name, sha256, dem_dir, progress)) is None:
        pass  # elevation rasters came in meanwhile
    try:
        solve_all_marked(sessions, progress)
    except Exception:
        logger.warning(
            "the roads are in, but not all slopes that they change could be found anew; workers go on with those, and "
            "/v1/admin/stats tells which they cannot find",
            exc_info=True,
        )
    return counts


def _import(
    sessions: Sessions,
    table: RoadTable,
    source_name: str,
    sha256: str,
    dem_dir: FilePlace,
    progress: Progress,
) -> ImportCounts | None:
    """One try: what takes long first, outside of any lock; None where the elevation set is another by then."""
    with sessions() as session:
        before = current_dem(session, dem_dir)
    slope, heights = terrain_under(before, table)
    with sessions.begin() as session:
        copy_roads(session, table, slope, heights, progress)
        own_network(session)
        if current_dem(session, dem_dir) != before:
            return None
        return merge_roads(session, table, source_name, sha256, progress)


_NEW_VERSION = text(
    """
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added)
    VALUES (:source_name, :sha256, :segments, 0, 0, 0, 0) RETURNING id
    """
)
_SET_COUNTS = text(
    """
    UPDATE road_versions
    SET kept = :kept, moved = :moved, dropped = :dropped, added = :added, length_m = :length_m WHERE id = :id
    """
)

# The merge, in this order: drop what is gone, update what is there, add what is new. Each statement handles
# all segments at once. What was measured on dropped segments goes by its foreign keys.
_DROP = text(
    """
    DELETE FROM segments AS s WHERE NOT EXISTS (
        SELECT FROM road_import AS i
        WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node)
    """
)

# A segment between the same nodes whose course changed is another road as far as its slope goes: what was
# measured on the old course is dropped. (=) on geometries compares every coordinate bit for bit.
_MOVE = text(
    """
    WITH moved AS (
        UPDATE segments AS s
        SET geom = i.geom, geom_3857 = i.geom_3857, length_m = i.length_m, road_version_id = :version
        FROM road_import AS i
        WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node
            AND NOT s.geom = i.geom
        RETURNING s.id
    ), estimates AS (
        DELETE FROM drive_segments USING moved WHERE segment_id = moved.id
    ), passes AS (
        DELETE FROM drive_passes USING moved WHERE segment_id = moved.id
    ), verdicts AS (
        DELETE FROM rejected_passes USING moved WHERE segment_id = moved.id
    ), sums AS (
        DELETE FROM pass_sums USING moved WHERE segment_id = moved.id
    ), network AS (
        DELETE FROM network_slopes USING moved WHERE segment_id = moved.id
    ), aggregates AS (
        DELETE FROM segment_slopes USING moved WHERE segment_id = moved.id
    )
    SELECT count(*) FROM moved
    """
)

# Only rows that differ are written: an unchanged row costs a comparison, a written one both of its indexes.
_UPDATE_TAGS = text(
    """
    UPDATE segments AS s
    SET highway = t.highway, name = t.name, oneway = i.oneway, bridge = i.bridge, tunnel = i.tunnel,
        layer = i.layer, dem_slope_percent = nullif(i.dem_slope_percent, 'NaN'),
        dem_heights_m = nullif(i.dem_heights_m, '{}')
    FROM road_import AS i JOIN road_import_tags AS t USING (tag)
    WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node
        AND (s.highway, s.name, s.oneway, s.bridge, s.tunnel, s.layer, s.dem_slope_percent, s.dem_heights_m)
            IS DISTINCT FROM (t.highway, t.name, i.oneway, i.bridge, i.tunnel, i.layer,
                              nullif(i.dem_slope_percent, 'NaN'), nullif(i.dem_heights_m, '{}'))
    RETURNING s.id
    """
)

_ADD = text(
    """
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, name, oneway,
                          bridge, tunnel, layer, dem_slope_percent, dem_heights_m, road_version_id)
    SELECT i.osm_way_id, i.from_node, i.to_node, i.geom, i.geom_3857, i.length_m, t.highway, t.name, i.oneway,
           i.bridge, i.tunnel, i.layer, nullif(i.dem_slope_percent, 'NaN'), nullif(i.dem_heights_m, '{}'), :version
    FROM road_import AS i JOIN road_import_tags AS t USING (tag)
    WHERE NOT EXISTS (
        SELECT FROM segments AS s
        WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node)
    """
)

# The planner must not go by the figures of an empty table until autovacuum comes round.
_ANALYZE = text("ANALYZE segments")


def replace_roads(
    session: Session,
    table: RoadTable,
    source_name: str,
    sha256: str,
    progress: Progress = no_progress,
    *,
    dem_slope_percent: Floats | None = None,
    dem_heights_m: Floats | None = None,
) -> ImportCounts:
    """Make ``table`` the whole network in the caller's transaction, and keep drives and solvers out until it ends.

    ``dem_slope_percent`` has shape (n,), ``dem_heights_m`` one height a knot (``knot_positions``), NaN unknown; None:
    unknown everywhere.
    """
    slope = np.full(len(table), np.nan) if dem_slope_percent is None else dem_slope_percent
    heights = np.full(len(knot_positions(table)[0]), np.nan) if dem_heights_m is None else dem_heights_m
    copy_roads(session, table, slope, heights, progress)
    own_network(session)
    return merge_roads(session, table, source_name, sha256, progress)


def merge_roads(
    session: Session, table: RoadTable, source_name: str, sha256: str, progress: Progress = no_progress
) -> ImportCounts:
    """Make what was copied (``copy_roads``) the whole network: a segment that is not in it is dropped.

    A segment whose (way, from, to) and geometry are unchanged is kept with its id and its estimates, and its
    tags are brought up to date; one whose geometry changed ("moved") keeps its id and loses its estimates. What has to
    be solved anew around that is marked. The caller owns the network.
    """
    values: dict[str, Any] = {"source_name": source_name, "sha256": sha256, "segments": len(table)}
    version = int(session.execute(_NEW_VERSION, values).scalar_one())
    progress("merging", 0.0)
    measured_lost, drives_affected = note_losses(session)
    cells = cells_lost(session)
    dropped = _count(session.execute(_DROP))
    moved = int(session.execute(_MOVE, {"version": version}).scalar_one())
    progress("merging", 0.3)
    changed = list(session.execute(_UPDATE_TAGS).scalars())
    progress("merging", 0.5)
    added = _count(session.execute(_ADD, {"version": version}))
    merged = {"kept": len(table) - moved - added, "moved": moved, "dropped": dropped, "added": added}
    session.execute(_SET_COUNTS, {"id": version, "length_m": float(table.length_m.sum()), **merged})
    session.execute(_ANALYZE)
    mark_repairs(session, version)
    raise_versions(session, cells | cells_new(session, version, changed))
    progress("merging", 1.0)
    return ImportCounts(
        **merged,
        measured_lost=measured_lost,
        drives_affected=drives_affected,
        skipped=dict(table.skipped),
    )


def _count(result: Any) -> int:
    return int(result.rowcount)
