"""Logs that their owners keep no longer are deleted: when a drive is done, or so many days after. Results stay.

Such a drive is not computed again, whatever changes: batches and changes of roads leave it out (``HAS_LOG``), and
whoever asks for it alone is told so. A log is deleted before that is noted, while its drive is held: cut off in
between, the next look does both again. Knows no SQL.
"""

from __future__ import annotations

import logging

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.drives.person import store

LOOK_EVERY_S = 30.0
"""How often a worker looks for logs that were kept long enough."""
PIECE_LOGS = 50
"""In one transaction: so many drives wait for as long as it takes to delete as many files."""

logger = logging.getLogger(__name__)


def delete_due(sessions: Sessions, blobs: BlobStore, keep_logs_days: int | None) -> bool:
    """Delete some that are due; whether there may be more. ``keep_logs_days``: of owners that did not say it."""
    with sessions.begin() as session:
        due = store.due_logs(session, keep_logs_days, PIECE_LOGS)
        for one in due:
            blobs.delete(one.blob_key)
        store.note_deleted(session, due)
    if due:
        logger.info("%d logs were kept as long as their owners want, and are deleted", len(due))
    return len(due) == PIECE_LOGS
