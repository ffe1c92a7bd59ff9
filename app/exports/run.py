"""Exports made by workers: one snapshot, one file, one blob, and a row that says how far it is.

A run may be cut off at any moment and repeated: the file is made in a folder of its own, its blob appears at once or
not at all, and a blob that no export refers to is swept. Whoever removes the export takes it away from its run. Knows
no HTTP.
"""

from __future__ import annotations

import logging
import shutil
import time
import uuid
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from app.core.blobs import EXPORTS, StoredBlob
from app.core.databases import database_identity
from app.core.db import Sessions
from app.core.errors import ServiceError, StorageFullError
from app.core.filesystems import file_system, free_bytes, full_is_told, storage_full
from app.core.settings import Settings
from app.core.telemetry.logs import about, tell
from app.exports import store
from app.exports.documents import Export
from app.exports.making import Made, asked_again, make_file
from app.exports.provenance import data_state
from app.exports.source import snapshot
from app.jobs.context import JobContext
from app.jobs.task import Interrupted, Task, Work
from fusion.errors import FusionError

CHUNK_BYTES = 2**20
LOOK_EVERY_S = 0.5
"""How often a run looks whether it is to go on, and shows how far it is."""
OTHERS_WAIT_S = 2.0
"""Once something that goes first has waited for so long, no lane is free but that of the export."""
MOST_YIELDS = 3
"""So often an export lets others go first and begins anew; then it runs to its end."""
ORPHAN_AGE = timedelta(hours=6)
"""A file that no export refers to is no run's any more by then."""

NO_ROOM = (
    "The service's storage is full: nothing of this file was kept. Ask again when whoever runs the service has made "
    "room (/readyz says how much there is)."
)

logger = logging.getLogger(__name__)

Computing = Callable[[], AbstractContextManager[None]]


class TooLargeError(FusionError):
    """The file takes more room than all exports together may."""

    kind = "too-large"


class _Unwanted(Exception):  # noqa: N818  (no error: somebody removed the export)
    """The export is no longer this run's."""


def export_task(settings: Settings, sessions: Sessions) -> Task:
    """What a worker does for an export."""
    context = JobContext(settings, sessions)

    def run(work: Work, *, export_id: str) -> str:
        return make_export(context, uuid.UUID(export_id), work.should_stop, work.computing)

    def fail(kind: str, reason: str, *, export_id: str) -> None:
        with sessions.begin() as session:
            store.fail(session, uuid.UUID(export_id), kind, reason, settings.export_keep_days)

    def put_back(*, export_id: str) -> None:
        with sessions.begin() as session:
            store.let_wait(session, uuid.UUID(export_id))

    advice = "Ask for a smaller part of the map (bbox, region, driven)."
    return Task(store.MAKE_EXPORT, run, fail, put_back, subject="export", advice=advice)


def make_export(
    context: JobContext, export_id: uuid.UUID, should_stop: Callable[[], bool], computing: Computing
) -> str:
    """Make the export's file; a word on how it ended. Safe to call twice, also at the same time.

    What is asked for in vain ends as a failed export with a sentence. Raises ``Interrupted`` where it is to be made by
    another run: the worker stops, or lets others go first.
    """
    with about(export=export_id):
        with context.sessions.begin() as session:
            claimed = store.claim(session, export_id)
        if claimed is None:
            return "unwanted"
        export, yields = claimed
        folder = context.scratch(EXPORTS) / f"{export.id}-{export.run}"
        look = _Look(context, export, should_stop, may_yield=yields < MOST_YIELDS)
        try:
            return _made(context, export, folder, look, computing)
        except _Unwanted:
            return "unwanted"
        except Interrupted:
            with context.sessions.begin() as session:
                store.put_back(session, export, yielded=look.yielded)
            raise
        except (FusionError, ServiceError) as error:
            kind, reason = _in_words(error)
            with context.sessions.begin() as session:
                store.fail(
                    session, export.id, kind, reason, context.settings.export_keep_days, run=export.run
                )
            tell(logger, "export failed", level=logging.WARNING, kind=kind, reason=reason)
            return "failed"
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _made(context: JobContext, export: Export, folder: Path, look: _Look, computing: Computing) -> str:
    began_s = time.monotonic()
    request = asked_again(export.request)
    with full_is_told():
        folder.mkdir(parents=True, exist_ok=True)
    path = folder / export.file_name
    with computing():
        with snapshot(context.sessions) as session:
            look.note_version(data_state(session).version)
            made = _in_room(look, lambda: make_file(session, context.settings, request, path, look.share))
        _require_small(context.settings, path.stat().st_size)
        blob = _stored(context, path, look)
    if not _finished(context, export, path, made, blob):
        context.part(EXPORTS).delete(blob.key)
        return "unwanted"
    _remove_old(context)
    tell(
        logger,
        "export done",
        format=request.format.name,
        bytes=blob.size_bytes,
        seconds=round(time.monotonic() - began_s, 3),
    )
    return "done"


def _in_room(look: _Look, work: Callable[[], Made]) -> Made:
    """The result of work that writes; GDAL does not say of a full disk what it was."""
    try:
        with full_is_told():
            return work()
    except (Interrupted, _Unwanted, FusionError, ServiceError):
        raise
    except Exception:
        look.require_room()
        raise


