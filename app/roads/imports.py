"""Roads come in: the roads of an OpenStreetMap file become those of a region, step by step, beside the service.

The file's roads are copied beside the stored ones (``copy``) and compared with them (``comparing``), which writes
nothing; a trial run ends there. Then each change is a short transaction (``changing``). How a file is read is the
library's business.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from app.core import mirror
from app.core.claims import Claim, ClaimLostError
from app.core.db import Sessions
from app.core.messages import say
from app.core.settings.places import FilePlace
from app.core.telemetry.events import imported
from app.network.cells import LAST_STEP, state_of
from app.network.locks import import_claim
from app.network.swap import solve_all_marked
from app.roads import region_files, steps, store
from app.roads.changing import touch
from app.roads.comparing import NOBODY, count_again, count_lost, losses, passes_on, plan_import, waiting_for
from app.roads.copy import copy_roads, forget_roads
from app.roads.documents import USUAL, ImportCounts, Source, Wishes, refuse
from app.roads.names import bring_names
from app.terrain.heights import terrain_under
from app.terrain.store import current_dem, dem_version_id
from fusion.errors import RoadsError
from fusion.roads.changes import Change
from fusion.roads.names import MapNames
from fusion.roads.osm import read_roads
from fusion.roads.osm_changes import is_change_file
from fusion.roads.table import RoadTable
from fusion.types import Progress, no_progress

logger = logging.getLogger(__name__)


@imported("roads")
def import_roads(
    sessions: Sessions,
    path: Path,
    dem_dir: FilePlace,
    progress: Progress = no_progress,
    *,
    region: str | None = None,
    wishes: Wishes = USUAL,
) -> ImportCounts:
    """Make the drivable roads of an OpenStreetMap file those of a region, and solve what that changes.

    The region is named after the file where none is named. What is cut off goes on when the file is imported again. The
    roads stay where a solution fails: what is marked waits for the workers then. Drives that are to be computed again
    are named (``touched_drives``), not queued.
    Raises ``RoadsError`` for a file that cannot be used, also for one without a single drivable road: it is taken for a
    mistake, since it would empty the region; and for losses that nobody has accepted. A file of changes is applied to
    what is kept of its region's file.
    """
    if not is_change_file(path):
        name = store.region_name(path.name) if region is None else store.check_name(region)
        return _bring_file(sessions, path, path, Source(path.name, "", name), dem_dir, wishes, progress)
    with sessions() as session:
        target = store.changed_region(session, region, path.name)
        bounds = store.region_extent(session, target.id)
    with TemporaryDirectory(prefix="versant-") as folder:
        progress("applying changes", 0.0)
        updated = region_files.changed_file(dem_dir, target, path, bounds, Path(folder))
        source = Source(path.name, "", target.name, based_on=target.file_uri)
        return _bring_file(sessions, updated, path, source, dem_dir, wishes, progress)


def _bring_file(
    sessions: Sessions,
    roads: Path,
    given: Path,
    source: Source,
    dem_dir: FilePlace,
    wishes: Wishes,
    progress: Progress,
) -> ImportCounts:
    """``bring_in`` of a file of roads, made perhaps of the file that was given, and kept for changes to come."""
    names = MapNames()
    table = read_roads(roads, progress, names=names)
    source = replace(source, sha256=mirror.sha256_of(given))
    if wishes.dry_run:
        return bring_in(sessions, table, source, dem_dir, wishes, progress, names)
    progress("keeping the file", 0.0)
    uri, sha256 = region_files.keep_file(dem_dir, roads, source.region)
    try:
        source = replace(source, file_uri=uri, file_sha256=sha256)
        return bring_in(sessions, table, source, dem_dir, wishes, progress, names)
    except BaseException:
        with sessions() as session:
            known = store.find_region(session, source.region)
        if known is None or known.file_uri != uri:  # else the roads are in, and the file is theirs
            mirror.forget(dem_dir, uri)
        raise


def remove_region(
    sessions: Sessions,
    name: str,
    dem_dir: FilePlace,
    progress: Progress = no_progress,
    wishes: Wishes = USUAL,
) -> ImportCounts:
    """Remove a region: roads that no other region has are deleted, and the evidence on them is retired.

    Raises ``RoadsError`` where there is no such region, and for losses that nobody has accepted.
    """
    with sessions() as session:
        region = store.known_region(session, name)
    source = Source(region.source_name, region.sha256, name)
    return bring_in(sessions, RoadTable.empty(), source, dem_dir, wishes, progress)


def bring_in(
    sessions: Sessions,
    table: RoadTable,
    source: Source,
    dem_dir: FilePlace,
    wishes: Wishes,
    progress: Progress = no_progress,
    names: MapNames | None = None,
) -> ImportCounts:
    """Make ``table`` the roads of a region (an empty one removes it), beside drives and solvers; one at a time.

    ``names`` become those of the region; without any it has none.
    """
    with import_claim(sessions) as claim:
        claim.wait(lambda: progress("waiting for another import", 0.0))
        transaction = partial(_transaction, sessions, claim)
        try:
            work = Import(table, source, wishes, progress, transaction, names=names or MapNames())
            counts = _do_alone(work, dem_dir)
        finally:
            # Where that fails the next import does it.
            with suppress(ClaimLostError, SQLAlchemyError), transaction() as session:
                forget_roads(session)
    if wishes.dry_run:
        return counts
    try:
        solve_all_marked(sessions, progress)
    except Exception:
        logger.warning(
            "the roads are in, but not all slopes that they change could be found anew; workers go on with those, and "
            "/v1/admin/stats tells which they cannot find",
            exc_info=True,
        )
    return counts


def _do_alone(work: Import, dem_dir: FilePlace) -> ImportCounts:
    """Plan, have it accepted, and carry it out; or only plan, in a dry run."""
    wishes, counts = work.wishes, work.plan(dem_dir)
    if wishes.dry_run:
        return counts
    work.require_acceptance()
    if wishes.agree is not None:
        wishes.agree(counts)
    while True:
        try:
            counts = work.carry_out(counts)
            break
        except steps.TerrainChangedError:
            work.plan(dem_dir)  # the rest of it, with the heights of now
    if work.former_uri is not None:
        mirror.forget(dem_dir, work.former_uri)
    return counts


@contextmanager
def _transaction(sessions: Sessions, claim: Claim) -> Iterator[Session]:
    """One in which the import is still the only one."""
    with sessions.begin() as session:
        claim.require(session)
        yield session


@dataclass
class Import:
    """One import: planned, and carried out."""

    table: RoadTable
    source: Source
    wishes: Wishes
    progress: Progress
    transaction: steps.Transactions
    dem_version: int = 0
    former_uri: str | None = None
    """The file that was kept of the region before"""
    run: steps.Run | None = None
    names: MapNames = field(default_factory=MapNames)

    def plan(self, dem_dir: FilePlace) -> ImportCounts:
        """Copy the roads with the heights of now, compare, and say what would be done."""
        with self.transaction() as session:
            dem, self.dem_version = current_dem(session, dem_dir), dem_version_id(session)
            known = store.find_region(session, self.source.region)
        self.former_uri = None if known is None else known.file_uri
        if self.source.based_on not in (None, self.former_uri):
            raise RoadsError(say("roads.imported_meanwhile", region=self.source.region))
        heights = terrain_under(dem, self.table)
        with self.transaction() as session:
            copy_roads(session, self.table, *heights, self.progress)
            self.progress("comparing", 0.0)
            counts = self.compare(session)
        self.progress("comparing", 1.0)
        return counts

    def compare(self, session: Session) -> ImportCounts:
        """Compare what was copied with what is stored."""
        table, known = self.table, store.find_region(session, self.source.region)
        region_id = NOBODY if known is None else known.id
        self._plan = plan = plan_import(session, table, region_id, self.wishes.tolerance_m)
        self._passes = passes_on(session, plan)
        return ImportCounts(
            region=self.source.region,
            kept=plan.kept,
            added=len(plan.added),
            **{change.name.lower(): plan.count(change) for change in Change if change is not Change.KEPT},
            measured_lost=count_lost(session, plan),
            restored=len({one.n for one in plan.returns if one.fresh}),
            drives_again=count_again(session, plan, waiting_for(session, plan, table)),
            skipped=dict(table.skipped),
            dry_run=self.wishes.dry_run,
        )

    def require_acceptance(self) -> None:
        """``RoadsError`` for losses that nobody has accepted."""
        if not self.wishes.accept_losses:
            with self.transaction() as session:
                refuse(losses(session, self._plan), self.source.region, removal=not len(self.table))

    def carry_out(self, counts: ImportCounts) -> ImportCounts:
        """Do what was planned last; ``counts`` are those of the first plan."""
        self.run = run = self.run or self._begin()
        run.dem_version = self.dem_version
        steps.carry_out(run, self._plan, self._passes)
        with self.transaction() as session:
            bring_names(session, run.region, self.names)
        with self.transaction() as session:
            self._end(session, run, counts)
        return replace(counts, longest_hold_s=round(run.longest_hold_s, 4))

    def _begin(self) -> steps.Run:
        """Note that the import begins, and which drives wait for what it brings."""
        name, sha256, region = self.source.name, self.source.sha256, self.source.region
        with self.transaction() as session:
            version, begun_at = store.begin_version(session, name, sha256, region)
            known = store.find_region(session, region)
            number = known.id if known else store.make_region(session, region, name, sha256, version)
            touch(session, state_of(version, LAST_STEP), (), waiting_for(session, self._plan, self.table))
        return steps.Run(self.transaction, version, number, begun_at, self.dem_version, self.progress)

    def _end(self, session: Session, run: steps.Run, counts: ImportCounts) -> None:
        """Note what the import has done. Drives that failed beside it for want of roads wait for them, too."""
        waiting = waiting_for(session, self._plan, self.table, run.begun_at)
        touch(session, state_of(run.version, LAST_STEP), (), waiting)
        store.end_version(
            session,
            run.version,
            kept=counts.kept + counts.renumbered + counts.reversed,
            moved=counts.moved + counts.far,
            dropped=counts.split + counts.merged + counts.dropped,
            added=counts.added,
        )
        if not len(self.table):
            store.forget_region(session, run.region)
            return
        brought = {
            "version": run.version,
            "segments": counts.segments,
            "bounds": list(self.table.bounds_deg()),
        }
        store.note_import(session, run.region, **vars(self.source), **brought)
