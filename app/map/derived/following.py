"""Ways and drawn pieces follow the changes of segments: what changed is derived anew, and nothing else.

Segments are changed by whoever changes them, and triggers note which (``SegmentChange``). Nobody who does waits for
what is derived: workers follow a moment later, in pieces. Each reads one snapshot, computes outside of any lock, and
writes in one short transaction what came of it together with how far it is; it may die at any moment. First come the
changes, which one lane at a time follows: the ways they belong to are made anew, and their cells are noted. The tiles
of each level, the finest first, are drawn by as many lanes as there are, each another one (``waiting``).

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

from app.core.claims import Claim
from app.core.db import Sessions
from app.map.derived import drawn_store, waiting
from app.map.derived.drawing import ABOVE, BLOCK, FINEST, parent
from app.map.derived.way_store import rows_of, segments_of, write_ways
from app.network.locks import deriving_claim
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
    """Keep others who follow out of what is left of the transaction, which waits for nobody; False: one has written."""
    return bool(session.execute(_TURN, {"turn": moment.turn}).rowcount)  # type: ignore[attr-defined]


def note_followed(session: Session, changes: Collection[Change]) -> None:
    """These are followed, in this order: their tiles are to be drawn anew, and where they are is known."""
    there = [c for c in changes if c.way is not None]
    columns = {"ids": "segment_id", "ways": "way", "cells": "cell"}
    session.execute(_FOLLOWED, {k: [getattr(c, name) for c in there] for k, name in columns.items()})
    session.execute(_GONE, {"ids": [c.segment_id for c in changes if c.way is None]})
    waiting.ask_to_draw(
        session, FINEST, {cell for c in changes for cell in (c.cell, c.former_cell) if cell is not None}
    )
    last = max(changes)
    session.execute(_UP_TO, {"xid": last.xid, "segment_id": last.segment_id})


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

_LOOKED_AT = 64
"""Tiles that wait, of which a lane takes the first that nobody is drawing."""

_Write = Callable[[Session], bool]
"""What a piece writes; False: others are at it just now, and nothing may be written."""


def follow(sessions: Sessions, for_s: float = PIECE_S) -> bool:
    """Derive what is to be for about so long; whether there is more to do. What others are at is left to them."""
    until_s = time.monotonic() + for_s
    with sessions() as session:
        if look(session, LONG_S).idle:
            return False
    with deriving_claim(sessions) as claim:
        leads = bool(claim.take())
        while _piece(sessions, claim, leads=leads):
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


def _piece(sessions: Sessions, claim: Claim, *, leads: bool) -> bool:
    """One piece; whether there was something to do and it was done. Who leads follows changes as well."""
    write = _follow(sessions) if leads else None
    if write is None:
        write = _draw_next(sessions, claim, leads=leads)
    if write is None and leads:  # others are drawing all that waits
        write = _follow(sessions, tiles_first=False)
    if write is None:
        return False
    for _ in range(_TRIES):
        with suppress(_Busy):
            _commit(sessions, write)
            return True
        time.sleep(_PAUSE_S)
    logger.debug("others were at the cells that were to be drawn again and again; later")
    return False


class _Busy(Exception):  # noqa: N818  (no error of the program)
    """Others hold what was to be written."""


def _commit(sessions: Sessions, write: _Write) -> None:
    try:
        with sessions.begin() as session:
            session.execute(_SHORT_WAITS)
            if not write(session):
                raise _Busy
    except OperationalError as error:
        if getattr(error.orig, "sqlstate", None) in _OTHERS_WRITE:
            raise _Busy from error
        raise


def _in_turn(moment: Moment, write: _Write, session: Session) -> bool:
    """Unless another has followed changes meanwhile, who had lost the lead or has it now: then nothing is written."""
    return not take_turn(session, moment) or write(session)


def _follow(sessions: Sessions, *, tiles_first: bool = True) -> _Write | None:
    """What the next piece of changes has to write; None: there is none, or it is the tiles' turn."""
    with snapshot(sessions) as session:
        moment = look(session, LONG_S)
        if moment.elsewhere:
            return partial(_in_turn, moment, partial(_take_in, moment))
        # While changes come without end, a tile that has waited for long comes after every second piece of them.
        if moment.changes and not (tiles_first and moment.waits_long and moment.turn % 2):
            return partial(_in_turn, moment, _follow_changes(session, moment))
    return None


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


def _draw_next(sessions: Sessions, claim: Claim, *, leads: bool) -> _Write | None:
    """What is to be written of the next tile that nobody else is drawing; None: there is none.

    While there are changes to follow, tiles are asked for anew again and again: then they are for who leads.
    """
    with sessions() as session:
        if not leads and look(session, LONG_S).changes:
            return None
        units = waiting.next_units(session, LONG_S, _LOOKED_AT)
    unit = next((unit for unit in units if claim.take([unit.key])), None)
    if unit is None:
        return None
    with snapshot(sessions) as session:
        moment = look(session, LONG_S)
        asked = waiting.asked_of(session, unit)
        if unit.level == BLOCK:
            tiles = [one.tile for one in asked if one.level == FINEST]
            redrawn = drawn_store.draw_block(session, unit.tile, tiles)
        else:
            redrawn = drawn_store.draw_above(session, unit.level, unit.tile)

    def write(writing: Session) -> bool:
        # Else somebody was quicker, or it is drawn once more.
        return not asked or not waiting.take_off(writing, asked) or _write_tiles(writing, redrawn)

    return partial(_in_turn, moment, write) if leads else write


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
            waiting.ask_to_draw(session, ABOVE[level], {parent(level, tile) for tile in changed})
    return not (exact or any_of) or drawn_store.raise_drawn(session, exact, any_of)
