"""The result of a batch brought into a service, as if its logs had been uploaded: ``versant import-batch``.

A drive is taken as it was computed where the service would find the same: by the same code, on the same roads and the
same ground. Another is stored as an upload is, and the workers compute it, behind uploads. Each drive is one
transaction with all that it says, so it may be cut off at any moment and begun again: what is there stays.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sqlalchemy.orm import Session

from app.batch.archive import Archive, Input
from app.batch.folder import BatchError
from app.batch.kept import KeptDrive, ground_under, over
from app.batch.listing import opened
from app.batch.run import Shown
from app.core.blobs import LOGS, StoredBlob
from app.core.errors import StorageFullError
from app.core.filesystems import file_system
from app.core.messages import say
from app.core.mirror import sha256_of
from app.core.receiving.body import Piece
from app.core.telemetry import audit
from app.core.version import code_version
from app.drives import claims, publishing, queue
from app.drives.batches import importing
from app.drives.batches.documents import Selection, Which
from app.drives.batches.removing import remove_all
from app.drives.batches.removing_store import Targets, ask
from app.drives.computing import Computed, surroundings_of
from app.drives.documents import Drive
from app.drives.intake import register_upload
from app.drives.method_choice import check_options
from app.drives.person.store import DueLog, note_deleted
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.upload_bundle import COPY_BYTES, UploadBundle
from app.drives.writing import write_result
from app.jobs.context import JobContext
from app.network.results import in_database
from app.network.solve import lag_among_all
from app.terrain.heights import fill_heights_along, open_dem
from app.terrain.store import DemSet
from fusion.errors import FusionError
from fusion.lags import next_lag
from fusion.messages import message_of
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem

ORIGIN = "versant import-batch"
"""What the audit log says of who it was: a person who may open the database."""
KNOWN_AT_ONCE = 1000
GROUND_M = 0.02
"""Heights of the same rasters differ by less, whoever packed them."""

OTHER_CODE = "another version of Versant made them"
OTHER_ROADS = "the roads around them are not those of the batch"
OTHER_GROUND = "the elevation rasters under them are not those of the batch"
OTHER_LAG = "beside other drives their altimeter shows another lag"


@dataclass
class Brought:
    """What came of it."""

    failed: int
    """Logs that failed in the batch, whose report says why: they stay out"""
    number: int | None = None
    """Of the import; None: nothing was changed"""
    as_computed: int = 0
    to_compute: Counter[str] = field(default_factory=Counter)
    """Drives that the workers compute, by the reason"""
    there: int = 0
    """Logs that the owner has already"""
    left_out: dict[str, str] = field(default_factory=dict)
    """Logs that are not brought in although they are drives, and why not"""
    without_log: int = 0


class Asked(NamedTuple):
    """How: ``dry_run`` changes nothing, ``without_logs`` also takes drives whose logs are not reached."""

    dry_run: bool = False
    without_logs: bool = False


def bring(context: JobContext, archive: Archive, asked: Asked, shown: Shown) -> Brought:
    """Bring all drives of an archive in, for the owner on whose behalf the sessions are; those that are not there yet.

    One import at a time: another is waited for. Raises ``BatchError`` where logs are not reached that are wanted,
    ``NoRoadsError`` where there are no roads, ``BadOptionsError`` for options that no request may have, and what
    storage raises.
    """
    check_options(archive.method, archive.options)
    with importing.import_claim(context.sessions) as claim, ExitStack() as stack:
        if not claim.take():  # of one that was killed for half a minute at most
            shown.work("waiting for another import")
            claim.wait()
        brought = Brought(failed=archive.failed)
        new = _not_there(context, archive, brought)
        missing = not_reached(new, shown.count("looking for logs", len(new)))
        if missing and not (asked.without_logs or asked.dry_run):
            raise BatchError(
                say("batch.logs_missing", n=len(missing), all=len(new), first=missing[0].log.name)
            )
        work = _Work(context, archive, asked, brought, {one.log.name for one in missing}, stack)
        bar = shown.count("drives", len(new))
        for inputs, kept in archive.groups(new):
            work.group(inputs, kept, bar)
    return brought


def take_back(context: JobContext, archive: Archive) -> int:
    """Remove all drives of the imports by which logs of this archive came; how many. Workers do the rest."""
    numbers = {
        number
        for of_some in _known(context, archive.inputs)
        for number in of_some.values()
        if number is not None
    }
    count = 0
    for number in sorted(numbers):
        selection = Selection(which=Which.ALL, imported=number, force=True)
        targets = Targets(selection=selection, method=None, ids=None, whatever_they_do=True)
        with context.sessions.begin() as session:
            asked_at = ask(session, targets)
            audit.note(session, ORIGIN, "drives removed", f"import {number}")
        count += remove_all(context.sessions, targets, asked_at)
    return count


def _known(context: JobContext, inputs: Sequence[Input]) -> Iterator[dict[str, int | None]]:
    for k in range(0, len(inputs), KNOWN_AT_ONCE):
        with context.sessions() as session:
            yield importing.known_logs(session, [one.sha256 for one in inputs[k : k + KNOWN_AT_ONCE]])


def _not_there(context: JobContext, archive: Archive, brought: Brought) -> list[Input]:
    known = {sha256 for of_some in _known(context, archive.inputs) for sha256 in of_some}
    new = [one for one in archive.inputs if one.sha256 not in known]
    brought.there = len(archive.inputs) - len(new)
    return new


@dataclass
class _Work:
    """Drive after drive; ``missing``: names of logs that are not reached."""

    context: JobContext
    archive: Archive
    asked: Asked
    brought: Brought
    missing: set[str]
    stack: ExitStack
    _dem: tuple[int, Dem] | None = None

    def group(self, inputs: Sequence[Input], kept: Iterator[KeptDrive], bar: Callable[[int], None]) -> None:
        """The drives of a group, those among them that are wanted."""
        wanted = {one.log.name: one for one in inputs}
        for drive in kept:
            if (one := wanted.get(drive.log)) is not None:
                self._drive(one, drive)
                bar(1)

    def _drive(self, one: Input, kept: KeptDrive) -> None:
        computed, why = self._computed(kept)
        lost = one.log.name in self.missing
        if lost and computed is None:
            self.brought.left_out[one.log.name] = say("batch.log_needed", why=why)
            return
        if not self.asked.dry_run:
            try:
                blob = (
                    lost_blob(one) if lost else stored(self.context, one, self.archive.options.get("columns"))
                )
            except StorageFullError:
                raise
            except (FusionError, OSError) as error:
                self.brought.left_out[one.log.name] = message_of(error)
                return
            as_computed = self._registered(one, blob, kept, computed, lost)
            if as_computed is None:
                self.brought.there += 1
                return
            why = why if as_computed or why else OTHER_ROADS
        self.brought.without_log += lost
        if why:
            self.brought.to_compute[why] += 1
        else:
            self.brought.as_computed += 1

    def _registered(
        self, one: Input, blob: StoredBlob, kept: KeptDrive, computed: Computed | None, lost: bool
    ) -> bool | None:
        """Make it a drive, and whether it says all that was computed; else a worker computes it, as where roads change
        meanwhile. None: its owner has one of this content."""
        number, written = self.number, False

        def begin(session: Session, drive: Drive) -> None:
            nonlocal written
            importing.note_imported(session, drive.id, number, kept.records)
            if lost:
                note_deleted(session, [DueLog(drive.id, blob.key)])
            written = computed is not None and self._written(session, drive, computed)
            if not written:
                queue.enqueue(session, drive.id, drive.generation, queue.PROCESS_BEHIND)

        _, created = register_upload(
            self.context.sessions,
            self.context.blobs,
            blob,
            filename=one.log.file_name,
            method=self.archive.method,
            options=self.archive.options,
            begin=begin,
        )
        return written if created else None

    def _written(self, session: Session, drive: Drive, computed: Computed) -> bool:
        """Write what it says; False where the roads are not the same any more."""
        running = claims.mark_running(session, drive.id, drive.generation)
        assert running is not None  # noqa: S101 - it was made in this transaction
        every_s = self.context.settings.publish_every_s
        if write_result(session, running, computed, publishing.patience_s(session, every_s, behind=True)):
            return True
        claims.mark_queued(session, drive.id, drive.generation)
        return False

    def _computed(self, kept: KeptDrive) -> tuple[Computed | None, str]:
        """What the service would compute of it; or None, and why that is not known."""
        if self.archive.version != code_version():
            return None, OTHER_CODE
        around = surroundings_of(self.context, kept.boxes_deg)
        roads, rows = self.archive.roads.near(kept.boxes_deg)
        met = roads.meets(kept.boxes_deg)
        if not _same(roads.subset(met), around.roads.table):
            return None, OTHER_ROADS
        ground_m = ground_under(kept.result.track, self._terrain(around.dem))
        if not np.allclose(ground_m, kept.ground_m, rtol=0, atol=GROUND_M, equal_nan=True):
            return None, OTHER_GROUND
        result, ids = over(kept.result, rows[met]), around.roads.ids
        if result.factors:
            driven = around.roads.table.subset(np.unique([f.segment for f in result.factors]))
            if not self.asked.dry_run:
                fill_heights_along(self.context.sessions, self.context.dem_dir, driven)
            if kept.lag_s is not None:
                with self.context.sessions() as session:
                    lag_s = lag_among_all(session, uuid.uuid4(), in_database(result.factors, ids))
                if lag_s is not None and next_lag(kept.lag_s, lag_s) is not None:
                    return None, OTHER_LAG
        return Computed(kept.facts, around, ids, around.roads.table, result), ""

    def _terrain(self, active: DemSet | None) -> Dem | None:
        if active is None:
            return None
        if self._dem is None or self._dem[0] != active.version_id:
            self._dem = active.version_id, self.stack.enter_context(open_dem(active))
        return self._dem[1]

    @cached_property
    def number(self) -> int:
        """Of the import."""
        with self.context.sessions.begin() as session:
            self.brought.number = number = importing.open_import(session, self.archive.name)
            audit.note(session, ORIGIN, "drives imported", f"import {number}")
        return number


def _same(one: RoadTable, other: RoadTable) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in RoadTable.columns())


def not_reached(inputs: Sequence[Input], progress: Callable[[int], None]) -> list[Input]:
    """Those whose files are not there; each file is looked for once. ``progress`` takes how many more were seen to."""
    there: dict[str, bool] = {}
    missing = []
    for one in inputs:
        address = one.log.address
        if address not in there:
            fs, path = file_system(address)
            there[address] = bool(fs.exists(path))
        if not there[address]:
            missing.append(one)
        progress(1)
    return missing


def stored(context: JobContext, one: Input, columns: Mapping[str, str] | None) -> StoredBlob:
    """The log as an upload stores it. Raises ``BatchError`` where its bytes are others than they were, ``OSError``, and
    what an upload of it would meet."""
    settings = context.settings
    with opened(one.log) as path:
        if sha256_of(path) != one.sha256:
            raise BatchError(say("batch.log_changed"))
        bundle = UploadBundle(
            context.blobs,
            keep_free_bytes=settings.min_free_bytes,
            expected_bytes=one.log.size,
            max_content_bytes=settings.max_log_bytes,
            look=FirstLook(columns),
        )
        try:
            for piece in _pieces(path, one.log.file_name):
                bundle.take([piece])
            return bundle.finish()[0]
        except BaseException:
            bundle.discard()
            raise


def _pieces(path: Path, name: str) -> Iterator[Piece]:
    with path.open("rb") as file:
        while data := file.read(COPY_BYTES):
            yield Piece(0, name, data)


def lost_blob(one: Input) -> StoredBlob:
    """Of a log that is not reached: a key under which there is nothing, as after a log's time is over."""
    return StoredBlob(f"{LOGS}/{uuid.uuid4().hex}", one.sha256, one.log.size, one.sha256)
