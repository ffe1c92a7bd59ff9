"""The tables of what is asked of workers: exports, operations and trials, whose rows have the same columns, and
batches; then those by which the service runs itself.

Statements of requests stand in ``app.jobs.requests.store``, those of batches in ``app.drives.batches.store``.
"""

from __future__ import annotations

import uuid
from datetime import date, datetime
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base, Followed, Numbered, OneRow, Owned, goes_with, status_constraints, where


class RequestColumns(Followed):
    """A table adds what was asked for and what came of it."""

    run: Mapped[int] = mapped_column(server_default="0")
    """Counts the runs of a worker; one that holds an older number discards its result."""
    yields: Mapped[int] = mapped_column(sa.SmallInteger, server_default="0")
    """How often it went back into the queue to let others go first."""


class Export(RequestColumns, Owned, Base):
    """A file that was asked for: what is to be in it, how far it is, and where it is kept."""

    __tablename__ = "exports"

    request: Mapped[dict[str, Any]]
    request_sha256: Mapped[str] = mapped_column(index=True)
    """Of the request and of the version of the program."""
    data_version: Mapped[str | None]
    """Of the snapshot that it is made from (``app.exports.making``); NULL until it runs."""
    provenance: Mapped[dict[str, Any] | None]
    companions: Mapped[dict[str, Any]] = mapped_column(server_default=sa.text("'{}'"))
    """The small files that belong beside it: name -> text."""
    notes: Mapped[dict[str, Any]] = mapped_column(server_default=sa.text("'{}'"))
    """What is to be told of it: ``{"notes": [sentences]}``."""
    entries: Mapped[int | None] = mapped_column(sa.BigInteger)
    """How many segments, ways, tiles or whatever it consists of."""
    file_name: Mapped[str]
    media_type: Mapped[str]
    blob_key: Mapped[str | None]
    sha256: Mapped[str | None]
    size_bytes: Mapped[int | None] = mapped_column(sa.BigInteger)
    expires_at: Mapped[datetime | None] = mapped_column(index=True)
    """When it and its file go; NULL while it is not at its end."""

    __table_args__ = (
        *status_constraints("queued", "running", "done", "failed", "cancelled"),
        sa.Index(None, "owner_id", "created_at", "id"),
        sa.Index(None, "created_at", "id"),
    )


class Operation(RequestColumns, Base):
    """Something that the operator asked for and a worker does: an import, a removal, a settling."""

    __tablename__ = "operations"

    kind: Mapped[str]
    subject: Mapped[str]
    """What it is done with, for people: the name of a file, region or raster."""
    request: Mapped[dict[str, Any]]
    state: Mapped[dict[str, Any]] = mapped_column(server_default=sa.text("'{}'"))
    """What a later run has to know of the former ones: whether anything was changed yet, how far it came."""
    approved: Mapped[bool] = mapped_column(server_default=sa.text("false"))
    """Its plan is to be carried out."""
    plan: Mapped[dict[str, Any] | None]
    result: Mapped[dict[str, Any] | None]
    blob_key: Mapped[str | None]
    """The file that came with it, as long as it is wanted."""
    planned_at: Mapped[datetime | None]

    __table_args__ = (
        *status_constraints("queued", "running", "planned", "done", "failed", "cancelled"),
        sa.Index(None, "created_at", "id"),
        sa.Index(None, "status"),
    )


class AuditEntry(Numbered, Owned, Base):
    """That somebody removed something, or asked for work in bulk, over HTTP. Rows are added, never changed."""

    __tablename__ = "audit_log"

    at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    action: Mapped[str]
    subject: Mapped[str]
    detail: Mapped[dict[str, Any]]
    origin: Mapped[str]
    """Address and program of whoever asked."""
    key_id: Mapped[uuid.UUID | None] = mapped_column(server_default=sa.text("versant_key()"))
    """The key that was shown; NULL: none, where none is asked for."""

    __table_args__ = (sa.Index(None, "at", "id"),)


class DrivenByDay(Base):
    """How much of the roads was driven at the end of a day, UTC; of today as it was last looked at."""

    __tablename__ = "driven_by_day"

    day: Mapped[date] = mapped_column(primary_key=True)
    highway: Mapped[str] = mapped_column(primary_key=True)
    segments: Mapped[int] = mapped_column(sa.BigInteger)
    length_m: Mapped[float]


TRIAL_STATUSES = ("queued", "running", "done", "failed")


class DriveTrial(RequestColumns, Base):
    """A drive computed by another method, for a look at it: what was asked for, how far it is, what came of it.

    Nothing refers to it, and it goes with its drive.
    """

    __tablename__ = "drive_trials"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"))
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
        *status_constraints(*TRIAL_STATUSES),
        sa.UniqueConstraint("drive_id", "asked_sha256"),
        sa.Index(None, "finished_at"),
    )


