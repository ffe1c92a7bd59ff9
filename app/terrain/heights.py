"""Slopes and heights of the stored segments by the active elevation rasters: computed, filled in, renewed.

Heights are computed outside of any lock and written in pieces, each a short transaction that owns the network; drives
come and go in between. The database notes what is left to be renewed, so the work may be interrupted at any moment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.settings.places import FilePlace
from app.network.cells import cells_met, cells_over, raise_versions, road_states
from app.network.extracts import roads_of, roads_without_heights, roads_without_heights_in, segment_ids_in
from app.network.locks import own_heights, own_network
from app.terrain.store import DemSet, PendingHeights, current_dem, note_renewed, pending_heights, set_terrain
from fusion.network.curve import interval_count, knot_length
from fusion.network.subnetwork import LONGEST_GAP_M, boxes_around
from fusion.network.unknowns import knot_positions, knot_rows
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import Floats, Ints, Progress

SEGMENTS_PER_FILL = 10_000
"""Drives wait for one such piece at most, a second or so."""


Look = Callable[[], object]
"""Called repeatedly during the work; it raises to end it."""


def _nothing() -> None:
    pass


def open_dem(active: DemSet, look: Look = _nothing) -> Dem:
    """The active rasters as one elevation model; ``TerrainError`` where one cannot be read."""
    return Dem.open(active.paths, active.priorities, before_read=look)


def terrain_under(active: DemSet | None, table: RoadTable, look: Look = _nothing) -> tuple[Floats, Floats]:
    """Each segment's slope by these rasters, percent, shape (n,), and the heights at the knots of all, m.

    NaN unknown; ``fusion.network.unknowns.knot_positions`` has the order of the knots.
    """
    if active is None or not len(table):
        return np.full(len(table), np.nan), np.full(len(knot_positions(table)[0]), np.nan)
    with open_dem(active, look) as dem:
        return dem_slopes(dem, table), dem.heights_along(*knot_positions(table), knot_rows(table))


def fill_heights(sessions: Sessions, dem_dir: FilePlace, after_id: int = 0) -> int | None:
    """Give heights to the next segments after an id that have a slope by the active rasters alone, as they were stored
    before heights were. Returns the last one's id; None: there are no more.

    One that reaches over a raster's edge has no slope and waits for the next import. In a short transaction that owns
    the network.
    """
    ids = _fill(
        sessions, dem_dir, lambda session: roads_without_heights(session, after_id, SEGMENTS_PER_FILL)
    )
    return int(ids.max()) if len(ids) else None


def fill_heights_along(sessions: Sessions, dem_dir: FilePlace, driven: RoadTable) -> None:
    """``fill_heights`` for the roads that a drive can have a part in: driven ones and gaps beside them.

    Before the drive is solved, so that no slope is published without the elevation model, however long filling the
    whole map takes. Drives that were solved before had their roads filled, too.
    """
    ends = (driven.lon0_deg, driven.lat0_deg, driven.lon1_deg, driven.lat1_deg)
    boxes = boxes_around(*ends, LONGEST_GAP_M)
    with sessions() as session:
        waits = current_dem(session, dem_dir) is not None and len(roads_without_heights_in(session, boxes)[1])
    if waits:
        _fill(sessions, dem_dir, lambda session: roads_without_heights_in(session, boxes))


def _fill(sessions: Sessions, dem_dir: FilePlace, read: Callable[[Session], tuple[RoadTable, Ints]]) -> Ints:
    """Give heights to the roads that ``read`` finds; their ids, of none where there are no rasters."""
    with sessions.begin() as session:
        own_network(session)
        active = current_dem(session, dem_dir)
        if active is None:
            return np.empty(0, np.int64)
        table, ids = read(session)
        if len(ids):
            _write_terrain(session, table, ids, *terrain_under(active, table))
    return ids


def renew_all(sessions: Sessions, dem_dir: FilePlace, progress: Progress) -> None:
    """Renew the heights of all segments that wait for it; ``progress`` may end the work at any moment."""
    shares = [0.0]
    for share in renewing(sessions, dem_dir, wait=True, look=lambda: progress("reading posts", shares[-1])):
        shares.append(share)
        progress("heights", share)


def renewing(sessions: Sessions, dem_dir: FilePlace, *, wait: bool, look: Look = _nothing) -> Iterator[float]:
    """Renew the heights of all segments that wait for it, a piece at each step; yields the share done.

    One program does it at a time: another one waits, or without ``wait`` leaves the work to the first.
    """
    with own_heights(sessions, wait=wait, look=look) as mine:
        while mine:
            with sessions() as session:
                pending = pending_heights(session)
                if pending is None:
                    return
                ids = segment_ids_in(session, np.array(pending.boxes_deg), pending.after_id)
            for start in range(0, max(len(ids), 1), SEGMENTS_PER_FILL):
                part = ids[start : start + SEGMENTS_PER_FILL]
                last = start + len(part) >= len(ids)
                left = _renew(sessions, dem_dir, pending, part, look, last=last)
                yield min((start + len(part)) / max(len(ids), 1), 1.0)
                if left is None:  # the rasters or the roads are others by now, or all is done
                    break
                pending = left


def _renew(
    sessions: Sessions, dem_dir: FilePlace, pending: PendingHeights, ids: Ints, look: Look, *, last: bool
) -> PendingHeights | None:
    """Write the active rasters' heights of these segments; what is left then, None where it has to be read again."""
    with sessions() as session:
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        active, cells = current_dem(session, dem_dir), cells_met(session, ids.tolist())
        states = road_states(session, cells)
        if pending_heights(session) != pending:
            return None
        table, ids_there = roads_of(session, ids)
    slope, heights = terrain_under(active, table, look)
    with sessions.begin() as session:
        own_network(session)
        if pending_heights(session) != pending or road_states(session, cells) != states:
            return None
        if len(ids_there):
            _write_terrain(session, table, ids_there, slope, heights)
        note_renewed(session, pending, None if last else int(ids[-1]))
        return pending_heights(session)


def _write_terrain(session: Session, table: RoadTable, ids: Ints, slope: Floats, heights: Floats) -> None:
    last = np.cumsum(interval_count(knot_length(table.length_m)) + 1)[:-1]
    set_terrain(session, ids, slope, np.split(heights, last))
    raise_versions(session, cells_over(session, ids.tolist()))
