"""The tables of the network: what drives and surveyors contribute, and the cells in which it is solved; and those of
imports: versions of roads and elevation, regions, the retired evidence of deleted roads."""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

import sqlalchemy as sa
from geoalchemy2 import WKBElement
from sqlalchemy.dialects.postgresql import ARRAY
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import (
    SRID_DEGREES,
    SRID_TILES,
    Base,
    Estimate,
    Import,
    Numbered,
    OfWay,
    goes_with,
    shape,
    where,
)

PARTITION_PREFIX = "drive_passes_of_"
"""How the names of the parts of ``drive_passes`` begin; a row's part follows from a hash of its partition."""


class DrivePass(Base):
    """What one pass of a drive over a segment contributes to the network: a factor, in the library's encoding."""

    __tablename__ = "drive_passes"

    id: Mapped[int] = mapped_column(
        sa.BigInteger, primary_key=True, server_default=sa.text("nextval('drive_passes_id_seq')")
    )
    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), index=True)
    segment_id: Mapped[int] = mapped_column(goes_with("segments"))
    entered_s: Mapped[float]
    """When the drive came to the segment, Unix seconds."""
    condensed_weight: Mapped[float | None]
    """NULL: the pass is recent and read as it is. Else the weight with which it is condensed; 0: it was rejected."""
    sequence: Mapped[int]
    """Its place among the drive's passes, in the order of driving."""
    partition: Mapped[int] = mapped_column(sa.SmallInteger, primary_key=True, autoincrement=False)
    """The tile of zoom 6 around the segment's cell: ``versant_partition(cell)``."""
    factor: Mapped[bytes]

    __table_args__ = (
        # Which drives were here at a moment is answered from the index alone, however many drives there are.
        sa.Index(None, "segment_id", "entered_s", postgresql_include=["drive_id", "partition"]),
        # The recent passes over a segment, however many passes there are.
        sa.Index("ix_drive_passes_recent", "segment_id", **where("condensed_weight IS NULL")),
        {"postgresql_partition_by": "HASH (partition)"},
    )


class CondensedPasses(Numbered, Base):
    """Old passes over a segment as one sum (``fusion.network.condensed``): the sum over the segment's rows.

    Rows are only added, so that nobody waits for anybody; a row that subtracts a drive has its signs reversed.
    """

    __tablename__ = "condensed_passes"

    segment_id: Mapped[int] = mapped_column(goes_with("segments"), index=True)
    evidence: Mapped[bytes]


class RejectedPass(Base):
    """A pass that is rejected because it contradicts the network. Passes of duplicate drives have no row here."""

    __tablename__ = "rejected_passes"

    segment_id: Mapped[int] = mapped_column(goes_with("segments"), primary_key=True, autoincrement=False)
    pass_id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), index=True)


class DriveConstants(Base):
    """What all passes of a drive say of its constants, in the library's encoding, and how many passes they are.

    The number of measurements and the times of the positions (Unix seconds, little-endian doubles) tell the drive from
    others, together with the entries of its passes.
    """

    __tablename__ = "drive_constants"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), primary_key=True)
    passes: Mapped[int]
    evidence: Mapped[bytes]
    measurements: Mapped[int]
    epoch_s: Mapped[bytes]
    partitions: Mapped[list[int]] = mapped_column(ARRAY(sa.SmallInteger))
    """Where its passes are: all regions, so that nobody looks for them elsewhere."""


class DeviceClass(Base):
    """Drives of one kind of device, and what their repeats say of their sigmas (``app.network.widenings``)."""

    __tablename__ = "device_classes"

    name: Mapped[str] = mapped_column(primary_key=True)
    applied: Mapped[float]
    """What sigmas of its drives are multiplied by in every solution."""
    learned: Mapped[float]
    """By how much they are too small, as repeats show."""
    sigma: Mapped[float]
    """Of ``learned``."""
    pairs: Mapped[int]
    """Of drives over one segment each, of the class on either side."""
    drive_pairs: Mapped[int]
    """Different pairs of drives among these, which is what ``sigma`` goes by."""
    drives: Mapped[int]
    learned_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    marked_after: Mapped[uuid.UUID | None]
    """Drives up to this one are marked since ``applied`` changed; NULL: all are."""

    __table_args__ = (sa.CheckConstraint("applied >= 1", name="applied"),)


