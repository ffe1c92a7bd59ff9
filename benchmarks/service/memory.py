"""How much memory a process takes with all that it started (Linux: ``/proc``)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service.watching import children, command_of, repeated

LOOK_EVERY_S = 0.1


class Peak:
    """The most that was seen, MB."""

    def __init__(self) -> None:
        self.own_mb: dict[int, float] = {}
        """The most that each process has had at any moment (VmHWM), by its number."""
        self.at_once_mb = 0.0
        """The most that all of them had resident at one moment."""
        self.now_mb = 0.0
        """What they had resident at the last look."""

    @property
    def sum_mb(self) -> float:
        """As if each had had its most when the others had."""
        return sum(self.own_mb.values())

    def look(self, pid: int) -> None:
        """Look once."""
        now = 0.0
        for member in family(pid):
            with suppress(OSError, KeyError):  # it has just ended
                own = _status_mb(member)
                self.own_mb[member] = own["VmHWM"]
                now += own["VmRSS"]
        self.now_mb = now
        self.at_once_mb = max(self.at_once_mb, now)


@contextmanager
def watched(pid: int) -> Iterator[Peak]:
    """Look again and again until the block ends."""
    peak = Peak()
    peak.look(pid)
    with repeated(lambda: peak.look(pid), LOOK_EVERY_S):
        yield peak


def family(pid: int) -> list[int]:
    """The process and all that descend from it.

    But for one that is just being started: until it runs a program of its own it is a second name of its parent.
    """
    pids = [pid]
    for member in pids:
        parent = command_of(member)
        pids += [k for k in children(member) if command_of(k) != parent]
    return pids


def _status_mb(pid: int) -> dict[str, float]:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return {
        name: int(rest.split()[0]) / 1024
        for name, _, rest in (line.partition(":") for line in lines)
        if name in {"VmHWM", "VmRSS"}
    }
