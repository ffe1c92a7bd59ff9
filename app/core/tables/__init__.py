"""The tables, as SQLAlchemy 2 declarative classes with GeoAlchemy2 geometry columns.

The classes describe the schema (``migrations/`` creates it, ``alembic check`` compares the two); queries and
the rows that they return stand in each subject's ``store.py``. Unknown is NULL, never 0; times are UTC
(``timestamptz``); slopes and sigmas are in percent, positive uphill from ``from_node`` to ``to_node``.
"""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

import sqlalchemy as sa
from geoalchemy2 import Geometry, WKBElement
from sqlalchemy.dialects.postgresql import ARRAY, JSONB
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

DRIVE_STATUSES = ("queued", "running", "done", "failed", "cancelled")

IS_SHOWN = "{}.status <> 'cancelled'"
"""SQL on a row of ``drives`` under that name: whether the drive is shown. Once a request for its removal is answered,
nobody is shown the drive or anything of it. Its row stays until the map is solved without it. Every statement that
reads drives for somebody has this condition."""

HAS_LOG = "log_deleted_at IS NULL"
"""Drives that can be computed again: their owner still keeps the log."""

WITHOUT_HEIGHTS = "dem_slope_percent IS NOT NULL AND dem_heights_m IS NULL"
"""Segments that were imported before heights of the elevation model were kept, and wait: they are found at once."""

MIDDLE_CELL = """versant_cell(
    (ST_X(ST_StartPoint(geom_3857)) + ST_X(ST_EndPoint(geom_3857))) / 2,
    (ST_Y(ST_StartPoint(geom_3857)) + ST_Y(ST_EndPoint(geom_3857))) / 2)
"""
"""The cell of a segment; ``versant_cell`` is a function of the database, made by a migration."""

SRID_DEGREES = 4326
SRID_TILES = 3857

_NAMES = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}


class Base(DeclarativeBase):
    """Common base: naming convention of constraints and indexes, and Python type -> SQL type."""

    metadata = sa.MetaData(naming_convention=_NAMES)
    type_annotation_map = {  # noqa: RUF012  (SQLAlchemy reads it as a plain class attribute)
        datetime: sa.DateTime(timezone=True),
        dict[str, Any]: JSONB,
        list[dict[str, Any]]: JSONB,
        list[float]: ARRAY(sa.Double),
        list[int]: ARRAY(sa.BigInteger),
        float: sa.Double,
    }


def shape(kind: str, srid: int) -> Geometry:
    """A geometry; its index, if it has one, is declared beside the table, so that its name is ours."""
    return Geometry(kind, srid=srid, spatial_index=False)


def goes_with(table: str) -> sa.ForeignKey:
    """The key of a row of that table, with which the row that names it goes."""
    return sa.ForeignKey(f"{table}.id", ondelete="CASCADE")


def where(condition: str) -> dict[str, Any]:
    """The options of an index on those rows alone."""
    return {"postgresql_where": sa.text(condition)}


class Numbered:
    """Rows are numbered as they come."""

    id: Mapped[int] = mapped_column(sa.BigInteger, sa.Identity(), primary_key=True)


class OneRow:
    """There is one row, of the number 1."""

    id: Mapped[int] = mapped_column(sa.SmallInteger, primary_key=True, autoincrement=False)


class Owned:
    """Belongs to an owner: of what an insert doesn't say it, to the caller's, or to the operator."""

    owner_id: Mapped[int] = mapped_column(
        sa.ForeignKey("owners.id"), server_default=sa.text("versant_owner()")
    )


class Followed:
    """Who asked when, and how far it is."""

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    status: Mapped[str]
    stage: Mapped[str | None]
    """What is being done just now, or was when it failed."""
    progress: Mapped[float] = mapped_column(server_default="0")
    failure_kind: Mapped[str | None]
    failure_reason: Mapped[str | None]
    failure_where: Mapped[str | None]
    failure_said: Mapped[dict[str, Any] | None] = mapped_column(JSONB(none_as_null=True))
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]


def status_constraints(*statuses: str) -> tuple[sa.CheckConstraint, sa.CheckConstraint]:
    """What holds of every table of what is followed."""
    names = ", ".join(f"'{status}'" for status in statuses)
    return (
        sa.CheckConstraint(f"status IN ({names})", name="status"),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
    )


class Import:
    """Roads as one file had them: which, when, and how many segments there are since."""

    source_name: Mapped[str]
    sha256: Mapped[str]
    imported_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    segments: Mapped[int]


class OfWay:
    """A part of an OpenStreetMap way, drawn from ``from_node`` to ``to_node``."""

    osm_way_id: Mapped[int] = mapped_column(sa.BigInteger)
    from_node: Mapped[int] = mapped_column(sa.BigInteger)
    to_node: Mapped[int] = mapped_column(sa.BigInteger)
    geom: Mapped[WKBElement] = mapped_column(shape("LINESTRING", SRID_DEGREES))
    length_m: Mapped[float]


