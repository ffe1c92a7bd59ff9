"""Ways and drawn pieces follow the changes of segments: what changed is derived anew, and nothing else.

Segments are changed by whoever changes them, and triggers note which (``SegmentChange``). Nobody who does waits for
what is derived: a worker follows a moment later, in pieces. Each reads one snapshot, computes outside of any lock, and
writes in one short transaction what came of it together with how far it is; it may die at any moment. First come the
changes: the ways they belong to are made anew, and their cells are noted; then the tiles of each level, the finest
first.

A change is followed once no transaction is left that may still write one below it: a snapshot has seen all of those
whose number is below its ``pg_snapshot_xmin``. Changes are followed in the order of (xid, segment_id), so none is left
out, whatever order transactions commit in. The numbers are one server's: of a database that was brought here from
another one everything is followed from the start, and numbers beyond a snapshot's are written down anew first.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import partial
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.map.derived import drawn_store
from app.map.derived.drawing import ABOVE, BLOCK, FINEST, children, parent
from app.map.derived.way_store import rows_of, segments_of, write_ways
from app.network.locks import deriving_alone
from app.network.swap import snapshot

# One statement, one snapshot; each part is a look at one entry of an index: asked whether there is any change, the
# planner would rather read all of them.
_LOOK = text("""
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
""")

# With where they were when they were followed last, and where they are.
_CHANGES = text("""
    SELECT c.xid, c.segment_id, s.osm_way_id AS way, s.cell, d.osm_way_id AS former_way, d.cell AS former_cell
    FROM (SELECT xid, segment_id FROM segment_changes
          WHERE (xid, segment_id) > (:xid, :segment_id) AND xid < :horizon
          ORDER BY xid, segment_id LIMIT :limit) AS c
    LEFT JOIN segments AS s ON s.id = c.segment_id
    LEFT JOIN derived_segments AS d ON d.segment_id = c.segment_id
    ORDER BY c.xid, c.segment_id
""")
_SHORT_WAITS = text("SET LOCAL lock_timeout = '50ms'")
_TURN = text("UPDATE derived_upto SET turn = turn + 1, written_xid = versant_xid() WHERE turn = :turn")
_UP_TO = text("UPDATE derived_upto SET xid = :xid, segment_id = :segment_id")
_FOLLOWED = text("""
    INSERT INTO derived_segments AS d (segment_id, osm_way_id, cell)
    SELECT * FROM unnest(CAST(:ids AS bigint[]), CAST(:ways AS bigint[]), CAST(:cells AS integer[]))
    ON CONFLICT (segment_id) DO UPDATE SET osm_way_id = excluded.osm_way_id, cell = excluded.cell
    WHERE (d.osm_way_id, d.cell) <> (excluded.osm_way_id, excluded.cell)
""")
_GONE = text("DELETE FROM derived_segments WHERE segment_id = ANY(CAST(:ids AS bigint[]))")

# Piece by piece: whoever changes one of these segments meanwhile waits for it.
_FROM_ELSEWHERE = text("""
    UPDATE segment_changes SET xid = versant_xid() WHERE segment_id = ANY(ARRAY(
        SELECT segment_id FROM segment_changes WHERE xid >= :beyond ORDER BY segment_id LIMIT :limit))
""")
_FROM_THE_START = text("UPDATE derived_upto SET xid = 0, segment_id = 0")

_TO_DRAW = text("""
    INSERT INTO cells_to_draw (level, cell, since)
    SELECT :level, cell, clock_timestamp() FROM unnest(CAST(:tiles AS integer[])) AS cell
    ON CONFLICT (level, cell) DO NOTHING
""")
_IS_DRAWN = text("DELETE FROM cells_to_draw WHERE level = :level AND cell = ANY(CAST(:tiles AS integer[]))")

# The finest first, for others are made of them; but none waits for ever while changes come.
_NEXT = text("""
    SELECT level, cell FROM cells_to_draw
    ORDER BY level < :block AND since < clock_timestamp() - make_interval(secs => :long_s) DESC, level DESC, since,
             cell
    LIMIT 1
""")
_WAITING_IN = text("""
    SELECT cell FROM cells_to_draw
    WHERE level = :level AND cell = ANY(CAST(:tiles AS integer[])) ORDER BY cell
""")


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


def look(session: Session, long_s: float) -> Moment:
    """How things stand; of a snapshot where the session has one."""
    return Moment(*session.execute(_LOOK, {"long_s": long_s}).one())


def take_turn(session: Session, moment: Moment) -> bool:
    """Keep others who derive out of what is left of the transaction, which waits for nobody; False: one has written."""
    session.execute(_SHORT_WAITS)
    return bool(session.execute(_TURN, {"turn": moment.turn}).rowcount)  # type: ignore[attr-defined]


def note_followed(session: Session, changes: Collection[Change]) -> None:
    """These are followed, in this order: their tiles are to be drawn anew, and where they are is known."""
    there = [c for c in changes if c.way is not None]
    columns = {"ids": "segment_id", "ways": "way", "cells": "cell"}
    session.execute(_FOLLOWED, {k: [getattr(c, name) for c in there] for k, name in columns.items()})
    session.execute(_GONE, {"ids": [c.segment_id for c in changes if c.way is None]})
    ask_to_draw(
        session, FINEST, {cell for c in changes for cell in (c.cell, c.former_cell) if cell is not None}
    )
    last = max(changes)
    session.execute(_UP_TO, {"xid": last.xid, "segment_id": last.segment_id})


def ask_to_draw(session: Session, level: int, tiles: Collection[int]) -> None:
    """Let these tiles be drawn anew."""
    if tiles:
        session.execute(_TO_DRAW, {"level": level, "tiles": sorted(tiles)})


logger = logging.getLogger(__name__)

AT_ONCE = 8000
"""Changes that are followed together: half a second's work."""
LONG_S = 10.0
"""A tile that has waited so long is drawn although changes, or finer tiles below it, are still coming."""
PIECE_S = 0.5
"""After so long a worker lets others go first."""

