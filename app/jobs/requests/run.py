"""A run of a request: begun, shown, put back, failed, whatever the request is for.

A run may be cut off at any moment and repeated, also while the former one still goes on. A request that cannot be met
ends as failed, with a sentence.
"""

from __future__ import annotations

import logging
import shutil
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.errors import ServiceError, StorageFullError
from app.core.settings import Settings
from app.core.telemetry.logs import about, tell
from app.jobs.context import JobContext
from app.jobs.requests.store import Failure, R, RequestStore
from app.jobs.task import Interrupted, Task, Work
from fusion.errors import FusionError
from fusion.messages import message_of

LOOK_EVERY_S = 0.5
"""How often a run looks whether it is to go on, and shows how far it is."""
STAGE_EVERY_S = 0.2
"""How often it shows another stage: nobody sees those that are shorter, and each costs a transaction."""
OTHERS_WAIT_S = 2.0
"""Once something that goes first has waited for so long, no lane is free but that of the request."""

logger = logging.getLogger(__name__)


class Discarded(Exception):  # noqa: N818  (no error: somebody cancelled, removed or claimed it)
    """What is computed is no longer this run's: nobody wants its result."""


class Progress:
    """Shows how far a run is, every ``LOOK_EVERY_S`` or, when its stage changes, ``STAGE_EVERY_S`` at most, and ends it
    where it is to end.

    ``write`` writes stage and share; False: it is no longer this run's.
    """

    def __init__(
        self,
        sessions: Sessions,
        should_stop: Callable[[], bool],
        write: Callable[[Session, str | None, float], bool],
    ) -> None:
        self._sessions, self._should_stop, self._write = sessions, should_stop, write
        self._looked_s = -float("inf")
        self.stage: str | None = None
        self._shown: str | None = None

    def show(self, stage: str | None, share: float) -> bool:
        """So much is done, 0..1; whether it was written. Raises ``Interrupted`` or ``Discarded``."""
        if self._should_stop():
            raise Interrupted
        now_s, self.stage = time.monotonic(), stage
        every_s = LOOK_EVERY_S if stage == self._shown else min(STAGE_EVERY_S, LOOK_EVERY_S)
        if now_s - self._looked_s < every_s:
            return False
        self._looked_s, self._shown = now_s, stage
        with self._sessions.begin() as session:
            if not self._write(session, stage, min(max(share, 0.0), 1.0)):
                raise Discarded
        return True


class RequestRun(Generic[R]):
    """What the work for a request is given."""

    def __init__(self, kind: RequestKind[R], context: JobContext, request: R, work: Work) -> None:
        self.kind, self.context, self.request = kind, context, request
        self.settings, self.sessions = context.settings, context.sessions
        self.computing = work.computing
        self.folder: Path = context.scratch(kind.folder) / f"{request.id}-{request.run}"
        """A folder of its own, which it makes where it needs one."""
        self.at_each_look: Callable[[], None] = lambda: None
        """What the work looks at as well."""
        self.yielded = False
        self.progress = Progress(context.sessions, work.should_stop, self._write)
        self._began_s, self._others_since_s = time.monotonic(), float("inf")
        self._undisturbed_s = kind.undisturbed_s(request.yields)

    def show(self, stage: str | None, share: float) -> None:
        """So much of this stage is done; raises where the run is to end."""
        if not self.progress.show(stage, share):
            return
        self.at_each_look()
        if self._others_are_first(time.monotonic()):
            self.yielded = True
            raise Interrupted

    def note(self, **columns: Any) -> None:
        """Write columns of the request; ``Discarded`` where it is no longer this run's."""
        with self.sessions.begin() as session:
            if not self.kind.store.update(session, self.request, **columns):
                raise Discarded

    def _write(self, session: Session, stage: str | None, share: float) -> bool:
        store = self.kind.store
        if not store.update(session, self.request, stage=stage, progress=share):
            return False
        if self._undisturbed_s == float("inf") or not store.others_wait(session):
            self._others_since_s = float("inf")
        else:
            self._others_since_s = min(self._others_since_s, time.monotonic())
        return True

    def _others_are_first(self, now_s: float) -> bool:
        waited_s, ran_s = now_s - self._others_since_s, now_s - self._began_s
        return waited_s >= OTHERS_WAIT_S and ran_s >= self._undisturbed_s


