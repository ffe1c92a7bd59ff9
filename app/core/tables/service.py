"""Tables by which the service runs itself, as ``tables`` describes those of its subjects."""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKey, SmallInteger, func
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base


class Computation(Base):
    """A job that is computed just now or took its process along in an earlier run (``app.jobs.computations``)."""

    __tablename__ = "computations"

    job_id: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    """Of the queue; no foreign key, for the queue's tables are its own."""
    deaths: Mapped[int] = mapped_column(SmallInteger, server_default="0")
    """Runs in which the process ended while it computed this job."""
    since: Mapped[datetime | None]
    """When the computation began; NULL: none runs."""
    process: Mapped[str | None]
    """Machine and number of the process, for people."""
    backend: Mapped[int | None]
    """The server's process behind the connection that the computation holds: both end together."""
    backend_start: Mapped[datetime | None]


class SchemaSupport(Base):
    """One row: the revision of the oldest programs that work with the schema."""

    __tablename__ = "schema_support"

    id: Mapped[int] = mapped_column(SmallInteger, primary_key=True, autoincrement=False)
    oldest_program: Mapped[str]

    __table_args__ = (CheckConstraint("id = 1", name="singleton"),)


class QueueMigration(Base):
    """A file of the queue's own schema that was applied (``app.core.schema``)."""

    __tablename__ = "queue_migrations"

    name: Mapped[str] = mapped_column(primary_key=True)
    applied_at: Mapped[datetime] = mapped_column(server_default=func.now())


class DrivePicture(Base):
    """The picture of a drive's profile as last drawn, of the run that ``app.drives.tracks.run_shown`` names."""

    __tablename__ = "drive_pictures"

    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"), primary_key=True)
    drawn_of: Mapped[str]
    png: Mapped[bytes]
    drawn_at: Mapped[datetime] = mapped_column(server_default=func.now(), index=True)


class ProcessTotals(Base):
    """What one process has counted and timed since it began (``app.core.telemetry.ledger``), in a row of its own."""

    __tablename__ = "process_totals"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    process: Mapped[str]
    """What it is, for people."""
    totals: Mapped[dict[str, Any]]
    written_at: Mapped[datetime] = mapped_column(server_default=func.now())


class KeptFigures(Base):
    """Figures that take a look at the whole map, as a worker made them last (``app.map.figures``)."""

    __tablename__ = "kept_figures"

    name: Mapped[str] = mapped_column(primary_key=True)
    rows: Mapped[list[dict[str, Any]]]
    made_at: Mapped[datetime] = mapped_column(server_default=func.now())
    took_s: Mapped[float]
    of_state: Mapped[str]
    """Of roads, slopes and elevation; figures of the present state need not be made again."""
