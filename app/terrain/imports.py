"""The set of elevation rasters is changed: rasters come in, go, or get another priority.

A change is one short transaction that names the new set and where heights of segments are to be renewed; these follow
in pieces (``app.terrain.heights``), by whoever made the change, or by a worker if that one is cut off.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

from app.core.db import Sessions
from app.core.messages import say
from app.core.settings.places import FilePlace
from app.core.telemetry.events import imported
from app.network.locks import own_network
from app.terrain.files import Limits, reach_deg, store_files, with_bounds
from app.terrain.heights import renew_all
from app.terrain.store import DemSet, DemSource, chosen, current_dem, local_raster, replace_dem
from fusion.errors import TerrainError
from fusion.terrain.dem import Dem
from fusion.types import Progress, no_progress

NO_DATUM = "unknown"

_Change = Callable[[Sequence[DemSource]], list[DemSource]]
"""The active rasters -> those that are to be active, in the order in which they count where nothing else decides."""


@imported("elevation")
def import_dem(
    sessions: Sessions,
    paths: Sequence[Path],
    dem_dir: FilePlace,
    progress: Progress = no_progress,
    *,
    priority: int | None = None,
    limits: Limits = Limits(),  # noqa: B008 - it is frozen
) -> DemSet:
    """Add elevation rasters to the active set; ``TerrainError`` for one that cannot be used."""
    if not paths:
        raise TerrainError(say("raster.none_named"))
    stored = store_files(paths, dem_dir, progress, limits)
    return add_dem(sessions, stored, dem_dir, progress, priority=priority)


def add_dem(
    sessions: Sessions,
    sources: Sequence[DemSource],
    dem_dir: FilePlace,
    progress: Progress = no_progress,
    *,
    priority: int | None = None,
    source: str | None = None,
    licence: str | None = None,
) -> DemSet:
    """Add stored rasters to the active set and renew slopes and heights of the segments that they cover.

    A raster that is in the set already changes nothing; one with the name of an active raster but other bytes
    takes its place. Names are compared without regard to case: N50E007.hgt and n50e007.HGT are one tile. Without a
    ``priority`` a raster keeps that of the one in whose place it comes, and a new one has 0; so it is with ``source``
    and ``licence``, which say whose data it is.
    Drives processed before keep their estimates; the network takes the new heights into account where later
    drives pass, or by `versant settle`. Drives and solvers wait for a piece of the work at most.
    """

    def added(former: Sequence[DemSource]) -> list[DemSource]:
        known = {one.name.casefold(): one for one in former}
        ranked = [
            _as_said(one, known.get(one.name.casefold(), one), priority, source, licence) for one in sources
        ]
        new = [one for one in dict.fromkeys(ranked) if one not in former]
        names = {one.name.casefold() for one in new}
        return [one for one in former if one.name.casefold() not in names] + new

    dem = _change(sessions, added, dem_dir, progress)
    assert dem is not None  # noqa: S101 - at least what was added is there
    return dem


def _as_said(
    one: DemSource, before: DemSource, priority: int | None, source: str | None, licence: str | None
) -> DemSource:
    """A raster with what was said of it now, or else of the one before it."""
    return replace(
        one,
        priority=before.priority if priority is None else priority,
        source=source or before.source,
        licence=licence or before.licence,
    )


def remove_dem(
    sessions: Sessions, names: Collection[str], dem_dir: FilePlace, progress: Progress = no_progress
) -> DemSet | None:
    """Take rasters out of the active set; what is left renews the heights of the segments that they covered.

    None where nothing is left. The files stay as long as a drive that runs, or a backup, may want them
    (``app.terrain.files.sweep_rasters``). ``TerrainError`` for a name that no active raster has.
    """

    def without(former: Sequence[DemSource]) -> list[DemSource]:
        gone = chosen(former, names)
        return [source for source in former if source not in gone]

    return _change(sessions, without, dem_dir, progress)


def rank_dem(
    sessions: Sessions, name: str, priority: int, dem_dir: FilePlace, progress: Progress = no_progress
) -> DemSet | None:
    """Give an active raster another priority and renew the heights of the segments that it covers."""

    def ranked(former: Sequence[DemSource]) -> list[DemSource]:
        mine = chosen(former, [name])
        return [replace(source, priority=priority) if source in mine else source for source in former]

    return _change(sessions, ranked, dem_dir, progress)


def _change(sessions: Sessions, change: _Change, dem_dir: FilePlace, progress: Progress) -> DemSet | None:
    outcome = None
    while outcome is None:
        with sessions() as session:
            active = current_dem(session, dem_dir)
        former = active.sources if active else ()
        sources = change(former)
        if sources == list(former):
            outcome = (active,)
            break
        outcome = _switch(sessions, active, with_bounds(sources, dem_dir), dem_dir)
    renew_all(sessions, dem_dir, progress)
    progress("heights", 1.0)
    return outcome[0]


def _switch(
    sessions: Sessions, active: DemSet | None, sources: list[DemSource], dem_dir: FilePlace
) -> tuple[DemSet | None] | None:
    """Make these the active rasters; None where others than before are by now. What takes long comes first."""
    former = list(active.sources) if active else []
    # Whose data it is changes no height.
    old, new = ({replace(one, source=None, licence=None): one for one in each} for each in (former, sources))
    changed = [new[one] for one in new if one not in old] + [old[one] for one in old if one not in new]
    boxes = [reach_deg(source, dem_dir) for source in changed]
    datum = NO_DATUM
    if sources:  # all of them can be used together, or nothing is changed
        paths = [local_raster(dem_dir, source) for source in sources]
        with Dem.open(paths, [source.priority for source in sources]) as dem:
            datum = dem.datum
    with sessions.begin() as session:
        own_network(session)
        if current_dem(session, dem_dir) != active:
            return None
        active_set = replace_dem(session, sources, datum, dem_dir, boxes)
        return (active_set if sources else None,)