class Batch(Numbered, Owned, Base):
    """One request to process many drives again."""

    __tablename__ = "batches"

    asked_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    selection: Mapped[dict[str, Any]]
    method: Mapped[str | None]
    """NULL: each drive's own, with the options that it has."""
    drives_of: Mapped[int | None] = mapped_column(
        sa.ForeignKey("owners.id"), server_default=sa.text("versant_confined_to()")
    )
    """The owner whose drives alone it is about, for workers go on with it; NULL: those of all."""
    state: Mapped[str]
    drives: Mapped[int] = mapped_column(server_default="0")
    """How many it has put into the queue."""
    after_created_at: Mapped[datetime | None]
    after_id: Mapped[uuid.UUID | None]
    """The last drive that it took, in the order of uploads; the next piece goes on from there."""

    __table_args__ = (
        sa.CheckConstraint("state IN ('enqueuing', 'enqueued', 'cancelled')", name="state"),
        # Who asks for the same again while it is being enqueued goes on with it.
        sa.Index(
            "uq_batches_enqueuing",
            "owner_id",
            sa.text("coalesce(drives_of, 0)"),
            "selection",
            sa.text("coalesce(method, '')"),
            unique=True,
            **where("state = 'enqueuing'"),
        ),
    )


class DriveCounts(Numbered, Owned, Base):
    """By how much a transaction changed the number of drives of a kind; triggers on ``drives`` write it.

    The sum over all rows of a kind is what there is of it. Rows are added, never changed: workers do not meet.
    """

    __tablename__ = "drive_counts"

    day: Mapped[date]
    """Of the upload, UTC."""
    status: Mapped[str]
    failure_kind: Mapped[str | None]
    batch_id: Mapped[int | None] = mapped_column(sa.BigInteger)
    drives: Mapped[int]
    distance_m: Mapped[float]
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)


class Computation(Base):
    """A job that is computed just now or took its process along in an earlier run (``app.jobs.computations``)."""

    __tablename__ = "computations"

    job_id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """Of the queue; no foreign key, for the queue's tables are its own."""
    deaths: Mapped[int] = mapped_column(sa.SmallInteger, server_default="0")
    """Runs in which the process ended while it computed this job."""
    since: Mapped[datetime | None]
    """When the computation began; NULL: none runs."""
    process: Mapped[str | None]
    """Whose mark it is (``app.core.claims.process_name``)."""


class ClaimRow(Base):
    """What one holder at a time works on (``app.core.claims``): worth nothing once the server has crashed."""

    __tablename__ = "claims"

    name: Mapped[str] = mapped_column(primary_key=True)
    key: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    holder: Mapped[uuid.UUID]
    process: Mapped[str]
    """Where the holder is: who finds it dead (``app.jobs.computations``) ends its claims."""
    until: Mapped[datetime]

    __table_args__ = ({"prefixes": ["UNLOGGED"]},)


class SchemaSupport(OneRow, Base):
    """One row: the revision of the oldest programs that work with the schema."""

    __tablename__ = "schema_support"

    oldest_program: Mapped[str]

    __table_args__ = (sa.CheckConstraint("id = 1", name="singleton"),)


class QueueMigration(Base):
    """A file of the queue's own schema that was applied (``app.core.schema``)."""

    __tablename__ = "queue_migrations"

    name: Mapped[str] = mapped_column(primary_key=True)
    applied_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class DrivePicture(Base):
    """The picture of a drive's profile as last drawn, of the run that ``app.drives.tracks.run_shown`` names."""

    __tablename__ = "drive_pictures"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), primary_key=True)
    drawn_of: Mapped[str]
    png: Mapped[bytes]
    drawn_at: Mapped[datetime] = mapped_column(server_default=sa.func.now(), index=True)


class ProcessTotals(Base):
    """What one process has counted and timed since it began (``app.core.telemetry.ledger``), in a row of its own."""

    __tablename__ = "process_totals"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    process: Mapped[str]
    """What it is, for people."""
    totals: Mapped[dict[str, Any]]
    written_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class KeptFigures(Base):
    """Figures that take a look at the whole map, as a worker made them last (``app.map.figures``)."""

    __tablename__ = "kept_figures"

    name: Mapped[str] = mapped_column(primary_key=True)
    rows: Mapped[list[dict[str, Any]]]
    made_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    took_s: Mapped[float]
    of_state: Mapped[str]
    """Of roads, slopes and elevation; figures of the present state need not be made again."""
