"""A worker's loop: takes jobs from the queue, one at a time, does chores beside them, and ends when it is asked to.

A worker that is killed leaves its job marked as running; every worker looks, when it starts and then again and again,
for jobs whose worker has given no sign of life for ``stalled_after_s`` and puts them back. More jobs at once are more
processes: the compiled loops of one use its cores, and must not be entered twice.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping, Sequence
from typing import Any

import procrastinate
from procrastinate import exceptions, jobs, signals
from sqlalchemy import Engine

from app.core.db import Sessions
from app.core.settings import Settings
from app.jobs import memory
from app.jobs.computations import SIGNS, Liveness, Signs, charge_dead, forget_gone
from app.jobs.connector import EngineConnector
from app.jobs.runs import Runs, make_queue
from app.jobs.stopping import RUN_ON_SHARE, BusyConnections, Stopping
from app.jobs.task import QUEUE, Task

logger = logging.getLogger(__name__)

_POLL_S = 1.0  # for jobs put back: only new ones announce themselves
_RESTART_AFTER_S = 1.0
_NEXT_PIECE_S = 1.0  # as long as a piece takes: half of the time the network is the drives'
_LOOK_AT_LIMITS_EVERY_S = 1.0
_LOOK_AT_EVENT_EVERY_S = 0.1
SILENT_S = 90.0
"""A loop that asks for no work for so long begins anew (upstream's faults: ``app.jobs``). It asks every second, unless
a job runs; while the database is away its questions take half a minute each."""


Chore = Callable[[], Awaitable[bool | None]]
"""What is done beside the jobs, in pieces of at most a second or so; true: there is more to do."""


class Watchdog:
    """For how long the loop on a queue has not asked for a job although none runs; ``current`` are those that do."""

    def __init__(self, queue: procrastinate.App, current: Mapping[int, Any]) -> None:
        self._current = current
        self._asked_s = time.monotonic()
        manager = queue.job_manager
        genuine = manager.fetch_job

        @functools.wraps(genuine)
        async def fetch_job(*arguments: Any, **options: Any) -> Any:
            self._asked_s = time.monotonic()
            return await genuine(*arguments, **options)

        manager.fetch_job = fetch_job  # type: ignore[method-assign]

    async def wait(self) -> None:
        """Returns when the loop has been silent for too long, from now on."""
        self._asked_s = time.monotonic()
        while time.monotonic() - self._asked_s < SILENT_S:
            await asyncio.sleep(min(_POLL_S, SILENT_S / 4))
            if self._current:
                self._asked_s = time.monotonic()


class Worker:
    """One lane of work on the queue."""

    def __init__(
        self,
        settings: Settings,
        engine: Engine,
        sessions: Sessions,
        tasks: Sequence[Task],
        wakes: int | None = None,
    ) -> None:
        """``sessions`` are of ``engine``; ``wakes``: the end of the listener's pipe (``app.jobs.listening``)."""
        self._settings, self._sessions = settings, sessions
        busy = BusyConnections(engine)
        self._signs = Signs(settings.data_dir / SIGNS)
        self._runs = Runs(Liveness(sessions, self._signs), settings.run_limit_s)
        self._queue = make_queue(EngineConnector(engine, busy.spare, wakes), tasks, self._runs)
        self._watchdog = Watchdog(self._queue, self._runs.current)
        self._unended: set[int] = set()
        self._stop, self._too_large = asyncio.Event(), False
        self._stopping = Stopping(
            self._queue,
            self._runs,
            busy,
            settings.grace_s,
            may_exit=threading.current_thread() is threading.main_thread(),
        )

    def run(
        self,
        chores: Sequence[tuple[Chore, float]],
        *,
        wait: bool,
        stop_event: threading.Event | None,
        renewed: bool = False,
    ) -> bool:
        """Work until stopped, or until the queue is empty; each chore first and again every so many seconds.

        With ``renewed`` it also ends between two jobs, and returns True, once the process has grown too large; and each
        job may ask for so much more memory as the settings say.
        """
        if renewed:
            self._runs.before_each = functools.partial(memory.limit_growth, self._settings.lane_memory_bytes)
            self._runs.after_each = self._end_if_large
        retry_every_s = min(self._settings.stalled_after_s / 4, 10.0)
        all_chores = ((self._retry_stalled, retry_every_s), *chores)
        try:
            self._signs.begin()
            asyncio.run(self._work(all_chores, wait, stop_event))
        finally:
            self._stopping.end()
            self._signs.end()
        return self._too_large

    async def _work(
        self, chores: Sequence[tuple[Chore, float]], wait: bool, stop_event: threading.Event | None
    ) -> None:
        stop = self._stop
        self._stopping.attach(asyncio.get_running_loop())
        limits = in_thread(self._stopping.give_up_overdue, "what takes too long could not be given up")
        with _stop_signals(stop):
            async with contextlib.AsyncExitStack() as tasks_beside:
                for background_work in (
                    self._end_when(stop, stop_event),
                    _repeat(limits, _LOOK_AT_LIMITS_EVERY_S, None),
                ):
                    await tasks_beside.enter_async_context(_background(background_work))
                await tasks_beside.enter_async_context(self._queue.open_async())
                heartbeat = _repeat(self._sign_of_life, self._settings.heartbeat_interval_s, None)
                await tasks_beside.enter_async_context(_background(heartbeat))
                for chore, every_s in chores:
                    more = await chore()
                    await tasks_beside.enter_async_context(_background(_repeat(chore, every_s, more)))
                while not stop.is_set():
                    await self._serve(wait, stop)
                    if not wait:
                        return
                    if not stop.is_set():  # it ended by itself: the connection to the database was lost
                        await asyncio.sleep(_RESTART_AFTER_S)

    def _end_if_large(self) -> None:
        """In the thread of a run that is over, before the queue asks for the next."""
        if memory.own_bytes() > memory.NEW_ABOVE_BYTES:
            memory.give_back()
        if (own_bytes := memory.own_bytes()) > memory.NEW_ABOVE_BYTES:
            logger.info("this process takes %d MB by now: another takes its place", own_bytes // 2**20)
            self._too_large = True
            self._stopping.in_loop(self._stop.set)

    async def _end_when(self, stop: asyncio.Event, stop_event: threading.Event | None) -> None:
        """Begin to end once ``stop`` is set, by whoever sets it or the event of another thread."""
        while not stop.is_set():
            if stop_event is not None and stop_event.is_set():
                stop.set()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), _LOOK_AT_EVENT_EVERY_S)
        self._stopping.begin()

    async def _serve(self, wait: bool, stop: asyncio.Event) -> None:
        """Run procrastinate's worker until it ends or ``stop`` is set."""
        worker = asyncio.create_task(
            self._queue.run_worker_async(
                queues=[QUEUE],
                concurrency=1,
                wait=wait,
                install_signal_handlers=False,
                fetch_job_polling_interval=_POLL_S,
                shutdown_graceful_timeout=self._settings.grace_s * RUN_ON_SHARE,
                update_heartbeat_interval=self._settings.heartbeat_interval_s,
                stalled_worker_timeout=self._settings.stalled_after_s,
                delete_jobs=jobs.DeleteJobCondition.SUCCESSFUL.value,
            )
        )
        stopping = asyncio.create_task(stop.wait())
        silent = asyncio.create_task(self._watchdog.wait())
        try:
            await asyncio.wait({worker, stopping, silent}, return_when=asyncio.FIRST_COMPLETED)
            worker.cancel()  # a worker that is cancelled ends its jobs first
            if silent.done() and not worker.done():
                logger.error("the worker asks for no work any more; it begins anew")
                worker.add_done_callback(_ignore_outcome)
                return
            await worker
        except asyncio.CancelledError:
            if not worker.done():
                raise
        except exceptions.ConnectorException:
            if not wait:
                raise
            logger.warning("the worker lost the database and will try again", exc_info=True)
        finally:
            stopping.cancel()
            silent.cancel()

    async def _sign_of_life(self) -> None:
        """The queue's own signs end when the worker is asked to stop, and its runs go on for a part of the grace."""
        with contextlib.suppress(exceptions.ConnectorException):  # the next one says so as well
            for worker in {run.worker for run in tuple(self._runs.current.values())}:
                await self._queue.job_manager.update_heartbeat(worker)

    async def _retry_stalled(self) -> None:
        """Put jobs of silent workers back. Two workers may do so at once: a job may safely run twice.

        First those of this machine that died are looked for: the computation may be what a worker died of.
        """
        await in_thread(self._look_for_dead, "deaths were not counted")()
        try:
            for job in await self._queue.job_manager.get_stalled_jobs(
                queue=QUEUE, seconds_since_heartbeat=self._settings.stalled_after_s
            ):
                number = job.id or 0
                if number in self._runs.current:
                    continue
                logger.warning("job %s of a silent worker goes back into the queue", number)
                await self._put_back(job)
            await self._put_back_unended()
        except exceptions.ConnectorException:
            logger.warning("stalled jobs could not be looked after; trying again later", exc_info=True)
        else:
            await in_thread(self._forget_gone, "marks of jobs that are gone could not be taken away")()

    async def _put_back_unended(self) -> None:
        """Put back what the queue believes this process to be at, and it is not, at two looks one after the other: the
        database went when a run had ended and was never told."""
        manager, unended = self._queue.job_manager, set[int]()
        for worker in tuple(self._runs.workers):
            for job in await manager.list_jobs_async(queue=QUEUE, status="doing", worker_id=worker):
                number = job.id or 0
                if number in self._runs.current:
                    continue
                if number not in self._unended:
                    unended.add(number)
                    continue
                logger.warning("job %s, of whose end the queue was not told, goes back into it", number)
                await self._put_back(job)
        self._unended = unended

    async def _put_back(self, job: jobs.Job) -> None:
        try:
            await self._queue.job_manager.retry_job(job)
        except exceptions.UniqueViolation:  # one is enough and another waits
            await self._queue.job_manager.finish_job(job, jobs.Status.ABORTED, delete_job=True)

    def _look_for_dead(self) -> None:
        for process in charge_dead(self._sessions, self._signs):
            logger.warning("process %s died; what it had claimed is free", process)

    def _forget_gone(self) -> None:
        with self._sessions.begin() as session:
            forget_gone(session)


