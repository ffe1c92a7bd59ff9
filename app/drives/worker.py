"""The worker: takes drives from the queue and processes them.

A worker that is killed leaves its job marked as running; every worker looks, when it starts and then again
and again, for jobs whose worker has given no sign of life for ``stalled_after_s`` and puts them back. How a drive is
computed is ``process``'s to know.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import signal
import threading
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator, Sequence
from datetime import timedelta
from typing import Any

import procrastinate
from procrastinate import exceptions, jobs
from procrastinate.retry import BaseRetryStrategy, RetryDecision

from app.core.db import make_engine, session_factory
from app.core.settings import Settings, libpq_url
from app.drives import intake
from app.drives.process import Workbench, give_up, is_connection_loss, process_drive
from app.drives.progress import Interrupted
from app.drives.queue import BEHIND, QUEUE, TASK
from app.drives.renewal import HeightFiller, renew

logger = logging.getLogger(__name__)

MAX_ATTEMPTS = 10
"""Runs that may be cut off before a drive fails, counting lost connections, killed and stopped workers."""

MAX_DEATHS = 3
"""Of those, runs in which the worker died: a drive that needs more memory than there is kills every time."""

SWEEP_EVERY_S = 3600.0
"""How often the blob store is cleared of what nobody refers to, seconds."""

RENEW_EVERY_S = 600.0
"""How often a worker looks for what an update of the service left to be done, seconds."""

GRACE_S = 5.0
"""How long a stopping worker lets its drives run on before it puts them back into the queue, seconds."""

_POLL_S = 1.0  # for jobs put back: only new ones announce themselves
_RESTART_AFTER_S = 1.0
_NEXT_PIECE_S = 1.0  # as long as a piece takes: half of the time the network is the drives'
_CONNECTIONS = 5  # of the queue: fetching, listening, heartbeat, looking after stalled jobs


Chore = Callable[[], Awaitable[bool | None]]
"""What is done beside the drives, in pieces of at most a second or so; true: there is more to do."""


class _AgainLater(BaseRetryStrategy):
    """Run a job again that was cut off: at once after a stop, later and later while the database is away."""

    def get_retry_decision(self, *, exception: BaseException, job: jobs.Job) -> RetryDecision | None:
        if isinstance(exception, exceptions.JobAborted):
            return RetryDecision()
        if is_connection_loss(exception):
            return RetryDecision(retry_in={"seconds": min(2**job.attempts, 60)})
        return None


def make_queue(url: str, bench: Workbench, begun: set[int]) -> procrastinate.App:
    """The queue with its one task, on the database at ``url``; the caller opens it.

    ``begun`` receives the ids of jobs that this process has begun and not brought to an end: when the
    database takes one of them for a dead worker's, it was only cut off from it.
    """
    connector = procrastinate.PsycopgConnector(conninfo=libpq_url(url), min_size=1, max_size=_CONNECTIONS)
    app = procrastinate.App(connector=connector)

    @app.task(name=TASK, queue=QUEUE, pass_context=True, retry=_AgainLater())
    def process(context: procrastinate.JobContext, *, drive_id: str, generation: int) -> str:
        drive = uuid.UUID(drive_id)
        if reason := _hopeless(context.job):
            give_up(bench, drive, generation, reason)
            return "given up"
        number = context.job.id or 0
        begun.add(number)
        try:
            outcome = process_drive(bench, drive, generation, should_stop=context.should_abort).value
        except Interrupted as stop:
            raise exceptions.JobAborted from stop
        begun.discard(number)
        return outcome

    return app


def _deaths(job: jobs.Job) -> int:
    """In how many runs of the job the worker died. Each lowers its priority by one: others go first."""
    return -(job.priority % BEHIND)


def _hopeless(job: jobs.Job) -> str | None:
    """Why the job is not run once more; None: it is."""
    if _deaths(job) >= MAX_DEATHS:
        return (
            f"The worker died {_deaths(job)} times while it processed this drive, most likely for lack of "
            "memory. Split the log into shorter drives."
        )
    if job.attempts >= MAX_ATTEMPTS:
        return (
            f"Processing was cut off {job.attempts} times: each time the worker was stopped, ran out of memory "
            "or lost the database. Split the log into shorter drives, or ask for it again once the service is "
            "steady."
        )
    return None


def run_worker(
    settings: Settings,
    *,
    concurrency: int | None = None,
    wait: bool = True,
    stop_event: threading.Event | None = None,
    grace_s: float = GRACE_S,
) -> None:
    """Process drives until SIGTERM or SIGINT (in the main thread) or until ``stop_event`` is set.

    With ``wait=False`` it returns as soon as the queue is empty. ``concurrency`` defaults to the setting. May
    run in any thread. Stopping lets running drives go on for ``grace_s``, then puts them back into the queue.
    """
    if settings.database_url is None:
        raise ValueError("the worker needs settings.database_url")
    lanes = concurrency or settings.worker_concurrency
    engine = make_engine(settings.database_url, pool_size=lanes, max_overflow=lanes)
    try:
        bench = Workbench.of(settings, session_factory(engine))
        begun: set[int] = set()
        queue = make_queue(settings.database_url, bench, begun)
        serve = functools.partial(_serve, settings, queue, lanes, wait, grace_s)
        retry = functools.partial(_retry_stalled, queue, settings.stalled_after_s, begun)
        heights = HeightFiller(bench.sessions, bench.dem_dir)
        renewed, swept = (
            functools.partial(renew, bench.sessions),
            functools.partial(_sweep, bench, timedelta(days=settings.orphan_days)),
        )
        chores = (
            (retry, min(settings.stalled_after_s / 4, 10.0)),
            (_in_thread(renewed, "what an update left could not be seen to"), RENEW_EVERY_S),
            (_in_thread(heights.piece, "heights could not be filled in"), RENEW_EVERY_S),
            (_in_thread(swept, "the blob store could not be swept"), SWEEP_EVERY_S),
        )
        asyncio.run(_work(queue, serve, chores, wait, stop_event))
    finally:
        engine.dispose()


async def _work(
    app: procrastinate.App,
    serve: Callable[[asyncio.Event], Awaitable[None]],
    chores: Sequence[tuple[Chore, float]],
    wait: bool,
    stop_event: threading.Event | None,
) -> None:
    """Serve until stopped, or once; do each chore first and then again every so many seconds."""
    stop = asyncio.Event()
    with _stop_signals(stop):
        async with contextlib.AsyncExitStack() as meanwhile:
            await meanwhile.enter_async_context(app.open_async())
            await meanwhile.enter_async_context(_background(_watch(stop_event, stop)))
            for chore, every_s in chores:
                more = await chore()
                await meanwhile.enter_async_context(_background(_again_and_again(chore, every_s, more)))
            while not stop.is_set():
                await serve(stop)
                if not wait:
                    return
                if not stop.is_set():  # it ended by itself: the connection to the database was lost
                    await asyncio.sleep(_RESTART_AFTER_S)


async def _serve(
    settings: Settings,
    app: procrastinate.App,
    lanes: int,
    wait: bool,
    grace_s: float,
    stop: asyncio.Event,
) -> None:
    """Run procrastinate's worker until it ends or ``stop`` is set."""
    worker = asyncio.create_task(
        app.run_worker_async(
            queues=[QUEUE],
            concurrency=lanes,
            wait=wait,
            install_signal_handlers=False,
            fetch_job_polling_interval=_POLL_S,
            shutdown_graceful_timeout=grace_s,
            update_heartbeat_interval=settings.heartbeat_interval_s,
            stalled_worker_timeout=settings.stalled_after_s,
            delete_jobs=jobs.DeleteJobCondition.SUCCESSFUL.value,
        )
    )
    stopping = asyncio.create_task(stop.wait())
    try:
        await asyncio.wait({worker, stopping}, return_when=asyncio.FIRST_COMPLETED)
        worker.cancel()  # a worker that is cancelled ends its drives first
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


