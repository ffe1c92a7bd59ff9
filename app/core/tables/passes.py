"""The tables of what drives and surveyors say of the network: passes, sums of old ones, verdicts, points."""

from __future__ import annotations

import uuid
from datetime import datetime

from sqlalchemy import BigInteger, CheckConstraint, ForeignKey, Identity, Index, SmallInteger, func, text
from sqlalchemy.dialects.postgresql import ARRAY
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base

PARTITION_PREFIX = "drive_passes_of_"
"""How the names of the parts of ``drive_passes`` begin: rows go by a hash of their region."""


class DrivePass(Base):
    """What one pass of a drive over a segment contributes to the network: a factor, in the library's encoding."""

    __tablename__ = "drive_passes"

    id: Mapped[int] = mapped_column(
        BigInteger, primary_key=True, server_default=text("nextval('drive_passes_id_seq')")
    )
    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"), index=True)
    segment_id: Mapped[int] = mapped_column(ForeignKey("segments.id", ondelete="CASCADE"))
    entered_s: Mapped[float]
    """When the drive came to the segment, Unix seconds."""
    condensed_weight: Mapped[float | None]
    """NULL: the pass is recent and read as it is. Else the weight with which it is condensed; 0: it was rejected."""
    sequence: Mapped[int]
    """Its place among the drive's passes, in the order of driving."""
    partition: Mapped[int] = mapped_column(SmallInteger, primary_key=True, autoincrement=False)
    """The tile of zoom 6 that the segment's cell lies in: ``versant_partition(cell)``."""
    factor: Mapped[bytes]

    __table_args__ = (
        # Who else was here at that moment is one look, however many drives there are, and only into the index.
        Index(
            "ix_drive_passes_segment_id_entered_s",
            "segment_id",
            "entered_s",
            postgresql_include=["drive_id", "partition"],
        ),
        # What is still read over a segment, however many passes there were.
        Index("ix_drive_passes_recent", "segment_id", postgresql_where=text("condensed_weight IS NULL")),
        {"postgresql_partition_by": "HASH (partition)"},
    )


class CondensedPasses(Base):
    """Old passes over a segment added up (``fusion.network.condensed``): a segment's sum is that of its rows.

    Rows are only added, so that nobody waits for anybody; one that takes off what a drive had said is of turned signs.
    """

    __tablename__ = "condensed_passes"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    segment_id: Mapped[int] = mapped_column(ForeignKey("segments.id", ondelete="CASCADE"), index=True)
    evidence: Mapped[bytes]


class RejectedPass(Base):
    """A pass that contradicts the network and is not heard; all others are, but for those of repeated drives."""

    __tablename__ = "rejected_passes"

    segment_id: Mapped[int] = mapped_column(
        ForeignKey("segments.id", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    pass_id: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"), index=True)


class DriveConstants(Base):
    """What a drive's passes together say of its constants, in the library's encoding, and of how many passes it is.

    Beside it what tells the drive from others, with the entries of its passes: how many measurements it has, and the
    times of its positions, Unix seconds as little-endian doubles.
    """

    __tablename__ = "drive_constants"

    drive_id: Mapped[uuid.UUID] = mapped_column(ForeignKey("drives.id", ondelete="CASCADE"), primary_key=True)
    passes: Mapped[int]
    evidence: Mapped[bytes]
    measurements: Mapped[int]
    epoch_s: Mapped[bytes]
    partitions: Mapped[list[int]] = mapped_column(ARRAY(SmallInteger))
    """Where its passes are: all regions, so that nobody looks for them elsewhere."""


class ControlPoint(Base):
    """A surveyed height, above the datum that the drives' altitudes use; one at a place."""

    __tablename__ = "control_points"

    lon_deg: Mapped[float] = mapped_column(primary_key=True)
    lat_deg: Mapped[float] = mapped_column(primary_key=True)
    height_m: Mapped[float]
    sigma_m: Mapped[float]
    name: Mapped[str]
    """Where it came from: a line of a file."""
    imported_at: Mapped[datetime] = mapped_column(server_default=func.now())

    __table_args__ = (CheckConstraint("sigma_m > 0", name="sigma"),)
