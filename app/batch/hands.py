"""Who does the work: a Dask cluster of this machine's processes, or one whose scheduler is named.

A worker that dies is replaced, and its task done again. A task that has killed three workers is looked into: each of
its logs is tried alone, and those that kill are left out of it.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import ExitStack, contextmanager
from typing import Any, Protocol

from app.batch.folder import BatchError
from app.core.messages import say

DEATHS = 3
"""Workers that a task may kill."""
WAITING_PER_HAND, FEWEST_WAITING = 3, 8
"""Tasks that are handed out beyond those at work: none waits for the next, and the scheduler holds few."""
STARTED_WITHIN_S = 60.0
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_RESERVES = ("target", "spill", "pause")
_MISSING = say("batch.no_dask")


class Job(Protocol):
    """Work on some logs whose result is a file."""

    @property
    def logs(self) -> Sequence[Any]:
        """What it works on."""
        ...

    @property
    def is_done(self) -> bool:
        """Whether its result is there."""
        ...

    def work(self, without: frozenset[int] = frozenset()) -> None:
        """Do it, without logs of these numbers."""
        ...

    def alone(self, k: int) -> None:
        """Do what is done with one log, and keep nothing."""
        ...


class Hands:
    """A client of a cluster."""

    def __init__(self, client: Any) -> None:
        self._client = client

    @property
    def count(self) -> int:
        """How many there are just now."""
        return max(1, sum(int(threads) for threads in self._client.nthreads().values()))

    @property
    def executor(self) -> Executor:
        """The same hands as the standard library's executor."""
        return self._client.get_executor(pure=False)  # type: ignore[no-any-return]

    def done(self, jobs: Sequence[Job]) -> Iterator[Job]:
        """Each job as it ends; logs that kill are left out of it (``Job.work``)."""
        for job, died in self.results(jobs, lambda job: (job.work,)):
            if died is not None:
                self._find_killers(job)
            yield job

    def results(
        self, items: Sequence[Any], call: Callable[[Any], tuple[Any, ...]]
    ) -> Iterator[tuple[Any, Any]]:
        """Each item with what its call returns, or ``Died`` in place of it, as they end."""
        from distributed import as_completed  # noqa: PLC0415 - here alone Dask is needed

        waiting, flying = iter(items), dict[str, Any]()
        ended: Any = as_completed([], loop=self._client.loop)  # type: ignore[no-untyped-call]
        room = max(FEWEST_WAITING, WAITING_PER_HAND * self.count)
        while True:
            while len(flying) < room and (item := next(waiting, None)) is not None:
                function, *arguments = call(item)
                future = self._client.submit(function, *arguments, pure=False)
                flying[future.key] = item
                ended.add(future)
            if not flying:
                return
            future = next(ended)
            yield flying.pop(future.key), self._outcome(future)

    def _outcome(self, future: Any) -> Any:
        from distributed.scheduler import KilledWorker  # noqa: PLC0415 - as above

        if future.status == "cancelled":
            raise BatchError(say("batch.scheduler_gone"))
        error = future.exception()
        if isinstance(error, KilledWorker):
            return DEAD
        if error is not None:
            raise error
        return future.result()

    def _find_killers(self, job: Job) -> None:
        """Try each log of a job that kills alone, one at a time so that nobody else is blamed; then do the rest."""
        killers: set[int] = set()
        for k in range(len(job.logs)):
            ((_, died),) = self.results([k], lambda k: (job.alone, k))
            if died is not None:
                killers.add(k)
        if len(killers) == len(job.logs):
            job.work(frozenset(killers))
            return
        ((_, died),) = self.results([job], lambda job: (job.work, frozenset(killers)))
        if died is not None:
            job.work(frozenset(range(len(job.logs))))


class Counted(Executor):
    """An executor whose tasks are counted as they end."""

    def __init__(self, executor: Executor, bar: Callable[[int], None]) -> None:
        self._executor, self._bar = executor, bar

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """See ``Executor``."""
        future = self._executor.submit(fn, *args, **kwargs)
        future.add_done_callback(lambda _: self._bar(1))
        return future


class _Dead:
    """In place of a result: the task killed its workers."""


DEAD = _Dead()


@contextmanager
def hands(scheduler: str | None, processes: int | None, memory: str | None) -> Iterator[Hands]:
    """Those of the cluster whose scheduler is named, else of so many processes of this machine, one a core by default.

    ``memory``: what each of these may take, such as 4GB; by default equal parts of the machine's. Raises ``BatchError``
    without Dask, and where no scheduler answers.
    """
    try:
        import dask  # noqa: PLC0415 - for whoever has the extra
        from distributed import Client, LocalCluster  # noqa: PLC0415
        from distributed.utils import get_mp_context  # noqa: PLC0415
    except ImportError as error:
        raise BatchError(_MISSING) from error
    with ExitStack() as stack:
        stack.enter_context(warnings.catch_warnings())
        # Equations of a block are handed over with its task, which Dask would rather have as a file.
        warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
        threads = {f"distributed.nanny.pre-spawn-environ.{name}": "1" for name in _THREADS}
        stack.enter_context(
            dask.config.set(
                {
                    **threads,
                    "distributed.scheduler.allowed-failures": DEATHS - 1,
                    "distributed.worker.multiprocessing-method": "forkserver",
                    # Results are files: a worker has nothing to spill, and one that waits for room waits for ever.
                    **dict.fromkeys([f"distributed.worker.memory.{name}" for name in _RESERVES], False),
                    # Nobody looks at the samples that workers take of their stacks, nor at figures twice a second.
                    "distributed.worker.profile.enabled": False,
                    "distributed.admin.system-monitor.interval": "5s",
                }
            )
        )
        if scheduler is None:
            # Workers are copies of a process that has loaded what they need: one that is replaced is there at once.
            context: Any = get_mp_context  # it has no types
            context().set_forkserver_preload(["app.batch.fusing", "app.batch.solving", "distributed"])
            place = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
            scheduler = stack.enter_context(
                LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=processes or os.cpu_count() or 1,
                    threads_per_worker=1,
                    memory_limit=memory or "auto",
                    dashboard_address="127.0.0.1:0",
                    worker_dashboard_address=None,
                    scheduler_kwargs={"dashboard": False},
                    host="127.0.0.1",
                    local_directory=place,
                    silence_logs="CRITICAL",
                )
            )
        try:
            made: Any = Client  # it has none either
            client = stack.enter_context(made(scheduler, set_as_default=False, timeout=STARTED_WITHIN_S))
        except (OSError, TimeoutError) as error:
            raise BatchError(say("batch.no_scheduler", address=scheduler)) from error
        _require_same_code(client)
        yield Hands(client)


def _require_same_code(client: Any) -> None:
    """Workers elsewhere have what they are installed with: without Versant they would never answer."""

    def version() -> str | None:  # sent as it stands here, so that it needs nothing there
        try:
            from app.core.version import code_version  # noqa: PLC0415
        except ImportError:
            return None
        return code_version()

    ours = version()
    for worker, theirs in client.run(version).items():
        if theirs != ours:
            has = "no Versant" if theirs is None else f"Versant {theirs}"
            raise BatchError(say("batch.other_worker", worker=worker, theirs=has, ours=ours))