_TRIES = 10
_PAUSE_S = 0.03
"""Solvers hold cells for some tens of milliseconds."""
_OTHERS_WRITE = frozenset({"55P03", "40P01"})

_Write = Callable[[Session], bool]
"""What a piece writes; False: others are at it just now, and nothing may be written."""


def follow(sessions: Sessions, for_s: float = PIECE_S) -> bool:
    """Derive what is to be for about so long; whether there is more to do. Where another is at it nothing is done."""
    until_s = time.monotonic() + for_s
    with sessions() as session:
        if look(session, LONG_S).idle:
            return False
    with deriving_alone(sessions) as alone:
        if not alone:
            return False
        while _piece(sessions):
            if time.monotonic() >= until_s:
                return True
    return False


def follow_all(sessions: Sessions, stop: threading.Event | None = None) -> None:
    """Derive until nothing is left to do, or ``stop``; whoever else is at it is waited for.

    Changes beside which a transaction is still open cannot be followed and are left.
    """
    while stop is None or not stop.is_set():
        with sessions() as session:
            if look(session, LONG_S).idle:
                return
        if not follow(sessions):
            time.sleep(_PAUSE_S)


def _piece(sessions: Sessions) -> bool:
    """One piece; whether there was something to do and it was done."""
    with snapshot(sessions) as session:
        moment = look(session, LONG_S)
        write = _next(session, moment)
    if write is None:
        return False
    for _ in range(_TRIES):
        with suppress(_Busy):
            _commit(sessions, moment, write)
            return True
        time.sleep(_PAUSE_S)
    logger.debug("others were at the cells that were to be drawn again and again; later")
    return False


class _Busy(Exception):  # noqa: N818  (no error of the program)
    """Others hold what was to be written."""


def _commit(sessions: Sessions, moment: Moment, write: _Write) -> None:
    try:
        with sessions.begin() as session:
            if take_turn(session, moment) and not write(session):
                raise _Busy
    except OperationalError as error:
        if getattr(error.orig, "sqlstate", None) in _OTHERS_WRITE:
            raise _Busy from error
        raise


def _next(session: Session, moment: Moment) -> _Write | None:
    """What the next piece has to write; None: there is nothing to do."""
    if moment.elsewhere:
        return partial(_take_in, moment)
    # While changes come without end, a tile that has waited for long comes after every second piece of them.
    if moment.changes and not (moment.waits_long and moment.turn % 2):
        return _follow_changes(session, moment)
    waiting = session.execute(_NEXT, {"block": BLOCK, "long_s": LONG_S}).one_or_none()
    return None if waiting is None else _draw(session, *waiting)


def _take_in(moment: Moment, session: Session) -> bool:
    """Count some changes of another server as this transaction's; follow all of them anew."""
    session.execute(_FROM_ELSEWHERE, {"beyond": moment.beyond, "limit": AT_ONCE})
    if moment.brought:
        session.execute(_FROM_THE_START)
    return True


def _follow_changes(session: Session, moment: Moment) -> _Write:
    values = {"xid": moment.xid, "segment_id": moment.segment_id, "horizon": moment.horizon, "limit": AT_ONCE}
    changes = [Change(*row) for row in session.execute(_CHANGES, values)]
    ways = {way for change in changes for way in (change.way, change.former_way) if way is not None}
    rows = rows_of(segments_of(session, ways, [change.segment_id for change in changes]))

    def write(writing: Session) -> bool:
        write_ways(writing, ways, rows)
        note_followed(writing, changes)
        return True

    return write


def _draw(session: Session, level: int, tile: int) -> _Write:
    if level == FINEST:
        block = parent(FINEST, tile)
        inside = {"level": FINEST, "tiles": sorted(children(BLOCK, block))}
        tiles = list(session.execute(_WAITING_IN, inside).scalars())
        redrawn = drawn_store.draw_block(session, block, tiles)
    else:
        tiles, redrawn = [tile], drawn_store.draw_above(session, level, tile)

    def write(writing: Session) -> bool:
        writing.execute(_IS_DRAWN, {"level": level, "tiles": sorted(tiles)})
        return _write_tiles(writing, redrawn)

    return write


def _write_tiles(session: Session, redrawn: drawn_store.Redrawn) -> bool:
    exact: set[int] = set()
    any_of: dict[int, set[int]] = {}
    for level, after in redrawn.after.items():
        before = redrawn.before[level]
        changed = redrawn.changed(level)
        if not changed:
            continue
        drawn_store.replace_pieces(session, level, before, after)
        met = drawn_store.changed_tiles(level, before, after)
        if level == FINEST:
            exact = met
        else:
            any_of[level] = met
        if level in ABOVE:
            ask_to_draw(session, ABOVE[level], {parent(level, tile) for tile in changed})
    return not (exact or any_of) or drawn_store.raise_drawn(session, exact, any_of)
