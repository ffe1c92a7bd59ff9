"""Processor time of processes and of all that descend from them, as Linux counts it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from service.watching import children

_BETWEEN, _COUNT = 11, 4
"""Of the fields of ``/proc/PID/stat`` behind the name: those before the times, and user and system time, of the process
and of its children that ended."""


def used_s(pids: Iterable[int]) -> float:
    """Seconds that these processes, those below them and those that ended there have used since they began."""
    ticks, left = 0, list(pids)
    while left:
        pid = left.pop()
        with suppress(OSError):  # it has ended, and its parent has its time
            # The name, in brackets, may hold anything.
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += sum(map(int, fields[_BETWEEN : _BETWEEN + _COUNT]))
            left += children(pid)
    return ticks / os.sysconf("SC_CLK_TCK")
