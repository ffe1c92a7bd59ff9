"""The tables of the operator: long work that was asked for, what was destroyed by whom, and how coverage grew.

Described as the others are (``app.core.tables``).
"""

from __future__ import annotations

from datetime import date, datetime
from typing import Any

from sqlalchemy import BigInteger, Identity, Index, func, text
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base
from app.core.tables.requests import RequestColumns, request_constraints

OPERATION_STATUSES = ("queued", "running", "planned", "done", "failed", "cancelled")


class Operation(RequestColumns, Base):
    """Something that the operator asked for and a worker does: an import, a removal, a settling."""

    __tablename__ = "operations"

    kind: Mapped[str]
    subject: Mapped[str]
    """What it is done with, for people: the name of a file, region or raster."""
    request: Mapped[dict[str, Any]]
    state: Mapped[dict[str, Any]] = mapped_column(server_default=text("'{}'"))
    """What a later run has to know of the former ones: whether anything was changed yet, how far it came."""
    approved: Mapped[bool] = mapped_column(server_default=text("false"))
    """Its plan is to be carried out."""
    plan: Mapped[dict[str, Any] | None]
    result: Mapped[dict[str, Any] | None]
    blob_key: Mapped[str | None]
    """The file that came with it, as long as it is wanted."""
    planned_at: Mapped[datetime | None]

    __table_args__ = (
        *request_constraints(OPERATION_STATUSES),
        Index("ix_operations_created_at_id", "created_at", "id"),
        Index("ix_operations_status", "status"),
    )


class AuditEntry(Base):
    """That somebody removed something, or asked for work in bulk, over HTTP. Rows are added, never changed."""

    __tablename__ = "audit_log"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    at: Mapped[datetime] = mapped_column(server_default=func.now())
    action: Mapped[str]
    subject: Mapped[str]
    detail: Mapped[dict[str, Any]]
    origin: Mapped[str]
    """Who it was, as far as the service can tell: address and program."""

    __table_args__ = (Index("ix_audit_log_at_id", "at", "id"),)


class DrivenByDay(Base):
    """How much of the roads was driven at the end of a day, UTC; of today as it was last looked at."""

    __tablename__ = "driven_by_day"

    day: Mapped[date] = mapped_column(primary_key=True)
    highway: Mapped[str] = mapped_column(primary_key=True)
    segments: Mapped[int] = mapped_column(BigInteger)
    length_m: Mapped[float]
