"""The table of trials, described as the others are (``app.core.tables``)."""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, ForeignKey, Index, UniqueConstraint, func
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base

TRIAL_STATUSES = ("queued", "running", "done", "failed")


class DriveTrial(Base):
    """A drive computed by another method, for a look at it: what was asked for, how far it is, what came of it.

    Nothing refers to it, and it goes with its drive.
    """

    __tablename__ = "drive_trials"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"))
    method: Mapped[str]
    options: Mapped[dict[str, Any]]
    asked_sha256: Mapped[str]
    """Of the method and of what its options change: the same again is the same trial."""
    status: Mapped[str]
    stage: Mapped[str | None]
    progress: Mapped[float] = mapped_column(server_default="0")
    run: Mapped[int] = mapped_column(server_default="0")
    """Counts the runs of a worker; one that holds an older number discards what it computed."""
    failure_kind: Mapped[str | None]
    failure_reason: Mapped[str | None]
    failure_where: Mapped[str | None]
    report: Mapped[dict[str, Any] | None]
    track: Mapped[bytes | None]
    measurements: Mapped[bytes | None]
    slopes: Mapped[bytes | None]
    """Of its segments, as an Arrow IPC stream (``app.drives.trials.results``)."""
    created_at: Mapped[datetime] = mapped_column(server_default=func.now())
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]

    __table_args__ = (
        CheckConstraint("status IN ('queued', 'running', 'done', 'failed')", name="status"),
        CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
        UniqueConstraint("drive_id", "asked_sha256"),
        Index("ix_drive_trials_finished_at", "finished_at"),
    )
