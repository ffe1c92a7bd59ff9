"""What goes on beside a benchmark: work that is repeated in a thread, and processes as Linux shows them (``/proc``)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def repeated(work: Callable[[], object], every_s: float) -> Iterator[None]:
    """Do it again and again in a thread, first after ``every_s``, until the block ends."""
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(every_s):
            work()

    thread = threading.Thread(target=repeat)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def children(pid: int) -> list[int]:
    """The processes that a process has started and that are there."""
    pids: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            pids += map(int, path.read_text().split())
    return pids


def descendants(pid: int) -> list[int]:
    """Its children, theirs and so on; forked ones have the same command line as their parent."""
    pids = children(pid)
    for one in pids:
        pids += children(one)
    return pids


def command_of(pid: int) -> list[str]:
    """The arguments of a process; none where it has just ended."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    return []


def pages_kb(pid: int) -> dict[str, int]:
    """A process's memory by name, of what it shares with others its part (``Pss``); nothing where it has just ended."""
    with suppress(OSError):
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
        return {name: int(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines)}
    return {}


def pss_mb(pid: int) -> float:
    """A process's memory, MB; of what it shares with others its part. 0 where it has just ended."""
    return pages_kb(pid).get("Pss", 0) / 1024
