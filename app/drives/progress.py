"""How a run shows where it is, and how it learns that it is to end. Knows nothing of what the run does."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from app.core.db import Sessions
from app.core.telemetry.events import Stages
from app.drives import store as drives
from app.drives.documents import Drive
from app.jobs.task import Interrupted

PROGRESS_EVERY_S = 0.5

PARTS = {
    "reading": (0.0, 0.1),
    "positioning": (0.1, 0.3),
    "roads": (0.3, 0.35),
    "estimating": (0.35, 0.95),
    "saving": (0.95, 1.0),
}
"""The parts of a run and the shares of the whole at which they begin and end."""


class Discarded(Exception):  # noqa: N818  (no error: the drive is somebody else's by now)
    """The drive was deleted or asked for anew."""


def never() -> bool:
    """Nobody asks the run to stop."""
    return False


class RunProgress:
    """Shows a run's progress on its drive, at most every ``PROGRESS_EVERY_S``, in transactions of its own."""

    def __init__(self, sessions: Sessions, drive: Drive, should_stop: Callable[[], bool] = never) -> None:
        self._sessions = sessions
        self._drive = drive
        self._should_stop = should_stop
        self._written_at = -np.inf
        self._share = 0.0
        self.stage = "reading"
        self.stages = Stages(drive.method)

    def part(self, part: str) -> Callable[[str, float], None]:
        """A ``Progress`` for one part of the run; it names its own stages and counts from 0 to 1."""
        start, end = PARTS[part]

        def progress(stage: str, share: float) -> None:
            self.show(stage, start + (end - start) * min(max(share, 0.0), 1.0))

        return progress

    def begin(self, part: str) -> None:
        """A part of the run begins."""
        self.stages.begin(part)
        self.show(part, PARTS[part][0])

    def show(self, stage: str, share: float) -> None:
        """Note stage and share (it never falls); raises when the run is to end."""
        self.stage = stage
        self._share = max(self._share, min(share, 1.0))
        if self._should_stop():
            raise Interrupted
        now = time.monotonic()
        if now - self._written_at < PROGRESS_EVERY_S:
            return
        self._written_at = now
        with self._sessions.begin() as session:
            drive = self._drive
            mine = drives.set_progress(session, drive.id, drive.generation, stage, self._share)
        if not mine:
            raise Discarded
