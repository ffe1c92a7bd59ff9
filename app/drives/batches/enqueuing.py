"""Batches of drives put into the queue, and taken out of it again when they are cancelled, piece by piece.

Each piece is a transaction, and the batch's row holds how far it is: after a cut a worker continues there. Knows no
HTTP; its SQL is ``store``'s.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.errors import BadRequestError
from app.core.messages import say
from app.core.telemetry import audit
from app.core.telemetry.logs import tell
from app.drives.batches import store
from app.drives.batches.documents import Selection, Which
from app.drives.batches.touched import queue_touched
from app.drives.method_choice import check_options
from app.jobs.requests.pieces import do_pieces

ENQUEUE_FOR_S = 10.0
"""How long a request enqueues (or takes out) by itself; the rest is a worker's."""
TEND_FOR_S = 1.0
TEND_EVERY_S = 5.0
"""How often a worker looks for what requests left, and how long it goes on at a time, seconds."""
MOST_COUNT_ROWS = 2000
"""Changes of the counts of drives that may wait to be added up; reading so many takes a millisecond."""

logger = logging.getLogger(__name__)

_Piece = Callable[[Session, int], bool]


def reprocess_all(
    sessions: Sessions,
    selection: Selection,
    method: str | None,
    for_s: float = ENQUEUE_FOR_S,
    *,
    origin: str | None = None,
) -> tuple[int, int]:
    """Queue every drive of the selection again, behind uploads: by ``method``, or (None) as each was asked for.

    Returns the batch's number and how many drives it has put into the queue after at most ``for_s`` seconds; a worker
    goes on with the rest. The same request again, while it is enqueued, goes on as well; once it is enqueued, its
    drives wait, and are none of a further batch. Raises ``UnknownNameError`` for a method that there is not.
    ``origin``: who asked over HTTP, for the audit log.
    """
    check(selection, method)
    with sessions.begin() as session:
        batch = store.open_batch(session, selection, method)
        if origin is not None:
            chosen = selection.model_dump(mode="json", exclude_none=True)
            audit.note(session, origin, "drives asked for again", f"batch {batch}", **chosen, method=method)
    _go_on(sessions, store.enqueue_piece, batch, for_s)
    with sessions() as session:
        count = store.enqueued(session, batch)
    tell(logger, "batch queued", batch=batch, drives=count, which=selection.which, method=method)
    return batch, count


def check(selection: Selection, method: str | None) -> None:
    """``UnknownNameError`` for a method that there is not, ``ValueError`` where one is needed and none is named."""
    if selection.which is Which.OTHER and method is None:
        raise ValueError("other drives than of which method?")
    for name in (method, selection.from_method):
        if name is not None:
            check_options(name, {})


def cancel(
    sessions: Sessions, batch: int, for_s: float = ENQUEUE_FOR_S, *, origin: str | None = None
) -> None:
    """Take what still waits of the batch out of the queue: those drives are as they were, with all they published.

    What runs runs to its end. Raises ``BadRequestError`` for an import, and for a batch that an update asked for:
    its drives have said nothing before, or what cannot be read any more.
    """
    with sessions.begin() as session:
        if not store.cancel_batch(session, batch):
            raise BadRequestError(
                say("batch.stays"),
                field="batch",
            )
        if origin is not None:
            audit.note(session, origin, "batch cancelled", f"batch {batch}")
    _go_on(sessions, store.put_back_piece, batch, for_s)


def tend(sessions: Sessions) -> bool:
    """A worker's part: go on with what requests and imports left for a moment, add counts up; whether more is to be
    done."""
    if count := queue_touched(sessions):
        logger.info("%d drives are computed again, behind uploads: roads under them changed", count)
    with sessions.begin() as session:
        store.fold_counts(session, MOST_COUNT_ROWS)
        left = store.unfinished_batches(session)
    for batch, cancelled in left:
        piece = store.put_back_piece if cancelled else store.enqueue_piece
        if _go_on(sessions, piece, batch, TEND_FOR_S):
            return True
    return False


def give_jobs(sessions: Sessions) -> int:
    """Put drives that wait without a job into the queue, behind uploads; returns how many."""
    count, last = 0, None

    def piece(session: Session) -> bool:
        nonlocal count, last
        last = store.adopt_piece(session, last)
        count += 0 if last is None else last.drives
        return last is not None

    do_pieces(sessions, piece, between=partial(_keep_statistics, sessions))
    return count


def _go_on(sessions: Sessions, piece: _Piece, batch: int, for_s: float) -> bool:
    """Piece after piece until all is done or the time is up; whether there may be more."""
    between = partial(_keep_statistics, sessions)
    return do_pieces(sessions, lambda session: piece(session, batch), for_s=for_s, between=between)


def _keep_statistics(sessions: Sessions, pieces: int) -> None:
    """After the first piece, the second, the fourth: figures of a queue half as long mislead nobody."""
    if not pieces & (pieces - 1):
        with sessions.begin() as session:
            store.refresh_statistics(session)