async def _again_and_again(chore: Chore, every_s: float, more: bool | None) -> None:
    while True:
        await asyncio.sleep(_NEXT_PIECE_S if more else every_s)
        more = await chore()


def _sweep(bench: Workbench, older_than: timedelta) -> None:
    """Clear the blob store."""
    if removed := intake.sweep_blobs(bench.sessions, bench.blobs, older_than).removed:
        logger.info("removed %d blobs that no drive refers to", removed)


def _in_thread(work: Callable[[], bool | None], failed: str) -> Chore:
    """A chore in a thread of its own; when a store or the database is away, it is left for the next time."""

    def careful() -> bool | None:
        try:
            return work()
        except Exception:
            logger.warning("%s; trying again later", failed, exc_info=True)
            return None

    return functools.partial(asyncio.to_thread, careful)


async def _retry_stalled(app: procrastinate.App, stalled_after_s: float, begun: set[int]) -> None:
    """Put jobs of silent workers back. Two workers may do so at once: a drive may safely run twice.

    A job that this process itself had begun was only cut off from the database; any other's worker died.
    """
    try:
        for job in await app.job_manager.get_stalled_jobs(
            queue=QUEUE, seconds_since_heartbeat=stalled_after_s
        ):
            logger.warning("job %s of a silent worker goes back into the queue", job.id)
            died = job.id not in begun
            begun.discard(job.id or 0)
            await app.job_manager.retry_job(job, priority=job.priority - 1 if died else None)
    except exceptions.ConnectorException:
        logger.warning("stalled jobs could not be looked after; trying again later", exc_info=True)


async def _watch(stop_event: threading.Event | None, stop: asyncio.Event) -> None:
    """Carry a thread's event over to the loop."""
    while stop_event is not None and not stop.is_set():
        if stop_event.is_set():
            stop.set()
        await asyncio.sleep(0.1)


@contextlib.asynccontextmanager
async def _background(coroutine: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    task = asyncio.create_task(coroutine)
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.contextmanager
def _stop_signals(stop: asyncio.Event) -> Iterator[None]:
    """Let the first SIGTERM or SIGINT set ``stop``; a second one acts as usual."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop = asyncio.get_running_loop()
    wanted = (signal.SIGTERM, signal.SIGINT)

    def restore() -> None:
        for number in wanted:
            loop.remove_signal_handler(number)

    def on_signal() -> None:
        logger.info("stopping: drives that do not end soon go back into the queue")
        stop.set()
        restore()

    for number in wanted:
        loop.add_signal_handler(number, on_signal)
    try:
        yield
    finally:
        restore()
