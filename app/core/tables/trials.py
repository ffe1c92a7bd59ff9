"""The table of trials, described as the others are (``app.core.tables``)."""

from __future__ import annotations

import uuid
from typing import Any

from sqlalchemy import ForeignKey, Index, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base
from app.core.tables.requests import RequestColumns, request_constraints

TRIAL_STATUSES = ("queued", "running", "done", "failed")


class DriveTrial(RequestColumns, Base):
    """A drive computed by another method, for a look at it: what was asked for, how far it is, what came of it.

    Nothing refers to it, and it goes with its drive.
    """

    __tablename__ = "drive_trials"

    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"))
    method: Mapped[str]
    options: Mapped[dict[str, Any]]
    asked_sha256: Mapped[str]
    """Of the method and of what its options change: the same again is the same trial."""
    report: Mapped[dict[str, Any] | None]
    track: Mapped[bytes | None]
    measurements: Mapped[bytes | None]
    slopes: Mapped[bytes | None]
    """Of its segments, as an Arrow IPC stream (``app.drives.trials.results``)."""

    __table_args__ = (
        *request_constraints(TRIAL_STATUSES),
        UniqueConstraint("drive_id", "asked_sha256"),
        Index("ix_drive_trials_finished_at", "finished_at"),
    )
