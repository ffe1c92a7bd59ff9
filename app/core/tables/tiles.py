"""The tables of vector tiles: those that are kept compressed, and the epoch of their versions."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, SmallInteger, func
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base


class StoredTile(Base):
    """A vector tile as it was built last, compressed. It can be built again: unlogged, and in no dump."""

    __tablename__ = "stored_tiles"

    layer: Mapped[str] = mapped_column(primary_key=True)
    z: Mapped[int] = mapped_column(SmallInteger, primary_key=True, autoincrement=False)
    x: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    y: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tag: Mapped[str]
    """The ETag that it was built for; with another one it is old."""
    size_bytes: Mapped[int]
    asked: Mapped[int] = mapped_column(BigInteger, server_default="1")
    """How often it was asked for, as far as processes have told."""
    asked_at: Mapped[datetime] = mapped_column(server_default=func.now())
    """What was asked for last stays longest where room is short."""
    body: Mapped[bytes]
    """The tile, gzip."""

    __table_args__ = ({"prefixes": ["UNLOGGED"], "postgresql_with": {"toast_tuple_target": "128"}},)


class TileEpoch(Base):
    """One row. What else makes tiles new than versions of cells: a restored database, cells that were deleted."""

    __tablename__ = "tile_epoch"

    id: Mapped[int] = mapped_column(SmallInteger, primary_key=True, autoincrement=False)
    epoch: Mapped[str]
    """Random. With the number of the transaction that wrote the row, which a dump does not bring back."""
