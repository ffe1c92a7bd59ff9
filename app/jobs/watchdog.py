"""Notices a worker that asks for no work any more, so that it begins anew (upstream's faults: ``app.jobs``)."""

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


class Watchdog:
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

    async def wait(self) -> None:
        """Returns when the loop has been silent for too long, from now on."""
        self._asked_s = time.monotonic()
        while time.monotonic() - self._asked_s < SILENT_S:
            await asyncio.sleep(min(_LOOK_EVERY_S, SILENT_S / 4))
            if self._current:
                self._asked_s = time.monotonic()
