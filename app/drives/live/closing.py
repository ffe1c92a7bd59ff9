"""Drives that are over become logs, by the same way as uploads; points that come late are put where they belong.

Which points are one drive is told by all that there are (``cutting``): those of the stream, and those of drives that
were made of it and lie so near in time that they may be one. So a point that comes when its drive is closed is put into
that drive's log, which is computed anew, fills the gap between two, or makes a drive of its own: as if it had come in
its turn. A repeated one is in the log already and goes.

Points leave the stream in the transaction that makes the drive, or gives it its new log. Whoever dies before leaves
them there, and a file that nobody refers to, which goes by and by.
"""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from app.access.quotas import Quotas
from app.core.blobs import BlobStore, StoredBlob
from app.core.caller import Caller, as_caller, guarded
from app.core.db import Sessions
from app.core.errors import ConflictError, QuotaError, UnauthorizedError
from app.core.settings import Settings
from app.core.telemetry.logs import tell
from app.drives import intake, queue
from app.drives import store as drives
from app.drives.documents import Drive
from app.drives.live import store
from app.drives.live.cutting import (
    LONGEST_US,
    MOST_POINTS,
    Piece,
    cut,
    filename_of,
    log_of,
    merged,
    points_in,
)
from app.drives.live.points import US, LivePoint
from app.drives.live.store import Closed, Stream
from app.drives.method_choice import default_method