class Road(OfWay):
    """One that may be driven on, with the slope that the elevation model gives it."""

    geom_3857: Mapped[WKBElement] = mapped_column(shape("LINESTRING", SRID_TILES))
    highway: Mapped[str]
    name: Mapped[str | None]
    oneway: Mapped[int] = mapped_column(sa.SmallInteger)
    bridge: Mapped[bool]
    """Whether any part of it is one; ``tunnel`` likewise."""
    tunnel: Mapped[bool]
    dem_slope_percent: Mapped[float | None]


class Estimate:
    """What one drive says about one segment, all its passes together."""

    slope_percent: Mapped[float]
    slope_sigma_percent: Mapped[float]
    observations: Mapped[int]
    passes: Mapped[int]
    first_at: Mapped[datetime]
    last_at: Mapped[datetime]


class Segment(Numbered, Road, Base):
    """A pair of consecutive nodes of a drivable way."""

    __tablename__ = "segments"

    layer: Mapped[int] = mapped_column(sa.SmallInteger)
    dem_heights_m: Mapped[list[float] | None]
    """Of the elevation model at the segment's knots (``fusion.network.unknowns.knot_positions``), NaN unknown."""
    road_version_id: Mapped[int] = mapped_column(sa.ForeignKey("road_versions.id"))
    """The import that brought the row's present geometry."""
    regions: Mapped[list[int]] = mapped_column(ARRAY(sa.SmallInteger), server_default=sa.text("'{}'"))
    """The regions whose files have it; a segment of none is nobody's, and stays."""
    cell: Mapped[int | None] = mapped_column(sa.Computed(MIDDLE_CELL, persisted=True), index=True)
    """The cell of the segment's middle (``app.network.cells``)."""

    __table_args__ = (
        sa.UniqueConstraint("osm_way_id", "from_node", "to_node"),
        sa.CheckConstraint("oneway IN (-1, 0, 1)", name="oneway"),
        sa.Index(None, "geom", postgresql_using="gist"),
        sa.Index(None, "geom_3857", postgresql_using="gist"),
        # What items and imports ask for by. Equal values share an entry, so these are small.
        sa.Index(None, "regions", postgresql_using="gin"),
        sa.Index(None, "highway"),
        sa.Index(None, "name", **where("name IS NOT NULL")),
        sa.Index("ix_segments_without_heights", "id", **where(WITHOUT_HEIGHTS)),
    )


_NAME = "left(lower(filename), 100)"  # of collation "C", of which reflected indexes say nothing


class Drive(Followed, Owned, Base):
    """An uploaded log and what became of it."""

    __tablename__ = "drives"

    sent_by: Mapped[uuid.UUID | None] = mapped_column(server_default=sa.text("versant_key()"))
    """The key that it was sent with: one that may only upload sees this drive and no other."""
    sha256: Mapped[str]
    content_sha256: Mapped[str | None]
    """Of what the bytes unpack to (``app.core.content``); NULL of drives from before it was computed."""
    filename: Mapped[str]
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)
    blob_key: Mapped[str]
    failure_version: Mapped[str | None]
    """The version of the code that it last failed by; NULL where that was not noted."""
    method: Mapped[str]
    options: Mapped[dict[str, Any]]
    generation: Mapped[int] = mapped_column(server_default="1")
    """Counts the requests to process this drive; a worker that holds an older number discards its result."""
    report: Mapped[dict[str, Any] | None]
    bounds: Mapped[WKBElement | None] = mapped_column(shape("POLYGON", SRID_DEGREES))
    epochs: Mapped[int | None]
    records: Mapped[int | None] = mapped_column(sa.BigInteger)
    """Those of its log, as they were counted for the owner (``app.access.quotas``); NULL: not yet."""
    distance_m: Mapped[float | None]
    drive_time: Mapped[datetime | None]
    duplicate_of: Mapped[uuid.UUID | None] = mapped_column(sa.ForeignKey("drives.id", ondelete="SET NULL"))
    """The drive that this one duplicates, which counts in its place (``app.network.results``)."""
    batch_id: Mapped[int | None] = mapped_column(sa.ForeignKey("batches.id", ondelete="SET NULL"))
    """The batch with which it was last asked for; NULL where it was asked for by itself."""
    import_id: Mapped[int | None] = mapped_column(sa.ForeignKey("batches.id", ondelete="SET NULL"))
    """The import of a batch's folder that it came with (``versant import-batch``); NULL: it was uploaded."""
    before_batch: Mapped[dict[str, Any] | None]
    """What it was before its batch, for as long as a cancelled batch would bring that back."""
    queued_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    computed_at: Mapped[datetime | None]
    """When its last run ended; from then on it waited for its cells to be solved."""
    traceparent: Mapped[str | None]
    """The trace of the request that asked for it (W3C Trace Context); NULL where none is recorded."""
    log_deleted_at: Mapped[datetime | None]
    """When its log was deleted, because its owner keeps logs no longer; NULL: it is there."""

    __table_args__ = (
        *status_constraints(*DRIVE_STATUSES),
        # The same log is one drive of an owner. That another owner has it is not to be told by an upload.
        *(sa.UniqueConstraint("owner_id", one) for one in ("sha256", "content_sha256")),
        sa.Index(None, "owner_id", "created_at", "id"),
        # Whose logs are to be deleted by now.
        sa.Index(None, "owner_id", "finished_at", **where(HAS_LOG)),
        sa.Index(None, "created_at", "id"),
        sa.Index(None, "status", "created_at", "id"),
        sa.Index(None, "queued_at", **where("status = 'queued'")),
        # How many ended in an hour or a day is answered out of the index.
        sa.Index(
            None,
            "finished_at",
            postgresql_include=["status", "distance_m"],
            **where("finished_at IS NOT NULL"),
        ),
        *(sa.Index(None, k, **where(f"{k} IS NOT NULL")) for k in ("batch_id", "duplicate_of", "import_id")),
        # Orders of the list (``app.drives.listing``) and what it is searched and filtered by.
        sa.Index(None, "drive_time", "created_at", "id"),
        sa.Index(None, "distance_m", "created_at", "id"),
        sa.Index("ix_drives_name_created_at_id", sa.text(_NAME), "created_at", "id"),
        sa.Index("ix_drives_words", sa.text("file_words(filename)"), postgresql_using="gin"),
        sa.Index(None, "failure_kind", "created_at", "id", **where("status = 'failed'")),
    )


