"""What a task of the queue is: a name, a function, and what is to be done where a run cannot end.

The contract of ``Task.run``: it may be cut off at any moment and repeated, on any machine, even while the former run
still goes on. It calls ``work.should_stop()`` once a second or more often and raises ``Interrupted`` when that is true.
It holds ``work.computing()`` around what takes memory and processor, and around no wait: a process that dies meanwhile
counts against its job, any other death does not. A lost connection to the database it lets through (the job runs again
later). Any other error ends the job: it is logged, and ``give_up`` puts it in words where people see it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import procrastinate
import psycopg
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.orm import Session

from app.core.claims import ClaimLostError
from app.core.messages import say
from fusion.errors import FusionError

QUEUE = "drives"
"""The one queue: who comes first is a matter of priority."""

# Never opened: it only formats jobs, which are written on the session's own connection.
FORMATTER = procrastinate.App(connector=procrastinate.SyncPsycopgConnector())


class Interrupted(Exception):  # noqa: N818  (no error: the worker was asked to stop)
    """The worker stops; the job goes back into the queue."""


class TooLongError(FusionError):
    """A run takes longer than any may."""

    kind = "too-long"


@dataclass(frozen=True)
class Kind:
    """A kind of job, as whoever adds one names it."""

    name: str
    priority: int = 0
    """Higher ones go first."""


@dataclass(frozen=True)
class Work:
    """What a run of a task is handed, besides the job's arguments."""

    should_stop: Callable[[], bool]
    """Whether the worker stops; raises ``TooLongError`` when the run has taken as long as it may."""
    computing: Callable[[], AbstractContextManager[None]]
    """To be held around the computation proper."""
    priority: int = 0
    """Of the job."""


@dataclass(frozen=True)
class Task:
    """A kind of job and what is done for it; the callables get the job's arguments by name."""

    kind: Kind
    run: Callable[..., str]
    """``run(work, **arguments)``: a word for the log on how it ended."""
    give_up: Callable[..., None]
    """``give_up(kind, reason, **arguments)``: it will not be run again; ``reason`` is a sentence for people."""
    put_back: Callable[..., None] = lambda **_: None
    """``put_back(**arguments)``: its run is over without an end and it waits for another. By default nothing waits but
    the job, which goes back by itself. A job with a queueing lock (one that waits is enough) ends with its run: then
    this adds another unless one waits."""
    subject: str = "job"
    """What people call that which is computed."""
    advice: str = say("processing.again")
    """The sentence on what to do where it is too much."""


def add_job(session: Session, kind: Kind, *, lock: str | None = None, **arguments: Any) -> None:
    """Add a job in the session's transaction: a rollback drops it, a commit wakes a worker.

    Jobs with the same ``lock`` run one after the other.
    """
    connection: Any = session.connection().connection.driver_connection
    FORMATTER.configure_task(
        kind.name, queue=QUEUE, lock=lock, priority=kind.priority, connection=connection
    ).defer(**arguments)


def is_connection_loss(error: BaseException) -> bool:
    """Whether the database could not be reached or cut a transaction off, so that another run may succeed.

    Whoever lost a claim was cut off for so long.
    """
    cut_off = OperationalError | InterfaceError | PoolTimeoutError | psycopg.OperationalError | ClaimLostError
    if isinstance(error, cut_off):
        return True
    return isinstance(error, DBAPIError) and error.connection_invalidated
