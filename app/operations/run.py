"""Runs of operations in a worker: one at a time, behind uploads, safe to be cut off at any moment and repeated.

What was asked for in vain ends as a failed operation with the sentence that the command line would give. Knows no HTTP.
"""

from __future__ import annotations

import logging
import shutil
import uuid
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from app.core.blobs import IMPORTS
from app.core.databases import database_identity
from app.core.db import Sessions
from app.core.errors import ServiceError, StorageFullError
from app.core.filesystems import full_is_told, require_room
from app.core.settings import Settings
from app.core.telemetry.logs import about, tell
from app.jobs.context import JobContext
from app.jobs.task import Interrupted, Task, Work
from app.operations import store
from app.operations.documents import Operation
from app.operations.look import Look, Unwanted
from app.operations.work import Bench, Outcome, PlanChangedError, work
from fusion.errors import FusionError

CHUNK_BYTES = 2**20
ORPHAN_AGE = timedelta(hours=6)
"""A file that no operation refers to is on its way to none any more by then."""
LOST = "The file of this operation is gone from the storage. Ask for it again, with the file."
NO_ROOM = (
    "The service's storage is full. Ask again when whoever runs the service has made room (/readyz says how much there "
    "is)."
)

logger = logging.getLogger(__name__)

Computing = Callable[[], AbstractContextManager[None]]


class FileLostError(FusionError):
    """The file that came with an operation is not there any more."""

    kind = "file-lost"


def operation_task(
    settings: Settings, sessions: Sessions, roads_changed: Callable[[Sessions], object]
) -> Task:
    """What a worker does for an operation."""
    context = JobContext(settings, sessions, roads_changed)

    def run(work: Work, *, operation_id: str) -> str:
        return operate(context, uuid.UUID(operation_id), work.should_stop, work.computing)

    def fail(kind: str, reason: str, *, operation_id: str) -> None:
        _fail(context, uuid.UUID(operation_id), kind, reason)

    def put_back(*, operation_id: str) -> None:
        with sessions.begin() as session:
            store.let_wait(session, uuid.UUID(operation_id))

    advice = "Ask for it again: what was done of it stays. The command line knows no such limit."
    return Task(store.OPERATE, run, fail, put_back, subject="operation", advice=advice)


def operate(
    context: JobContext, number: uuid.UUID, should_stop: Callable[[], bool], computing: Computing
) -> str:
    """Do, or plan, what was asked for; a word on how it ended. Safe to call twice, also at the same time.

    Raises ``Interrupted`` where another run is to go on: the worker stops, or lets others go first.
    """
    with about(operation=number):
        with context.sessions.begin() as session:
            operation = store.claim(session, number)
        if operation is None:
            return "unwanted"
        look = Look(context.sessions, operation, should_stop)
        folder = context.scratch("operations") / f"{operation.id}-{operation.run}"
        try:
            return _operated(context, operation, look, folder, computing)
        except Unwanted:
            return "unwanted"
        except Interrupted:
            with context.sessions.begin() as session:
                store.put_back(session, operation, yielded=look.yielded)
            raise
        except (FusionError, ServiceError) as error:
            kind, reason = _in_words(error)
            _fail(context, number, kind, reason, operation.run)
            return "failed"
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _operated(
    context: JobContext, operation: Operation, look: Look, folder: Path, computing: Computing
) -> str:
    look.progress("beginning", 0.0)
    file = None if operation.blob_key is None else _brought(context, operation, look, folder)
    try:
        outcome = work(Bench(context.settings, context.sessions, operation, look, file, computing))
    except PlanChangedError as changed:
        outcome = Outcome(changed.plan, planned=True)
    with context.sessions.begin() as session:
        say = store.plan if outcome.planned else store.finish
        ours = say(session, operation, outcome.document)
    if not ours:
        return "unwanted"
    if outcome.planned:
        return "planned"
    if operation.blob_key is not None:
        context.part(IMPORTS).delete(operation.blob_key)
    context.roads_changed(context.sessions)
    tell(logger, "operation done", kind=operation.kind)
    return "done"


def _brought(context: JobContext, operation: Operation, look: Look, folder: Path) -> Path:
    """The file that came with the operation, on this machine, under its own name."""
    path = folder / str(operation.request["filename"])
    size = max(int(operation.request["size_bytes"]), 1)
    try:
        with full_is_told(), context.part(IMPORTS).open(str(operation.blob_key), CHUNK_BYTES) as source:
            folder.mkdir(parents=True, exist_ok=True)
            require_room(folder, size, context.settings.min_free_bytes)
            with path.open("wb") as target:
                while chunk := source.read(CHUNK_BYTES):
                    target.write(chunk)
                    look.progress("fetching the file", target.tell() / size)
    except FileNotFoundError as error:
        raise FileLostError(LOST) from error
    return path


def _fail(context: JobContext, number: uuid.UUID, kind: str, reason: str, run: int | None = None) -> None:
    with context.sessions.begin() as session:
        key = store.fail(session, number, kind, reason, run)
    if key is not None:
        context.part(IMPORTS).delete(key)
    tell(logger, "operation failed", level=logging.WARNING, operation=number, kind=kind, reason=reason)


def _in_words(error: FusionError | ServiceError) -> tuple[str, str]:
    """Kind and reason of a failure."""
    if isinstance(error, FusionError):
        return error.kind, str(error)
    return ("storage-full", NO_ROOM) if isinstance(error, StorageFullError) else ("impossible", str(error))


def tend(settings: Settings, sessions: Sessions) -> bool:
    """A worker's part: plans that nobody wanted are forgotten, what waits without a job gets one, files that runs and
    requests left behind go."""
    context = JobContext(settings, sessions)
    with sessions.begin() as session:
        store.give_jobs(session)
        gone = store.forget_plans(session)
    for key in gone:
        context.part(IMPORTS).delete(key)
    sweep_files(context)
    limit = datetime.now(UTC) - timedelta(seconds=2 * settings.run_limit_s)
    with suppress(FileNotFoundError):
        for folder in context.scratch("operations").iterdir():
            if datetime.fromtimestamp(folder.stat().st_mtime, UTC) < limit:
                shutil.rmtree(folder, ignore_errors=True)
    return False


def sweep_files(context: JobContext) -> list[str]:
    """Remove files that no operation refers to, unless another database uses the store; their keys."""
    blobs = context.part(IMPORTS)
    old = blobs.older(blobs.keys(), ORPHAN_AGE)
    if not old:
        return []
    with context.sessions() as session:
        identity, referred = database_identity(session), store.referred_blobs(session)
    if any(name != identity for name in blobs.databases()):
        return []
    orphans = [key for key in old if key not in referred]
    for key in orphans:
        blobs.delete(key)
    return orphans
