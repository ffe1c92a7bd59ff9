"""Requests over very many rows, which are done piece by piece, each a short transaction.

What is left when the time is up, or the process is cut off, somebody goes on with: the rows say where.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.jobs.task import Interrupted


def never() -> bool:
    """Nobody asks to stop."""
    return False


def do_pieces(
    sessions: Sessions,
    piece: Callable[[Session], bool],
    *,
    for_s: float = float("inf"),
    should_stop: Callable[[], bool] = never,
    between: Callable[[int], None] = lambda _: None,
) -> bool:
    """Piece after piece, one at least, until there is no more or the time is up; whether there may be more.

    ``piece`` returns whether there may be more; ``between`` is told after each such piece how many were done. Raises
    ``Interrupted`` when ``should_stop`` is true.
    """
    until_s, pieces, more = time.monotonic() + for_s, 0, True
    while more and (not pieces or time.monotonic() < until_s):
        if should_stop():
            raise Interrupted
        with sessions.begin() as session:
            more = piece(session)
        pieces += 1
        if more:
            between(pieces)
    return more
