"""The table of exports, described as the others are (``app.core.tables``)."""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, Index, SmallInteger, func, text
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base

EXPORT_STATUSES = ("queued", "running", "done", "failed", "cancelled")


class Export(Base):
    """A file that was asked for: what is to be in it, how far it is, and where it is kept."""

    __tablename__ = "exports"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    request: Mapped[dict[str, Any]]
    request_sha256: Mapped[str]
    """Of the request and of the version of the program."""
    status: Mapped[str]
    progress: Mapped[float] = mapped_column(server_default="0")
    run: Mapped[int] = mapped_column(server_default="0")
    """Counts the runs of a worker; one that holds an older number discards what it made."""
    yields: Mapped[int] = mapped_column(SmallInteger, server_default="0")
    """How often it went back into the queue to let a drive go first."""
    data_version: Mapped[str | None]
    """Of the snapshot that it is made from (``app.exports.provenance``); NULL until it runs."""
    provenance: Mapped[dict[str, Any] | None]
    companions: Mapped[dict[str, Any]] = mapped_column(server_default=text("'{}'"))
    """The small files that belong beside it: name -> text."""
    notes: Mapped[dict[str, Any]] = mapped_column(server_default=text("'{}'"))
    """What is to be told of it: ``{"notes": [sentences]}``."""
    entries: Mapped[int | None] = mapped_column(BigInteger)
    """How many segments, ways, tiles or whatever it consists of."""
    file_name: Mapped[str]
    media_type: Mapped[str]
    blob_key: Mapped[str | None]
    sha256: Mapped[str | None]
    size_bytes: Mapped[int | None] = mapped_column(BigInteger)
    failure_kind: Mapped[str | None]
    failure_reason: Mapped[str | None]
    created_at: Mapped[datetime] = mapped_column(server_default=func.now())
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    expires_at: Mapped[datetime | None]
    """When it and its file go; NULL while it is not at its end."""

    __table_args__ = (
        CheckConstraint("status IN ('queued', 'running', 'done', 'failed', 'cancelled')", name="status"),
        CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
        Index("ix_exports_request_sha256", "request_sha256"),
        Index("ix_exports_created_at_id", "created_at", "id"),
        Index("ix_exports_expires_at", "expires_at"),
    )
