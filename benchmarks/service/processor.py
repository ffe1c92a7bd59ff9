"""Processor time of processes and of all that descend from them, as Linux counts it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from service.memory import family

_FIRST, _COUNT = 13, 4
"""Of the fields of ``/proc/PID/stat`` without the number: user and system time, and those of children that ended."""


def used_s(pids: Iterable[int]) -> float:
    """Seconds that these processes, those below them and those that ended there have used since they began."""
    ticks = 0
    for pid in {member for ancestor in pids for member in family(ancestor)}:
        with suppress(OSError):  # it has ended, and its parent has its time
            # The name, in brackets, may hold anything; two fields before the times come before its end.
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += sum(map(int, fields[_FIRST - 2 : _FIRST - 2 + _COUNT]))
    return ticks / os.sysconf("SC_CLK_TCK")
