"""How far the changes of segments are followed, and what is to be derived anew; in the database.

A change is followed once no transaction is left that may still write one below it: a snapshot has seen all of those
whose number is below its ``pg_snapshot_xmin``. Changes are followed in the order of (xid, segment_id), so none is left
out, whatever order transactions commit in. The numbers are one server's: of a database that was brought here from
another one everything is followed from the start, and numbers beyond a snapshot's are written down anew first.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.map.derived.pieces import BLOCK, FINEST

# Any constant that no other user of this database takes.
_DERIVE = 0x5653_4456  # "VSDV"
_TRY = text("SELECT pg_try_advisory_lock(:key)")
_FREE = text("SELECT pg_advisory_unlock(:key)")

# One statement, one snapshot; each part is a look at one entry of an index: asked whether there is any change, the
# planner would rather read all of them.
_LOOK = text(
    """
    WITH moment AS (
        SELECT u.xid, u.segment_id, u.turn,
               CAST(CAST(pg_snapshot_xmin(pg_current_snapshot()) AS text) AS bigint) AS horizon,
               CAST(CAST(pg_snapshot_xmax(pg_current_snapshot()) AS text) AS bigint) AS beyond,
               CAST(CAST(u.xmin AS text) AS bigint) <> u.written_xid & 4294967295 AS brought
        FROM derived_upto AS u
    )
    SELECT m.*, m.brought OR coalesce((SELECT max(xid) FROM segment_changes) >= m.beyond, false) AS elsewhere,
           coalesce((SELECT c.xid FROM segment_changes AS c WHERE (c.xid, c.segment_id) > (m.xid, m.segment_id)
                     ORDER BY c.xid, c.segment_id LIMIT 1) < m.horizon, false) AS changes,
           (SELECT min(since) < clock_timestamp() - make_interval(secs => :long_s) FROM cells_to_draw) AS waits_long
    FROM moment AS m
    """
)

# With where they were when they were followed last, and where they are.
_CHANGES = text(
    """
    SELECT c.xid, c.segment_id, s.osm_way_id AS way, s.cell, d.osm_way_id AS former_way, d.cell AS former_cell
    FROM (SELECT xid, segment_id FROM segment_changes
          WHERE (xid, segment_id) > (:xid, :segment_id) AND xid < :horizon
          ORDER BY xid, segment_id LIMIT :limit) AS c
    LEFT JOIN segments AS s ON s.id = c.segment_id
    LEFT JOIN derived_segments AS d ON d.segment_id = c.segment_id
    ORDER BY c.xid, c.segment_id
    """
)
_SHORT_WAITS = text("SET LOCAL lock_timeout = '50ms'")
_TURN = text("UPDATE derived_upto SET turn = turn + 1, written_xid = versant_xid() WHERE turn = :turn")
_UP_TO = text("UPDATE derived_upto SET xid = :xid, segment_id = :segment_id")
_FOLLOWED = text(
    """
    INSERT INTO derived_segments AS d (segment_id, osm_way_id, cell)
    SELECT * FROM unnest(CAST(:ids AS bigint[]), CAST(:ways AS bigint[]), CAST(:cells AS integer[]))
    ON CONFLICT (segment_id) DO UPDATE SET osm_way_id = excluded.osm_way_id, cell = excluded.cell
    WHERE (d.osm_way_id, d.cell) <> (excluded.osm_way_id, excluded.cell)
    """
)
_GONE = text("DELETE FROM derived_segments WHERE segment_id = ANY(CAST(:ids AS bigint[]))")

# Piece by piece: whoever changes one of these segments meanwhile waits for it.
_FROM_ELSEWHERE = text(
    """
    UPDATE segment_changes SET xid = versant_xid() WHERE segment_id = ANY(ARRAY(
        SELECT segment_id FROM segment_changes WHERE xid >= :beyond ORDER BY segment_id LIMIT :limit))
    """
)
_FROM_THE_START = text("UPDATE derived_upto SET xid = 0, segment_id = 0")

_TO_DRAW = text(
    """
    INSERT INTO cells_to_draw (level, cell, since)
    SELECT :level, cell, clock_timestamp() FROM unnest(CAST(:tiles AS integer[])) AS cell
    ON CONFLICT (level, cell) DO NOTHING
    """
)
_IS_DRAWN = text("DELETE FROM cells_to_draw WHERE level = :level AND cell = ANY(CAST(:tiles AS integer[]))")

# The finest first, for others are made of them; but none waits for ever while changes come.
_NEXT = text(
    """
    SELECT level, cell FROM cells_to_draw
    ORDER BY level < :block AND since < clock_timestamp() - make_interval(secs => :long_s) DESC, level DESC, since,
             cell
    LIMIT 1
    """
)
_WAITING_IN = text(
    """
    SELECT cell FROM cells_to_draw
    WHERE level = :level AND cell = ANY(CAST(:tiles AS integer[])) ORDER BY cell
    """
)


class Moment(NamedTuple):
    """One look: how far changes are followed, and whether there is anything to do."""

    xid: int
    segment_id: int
    turn: int
    horizon: int
    beyond: int
    """No transaction of this server has a number as high."""
    brought: bool
    """The database came from another server, which numbered otherwise."""
    elsewhere: bool
    """So it did, or some changes have numbers of another server."""
    changes: bool
    """Some can be followed."""
    waits_long: bool | None
    """A tile waits that has waited long; None: none waits."""

    @property
    def idle(self) -> bool:
        """Nothing is to do."""
        return not self.elsewhere and not self.changes and self.waits_long is None


class Change(NamedTuple):
    """A segment that changed, where it is, None where it is not, and where it was when it was followed last."""

    xid: int
    segment_id: int
    way: int | None
    cell: int | None
    former_way: int | None
    former_cell: int | None


@contextmanager
def deriving_alone(sessions: Sessions) -> Iterator[bool]:
    """Whether nobody else derives, until the block or the process ends. What is written does not depend on it."""
    with sessions() as session:
        session.connection(execution_options={"isolation_level": "AUTOCOMMIT"})
        alone = bool(session.execute(_TRY, {"key": _DERIVE}).scalar_one())
        try:
            yield alone
        finally:
            if alone:
                session.execute(_FREE, {"key": _DERIVE})


def look(session: Session, long_s: float) -> Moment:
    """How things stand; of a snapshot where the session has one."""
    return Moment(*session.execute(_LOOK, {"long_s": long_s}).one())


def changes_after(session: Session, moment: Moment, limit: int) -> list[Change]:
    """The next changes that can be followed."""
    values = {"xid": moment.xid, "segment_id": moment.segment_id, "horizon": moment.horizon, "limit": limit}
    return [Change(*row) for row in session.execute(_CHANGES, values)]


def take_turn(session: Session, moment: Moment) -> bool:
    """Keep others who derive out of what is left of the transaction, which waits for nobody; False: one has written."""
    session.execute(_SHORT_WAITS)
    return bool(session.execute(_TURN, {"turn": moment.turn}).rowcount)  # type: ignore[attr-defined]


def note_followed(session: Session, changes: Collection[Change]) -> None:
    """These are followed, in this order: their tiles are to be drawn anew, and where they are is known."""
    there = [c for c in changes if c.way is not None]
    session.execute(
        _FOLLOWED,
        {
            "ids": [c.segment_id for c in there],
            "ways": [c.way for c in there],
            "cells": [c.cell for c in there],
        },
    )
    session.execute(_GONE, {"ids": [c.segment_id for c in changes if c.way is None]})
    cells = {cell for c in changes for cell in (c.cell, c.former_cell) if cell is not None}
    ask_to_draw(session, FINEST, cells)
    last = max(changes)
    session.execute(_UP_TO, {"xid": last.xid, "segment_id": last.segment_id})


def take_in(session: Session, moment: Moment, limit: int) -> None:
    """Count some changes of another server as this transaction's; follow all of them anew."""
    session.execute(_FROM_ELSEWHERE, {"beyond": moment.beyond, "limit": limit})
    if moment.brought:
        session.execute(_FROM_THE_START)


def ask_to_draw(session: Session, level: int, tiles: Collection[int]) -> None:
    """Let these tiles be drawn anew."""
    if tiles:
        session.execute(_TO_DRAW, {"level": level, "tiles": sorted(tiles)})


def next_tile(session: Session, long_s: float) -> tuple[int, int] | None:
    """The level and the tile that is to be drawn next."""
    row = session.execute(_NEXT, {"block": BLOCK, "long_s": long_s}).one_or_none()
    return None if row is None else (row.level, row.cell)


def waiting_among(session: Session, level: int, tiles: Collection[int]) -> list[int]:
    """Which of these tiles are to be drawn anew, sorted."""
    return list(session.execute(_WAITING_IN, {"level": level, "tiles": sorted(tiles)}).scalars())


def note_drawn(session: Session, level: int, tiles: Collection[int]) -> None:
    """They are."""
    session.execute(_IS_DRAWN, {"level": level, "tiles": sorted(tiles)})