class Provenance(Numbered, Base):
    """How a drive's present estimates were made; ``options`` are complete, defaults included."""

    __tablename__ = "provenances"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), index=True)
    method: Mapped[str]
    options: Mapped[dict[str, Any]]
    code_version: Mapped[str]
    road_version_id: Mapped[int] = mapped_column(sa.ForeignKey("road_versions.id"))
    road_state: Mapped[int | None] = mapped_column(sa.BigInteger)
    """Of the cells that the run took its roads from, the highest (``Cell.road_state``); NULL of older runs."""
    dem_version_id: Mapped[int | None] = mapped_column(sa.ForeignKey("dem_versions.id"))
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class DriveSegment(Estimate, Base):
    """An estimate, and the run that made it."""

    __tablename__ = "drive_segments"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), primary_key=True)
    segment_id: Mapped[int] = mapped_column(goes_with("segments"), primary_key=True, index=True)
    provenance_id: Mapped[int] = mapped_column(goes_with("provenances"), index=True)
    in_network: Mapped[bool] = mapped_column(server_default=sa.text("false"))
    """The drive contributes factors: this is shown as its own estimate and not combined a second time."""

    __table_args__ = (
        sa.CheckConstraint("slope_sigma_percent > 0", name="sigma"),
        sa.Index("ix_drive_segments_slope_only", "segment_id", **where("NOT in_network")),
    )


class _Slope:
    """A segment's slope, and what the network knows of it besides; that is NULL where it is not in the network."""

    segment_id: Mapped[int] = mapped_column(goes_with("segments"), primary_key=True, autoincrement=False)
    slope_percent: Mapped[float]
    slope_sigma_percent: Mapped[float]
    drives: Mapped[int]
    observations: Mapped[int]
    driven_share: Mapped[float | None]
    """Share of the length over which passes are accepted."""
    height_from_m: Mapped[float | None]
    height_to_m: Mapped[float | None]
    height_sigma_m: Mapped[float | None]
    steepest_percent: Mapped[float | None]
    """Of the steepest stretch inside, signed as slopes are; from and to: metres from ``from_node``."""
    steepest_from_m: Mapped[float | None]
    steepest_to_m: Mapped[float | None]


class NetworkSlope(_Slope, Base):
    """What all factors together say of a segment; a gap between driven ones has 0 drives and observations."""

    __tablename__ = "network_slopes"


class DriveTrack(Base):
    """A drive's estimated track and what its sensors said along it: Arrow IPC streams (``app.drives.tracks``)."""

    __tablename__ = "drive_tracks"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), primary_key=True)
    track: Mapped[bytes]
    measurements: Mapped[bytes | None]
    """Drawn behind the profile; NULL where the method offers none."""


class SegmentSlope(_Slope, Base):
    """What is published of one segment: the network's slope combined with the estimates of slope-only drives.

    A gap between driven segments has 0 drives and observations; a segment of which nothing is known has no row.
    """

    __tablename__ = "segment_slopes"

    updated_at: Mapped[datetime] = mapped_column(server_default=sa.func.now(), index=True)

    __table_args__ = (  # what items are asked for and sorted by
        *(sa.Index(None, one) for one in ("slope_percent", "steepest_percent")),
        sa.Index("ix_segment_slopes_steepness_percent", sa.text("abs(slope_percent)")),
    )
