"""The tables of what is served besides segments: changes, ways, what low zooms draw, stored vector tiles; and those by
which others follow the map: whose numbers of transactions count, and who is told of changes."""

from __future__ import annotations

import uuid
from datetime import date, datetime
from typing import Any

import sqlalchemy as sa
from geoalchemy2 import WKBElement
from sqlalchemy.dialects.postgresql import ARRAY, TEXT
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import SRID_DEGREES, SRID_TILES, Base, OneRow, Owned, Road, goes_with, shape, where

DRAWN_LEVELS = (12, 10, 8, 6)
"""Each is drawn at this zoom and at the one below."""
FAR_ZOOM = 10
"""The names that a map shows up to here have an index of their own."""


class SegmentChange(Base):
    """When anything that is shown of a segment changed last. Triggers write it; none of a segment's writers need to."""

    __tablename__ = "segment_changes"

    segment_id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """No foreign key: that it is gone is told for some time."""
    xid: Mapped[int] = mapped_column(sa.BigInteger)
    """The transaction. A snapshot tells all of those below its ``pg_snapshot_xmin``, of later ones perhaps some."""
    changed_at: Mapped[datetime] = mapped_column(index=True)
    gone: Mapped[bool]
    was: Mapped[WKBElement | None] = mapped_column(shape("GEOMETRY", SRID_DEGREES))
    """Where it lay before it moved or went, as far back as changes are told: all places in one box."""

    __table_args__ = (
        sa.Index("ix_segment_changes_xid", "xid", "segment_id"),
        # What is told for a time only.
        sa.Index("ix_segment_changes_left", "changed_at", **where("gone OR was IS NOT NULL")),
    )


class Way(Road, Base):
    """Consecutive segments of one OpenStreetMap way, as one; derived from them by workers (``app.map.derived``)."""

    __tablename__ = "ways"

    id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """Of its first segment."""
    segments: Mapped[int]
    slope_percent: Mapped[float | None]
    """Mean over what was measured of it, by length."""
    slope_sigma_percent: Mapped[float | None]
    drives: Mapped[int]
    observations: Mapped[int]
    updated_at: Mapped[datetime | None]
    measured_share: Mapped[float]
    """Of its length, in segments with a slope."""
    steepest_percent: Mapped[float | None]
    """Mean grade over the steepest 20 m, signed; from and to: metres from ``from_node``."""
    steepest_from_m: Mapped[float | None]
    steepest_to_m: Mapped[float | None]

    __table_args__ = (
        sa.Index(None, "osm_way_id"),
        sa.Index(None, "geom", postgresql_using="gist"),
        sa.Index(None, "geom_3857", postgresql_using="gist"),
        # As items ask for it; most ways of a country have no slope.
        sa.Index(
            "ix_ways_steepness_percent",
            sa.text("abs(slope_percent)"),
            **where("abs(slope_percent) IS NOT NULL"),
        ),
    )


class DrawnPiece(Base):
    """A stretch of road as low zooms draw it, derived cell by cell (``app.map.derived``).

    A cell of a level is a tile two zooms below it: of 12 a tile of zoom 14, of 6 one of zoom 8, as ``x << zoom | y``.
    """

    __tablename__ = "drawn_pieces"

    level: Mapped[int] = mapped_column(sa.SmallInteger, primary_key=True, autoincrement=False)
    cell: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    segment_id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """One of its segments, which no other piece of the level has."""
    rank: Mapped[int] = mapped_column(sa.SmallInteger)
    """Of the class: 0 motorways, then less and less important."""
    highway: Mapped[str]
    oneway: Mapped[int] = mapped_column(sa.SmallInteger)
    slope_percent: Mapped[float | None]
    """Mean over what was measured of it, by length, along the line."""
    slope_sigma_percent: Mapped[float | None]
    drives: Mapped[int]
    length_m: Mapped[float]
    geom_3857: Mapped[WKBElement] = mapped_column(shape("LINESTRING", SRID_TILES))

    __table_args__ = tuple(
        sa.Index(
            f"ix_drawn_pieces_{level}", "geom_3857", postgresql_using="gist", **where(f"level = {level}")
        )
        for level in DRAWN_LEVELS
    )


