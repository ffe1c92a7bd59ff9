"""``versant batch`` as a process: undisturbed, with workers that are killed, cut off, and without its scheduler."""

from __future__ import annotations

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

GIVE_UP_S = 180.0


def start(arguments: Sequence[str | Path]) -> subprocess.Popen[bytes]:
    """The command, as leader of its own processes."""
    command = [sys.executable, "-m", "app.cli", "--quiet", *map(str, arguments)]
    return subprocess.Popen(command, start_new_session=True, stderr=subprocess.DEVNULL)


def timed(arguments: Sequence[str | Path]) -> tuple[float, float]:
    """Seconds by the clock, and of processors."""
    before, began = _used_s(), time.perf_counter()
    start(arguments).wait()
    return time.perf_counter() - began, _used_s() - before


def with_kills(arguments: Sequence[str | Path], every_s: float) -> int:
    """Kill a worker at random as often until the command ends; how many were killed."""
    rng, killed, process = random.Random(1), 0, start(arguments)  # noqa: S311 - no secret
    while process.poll() is None:
        with suppress(subprocess.TimeoutExpired):
            process.wait(every_s)
            break
        if workers := _workers(process.pid):
            killed += 1
            with suppress(psutil.NoSuchProcess):
                rng.choice(workers).kill()
    return killed


def cut_off(arguments: Sequence[str | Path], after_s: Sequence[float]) -> int:
    """Kill the command and all its processes so many seconds after each start, then let it end; how often it began."""
    for count, seconds in enumerate(after_s, 1):
        process = start(arguments)
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            every = psutil.Process(process.pid).children(recursive=True)
            process.kill()  # its workers have to notice by themselves
            process.wait()
            _, left = psutil.wait_procs(every, GIVE_UP_S)
            for one in left:
                print(f"still there: {one}")
                one.kill()
        else:
            return count
    start(arguments).wait()
    return len(after_s) + 1


def without_scheduler(arguments: Sequence[str | Path], port: int, after_s: float) -> tuple[int, int]:
    """Kill the scheduler so long after the start, and start all again: how the first command ended, and the second."""
    ends = []
    for kill in (True, False):
        with _cluster(port) as scheduler:
            process = start([*arguments, "--scheduler", f"tcp://127.0.0.1:{port}"])
            if kill:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(after_s)
                scheduler.kill()
            ends.append(process.wait(None if not kill else GIVE_UP_S))
    return ends[0], ends[1]


@contextmanager
def _cluster(port: int) -> Iterator[subprocess.Popen[bytes]]:
    """A scheduler and two workers, as on other machines."""
    environment = os.environ | dict.fromkeys(("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    worker = [
        *dask,
        "worker",
        f"tcp://127.0.0.1:{port}",
        "--nthreads",
        "1",
        "--nworkers",
        "2",
        "--no-dashboard",
    ]
    processes = [
        subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, start_new_session=True)
        for command in (scheduler, worker)
    ]
    try:
        yield processes[0]
    finally:
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)


def bytes_of(folder: Path) -> dict[str, str]:
    """Digests of all results of a batch."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _workers(command: int) -> list[psutil.Process]:
    """What works for it: children of the process that copies itself."""
    with suppress(psutil.NoSuchProcess):
        return [
            worker
            for child in psutil.Process(command).children()
            for worker in child.children()
            if worker.cpu_times().user > 0.5
        ]
    return []


def _used_s() -> float:
    used = os.times()
    return used.children_user + used.children_system
