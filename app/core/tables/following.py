"""The tables by which others follow the map: whose numbers of transactions count, and who is told of changes."""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKey, Index, SmallInteger, func, text
from sqlalchemy.dialects.postgresql import ARRAY, TEXT
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base


class ChangeEpoch(Base):
    """One row: since when the numbers of transactions are those of one history (``app.changes.store``)."""

    __tablename__ = "change_epoch"

    id: Mapped[int] = mapped_column(SmallInteger, primary_key=True, autoincrement=False)
    epoch: Mapped[str]
    """Random; part of every version."""
    place: Mapped[str]
    """Server, database and timeline in which it began."""
    xid: Mapped[int] = mapped_column(BigInteger)
    """The transaction that wrote this row: a copy of the row, by a dump, was written by another."""
    pruned_xid: Mapped[int] = mapped_column(BigInteger, server_default="0")
    """What was gone before it is not told any more."""
    begun_at: Mapped[datetime] = mapped_column(server_default=func.now())

    __table_args__ = (CheckConstraint("id = 1", name="singleton"),)


class Webhook(Base):
    """An address that is told of events (``app.changes.webhooks``)."""

    __tablename__ = "webhooks"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    url: Mapped[str]
    secret: Mapped[str]
    """What messages are signed by; whoever reads the database could sign as well."""
    events: Mapped[list[str]] = mapped_column(ARRAY(TEXT))
    bbox: Mapped[list[float] | None]
    """West, south, east, north, degrees: only what happens there is told; NULL: everywhere."""
    active: Mapped[bool] = mapped_column(server_default=text("true"))
    off_reason: Mapped[str | None]
    """Why the service switched it off; NULL where it did not."""
    reported_version: Mapped[str | None]
    """The version of the map up to which changes of segments were told and taken; NULL: it does not ask for them."""
    failures: Mapped[int] = mapped_column(server_default="0")
    """In a row."""
    failing_since: Mapped[datetime | None]
    last_success_at: Mapped[datetime | None]
    next_at: Mapped[datetime] = mapped_column(server_default=func.now())
    """Nothing is sent before."""
    claimed_until: Mapped[datetime | None]
    """Somebody is sending; one at a time, and whoever dies at it holds it no longer."""
    created_at: Mapped[datetime] = mapped_column(server_default=func.now())


class WebhookDelivery(Base):
    """A message to one address: it commits together with what it tells of."""

    __tablename__ = "webhook_deliveries"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    webhook_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("webhooks.id", ondelete="CASCADE"))
    event: Mapped[str]
    data: Mapped[dict[str, Any]]
    created_at: Mapped[datetime] = mapped_column(server_default=func.now())
    state: Mapped[str] = mapped_column(server_default="waiting")
    attempts: Mapped[int] = mapped_column(server_default="0")
    due_at: Mapped[datetime] = mapped_column(server_default=func.now())
    ended_at: Mapped[datetime | None]
    status: Mapped[int | None]
    """HTTP's, of the last attempt; NULL where there was no answer."""
    problem: Mapped[str | None]
    """What was wrong at the last attempt."""

    __table_args__ = (
        CheckConstraint("state IN ('waiting', 'taken', 'given up')", name="state"),
        Index(
            "ix_webhook_deliveries_waiting",
            "webhook_id",
            "due_at",
            postgresql_where=text("state = 'waiting'"),
        ),
        Index("ix_webhook_deliveries_created_at", "webhook_id", "created_at"),
        Index("ix_webhook_deliveries_ended_at", "ended_at", postgresql_where=text("ended_at IS NOT NULL")),
    )
