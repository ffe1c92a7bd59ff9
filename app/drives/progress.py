"""How a run shows where it is, what operators are told of it, and how it learns that it is to end.

Knows nothing of what the run does.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.telemetry.events import Stages
from app.core.telemetry.logs import tell
from app.core.telemetry.measures import DRIVES_FAILED, DRIVES_PUT_BACK, QUEUED_S
from app.drives import claims
from app.drives.documents import Drive
from app.jobs.requests.run import Progress

logger = logging.getLogger(__name__)

FAULTS = frozenset({"internal", "out-of-memory", "interrupted"})
"""Kinds of failures that are not the log's: to be seen to."""
SHORTEST_NAME = 4
"""Names of files that are no words of a reason."""

PARTS = {
    "reading": (0.0, 0.1),
    "positioning": (0.1, 0.3),
    "roads": (0.3, 0.35),
    "estimating": (0.35, 0.95),
    "saving": (0.95, 1.0),
}
"""The parts of a run and the shares of the whole at which they begin and end."""


class RunProgress:
    """How far a run of a drive, or of a trial of it, is; ``show`` shows a stage and the share of the whole, 0..1."""

    def __init__(self, show: Callable[[str, float], object], stages: Stages | None = None) -> None:
        """``stages`` measures how long each part takes."""
        self._show, self._stages = show, stages
        self._share = 0.0
        self.stage = "reading"

    def part(self, part: str) -> Callable[[str, float], None]:
        """A ``Progress`` for one part of the run; it names its own stages and counts from 0 to 1."""
        start, end = PARTS[part]

        def progress(stage: str, share: float) -> None:
            self.show(stage, start + (end - start) * min(max(share, 0.0), 1.0))

        return progress

    def begin(self, part: str) -> None:
        """A part of the run begins."""
        if self._stages is not None:
            self._stages.begin(part)
        self.show(part, PARTS[part][0])

    def show(self, stage: str, share: float) -> None:
        """Show stage and share (it never falls); raises when the run is to end."""
        self.stage, self._share = stage, max(self._share, min(share, 1.0))
        self._show(stage, self._share)


def shown_on(
    sessions: Sessions, drive: Drive, should_stop: Callable[[], bool]
) -> Callable[[str, float], bool]:
    """Shows a run on its drive."""

    def write(session: Session, stage: str | None, share: float) -> bool:
        return claims.set_progress(session, drive.id, drive.generation, str(stage), share)

    return Progress(sessions, should_stop, write).show


def tell_started(drive: Drive) -> None:
    """A worker has begun with the drive."""
    waited_s = 0.0 if drive.started_at is None else (drive.started_at - drive.queued_at).total_seconds()
    QUEUED_S.observe(waited_s)
    tell(logger, "drive started", method=drive.method, bytes=drive.size_bytes, waited_s=waited_s)
    tell(logger, "drive's file", level=logging.DEBUG, filename=drive.filename)


def tell_put_back(drive: Drive, stage: str) -> None:
    """Its worker stops; another one begins anew."""
    DRIVES_PUT_BACK.count(drive.method, "stopped")
    tell(logger, "drive put back", reason="the worker stops", stage=stage)


def tell_discarded(drive: Drive) -> None:
    """What was computed is unwanted."""
    DRIVES_PUT_BACK.count(drive.method, "discarded")
    tell(logger, "drive discarded", reason="deleted or asked for anew while it was computed")


def tell_failed(drive: Drive, kind: str, reason: str, stage: str | None) -> None:
    """It ended without a result: a log that cannot be used is news, a fault of the service an error."""
    DRIVES_FAILED.count(drive.method, kind)
    for name in drive.filename.split(", "):  # it may be somebody's
        if len(name) >= SHORTEST_NAME:
            reason = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", "(file)", reason)
    level = logging.ERROR if kind in FAULTS else logging.INFO
    tell(logger, "drive failed", level=level, method=drive.method, kind=kind, stage=stage, reason=reason)
