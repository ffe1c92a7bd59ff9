"""Drives that come, come again or go: row and job in one transaction, and the blob beside them.

Uploads, reruns, removals, and the sweep of blobs that lost their drive. Knows no HTTP; its SQL is the store's.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Mapping
from datetime import timedelta
from typing import Any

from app.core.blobs import BlobStore, StoredBlob
from app.core.databases import database_identity
from app.core.db import Sessions
from app.drives import queue
from app.drives import store as drives
from app.drives.documents import Drive
from fusion.pipeline import parse_options

ORPHAN_AGE = timedelta(hours=1)
"""A blob exists for a moment before its drive does: one that is older and without a drive is an orphan."""

logger = logging.getLogger(__name__)


def register_upload(
    sessions: Sessions,
    blobs: BlobStore,
    blob: StoredBlob,
    *,
    filename: str,
    method: str,
    options: Mapping[str, Any] | None = None,
) -> tuple[Drive, bool]:
    """Make a stored blob a queued drive; row and job in one transaction.

    The blob becomes the drive's, or is deleted: when the same bytes are known already, and when the
    transaction fails. Only a process that dies in between leaves a blob that nobody refers to: ``sweep_blobs``
    removes it later; an upload of the same bytes brings its own.
    """
    try:
        parse_options(method, options or {})
        with sessions.begin() as session:
            # Before the drive refers to the blob: another database's sweep must not take it for an orphan.
            blobs.register_database(database_identity(session))
            drive, created = drives.create_drive(
                session,
                sha256=blob.sha256,
                filename=filename,
                size_bytes=blob.size_bytes,
                blob_key=blob.key,
                method=method,
                options=options or {},
            )
            if created:
                queue.enqueue(session, drive.id, drive.generation)
    except BaseException:
        blobs.delete(blob.key)
        raise
    if not created:
        blobs.delete(blob.key)
    return drive, created


def reprocess(
    sessions: Sessions,
    drive_id: uuid.UUID,
    method: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> Drive | None:
    """Queue the drive again; without ``method`` with the method and options it had. None: no such drive."""
    with sessions.begin() as session:
        known = drives.get_drive(session, drive_id)
        if known is None:
            return None
        chosen = known.method if method is None else method
        wanted = known.options if method is None and options is None else options or {}
        parse_options(chosen, wanted)
        drive = drives.request_reprocess(session, drive_id, chosen, wanted)
        if drive is not None:
            queue.enqueue(session, drive.id, drive.generation)
        return drive


def remove_drive(sessions: Sessions, drive_id: uuid.UUID) -> Drive | None:
    """Cancel a drive whatever its status, and queue its removal; None when there is none.

    A worker that computes it finds it cancelled and discards its result. Its influence, its row and its bytes go in
    that order (``app.drives.publishing``).
    """
    with sessions.begin() as session:
        drive, generation = drives.request_removal(session, drive_id)
        if generation is not None:
            queue.enqueue_removal(session, drive_id, generation)
        return drive


def sweep_blobs(sessions: Sessions, blobs: BlobStore, older_than: timedelta = ORPHAN_AGE) -> int:
    """Remove parts of uploads that broke off, and blobs older than ``older_than`` that no drive refers to.

    Returns how many. Where several databases keep blobs in one store, orphans of one may be drives of another, so only
    parts are removed.
    """
    removed = blobs.sweep()
    with sessions() as session:
        blobs.register_database(database_identity(session))
    notes = blobs.databases()
    if len(notes) > 1:
        logger.warning(
            "blobs without a drive stay: several databases use this store. Delete the notes of those that are "
            "gone: %s",
            ", ".join(notes),
        )
        return removed
    stored = blobs.keys()
    with sessions() as session:
        orphans = drives.unreferenced_blobs(session, stored)
    return removed + blobs.remove_old(orphans, older_than)
