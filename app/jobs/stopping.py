"""How a worker ends: asked, within its grace, whatever its threads do.

First the marks of its computations go, so that a kill from now on counts against no job. Its runs go on for half of
the grace. Then they are asked to end, and the statements that they wait for are cancelled. A run that does not look (a
loop in machine code) is put back into the queue for it, and the process ends.
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn

import procrastinate
import psycopg
from procrastinate import jobs, utils
from sqlalchemy import Engine, event

from app.jobs.runs import Run, Runs
from fusion.messages import message_of

logger = logging.getLogger(__name__)

RUN_ON_SHARE = 0.5
"""Share of the grace for which runs go on."""

_PUT_BACK_SHARE = 0.8  # the rest is for putting back those that do not end

_CANCEL_TIMEOUT_S = 1.0


class BusyConnections:
    """The connections of an engine that are in use, so that what they wait for can be cancelled."""

    def __init__(self, engine: Engine) -> None:
        self._busy: set[psycopg.Connection[Any]] = set()
        event.listen(engine, "checkout", lambda connection, *_: self._busy.add(connection))
        for over in ("checkin", "close", "invalidate"):
            event.listen(engine, over, lambda connection, *_: self._busy.discard(connection))

    def spare(self, connection: psycopg.Connection[Any]) -> None:
        """Cancel nothing on it until it is used for something else: by it the queue is told what becomes of jobs."""
        self._busy.discard(connection)

    def cancel(self) -> None:
        """End the statements that run just now: each raises in its own thread."""
        for connection in tuple(self._busy):
            with suppress(psycopg.Error, OSError):
                connection.cancel_safe(timeout=_CANCEL_TIMEOUT_S)


class Stopping:
    """Brings a worker to its end; ``may_exit``: the process is its own."""

    def __init__(
        self, queue: procrastinate.App, runs: Runs, busy: BusyConnections, grace_s: float, *, may_exit: bool
    ) -> None:
        self._queue, self._runs, self._busy = queue, runs, busy
        self._grace_s, self._may_exit = grace_s, may_exit
        self._over = threading.Event()
        self._given_up: set[int] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    def begin(self) -> None:
        """The worker was asked to stop."""
        self._in_background(self._runs.liveness.stop)
        self._in_background(self._stop)
        if self._may_exit:
            self._in_background(self._exit_at_the_end)

    def end(self) -> None:
        """The worker came to its end by itself."""
        self._over.set()

    def give_up_overdue(self) -> None:
        """End a run that is beyond its limit and does not look; the process goes with it if it is its own."""
        overdue = [run for run in self._runs.overdue() if run.job not in self._given_up]
        if not overdue:
            return
        self._given_up.update(run.job for run in overdue)
        if self._may_exit:
            self._in_background(self._runs.liveness.stop)
            self._in_background(lambda: self._exit_at_the_end(1))
        self._busy.cancel()
        for run in overdue:
            logger.error("job %s does not end after %.0f s: it is given up", run.job, run.took_s)
            with suppress(Exception):  # it ends all the same
                run.task.give_up(run.too_long.kind, message_of(run.too_long), **run.arguments)
            with suppress(Exception):
                self._in_loop(run, jobs.Status.FAILED)
        if self._may_exit:
            _exit(1)

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """The loop in which the queue is open."""
        self._loop = loop

    def in_loop(self, call: Callable[[], object]) -> None:
        """Have the worker's loop do something, whatever thread asks for it."""
        assert self._loop is not None  # noqa: S101 - it runs
        self._loop.call_soon_threadsafe(call)

    def _stop(self) -> None:
        if self._over.wait(self._grace_s * RUN_ON_SHARE):
            return
        self._runs.stopping.set()
        self._busy.cancel()
        if self._over.wait(self._grace_s * (_PUT_BACK_SHARE - RUN_ON_SHARE)) or not self._may_exit:
            return
        self._put_back(list(self._runs.current.values()))
        _exit(0)

    def _exit_at_the_end(self, status: int = 0) -> None:
        """Even if the database does not answer any more."""
        if not self._over.wait(self._grace_s):
            _exit(status)

    def _put_back(self, runs: list[Run]) -> None:
        for run in runs:
            logger.warning("job %s does not end: it goes back into the queue in its absence", run.job)
            with suppress(Exception):  # a drive that still says "running" is taken up all the same
                run.task.put_back(**run.arguments)
            with suppress(Exception):
                self._in_loop(run, jobs.Status.ABORTED if run.once else None)

    def _in_loop(self, run: Run, status: jobs.Status | None) -> None:
        """Write to the queue, whose connections belong to the loop; without a status the job is run again."""
        manager = self._queue.job_manager
        assert self._loop is not None  # noqa: S101 - the queue is open
        action = (
            manager.retry_job_by_id_async(run.job, retry_at=utils.utcnow())
            if status is None
            else manager.finish_job_by_id_async(run.job, status, delete_job=False)
        )
        asyncio.run_coroutine_threadsafe(action, self._loop).result(self._grace_s)

    def _in_background(self, work: Callable[[], None]) -> None:
        threading.Thread(target=work, daemon=True).start()


def _exit(status: int) -> NoReturn:
    """Leave without waiting for threads."""
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