class MapName(Base):
    """A name that a map shows beside roads: of a place or a water, or the number of a road. Imports bring them."""

    __tablename__ = "map_names"

    layer: Mapped[str] = mapped_column(primary_key=True)
    """``places``, ``water`` or ``roads``."""
    osm_id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """Of a node where it is a place, else of a way."""
    kind: Mapped[str]
    """As OpenStreetMap has it: ``town``, ``river``, ``primary``."""
    name: Mapped[str]
    population: Mapped[int | None] = mapped_column(sa.BigInteger)
    from_zoom: Mapped[int] = mapped_column(sa.SmallInteger)
    """Tiles have it from this zoom on."""
    regions: Mapped[list[int]] = mapped_column(ARRAY(sa.SmallInteger))
    """The regions whose files have it."""
    geom_3857: Mapped[WKBElement] = mapped_column(shape("GEOMETRY", SRID_TILES))

    __table_args__ = (
        sa.Index(None, "geom_3857", postgresql_using="gist"),
        # Tiles that show much of the map read few of the names below them.
        sa.Index(
            "ix_map_names_far",
            "geom_3857",
            postgresql_using="gist",
            **where(f"from_zoom <= {FAR_ZOOM}"),
        ),
    )


class DerivedUpTo(OneRow, Base):
    """How far segments' changes are followed by the two tables above: one row (``app.map.derived``)."""

    __tablename__ = "derived_upto"

    xid: Mapped[int] = mapped_column(sa.BigInteger)
    """The last change that was followed, in the order of (xid, segment_id)."""
    segment_id: Mapped[int] = mapped_column(sa.BigInteger)
    turn: Mapped[int] = mapped_column(sa.BigInteger)
    """Raised by whoever follows changes: of two who read the same one comes too late, and writes nothing."""
    written_xid: Mapped[int] = mapped_column(sa.BigInteger)
    """The transaction that wrote the row, which the row itself knows too: a dump that was brought in did not."""

    __table_args__ = (sa.CheckConstraint("id = 1", name="one"),)


class DerivedSegment(Base):
    """Where a segment was when it was derived from last: what is to be derived anew when it goes elsewhere."""

    __tablename__ = "derived_segments"

    segment_id: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    """No foreign key: one that is gone stays until that is followed."""
    osm_way_id: Mapped[int] = mapped_column(sa.BigInteger)
    cell: Mapped[int]


class CellToDraw(Base):
    """A cell of a level whose pieces are to be derived anew; one of the finest level together with its block.

    Who asks for it anew writes the row anew (``app.map.derived.waiting``).
    """

    __tablename__ = "cells_to_draw"

    level: Mapped[int] = mapped_column(sa.SmallInteger, primary_key=True, autoincrement=False)
    cell: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    since: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class StoredTile(Base):
    """A vector tile as it was built last, compressed. It can be built again: unlogged, and in no dump."""

    __tablename__ = "stored_tiles"

    layer: Mapped[str] = mapped_column(primary_key=True)
    z: Mapped[int] = mapped_column(sa.SmallInteger, primary_key=True, autoincrement=False)
    x: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    y: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    tag: Mapped[str]
    """The ETag that it was built for; with another one it is old."""
    size_bytes: Mapped[int]
    asked: Mapped[int] = mapped_column(sa.BigInteger, server_default="1")
    """How often it was asked for, as far as processes have told."""
    asked_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    """What was asked for last stays longest where room is short."""
    body: Mapped[bytes]
    """The tile, gzip."""

    __table_args__ = ({"prefixes": ["UNLOGGED"], "postgresql_with": {"toast_tuple_target": "128"}},)


