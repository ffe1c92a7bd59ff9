"""Uploads, reruns and removals of drives: row and job in one transaction, and the blob beside them.

Also the sweep of blobs that lost their drive. Knows no HTTP; its SQL is the store's.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from app.access.store import hold_owner
from app.core.blobs import BlobStore, StoredBlob
from app.core.caller import as_caller, present_caller
from app.core.databases import database_identity
from app.core.db import Sessions
from app.core.telemetry import audit
from app.core.telemetry.logs import about, tell
from app.drives import queue
from app.drives import store as drives
from app.drives.documents import Drive
from app.drives.method_choice import check_options, chosen_anew

SHOWN_ORPHANS = 20
"""Number of blobs that the log names, of those that a sweep would remove."""

LOST_COMMIT_WAIT_S = 5.0
"""Wait for a commit that was not answered: the database may still hold the broken connection."""

WRITTEN_WITHIN_S = 15.0
"""For so long a removal waits for the worker that is writing what the drive says; it holds the drive's row."""

Count = Callable[[Session, int], None]
Begin = Callable[[Session, Drive], None]

logger = logging.getLogger(__name__)


def _enqueue(session: Session, drive: Drive) -> None:
    queue.enqueue(session, drive.id, drive.generation)


def register_upload(
    sessions: Sessions,
    blobs: BlobStore,
    blob: StoredBlob,
    *,
    filename: str,
    method: str,
    options: Mapping[str, Any] | None = None,
    count: Count | None = None,
    begin: Begin = _enqueue,
) -> tuple[Drive, bool]:
    """Make a stored blob a queued drive; row and job in one transaction. The flag says whether the drive is new.
    ``count`` is told of a new one's size within that transaction, and may refuse it by an error. ``begin`` takes the
    place of its job: whatever the drive is to have when it is there.

    Content that the caller's owner has already gives the drive that has it, which keeps its own blob unless that is
    lost; one whose log was deleted, because its owner keeps logs no longer, gets none by that. The new blob becomes the
    drive's or is deleted. It stays where nobody can tell whether it became a drive's, as when this process dies:
    ``sweep_blobs`` later removes blobs without a drive.
    """
    caller = present_caller()
    request = _Request({"filename": filename, "method": method, "options": options or {}}, count, begin)
    try:
        check_options(method, options or {})
        with as_caller(caller.as_owner):  # a key that may only upload sees but a part of what its owner has
            try:
                drive, created = _add(sessions, blobs, blob, request)
            except _CommitLostError as lost:
                drive, created = _add_again(sessions, blobs, blob, request, lost)
    except _CommitLostError as lost:
        raise (lost.__cause__ or lost) from None
    except Exception:
        blobs.delete(blob.key)
        raise
    if drive.blob_key != blob.key:
        blobs.delete(blob.key)
    if not created and caller.scope == "upload":
        with as_caller(caller.as_owner), sessions.begin() as session:
            drives.note_sender(session, drive.id)
    with about(drive=drive.id):
        event = "drive uploaded" if created else "drive uploaded again"
        tell(logger, event, bytes=drive.size_bytes, method=drive.method, state=drive.status)
        tell(logger, "drive's file", level=logging.DEBUG, filename=filename)
    return drive, created


@dataclass(frozen=True)
class _Request:
    """What a new drive is, but for its file, and who counts it."""

    columns: Mapping[str, Any]
    count: Count | None
    begin: Begin


class _CommitLostError(Exception):
    """Nobody knows whether the transaction was committed; its cause is what went wrong."""

    def __init__(self, created: bool) -> None:
        """``created`` tells whether the transaction made a drive."""
        super().__init__("the database did not say whether it committed an upload")
        self.created = created


def _add(
    sessions: Sessions,
    blobs: BlobStore,
    blob: StoredBlob,
    request: _Request,
    wait_s: float | None = None,
) -> tuple[Drive, bool]:
    """Add the drive or find that of the same content; ``_CommitLostError`` when the commit was not answered."""
    with sessions() as session:
        if wait_s is not None:
            drives.wait_at_most(session, wait_s)
        # Before the drive refers to the blob: another database's sweep must not take it for an orphan.
        blobs.register_database(database_identity(session))
        hold_owner(session)
        drive, created = _create_or_heal(session, blobs, blob, request)
        try:
            session.commit()
        except Exception as error:
            if isinstance(error, DBAPIError) and not error.connection_invalidated:
                raise  # the database said no
            raise _CommitLostError(created) from error
    return drive, created


def _add_again(
    sessions: Sessions,
    blobs: BlobStore,
    blob: StoredBlob,
    request: _Request,
    lost: _CommitLostError,
) -> tuple[Drive, bool]:
    """``_add`` over another connection: it waits for a commit that is under way and finds what that left."""
    logger.warning("an upload's commit was not answered, and is asked for again: %s", lost.__cause__)
    try:
        drive, created = _add(sessions, blobs, blob, request, LOST_COMMIT_WAIT_S)
    except Exception:
        raise lost from lost.__cause__
    return drive, created or (lost.created and drive.blob_key == blob.key)