def in_thread(work: Callable[[], bool | None], failed: str) -> Chore:
    """A chore in a thread of its own; when a store or the database is away, it is left for the next time."""

    def careful() -> bool | None:
        try:
            return work()
        except Exception:
            logger.warning("%s; trying again later", failed, exc_info=True)
            return None

    return functools.partial(asyncio.to_thread, careful)


async def _repeat(chore: Chore, every_s: float, more: bool | None) -> None:
    while True:
        await asyncio.sleep(_NEXT_PIECE_S if more else every_s)
        try:
            more = await chore()
        except Exception:  # else it would never be done again, and nobody would know
            logger.exception("what is done beside the jobs failed; trying again later")
            more = None


def _ignore_outcome(task: asyncio.Task[None]) -> None:
    """Whatever one ends by that is waited for no more."""
    if not task.cancelled():
        task.exception()


@contextlib.asynccontextmanager
async def _background(coroutine: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    task = asyncio.create_task(coroutine)
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def _stop_signals(stop: asyncio.Event) -> contextlib.AbstractContextManager[None]:
    """Let the first SIGTERM or SIGINT set ``stop``; a second one acts as usual. Only the main thread gets them."""

    def on_signal() -> None:
        logger.info("stopping: what does not end soon goes back into the queue")
        stop.set()

    is_main = threading.current_thread() is threading.main_thread()
    return signals.on_stop(on_signal) if is_main else contextlib.nullcontext()
