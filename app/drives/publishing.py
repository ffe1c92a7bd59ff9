"""What comes after a drive has said what it has to say: cells are solved, drives become done, removed ones go.

Between both stand marks (``app.network.marks``): a drive is done once its cells were solved with it, and gone once
they were solved without it. All of it may be cut off at any moment and done twice.
"""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Sequence

from sqlalchemy.orm import Session

from app.changes.webhooks.store import DRIVE_DONE, announce_drive
from app.core.blobs import BlobStore
from app.core.db import Bounds, Sessions
from app.core.telemetry import tracing
from app.core.telemetry.logs import about, tell
from app.core.telemetry.measures import DRIVES_DONE, STAGE_S
from app.drives import claims, queue
from app.drives.batches.store import fold_counts
from app.exports import store as exports
from app.map.derived import following
from app.map.tiles.store import drop_tiles
from app.network import results as slopes
from app.network.marks import MarkedBy, any_due, any_solvable, count_cells, make_due
from app.network.rejections import Rejections, rejections_of
from app.network.settle import settle_due
from app.network.swap import BusyError, solve_marked
from app.roads import retired

logger = logging.getLogger(__name__)

SOLVING_S = 0.5
"""While drives wait, a cell that is marked waits for so long times the number of marked ones: solving one takes about
a fifth of that (``benchmarks/publishing.py``), so that most of the time is the drives'."""

SETTLE_AFTER_S = 600.0
"""What changed is settled in a wide window so long after, when nothing else waits."""


REACH_DEG = 0.1
"""So far from a drive may lie what the map said on account of it: heights are carried over undriven gaps."""

DERIVE_PAUSE_S = 15.0
"""While drives wait, what is derived from segments follows no more often than that: they come first, and one piece does
for all that has changed by then."""


def patience_s(session: Session, publish_every_s: float, *, behind: bool) -> float:
    """How long a drive's cells may wait to be solved, s: not at all, unless other drives wait as well.

    ``behind``: the drive is of those that are processed again by the thousand.
    """
    if not queue.drives_wait(session, behind=behind):
        return 0.0
    return max(publish_every_s, SOLVING_S * count_cells(session))


def solve_some(sessions: Sessions, blobs: BlobStore) -> int:
    """Solve cells that are due, and see to the drives that waited for them; the number of cells.

    Where more are due than one solver takes, another is asked for first.
    """

    def ask() -> None:
        with sessions.begin() as session:
            queue.enqueue_solve(session)

    with tracing.span("solve") as span:
        try:
            count = solve_marked(sessions, more=ask, published=lambda: finish(sessions, blobs))
        except BusyError:
            logger.info("cells that others write in are left for the next solver", exc_info=True)
            count = 0
        span.note(cells=count)
    finish(sessions, blobs)
    return count


def look_after(sessions: Sessions, blobs: BlobStore) -> None:
    """Finish drives whose cells were solved elsewhere, and ask for a solver where marks are due and none waits.

    Cells wait for the sake of drives that wait: when none does any more, all are due.
    """
    finish(sessions, blobs)
    with sessions.begin() as session:
        if not queue.drives_wait(session, behind=True):
            make_due(session)
        if any_due(session):
            queue.enqueue_solve(session)


def settle_quietly(sessions: Sessions) -> bool:
    """Settle a cell that has changed a while ago, when no drive waits; whether there was one.

    What no solver can solve keeps the rest from being settled no longer than it takes to find that out.
    """
    with sessions() as session:
        if queue.drives_wait(session, behind=True) or any_solvable(session):
            return False
    return settle_due(sessions, SETTLE_AFTER_S)


class Deriver:
    """Lets ways and what low zooms draw follow what was published, or imported, a piece at each call."""

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions
        self._not_before_s = 0.0

    def piece(self) -> bool:
        """The next piece, if it is time for one; whether there is more to do."""
        if time.monotonic() < self._not_before_s:
            return False
        more = following.follow(self._sessions)
        with self._sessions() as session:
            if queue.drives_wait(session, behind=True):
                self._not_before_s = time.monotonic() + DERIVE_PAUSE_S
        return more


def finish(sessions: Sessions, blobs: BlobStore) -> int:
    """End the drives of which no mark is left: those that were published are done, those that were removed go.

    Done are also those of which only marks in cells are left that no solver can solve.
    """
    with sessions.begin() as session:
        published = claims.published_drives(session)
        for drive in published:
            claims.mark_done(session, drive.id)
            facts = {"method": drive.method, "segments": drive.report.get("segments_estimated")}
            announce_drive(session, DRIVE_DONE, drive.id, facts)
        rejections = rejections_of(session, [drive.id for drive in published])
    for drive in published:
        _tell_done(drive, rejections.get(drive.id))
    with sessions.begin() as session:
        removed = claims.delete_removed(session)
        files = _clear_up(session, [one.bbox for one in removed if one.bbox is not None]) if removed else []
    for one in removed:
        blobs.delete(one.blob_key)
        tell(logger, "drive deleted", drive=one.id)
    for key in files:
        blobs.delete(key)
    return len(published) + len(removed)


def _clear_up(session: Session, boxes: Sequence[Bounds]) -> list[str]:
    """Take away what tells of removed drives that were in these boxes and does not go with their rows; the files that
    nobody refers to any more."""
    retired.delete_empty(session)
    fold_counts(session, most_rows=0)
    if not boxes:
        return []
    wide = [(w - REACH_DEG, s - REACH_DEG, e + REACH_DEG, n + REACH_DEG) for w, s, e, n in boxes]
    drop_tiles(session, wide)
    return exports.end_over(session, wide)


def _tell_done(drive: claims.Published, rejections: Rejections | None) -> None:
    DRIVES_DONE.count(drive.method)
    if drive.waited_s is not None:
        STAGE_S.observe(drive.waited_s, "publishing", drive.method)
    with about(drive=drive.id):
        tell(
            logger,
            "drive done",
            method=drive.method,
            km=None if drive.distance_m is None else drive.distance_m / 1000,
            segments=drive.report.get("segments_estimated"),
            rejected_segments=rejections.rejected if rejections else 0,
            warnings=len(drive.report.get("warnings", ())),
            publishing_s=drive.waited_s,
        )


def remove(sessions: Sessions, blobs: BlobStore, drive_id: uuid.UUID, generation: int) -> None:
    """Take back what a drive said whose removal was asked for, and delete its log; its row goes when its cells are
    solved, however long that takes."""
    with sessions.begin() as session:
        slopes.begin_change(session, drive_id)
        blob_key = claims.mark_removing(session, drive_id, generation)
        if blob_key is not None:
            slopes.append_removal(session, MarkedBy(drive_id, generation))
            queue.enqueue_solve(session)
    if blob_key is not None:
        blobs.delete(blob_key)
    finish(sessions, blobs)
