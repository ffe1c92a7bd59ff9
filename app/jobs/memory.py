"""The memory of a worker's process: a limit to what it may allocate, and a size above which it is replaced.

Beyond the limit an allocation fails in the run that asks for it (``MemoryError``); without it the machine would swap,
or kill any process. A process seldom gives memory back, so one that has grown ends after its job, and another takes its
place. Linux alone measures and limits this; elsewhere nothing is done.
"""

from __future__ import annotations

import ctypes
import gc
import re
import sys
import traceback
from contextlib import suppress
from pathlib import Path

from app.core.messages import say

NEW_ABOVE_BYTES = 400 * 2**20
"""Above so much of its own (PSS) a process ends: half of it is its share of what all have loaded, or less."""

MORE_MEMORY = say("processing.more_memory")
"""What a run needs that failed for lack of it."""

_SELF = Path("/proc/self")


def limit_growth(growth_bytes: int) -> None:
    """Let this process ask for so much more than it has now; what asks for more gets a ``MemoryError``."""
    if sys.platform != "linux":
        return
    import resource  # noqa: PLC0415 - not everywhere

    with suppress(OSError, ValueError):  # a lower limit was set from outside
        limit = _figure_bytes("status", "VmData") + growth_bytes
        resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def own_bytes() -> int:
    """What is this process's own, with its share of what it shares (PSS); 0 where that is not told."""
    try:
        return _figure_bytes("smaps_rollup", "Pss")
    except OSError:
        return 0


def give_back() -> None:
    """Return to the system what is free, and what refers to itself alone, as far as the C library can."""
    gc.collect()
    trim()


def trim() -> None:
    """Return to the system what is free: milliseconds. Of a long drive each stage leaves hundreds of megabytes."""
    with suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def forget(error: MemoryError) -> None:
    """Let go of what the run held that failed by this error, so that the next one begins with as much as it did."""
    traceback.clear_frames(error.__traceback__)
    give_back()


def _figure_bytes(file: str, name: str) -> int:
    figure = re.search(rf"^{name}:\s+(\d+) kB", (_SELF / file).read_text(), re.MULTILINE)
    return 0 if figure is None else int(figure[1]) * 1024