class ControlPoint(Base):
    """A surveyed height, above the datum that the drives' altitudes use; one at a place."""

    __tablename__ = "control_points"

    lon_deg: Mapped[float] = mapped_column(primary_key=True)
    lat_deg: Mapped[float] = mapped_column(primary_key=True)
    height_m: Mapped[float]
    sigma_m: Mapped[float]
    name: Mapped[str]
    """Where it came from: a line of a file."""
    imported_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())

    __table_args__ = (sa.CheckConstraint("sigma_m > 0", name="sigma"),)


class Cell(Base):
    """A cell of the map, a tile of zoom 14, and its versions (``app.network.cells``)."""

    __tablename__ = "cells"

    id: Mapped[int] = mapped_column(sa.Integer, primary_key=True, autoincrement=False)
    """x in the upper bits, y in the lower 14."""
    version: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """Raised if and only if anything that is shown of the cell changes."""
    changed_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    unsettled_since: Mapped[datetime | None]
    """Since when a change near by waits that only a solution of a wider subnetwork takes into account."""
    driven: Mapped[dict[str, Any]] = mapped_column(server_default=sa.text("'{}'"))
    """Number and length, m, of the driven segments of each class whose middle lies in the cell."""

    road_state: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """Which step of which import changed the roads that meet the cell last (``app.network.cells``)."""
    course_state: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """The same of changes that a drive would notice: roads that came, went, or lie elsewhere."""

    drawn_version: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """Raised when what low zooms draw of the cell changes, which follows ``version`` (``app.map.derived``). What is
    drawn of a greater cell raises it of any cell inside."""
    changed_xid: Mapped[int] = mapped_column(sa.BigInteger, server_default="0", index=True)
    """The transaction that raised either of the two last; a trigger writes it (``SegmentChange.xid``)."""

    __table_args__ = (sa.Index(None, "unsettled_since", **where("unsettled_since IS NOT NULL")),)


class NetworkMark(Numbered, Base):
    """What waits to be solved in a cell because a drive was added or removed or something else changed there."""

    __tablename__ = "network_marks"

    cell: Mapped[int] = mapped_column(index=True)
    drive_id: Mapped[uuid.UUID | None] = mapped_column(index=True)
    """The drive that is published, or deleted, once all its marks are gone; it may not exist any more."""
    generation: Mapped[int | None]
    touched: Mapped[list[int]]
    """Segments around which the network is to be solved again."""
    combined: Mapped[list[int]]
    """Segments of which only the published slope is to be combined again."""
    due_at: Mapped[datetime] = mapped_column(index=True)
    tries: Mapped[int] = mapped_column(sa.SmallInteger, server_default="0")
    """How many solvers have begun it."""
    made_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class RoadVersion(Numbered, Import, Base):
    """One import of the road network and what became of the segments that were there."""

    __tablename__ = "road_versions"

    kept: Mapped[int]
    moved: Mapped[int]
    dropped: Mapped[int]
    added: Mapped[int]
    length_m: Mapped[float | None]
    """Of the whole network after it, as ``segments`` are; NULL of imports by code that did not note it."""
    region: Mapped[str | None]
    """What it brought up to date; NULL: the whole network, as imports did before there were regions."""