LOOK_EVERY_S = 5.0
"""How often a worker looks for drives that are over."""
PIECE_S = 1.0
"""Then it lets others go first."""
AT_ONCE = 50
AGAIN_S = 60.0
"""After something went wrong with a stream."""
QUOTA_S = 900.0
"""While its owner has no quota left: nothing is lost, it waits."""
WAITS_DAYS = 2
"""For so long points that went nowhere wait for others that make a drive of them."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Made:
    """A drive as it is to be: its points, those of them that are in the stream, and the drives that it takes the place
    of, of which it keeps the first."""

    points: list[LivePoint]
    open_us: list[int]
    olds: list[Closed]


class Closer:
    """Makes logs of what is over."""

    def __init__(self, sessions: Sessions, blobs: BlobStore, settings: Settings) -> None:
        """``sessions``: a worker's."""
        self._sessions, self._blobs, self._settings = sessions, blobs, settings
        self._owners = guarded(sessions)
        self._silence_us = round(settings.live_silence_s * US)

    def look(self) -> bool:
        """Close what is over, for a second at most; whether there may be more."""
        until = time.monotonic() + PIECE_S
        with self._sessions.begin() as session:
            due = store.due_streams(session, AT_ONCE)
            if not due:
                store.forget_old(session)
        for stream_id in due:
            self._look_at(stream_id)
            if time.monotonic() > until:
                return True
        return len(due) == AT_ONCE

    def _look_at(self, stream_id: int) -> None:
        with self._sessions.begin() as session:
            stream = store.take(session, stream_id)
            if stream is None:
                return
            points = store.points_of(session, stream_id, 2 * MOST_POINTS)
            try:
                with as_caller(Caller("own", stream.owner_id, stream.key_id)):
                    after_s = self._close(stream, points)
            except UnauthorizedError:  # the owner is being removed, and this goes with it
                after_s = AGAIN_S
            except QuotaError as error:
                tell(logger, "drive waits for its owner's quota", owner=stream.owner_id, reason=str(error))
                after_s = QUOTA_S
            except Exception:
                logger.warning("a stream of points could not be looked at; trying again later", exc_info=True)
                after_s = AGAIN_S
            store.look_again(session, stream, after_s)

    def _close(self, stream: Stream, points: list[LivePoint]) -> float | None:
        """Make drives of what is over; after how many seconds to look again, None: when something comes."""
        silence_s = self._settings.live_silence_s
        is_silent = stream.silent_s >= silence_s
        pieces, left = cut(points, self._silence_us), 0
        for piece in pieces:
            if not (piece.is_over or is_silent):
                return max(silence_s - stream.silent_s, 0.1)
            left += not self._close_piece(stream, points[piece.begin : piece.end], piece)
        if len(points) == 2 * MOST_POINTS:
            return 0.0
        return 3600.0 if left else None

    def _close_piece(self, stream: Stream, points: list[LivePoint], piece: Piece) -> bool:
        """Whether none of the points is in the stream any more."""
        around = points[0].time_us - self._silence_us, points[-1].time_us + self._silence_us
        with self._owners() as session:
            near = store.closed_between(session, stream.id, *around)
        kept = [one for one in near if one.has_log]
        if len(kept) < len(near):
            points = self._let_go(stream, points, [one for one in near if not one.has_log])
        if not kept and not piece.moved:
            return self._forget_old(stream, points)
        # Drives of their own in front: cut off after them, what is left finds them.
        made = self._as_if_in_turn(points, kept)
        for one in sorted(made, key=lambda one: bool(one.olds)):
            self._record(stream, one)
        recorded = {time_us for one in made for time_us in one.open_us}
        return self._forget_old(stream, [point for point in points if point.time_us not in recorded])

    def _let_go(self, stream: Stream, points: list[LivePoint], logless: list[Closed]) -> list[LivePoint]:
        """Without those of a time of which there is a drive whose owner keeps its log no longer."""
        gone = [p.time_us for p in points if any(c.begins_us <= p.time_us <= c.ends_us for c in logless)]
        with self._owners.begin() as session:
            store.remove_points(session, stream.id, gone)
        return [point for point in points if point.time_us not in set(gone)]

    def _forget_old(self, stream: Stream, points: list[LivePoint]) -> bool:
        """Whether none of these, which went nowhere, is left: they have waited for long enough, or are as much as a
        drive may be, so that nothing can be made of them."""
        times_us = [point.time_us for point in points]
        is_full = len(points) >= MOST_POINTS or (bool(points) and times_us[-1] - times_us[0] >= LONGEST_US)
        with self._owners.begin() as session:
            waited_days = 0 if is_full else WAITS_DAYS
            return store.remove_points(session, stream.id, times_us, waited_days=waited_days) == len(points)

    def _as_if_in_turn(self, points: list[LivePoint], near: list[Closed]) -> list[_Made]:
        """The drives that these points and those of ``near`` are, but for what went nowhere."""
        known: list[LivePoint] = []
        for one in near:
            with self._blobs.open(one.blob_key) as log:
                known = merged(known, points_in(log.read()))
        everything, opened = merged(known, points), {point.time_us for point in points}
        made = []
        for piece in cut(everything, self._silence_us):
            part = everything[piece.begin : piece.end]
            olds = [one for one in near if part[0].time_us <= one.begins_us <= part[-1].time_us]
            open_us = [point.time_us for point in part if point.time_us in opened]
            if olds or piece.moved:
                made.append(_Made(part, open_us, olds))
            elif made and len(open_us) < len(part):  # what a log has stays in one
                made[-1] = _Made(made[-1].points + part, made[-1].open_us + open_us, made[-1].olds)
        return made

    def _record(self, stream: Stream, made: _Made) -> None:
        times_us = [point.time_us for point in made.points]
        log = log_of(made.points)
        if not made.olds:
            self._register(stream, made, self._stored(log), times_us)
            return
        first = made.olds[0]
        with self._blobs.open(first.blob_key) as before:
            is_same = len(made.olds) == 1 and before.read() == log
        if is_same:
            with self._owners.begin() as session:
                store.remove_points(session, stream.id, made.open_us)
        else:
            self._replace(stream, made, self._stored(log), times_us)

    def _stored(self, log: bytes) -> StoredBlob:
        with self._blobs.writer(keep_free_bytes=self._settings.min_free_bytes) as writer:
            writer.write(log)
            return writer.finish()

    def _register(self, stream: Stream, made: _Made, blob: StoredBlob, times_us: Sequence[int]) -> None:
        def begin(session: Session, drive: Drive) -> None:
            queue.enqueue(session, drive.id, drive.generation)
            store.note_drive(session, stream.id, drive.id, times_us)

        drive, created = intake.register_upload(
            self._owners,
            self._blobs,
            blob,
            filename=filename_of(stream.sender, stream.device, made.points),
            method=default_method(self._settings),
            count=Quotas(self._settings).count,
            begin=begin,
        )
        if not created:
            with self._owners.begin() as session:
                store.note_drive(session, stream.id, drive.id, times_us)
        tell(logger, "drive under way closed", drive=drive.id, points=len(times_us), state=drive.status)

    def _replace(self, stream: Stream, made: _Made, blob: StoredBlob, times_us: Sequence[int]) -> None:
        """Give the first of the drives the log of all, and let the others go, in one transaction."""
        first, *others = made.olds
        replaced = None
        try:
            with self._owners.begin() as session:
                replaced = drives.replace_log(
                    session,
                    first.drive_id,
                    first.blob_key,
                    blob_key=blob.key,
                    sha256=blob.sha256,
                    content_sha256=blob.content_sha256,
                    size_bytes=blob.size_bytes,
                )
                if replaced is not None:
                    queue.enqueue(session, replaced.id, replaced.generation)
                    for one in others:
                        _remove(session, one.drive_id)
                    store.note_drive(session, stream.id, first.drive_id, times_us)
        except ConflictError:  # its owner has uploaded the very same: that drive has these points
            with self._owners.begin() as session:
                store.remove_points(session, stream.id, made.open_us)
        self._blobs.delete(blob.key if replaced is None else first.blob_key)
        tell(logger, "points came late", drive=first.drive_id, points=len(made.open_us))


def _remove(session: Session, drive_id: uuid.UUID) -> None:
    generation = drives.request_removal(session, drive_id)
    if generation is not None:
        queue.enqueue_removal(session, drive_id, generation)
