"""The tables of many drives at once: the batches that were asked for, and the counts of drives that are kept.

Described as the other tables are (``app.core.tables``); their statements stand in ``app.drives.batches.store``.
"""

from __future__ import annotations

import uuid
from datetime import date, datetime
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, Identity, Index, func, text
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base

BATCH_STATES = ("enqueuing", "enqueued", "cancelled")


class Batch(Base):
    """One request to process many drives again."""

    __tablename__ = "batches"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    asked_at: Mapped[datetime] = mapped_column(server_default=func.now())
    selection: Mapped[dict[str, Any]]
    method: Mapped[str | None]
    """NULL: each drive's own, with the options that it has."""
    state: Mapped[str]
    drives: Mapped[int] = mapped_column(server_default="0")
    """How many it has put into the queue."""
    after_created_at: Mapped[datetime | None]
    after_id: Mapped[uuid.UUID | None]
    """The last drive that it took, in the order of uploads; the next piece goes on from there."""

    __table_args__ = (
        CheckConstraint("state IN ('enqueuing', 'enqueued', 'cancelled')", name="state"),
        # Who asks for the same again while it is being enqueued goes on with it.
        Index(
            "uq_batches_enqueuing",
            "selection",
            text("coalesce(method, '')"),
            unique=True,
            postgresql_where=text("state = 'enqueuing'"),
        ),
    )


class DriveCounts(Base):
    """By how much a transaction changed the number of drives of a kind; triggers on ``drives`` write it.

    The sum over all rows of a kind is what there is of it. Rows are added, never changed: workers do not meet.
    """

    __tablename__ = "drive_counts"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    day: Mapped[date]
    """Of the upload, UTC."""
    status: Mapped[str]
    failure_kind: Mapped[str | None]
    batch_id: Mapped[int | None] = mapped_column(BigInteger)
    drives: Mapped[int]
    distance_m: Mapped[float]
    size_bytes: Mapped[int] = mapped_column(BigInteger)