class DemVersion(Numbered, Base):
    """One state of the set of elevation rasters; ``sources`` lists ``{name, uri, sha256, priority, bounds_deg}`` of
    each file; versions of before 0014 have the first three. The active one may be empty.
    """

    __tablename__ = "dem_versions"

    sources: Mapped[list[dict[str, Any]]]
    datum: Mapped[str]
    imported_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    active: Mapped[bool]
    pending: Mapped[dict[str, Any] | None]
    """Where segments still have the heights of the set before: ``{boxes_deg, after_id}``; NULL: nowhere."""

    __table_args__ = (sa.Index("uq_dem_versions_active", "active", unique=True, **where("active")),)


class Region(Import, Base):
    """Roads that came from one file and are updated by the next of that name."""

    __tablename__ = "regions"

    id: Mapped[int] = mapped_column(sa.SmallInteger, sa.Identity(), primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    road_version_id: Mapped[int] = mapped_column(sa.ForeignKey("road_versions.id"))
    """The import that brought it to its present state."""
    file_uri: Mapped[str | None]
    """What a file of changes is applied to: its ways and their nodes, where ``app.roads.region_files`` keeps them."""
    file_sha256: Mapped[str | None]
    bounds: Mapped[list[float] | None]
    """West, south, east, north of its roads, degrees, as its last import left them."""


class RetiredSegment(Numbered, OfWay, Base):
    """A road that was deleted or moved, as it was when something was measured on it."""

    __tablename__ = "retired_segments"

    segment_id: Mapped[int] = mapped_column(sa.BigInteger)
    """The number that it had, and has again when it comes back. There need not be such a segment."""
    retired_at: Mapped[datetime] = mapped_column(server_default=sa.func.now(), index=True)


class _Retired(Numbered):
    """Evidence of one drive on a retired segment, from the run whose provenance has the number ``run``."""

    retired_id: Mapped[int] = mapped_column(goes_with("retired_segments"), index=True)
    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), index=True)
    run: Mapped[int | None] = mapped_column(sa.BigInteger)
    """No foreign key: a drive that was computed anew has another, and is computed once more if the road comes back."""


class RetiredPass(_Retired, Base):
    """A pass (``DrivePass``)."""

    __tablename__ = "retired_passes"

    sequence: Mapped[int]
    entered_s: Mapped[float]
    factor: Mapped[bytes]


class RetiredEstimate(_Retired, Estimate, Base):
    """An estimate (``DriveSegment``)."""

    __tablename__ = "retired_estimates"

    in_network: Mapped[bool]


class TouchedDrive(Base):
    """A drive that is to be computed again because roads under it changed; a worker queues it."""

    __tablename__ = "touched_drives"

    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), primary_key=True)
    road_state: Mapped[int] = mapped_column(sa.BigInteger)
    """A run that knew the roads of this state, or later ones, need not be repeated."""
    made_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class RoadImport(Base):
    """A road of the file that is imported just now, with the heights below it; NaN and an empty array: unknown."""

    __tablename__ = "road_import"

    n: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    """Its place in the file."""
    osm_way_id: Mapped[int] = mapped_column(sa.BigInteger)
    from_node: Mapped[int] = mapped_column(sa.BigInteger)
    to_node: Mapped[int] = mapped_column(sa.BigInteger)
    geom: Mapped[WKBElement] = mapped_column(shape("LINESTRING", SRID_DEGREES))
    geom_3857: Mapped[WKBElement] = mapped_column(shape("LINESTRING", SRID_TILES))
    length_m: Mapped[float]
    tag: Mapped[int]
    oneway: Mapped[int] = mapped_column(sa.SmallInteger)
    bridge: Mapped[bool]
    tunnel: Mapped[bool]
    layer: Mapped[int] = mapped_column(sa.SmallInteger)
    dem_slope_percent: Mapped[float]
    dem_heights_m: Mapped[list[float]]

    __table_args__ = ({"prefixes": ["UNLOGGED"]},)


class RoadImportTags(Base):
    """What many roads of that file have in common."""

    __tablename__ = "road_import_tags"

    tag: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    highway: Mapped[str]
    name: Mapped[str | None]

    __table_args__ = ({"prefixes": ["UNLOGGED"]},)
