"""The tables of roads that change: regions, and the retired evidence of deleted roads."""

from __future__ import annotations

import uuid
from datetime import datetime

from geoalchemy2 import WKBElement
from sqlalchemy import BigInteger, ForeignKey, Identity, SmallInteger, func
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import SRID_DEGREES, Base, line


class Region(Base):
    """Roads that came from one file and are updated by the next of that name."""

    __tablename__ = "regions"

    id: Mapped[int] = mapped_column(SmallInteger, Identity(), primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    source_name: Mapped[str]
    sha256: Mapped[str]
    imported_at: Mapped[datetime] = mapped_column(server_default=func.now())
    road_version_id: Mapped[int] = mapped_column(ForeignKey("road_versions.id"))
    """The import that brought it to its present state."""
    segments: Mapped[int]
    file_uri: Mapped[str | None]
    """What a file of changes is applied to: its ways and their nodes, where ``app.roads.region_files`` keeps them."""
    file_sha256: Mapped[str | None]
    bounds: Mapped[list[float] | None]
    """West, south, east, north of its roads, degrees, as its last import left them."""


class RetiredSegment(Base):
    """A road that was deleted or moved, as it was when something was measured on it."""

    __tablename__ = "retired_segments"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    segment_id: Mapped[int] = mapped_column(BigInteger)
    """The number that it had, and has again when it comes back. There need not be such a segment."""
    osm_way_id: Mapped[int] = mapped_column(BigInteger)
    from_node: Mapped[int] = mapped_column(BigInteger)
    to_node: Mapped[int] = mapped_column(BigInteger)
    geom: Mapped[WKBElement] = mapped_column(line(SRID_DEGREES))
    length_m: Mapped[float]
    retired_at: Mapped[datetime] = mapped_column(server_default=func.now(), index=True)


class _Retired:
    """Evidence of one drive on a retired segment, from the run whose provenance has the number ``run``."""

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    retired_id: Mapped[int] = mapped_column(ForeignKey("retired_segments.id", ondelete="CASCADE"), index=True)
    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"), index=True)
    run: Mapped[int | None] = mapped_column(BigInteger)
    """No foreign key: a drive that was computed anew has another, and is computed once more if the road comes back."""


class RetiredPass(_Retired, Base):
    """A pass (``DrivePass``)."""

    __tablename__ = "retired_passes"

    sequence: Mapped[int]
    entered_s: Mapped[float]
    factor: Mapped[bytes]


class RetiredEstimate(_Retired, Base):
    """An estimate (``DriveSegment``)."""

    __tablename__ = "retired_estimates"

    slope_percent: Mapped[float]
    slope_sigma_percent: Mapped[float]
    observations: Mapped[int]
    passes: Mapped[int]
    first_at: Mapped[datetime]
    last_at: Mapped[datetime]
    in_network: Mapped[bool]


class TouchedDrive(Base):
    """A drive that is to be computed again because roads under it changed; a worker queues it."""

    __tablename__ = "touched_drives"

    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"), primary_key=True)
    road_state: Mapped[int] = mapped_column(BigInteger)
    """A run that knew the roads of this state, or later ones, need not be repeated."""
    made_at: Mapped[datetime] = mapped_column(server_default=func.now())
