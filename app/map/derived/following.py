"""Ways and drawn pieces follow the changes of segments: what changed is derived anew, and nothing else.

Segments are changed by whoever changes them, and triggers note which (``SegmentChange``). Nobody who does waits for
what is derived: a worker follows a moment later, in pieces. Each reads one snapshot, computes outside of any lock, and
writes in one short transaction what came of it together with how far it is; it may die at any moment. First come the
changes: the ways they belong to are made anew, and their cells are noted; then the tiles of each level, the finest
first.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.map.derived import store
from app.map.derived.drawn_store import (
    Redrawn,
    changed_tiles,
    draw_above,
    draw_block,
    raise_drawn,
    replace_pieces,
)
from app.map.derived.pieces import ABOVE, BLOCK, FINEST, children, parent
from app.map.derived.store import Moment
from app.map.derived.way_store import rows_of, segments_of, write_ways
from app.network.swap import snapshot

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
        if store.look(session, LONG_S).idle:
            return False
    with store.deriving_alone(sessions) as alone:
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
            if store.look(session, LONG_S).idle:
                return
        if not follow(sessions):
            time.sleep(_PAUSE_S)


def _piece(sessions: Sessions) -> bool:
    """One piece; whether there was something to do and it was done."""
    with snapshot(sessions) as session:
        moment = store.look(session, LONG_S)
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
            if store.take_turn(session, moment) and not write(session):
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
    waiting = store.next_tile(session, LONG_S)
    if waiting is None:
        return None
    return _draw(session, *waiting)


def _take_in(moment: Moment, session: Session) -> bool:
    store.take_in(session, moment, AT_ONCE)
    return True


def _follow_changes(session: Session, moment: Moment) -> _Write:
    changes = store.changes_after(session, moment, AT_ONCE)
    ways = {way for change in changes for way in (change.way, change.former_way) if way is not None}
    rows = rows_of(segments_of(session, ways, [change.segment_id for change in changes]))

    def write(writing: Session) -> bool:
        write_ways(writing, ways, rows)
        store.note_followed(writing, changes)
        return True

    return write


def _draw(session: Session, level: int, tile: int) -> _Write:
    if level == FINEST:
        block = parent(FINEST, tile)
        tiles = store.waiting_among(session, FINEST, children(BLOCK, block))
        redrawn = draw_block(session, block, tiles)
    else:
        tiles, redrawn = [tile], draw_above(session, level, tile)

    def write(writing: Session) -> bool:
        store.note_drawn(writing, level, tiles)
        return _write_tiles(writing, redrawn)

    return write


def _write_tiles(session: Session, redrawn: Redrawn) -> bool:
    exact: set[int] = set()
    any_of: dict[int, set[int]] = {}
    for level, after in redrawn.after.items():
        before = redrawn.before[level]
        changed = redrawn.changed(level)
        if not changed:
            continue
        replace_pieces(session, level, before, after)
        met = changed_tiles(level, before, after)
        if level == FINEST:
            exact = met
        else:
            any_of[level] = met
        if level in ABOVE:
            store.ask_to_draw(session, ABOVE[level], {parent(level, tile) for tile in changed})
    return not (exact or any_of) or raise_drawn(session, exact, any_of)
