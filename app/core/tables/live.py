"""The tables of drives under way: streams of points that phones and trackers send, until they are logs.

Statements stand in ``app.drives.live.store``.
"""

from __future__ import annotations

import uuid
from datetime import datetime

import sqlalchemy as sa
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base, Numbered, goes_with, where


class LiveStream(Numbered, Base):
    """What one device sends by one key and one program; two phones with one address are two streams."""

    __tablename__ = "live_streams"

    owner_id: Mapped[int] = mapped_column(
        goes_with("owners"), index=True, server_default=sa.text("versant_owner()")
    )
    key_id: Mapped[uuid.UUID | None] = mapped_column(
        goes_with("keys"), server_default=sa.text("versant_key()")
    )
    """NULL: of a service that asks for no keys."""
    sender: Mapped[str]
    device: Mapped[str]
    made_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    seen_at: Mapped[datetime] = mapped_column(server_default=sa.func.clock_timestamp())
    """When it sent something last."""
    due_at: Mapped[datetime | None]
    """When a worker is to look whether a drive of it is over; NULL: it has no points."""
    unusable: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """Points that could not be used."""
    unusable_why: Mapped[str | None]
    """Of the last one."""

    __table_args__ = (
        sa.Index("ix_live_streams_key_id", "key_id", "sender", "device", unique=True),
        sa.Index(
            "ix_live_streams_keyless", "owner_id", "sender", "device", unique=True, **where("key_id IS NULL")
        ),
        sa.Index("ix_live_streams_due_at", "due_at", **where("due_at IS NOT NULL")),
    )


class LivePointRow(Base):
    """A point that is in no log yet; the time of a stream's point is its name."""

    __tablename__ = "live_points"

    stream_id: Mapped[int] = mapped_column(goes_with("live_streams"), primary_key=True, autoincrement=False)
    time_us: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """Unix microseconds."""
    came_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    lat_deg: Mapped[float]
    lon_deg: Mapped[float]
    alt_msl_m: Mapped[float | None]
    height_ell_m: Mapped[float | None]
    h_acc_m: Mapped[float | None]
    v_acc_m: Mapped[float | None]
    speed_mps: Mapped[float | None]
    s_acc_mps: Mapped[float | None]
    heading_deg: Mapped[float | None]
    odo_speed_mps: Mapped[float | None]
    pressure_hpa: Mapped[float | None]


class LiveDrive(Base):
    """A drive that was made of a stream's points: points that come late may belong to it. It goes with its drive."""

    __tablename__ = "live_drives"

    stream_id: Mapped[int] = mapped_column(goes_with("live_streams"), primary_key=True, autoincrement=False)
    drive_id: Mapped[uuid.UUID] = mapped_column(goes_with("drives"), primary_key=True, index=True)
    begins_us: Mapped[int] = mapped_column(sa.BigInteger)
    ends_us: Mapped[int] = mapped_column(sa.BigInteger)

    __table_args__ = (sa.Index("ix_live_drives_stream_id_ends_us", "stream_id", "ends_us"),)