def _finished(context: JobContext, export: Export, path: Path, made: Made, blob: StoredBlob) -> bool:
    companions = asked_again(export.request).format.companions(path, made.stated)
    with context.sessions.begin() as session:
        # Before the export refers to the blob: another database's sweep must not take it for an orphan.
        context.part(EXPORTS).register_database(database_identity(session))
        return store.finish(
            session,
            export,
            entries=made.count,
            provenance=made.provenance,
            companions={place.name: text for place, text in companions.items()},
            notes=made.notes,
            blob_key=blob.key,
            sha256=blob.sha256,
            size_bytes=blob.size_bytes,
            keep_days=context.settings.export_keep_days,
        )


def _stored(context: JobContext, path: Path, look: _Look) -> StoredBlob:
    size_bytes, keep_free = path.stat().st_size, context.settings.min_free_bytes
    with (
        context.part(EXPORTS).writer(
            keep_free_bytes=keep_free, expected_bytes=size_bytes, max_content_bytes=0
        ) as writer,
        path.open("rb") as file,
    ):
        while chunk := file.read(CHUNK_BYTES):
            writer.write(chunk)
            look.share(1.0)
        return writer.finish()


def _require_small(settings: Settings, size_bytes: int) -> None:
    if size_bytes > settings.exports_max_bytes:
        raise TooLargeError(
            f"The file has {size_bytes} bytes, and all exports together may have {settings.exports_max_bytes} "
            "(VERSANT_EXPORTS_MAX_BYTES). Ask for a smaller part of the map (bbox, region, driven)."
        )


def _in_words(error: FusionError | ServiceError) -> tuple[str, str]:
    """Kind and reason of a failure."""
    if isinstance(error, FusionError):
        return error.kind, str(error)
    if isinstance(error, StorageFullError):
        return "storage-full", NO_ROOM
    return "impossible", str(error)


class _Look:
    """Looks, at most every ``LOOK_EVERY_S``, whether a run is to go on, and shows how far it is."""

    def __init__(
        self, context: JobContext, export: Export, should_stop: Callable[[], bool], *, may_yield: bool
    ) -> None:
        self._context, self._export, self._should_stop = context, export, should_stop
        self._may_yield = may_yield
        self._looked_s = self._waited_since_s = -float("inf")
        self.yielded = False

    def note_version(self, data_version: str) -> None:
        """The snapshot is taken."""
        with self._context.sessions.begin() as session:
            if not store.note_version(session, self._export, data_version):
                raise _Unwanted

    def share(self, share: float) -> None:
        """So much of the work is done; raises where it is to end."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = now_s
        if self._should_stop():
            raise Interrupted
        self.require_room()
        with self._context.sessions.begin() as session:
            if not store.set_progress(session, self._export, min(max(share, 0.0), 1.0)):
                raise _Unwanted
            waiting = store.others_wait(session)
        self._let_others_go_first(waiting, now_s)

    def require_room(self) -> None:
        """``StorageFullError`` where less stays free than is to."""
        free = free_bytes(*file_system(str(self._context.scratch(EXPORTS))))
        if free is not None and free < self._context.settings.min_free_bytes:
            raise storage_full()

    def _let_others_go_first(self, waiting: bool, now_s: float) -> None:
        if not waiting:
            self._waited_since_s = -float("inf")
        elif self._waited_since_s == -float("inf"):
            self._waited_since_s = now_s
        elif self._may_yield and now_s - self._waited_since_s >= OTHERS_WAIT_S:
            self.yielded = True
            raise Interrupted


def tend(settings: Settings, sessions: Sessions) -> bool:
    """A worker's part: remove what has expired or is too much, with its files, and what runs left behind; what waits
    without a job gets one."""
    context = JobContext(settings, sessions)
    with sessions.begin() as session:
        store.give_jobs(session)
    _remove_old(context)
    _sweep_scratch(context)
    return False


def _remove_old(context: JobContext) -> None:
    with context.sessions.begin() as session:
        removed, keys = store.remove_old(session, context.settings.exports_max_bytes)
    for key in keys:
        context.part(EXPORTS).delete(key)
    if removed:
        logger.info("%d exports are removed: they have expired, or all together are too large", removed)


def sweep_files(settings: Settings, sessions: Sessions) -> list[str]:
    """Remove files of exports that no export refers to, unless another database uses the store; their keys."""
    context = JobContext(settings, sessions)
    blobs = context.part(EXPORTS)
    old = blobs.older(blobs.keys(), ORPHAN_AGE)
    with sessions() as session:
        identity, referred = database_identity(session), store.referred_blobs(session)
    orphans = [key for key in old if key not in referred]
    if any(name != identity for name in blobs.databases()):
        return []
    for key in orphans:
        blobs.delete(key)
    return orphans


def _sweep_scratch(context: JobContext) -> None:
    """Remove folders of runs that were killed: none lasts so long."""
    limit = datetime.now(UTC) - timedelta(seconds=2 * context.settings.run_limit_s)
    with suppress(FileNotFoundError):
        for folder in context.scratch(EXPORTS).iterdir():
            if datetime.fromtimestamp(folder.stat().st_mtime, UTC) < limit:
                shutil.rmtree(folder, ignore_errors=True)
