"""The table of exports, described as the others are (``app.core.tables``)."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, Index, text
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base
from app.core.tables.requests import RequestColumns, request_constraints

EXPORT_STATUSES = ("queued", "running", "done", "failed", "cancelled")


class Export(RequestColumns, Base):
    """A file that was asked for: what is to be in it, how far it is, and where it is kept."""

    __tablename__ = "exports"

    request: Mapped[dict[str, Any]]
    request_sha256: Mapped[str]
    """Of the request and of the version of the program."""
    data_version: Mapped[str | None]
    """Of the snapshot that it is made from (``app.exports.making``); NULL until it runs."""
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
    expires_at: Mapped[datetime | None]
    """When it and its file go; NULL while it is not at its end."""

    __table_args__ = (
        *request_constraints(EXPORT_STATUSES),
        Index("ix_exports_request_sha256", "request_sha256"),
        Index("ix_exports_created_at_id", "created_at", "id"),
        Index("ix_exports_expires_at", "expires_at"),
    )