class TileEpoch(OneRow, Base):
    """One row: the epoch of tile versions. A restored database or deleted cells begin a new one."""

    __tablename__ = "tile_epoch"

    epoch: Mapped[str]
    """Random. With the number of the transaction that wrote the row, which a dump does not bring back."""


class ChangeEpoch(OneRow, Base):
    """One row: since when the numbers of transactions are those of one history (``app.changes.store``)."""

    __tablename__ = "change_epoch"

    epoch: Mapped[str]
    """Random; part of every version."""
    place: Mapped[str]
    """Server, database and timeline in which it began."""
    xid: Mapped[int] = mapped_column(sa.BigInteger)
    """The transaction that wrote this row: a copy of the row, by a dump, was written by another."""
    pruned_xid: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """What was gone before it is not told any more."""
    begun_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())

    __table_args__ = (sa.CheckConstraint("id = 1", name="singleton"),)


class EditionRow(Base):
    """An edition of the map for the public (``app.releases``), and the files of it that are kept."""

    __tablename__ = "editions"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    day: Mapped[date]
    owners: Mapped[int]
    """Among so many each is hidden, even from those that work together."""
    owners_needed: Mapped[int]
    """Distinct owners who drove a segment of it."""
    segments: Mapped[int] = mapped_column(sa.BigInteger)
    length_m: Mapped[float]
    withheld_share: Mapped[float | None]
    """Of the driven segments; NULL where none is driven."""
    withheld_length_share: Mapped[float | None]
    files: Mapped[list[dict[str, Any]]] = mapped_column(server_default=sa.text("'[]'"))


class Webhook(Owned, Base):
    """An address that is told of events (``app.changes.webhooks``)."""

    __tablename__ = "webhooks"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    url: Mapped[str]
    secret: Mapped[str]
    """What messages are signed by; whoever reads the database could sign as well."""
    events: Mapped[list[str]] = mapped_column(ARRAY(TEXT))
    bbox: Mapped[list[float] | None]
    """West, south, east, north, degrees: only what happens there is told; NULL: everywhere."""
    active: Mapped[bool] = mapped_column(server_default=sa.text("true"))
    off_reason: Mapped[str | None]
    """Why the service switched it off; NULL where it did not."""
    reported_version: Mapped[str | None]
    """The version of the map up to which changes of segments were told and taken; NULL: it does not ask for them."""
    failures: Mapped[int] = mapped_column(server_default="0")
    """In a row."""
    failing_since: Mapped[datetime | None]
    last_success_at: Mapped[datetime | None]
    next_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    """Nothing is sent before."""
    claimed_until: Mapped[datetime | None]
    """Somebody is sending; one at a time, and whoever dies at it holds it no longer."""
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())


class WebhookDelivery(Base):
    """A message to one address: it commits together with what it tells of."""

    __tablename__ = "webhook_deliveries"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    webhook_id: Mapped[uuid.UUID] = mapped_column(goes_with("webhooks"))
    event: Mapped[str]
    data: Mapped[dict[str, Any]]
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    state: Mapped[str] = mapped_column(server_default="waiting")
    attempts: Mapped[int] = mapped_column(server_default="0")
    due_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    ended_at: Mapped[datetime | None]
    status: Mapped[int | None]
    """HTTP's, of the last attempt; NULL where there was no answer."""
    problem: Mapped[str | None]
    """What was wrong at the last attempt."""

    __table_args__ = (
        sa.CheckConstraint("state IN ('waiting', 'taken', 'given up')", name="state"),
        sa.Index("ix_webhook_deliveries_waiting", "webhook_id", "due_at", **where("state = 'waiting'")),
        sa.Index("ix_webhook_deliveries_created_at", "webhook_id", "created_at"),
        sa.Index(None, "ended_at", **where("ended_at IS NOT NULL")),
    )
