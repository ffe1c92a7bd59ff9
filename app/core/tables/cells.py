"""The tables by which the map is solved and numbered cell by cell; the others are in ``app.core.tables``."""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, Identity, Index, Integer, SmallInteger, func, text
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base


class Cell(Base):
    """A cell of the map, a tile of zoom 14: what is shown of it, numbered (``app.network.cells``)."""

    __tablename__ = "cells"

    id: Mapped[int] = mapped_column(Integer, primary_key=True, autoincrement=False)
    """x in the upper bits, y in the lower 14."""
    version: Mapped[int] = mapped_column(BigInteger, server_default="0")
    """Raised when, and only when, anything that is shown of the cell changes."""
    changed_at: Mapped[datetime] = mapped_column(server_default=func.now())
    unsettled_since: Mapped[datetime | None]
    """Since when something near has changed that only a solution of a wider window takes into account."""
    driven: Mapped[dict[str, Any]] = mapped_column(server_default=text("'{}'"))
    """Number and length, m, of the driven segments of each class whose middle lies in the cell."""

    road_state: Mapped[int] = mapped_column(BigInteger, server_default="0")
    """Which step of which import changed the roads that meet the cell last (``app.network.road_states``)."""
    course_state: Mapped[int] = mapped_column(BigInteger, server_default="0")
    """The same of changes that a drive would notice: roads that came, went, or lie elsewhere."""

    drawn_version: Mapped[int] = mapped_column(BigInteger, server_default="0")
    """Raised when what low zooms draw of the cell changes, which follows ``version`` (``app.map.derived``). What is
    drawn of a greater cell raises it of any cell inside."""
    changed_xid: Mapped[int] = mapped_column(BigInteger, server_default="0", index=True)
    """The transaction that raised either of the two last; a trigger writes it (``SegmentChange.xid``)."""

    __table_args__ = (
        Index(
            "ix_cells_unsettled_since",
            "unsettled_since",
            postgresql_where=text("unsettled_since IS NOT NULL"),
        ),
    )


class NetworkMark(Base):
    """What waits to be solved in a cell, since one drive came or went or since something else changed there."""

    __tablename__ = "network_marks"

    id: Mapped[int] = mapped_column(BigInteger, Identity(), primary_key=True)
    cell: Mapped[int]
    drive_id: Mapped[uuid.UUID | None]
    """The drive that is published, or gone, once all its marks are; it need not be there any more."""
    generation: Mapped[int | None]
    touched: Mapped[list[int]]
    """Segments around which the network is to be solved again."""
    combined: Mapped[list[int]]
    """Segments of which only what is published is to be put together again."""
    due_at: Mapped[datetime]
    tries: Mapped[int] = mapped_column(SmallInteger, server_default="0")
    """How often a solver has begun with it."""
    made_at: Mapped[datetime] = mapped_column(server_default=func.now())

    __table_args__ = (
        Index("ix_network_marks_cell", "cell"),
        Index("ix_network_marks_drive_id", "drive_id"),
        Index("ix_network_marks_due_at", "due_at"),
    )
