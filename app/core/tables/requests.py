"""The columns of what is asked of a worker and followed until its end: exports, operations, trials.

Their statements stand in ``app.jobs.requests.store``.
"""

from __future__ import annotations

import uuid
from datetime import datetime

from sqlalchemy import CheckConstraint, SmallInteger, func
from sqlalchemy.orm import Mapped, mapped_column


class RequestColumns:
    """Who asked when, and how far it is. A table adds what was asked for and what came of it."""

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    status: Mapped[str]
    stage: Mapped[str | None]
    """What is being done just now, or was when it failed."""
    progress: Mapped[float] = mapped_column(server_default="0")
    run: Mapped[int] = mapped_column(server_default="0")
    """Counts the runs of a worker; one that holds an older number discards its result."""
    yields: Mapped[int] = mapped_column(SmallInteger, server_default="0")
    """How often it went back into the queue to let others go first."""
    failure_kind: Mapped[str | None]
    failure_reason: Mapped[str | None]
    failure_where: Mapped[str | None]
    created_at: Mapped[datetime] = mapped_column(server_default=func.now())
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]


def request_constraints(statuses: tuple[str, ...]) -> tuple[CheckConstraint, CheckConstraint]:
    """What holds of every such table."""
    names = ", ".join(f"'{status}'" for status in statuses)
    return (
        CheckConstraint(f"status IN ({names})", name="status"),
        CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
    )
