"""Seconds and memory of one reading, in a process of its own."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from fusion.formats import read_log
from reading.logs import LIBRARIES, MAKERS


def write(name: str, records: int, path: Path) -> dict[str, float]:
    """Make a log of so many records, in another process than that which reads it: making takes memory too."""
    path.write_bytes(MAKERS[name](records))
    return {}


def read(name: str, path: Path) -> dict[str, float]:
    """Read a log."""
    read_log(MAKERS[name](100))  # what is loaded or compiled at the first log counts for no other
    return _timed(path.read_bytes(), read_log)


def parse(name: str, path: Path) -> dict[str, float]:
    """Let the library take the same bytes."""
    LIBRARIES[name][1](MAKERS[name](100))
    return _timed(path.read_bytes(), LIBRARIES[name][1])


def apart(work: Callable[..., dict[str, float]], *arguments: object) -> dict[str, float]:
    """What some work takes in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def _timed(data: bytes, work: Callable[[bytes], object]) -> dict[str, float]:
    idle_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    work(data)
    seconds = time.process_time() - began
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"seconds": seconds, "megabytes": len(data) / 1e6, "memory_mb": (peak_kb - idle_kb) / 1e3}