def expected_failure(no_room: str) -> Callable[[Exception, RequestRun[Any]], Failure | None]:
    """What to say of errors that the request is to blame for; ``no_room``: of a full storage."""

    def failure(error: Exception, _run: RequestRun[Any]) -> Failure | None:
        if isinstance(error, FusionError):
            return Failure(error.kind, message_of(error))
        if isinstance(error, StorageFullError):
            return Failure("storage-full", no_room)
        return Failure("impossible", message_of(error)) if isinstance(error, ServiceError) else None

    return failure


@dataclass(frozen=True)
class RequestKind(Generic[R]):
    """A kind of request: where its rows are, and what a worker does for one."""

    store: RequestStore[R]
    work: Callable[[RequestRun[R]], str]
    """Does it; a word on how it ended. May raise ``Interrupted`` and ``Discarded``."""
    advice: str
    """The sentence on what to do where it is too much."""
    failure: Callable[[Exception, RequestRun[R]], Failure | None]
    """What is said of an error in a run; None: it is the service's, and goes to the log."""
    folder: str
    """Of the runs' folders, in the data folder."""
    files: str | None = None
    """The part of the blob store that its rows refer to by ``blob_key``."""
    private: bool = False
    """It fails by somebody's file, and the reason may name that: operators are told the kind alone."""
    undisturbed_s: Callable[[int], float] = lambda _: float("inf")
    """For how long a run lets nobody go first, by how often the request has done so."""
    at_end: Callable[[Settings], Mapping[str, Any]] = lambda _: {}
    """Columns that are written where it fails."""
    expire: Callable[[Session, Settings], list[str | None]] = lambda *_: []
    """Removes, or ends, what was kept long enough; the files that nobody refers to any more, one of each request."""

    def task(self, context: JobContext) -> Task:
        """What a worker does for a job of it."""

        def number_of(arguments: Mapping[str, Any]) -> uuid.UUID:
            return uuid.UUID(arguments[self.store.argument])

        def run(work: Work, **arguments: Any) -> str:
            return perform(self, context, number_of(arguments), work)

        def give_up(kind: str, reason: str, **arguments: Any) -> None:
            fail(self, context, number_of(arguments), Failure(kind, reason))

        def put_back(**arguments: Any) -> None:
            with context.sessions.begin() as session:
                self.store.let_wait(session, number_of(arguments))

        return Task(self.store.job, run, give_up, put_back, subject=self.store.name, advice=self.advice)


def perform(kind: RequestKind[R], context: JobContext, number: uuid.UUID, work: Work) -> str:
    """Do what is asked for; a word on how it ended. Safe to call twice, also at the same time.

    Raises ``Interrupted`` where another run is to go on: the worker stops, or lets others go first.
    """
    with about(**{kind.store.name: number}):
        with context.sessions.begin() as session:
            request = kind.store.claim(session, number)
        if request is None:
            return "unwanted"
        run = RequestRun(kind, context, request, work)
        try:
            return kind.work(run)
        except Discarded:
            return "unwanted"
        except Interrupted:
            with context.sessions.begin() as session:
                kind.store.put_back(session, request, yielded=run.yielded)
            raise
        except Exception as error:
            failure = kind.failure(error, run)
            if failure is None:
                raise
            fail(kind, context, number, failure, request.run)
            return "failed"
        finally:
            shutil.rmtree(run.folder, ignore_errors=True)


def fail(
    kind: RequestKind[R], context: JobContext, number: uuid.UUID, failure: Failure, run: int | None = None
) -> None:
    """Fail it, unless it is at its end or another run's; its file goes."""
    dropped = {} if kind.files is None else {"blob_key": None}
    with context.sessions.begin() as session:
        before = kind.store.fail(session, number, failure, run, **dropped, **kind.at_end(context.settings))
    key = getattr(before, "blob_key", None)
    if kind.files is not None and key is not None:
        context.part(kind.files).delete(key)
    words = {"kind": failure.kind, "stage": failure.stage, "reason": None if kind.private else failure.reason}
    level = logging.INFO if kind.private else logging.WARNING
    with about(**{kind.store.name: number}):
        tell(logger, f"{kind.store.name} failed", level=level, **words)
