"""Whether a worker still asks for work: the queue's own loop can wait for ever for a side task that has missed its end.

Seen once, after two restarts of the database in quick succession: the processes lived and did nothing more. Most likely
the loop was ending what it runs beside, and one of these got its connection in the moment in which it was cancelled.
"""

from __future__ import annotations

import asyncio
import functools
import time
from collections.abc import Mapping
from typing import Any

import procrastinate

SILENT_S = 90.0
"""A loop asks every second, unless a job runs; while the database is away its questions take half a minute each."""

_LOOK_EVERY_S = 1.0


class Silence:
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

    async def lasts(self) -> None:
        """Ends when it has lasted too long, from now on."""
        self._asked_s = time.monotonic()
        while time.monotonic() - self._asked_s < SILENT_S:
            await asyncio.sleep(min(_LOOK_EVERY_S, SILENT_S / 4))
            if self._current:
                self._asked_s = time.monotonic()
