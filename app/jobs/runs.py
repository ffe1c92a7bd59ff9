"""The runs of this process: each is begun, ended, put back or given up, whatever happens to it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import procrastinate
from procrastinate import exceptions, job_context, jobs
from procrastinate.connector import BaseAsyncConnector
from procrastinate.retry import BaseRetryStrategy, RetryDecision

from app.core.messages import say
from app.core.telemetry.logs import about
from app.jobs import memory
from app.jobs.computations import Liveness
from app.jobs.task import QUEUE, Interrupted, Task, TooLongError, Work, is_connection_loss
from fusion.errors import FusionError
from fusion.messages import message_of

logger = logging.getLogger(__name__)

MAX_DEATHS = 3
"""A job is given up when so many processes died of it: what needs more memory than there is kills every time."""

LONGEST_PAUSE_S = 120
"""Between two runs of a job that loses the database again and again. Runs that were cut off for another reason count as
well, so one that was often interrupted waits for so long after a restart of the database that takes a second."""

ONCE_AGAIN_S = 1.0
"""Pause before a job of which one is enough is asked for anew, having lost the database."""

LEEWAY, LEEWAY_S = 1.1, 5.0
"""A run that takes so many times its limit, and so much more, does not look at it any more: its process is given up.

Without the seconds a short limit would give up processes whose runs look, only not that often.
"""


class CutOffError(Exception):
    """The worker stops: the job goes back into the queue at once."""


class _AgainLater(BaseRetryStrategy):
    """Run a job again that was cut off: at once after a stop, later and later while the database is away.

    However often: neither is the job's fault.
    """

    def get_retry_decision(self, *, exception: BaseException, job: jobs.Job) -> RetryDecision | None:
        if isinstance(exception, CutOffError):
            return RetryDecision()
        if is_connection_loss(exception):
            return RetryDecision(retry_in={"seconds": min(2 ** min(job.attempts, 30), LONGEST_PAUSE_S)})
        return None


@dataclass(frozen=True)
class Run:
    """One job that this process has begun."""

    job: int
    task: Task
    arguments: Mapping[str, Any]
    limit_s: float
    worker: int
    """Whom the queue believes to be at it."""
    once: bool = False
    """One such job that waits is enough: this one cannot go back where another waits."""
    began_s: float = field(default_factory=time.monotonic)

    @property
    def took_s(self) -> float:
        """For how long it runs."""
        return time.monotonic() - self.began_s

    @property
    def too_long(self) -> TooLongError:
        """What is to be said when it is beyond its limit."""
        return TooLongError(
            say(
                "processing.too_long",
                subject=self.task.subject,
                limit_s=self.limit_s,
                advice=self.task.advice,
            )
        )


class Runs:
    """The runs of this process, now and before."""

    def __init__(self, liveness: Liveness, limit_s: float) -> None:
        self.liveness, self.limit_s = liveness, limit_s
        self.current: dict[int, Run] = {}
        self.workers: set[int] = set()
        """Whom the queue has given jobs in this process."""
        self.stopping = threading.Event()
        """Runs end at their next look and go back into the queue."""
        self.before_each: Callable[[], None] = lambda: None
        """Called when a run begins."""
        self.after_each: Callable[[], None] = lambda: None
        """Called when a run is over."""

    def overdue(self) -> list[Run]:
        """Those that took longer than they may and do not look."""
        return [run for run in tuple(self.current.values()) if run.took_s > run.limit_s * LEEWAY + LEEWAY_S]

    def perform(self, task: Task, context: procrastinate.JobContext, arguments: Mapping[str, Any]) -> str:
        """Run the job to its end, or say to the queue what is to become of it."""
        once = context.job.queueing_lock is not None
        run = Run(context.job.id or 0, task, arguments, self.limit_s, context.job.worker_id or 0, once)
        self.workers.add(run.worker)
        self.before_each()
        try:
            with about(job=run.job):
                return self._run_to_end(run, context)
        finally:
            self.after_each()

    def _run_to_end(self, run: Run, context: procrastinate.JobContext) -> str:
        task, arguments, once = run.task, run.arguments, run.once
        deaths = self.liveness.deaths(run.job)
        if deaths >= MAX_DEATHS:
            reason = say("processing.died", n=deaths, subject=task.subject, advice=task.advice)
            task.give_up("interrupted", reason, **arguments)
            self.liveness.forget(run.job)
            return "given up"
        try:
            with self._registered(run):
                outcome = task.run(self._work(run, context), **arguments)
        except Interrupted as stop:
            if context.abort_reason() == job_context.AbortReason.USER_REQUEST:
                raise exceptions.JobAborted from stop
            if not once:
                raise CutOffError from stop
            task.put_back(**arguments)
            outcome = "put back"
        except Exception as error:
            outcome = self._cut_off_or_failed(run, context, error)
        self.liveness.forget(run.job)
        return outcome

    def _work(self, run: Run, context: procrastinate.JobContext) -> Work:
        def should_stop() -> bool:
            if run.took_s > run.limit_s:
                raise run.too_long
            return self.stopping.is_set() or context.should_abort()

        return Work(should_stop, lambda: self.liveness.computing(run.job), context.job.priority)

    @contextmanager
    def _registered(self, run: Run) -> Iterator[None]:
        self.current[run.job] = run
        try:
            yield
        finally:
            del self.current[run.job]

    def _cut_off_or_failed(self, run: Run, context: procrastinate.JobContext, error: Exception) -> str:
        """See to a run that ended by an error; raises what the queue is to judge."""
        if is_connection_loss(error):
            # Its statement was cancelled, most likely.
            stopped = self.stopping.is_set() or context.should_abort()
            if not stopped:
                logger.warning("job %s lost the database and is run again later", run.job, exc_info=error)
            if run.once:
                self.stopping.wait(0.0 if stopped else ONCE_AGAIN_S)
                run.task.put_back(**run.arguments)
                return "put back"
            if not stopped:
                raise error
            with suppress(Exception):  # the database may be gone indeed; its next run begins all the same
                run.task.put_back(**run.arguments)
            raise CutOffError from error
        logger.error("job %s (%s) failed", run.job, run.task.kind.name, exc_info=error)
        run.task.give_up(*_failure_of(run.task, error), **run.arguments)
        self.liveness.forget(run.job)
        raise error


def make_queue(connector: BaseAsyncConnector, tasks: Sequence[Task], runs: Runs) -> procrastinate.App:
    """The queue with its tasks (their contract: ``app.jobs.task``), by ``connector``; the caller opens it.

    ``runs`` holds what this process runs of them.
    """
    app = procrastinate.App(connector=connector)
    for task in tasks:
        _register(app, task, runs)
    return app


def _register(app: procrastinate.App, task: Task, runs: Runs) -> None:
    @app.task(
        name=task.kind.name, queue=QUEUE, priority=task.kind.priority, pass_context=True, retry=_AgainLater()
    )
    def perform(context: procrastinate.JobContext, /, **arguments: Any) -> str:
        return runs.perform(task, context, arguments)


def _failure_of(task: Task, error: Exception) -> tuple[str, str]:
    """Kind and reason of a failure."""
    if isinstance(error, FusionError):
        return error.kind, message_of(error)
    if isinstance(error, MemoryError):
        memory.forget(error)
        return "out-of-memory", say(
            "processing.needs_memory", subject=task.subject, more=memory.MORE_MEMORY, advice=task.advice
        )
    fault = say("processing.fault", error=type(error).__name__)
    return "internal", fault