def _create_or_heal(
    session: Session, blobs: BlobStore, blob: StoredBlob, request: _Request
) -> tuple[Drive, bool]:
    """A new drive and its job, or the drive of the same content; one whose blob is lost gets this one.

    A failed drive is then computed again: most likely it failed because its blob was lost.
    """
    stored: dict[str, Any] = {"sha256": blob.sha256, "size_bytes": blob.size_bytes, "blob_key": blob.key}
    while True:
        drive, created = drives.create_drive(
            session, **stored, content_sha256=blob.content_sha256, **request.columns
        )
        if created:
            request.begin(session, drive)
            if request.count is not None:  # last: others of the same owner wait from here to the commit
                request.count(session, blob.size_bytes)
            return drive, True
        if drive.log_deleted_at is not None or blobs.exists(drive.blob_key):
            return drive, False
        if drives.give_blob(session, drive, **stored):
            break
        # it was deleted meanwhile, or another upload was faster
    logger.info("drive %s had lost its file and has another one", drive.id)
    healed = drives.get_drive(session, drive.id)
    if drive.status == "failed":
        healed = drives.request_reprocess(session, drive.id, drive.method, drive.options)
        queue.enqueue(session, drive.id, drive.generation + 1)
    return healed or drive, False


def reprocess(
    sessions: Sessions,
    drive_id: uuid.UUID,
    method: str | None = None,
    options: Mapping[str, Any] | None = None,
    positioning: Mapping[str, Any] | None = None,
) -> Drive | None:
    """Queue the drive again; without ``method`` with the method and options it had. None: no such drive;
    ``LogDeletedError``: it has no log any more.

    ``positioning`` is put into the options (``with_positioning``).
    """
    with sessions.begin() as session:
        former = drives.get_drive(session, drive_id)
        if former is None:
            return None
        former.require_log()
        chosen = chosen_anew(method, options, positioning or {}, (former.method, former.options))
        drive = drives.request_reprocess(session, drive_id, *chosen)
        if drive is not None:
            queue.enqueue(session, drive.id, drive.generation)
    if drive is not None:
        tell(logger, "drive queued again", drive=drive_id, method=drive.method, run=drive.generation)
    return drive


def remove_drive(sessions: Sessions, drive_id: uuid.UUID, origin: str | None = None) -> bool:
    """Cancel a drive whatever its status, and queue its removal; False when there is none, or it was cancelled before.

    From now on nothing of it is shown, and a worker that computes it, or a trial of it, discards the result. Its
    influence, its bytes and its row are removed soon (``app.drives.publishing``). ``origin``: who asked over HTTP, for
    the audit log.
    """
    with sessions.begin() as session:
        drives.wait_at_most(session, WRITTEN_WITHIN_S)
        generation = drives.request_removal(session, drive_id)
        if generation is None:
            return False
        queue.enqueue_removal(session, drive_id, generation)
        if origin is not None:
            audit.note(session, origin, "drive removed", drive_id)
    tell(logger, "drive cancelled", drive=drive_id, reason="its removal was asked for")
    return True


def sweep_blobs(
    sessions: Sessions, blobs: BlobStore, older_than: timedelta, *, confirmed: bool = False
) -> Sweep:
    """Remove parts of uploads that broke off, and blobs older than ``older_than`` that no drive refers to.

    Another database may share the store, or this one may be its restored backup: a blob without a drive here may have
    one there. Then only parts are removed, and the log says what else would be. ``confirmed`` says that this database
    is the only one; the others are forgotten.
    """
    parts = blobs.sweep()
    with sessions() as session:
        identity = database_identity(session)
    blobs.register_database(identity)
    if confirmed:
        blobs.forget_databases(identity)
    stored = blobs.keys()
    with sessions() as session:
        unreferenced = drives.unreferenced_blobs(session, stored)
    orphans = blobs.older(unreferenced, older_than)
    strangers = tuple(name for name in blobs.databases() if name != identity)
    if not strangers:
        for key in orphans:
            blobs.delete(key)
    elif orphans:
        logger.warning(
            "%d blobs without a drive stay, the first: %s. Other databases have used this store (%s). If they are gone "
            "and no other backup may be restored, `versant sweep --only-database` removes these blobs.",
            len(orphans),
            ", ".join(orphans[:SHOWN_ORPHANS]),
            ", ".join(strangers),
        )
    return Sweep(parts, tuple(orphans), strangers)


@dataclass(frozen=True)
class Sweep:
    """Result of a sweep: parts of uploads, removed; old blobs without a drive, removed unless there are strangers."""

    parts: int
    orphans: tuple[str, ...]
    strangers: tuple[str, ...]
    """Identities of other databases that have used the store."""

    @property
    def removed(self) -> int:
        """How many files are gone."""
        return self.parts + (0 if self.strangers else len(self.orphans))
