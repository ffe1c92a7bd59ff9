"""What workers do for requests beside their jobs: expired ones go, lost jobs come back, files of nobody are removed."""

from __future__ import annotations

import logging
import shutil
from contextlib import suppress
from datetime import UTC, datetime, timedelta

from app.core.databases import database_identity
from app.jobs.context import JobContext
from app.jobs.requests.run import RequestKind
from app.jobs.requests.store import R

ORPHAN_AGE = timedelta(hours=6)
"""A file that no request refers to is no run's any more by then, nor on its way to a request."""

logger = logging.getLogger(__name__)


def look_after(kind: RequestKind[R], context: JobContext) -> None:
    """Give jobs to requests that wait without one; remove what has expired, and folders of runs that were killed."""
    with context.sessions.begin() as session:
        kind.store.give_jobs(session)
    expire(kind, context)
    limit = datetime.now(UTC) - timedelta(seconds=2 * context.settings.run_limit_s)  # no run lasts so long
    with suppress(FileNotFoundError):
        for folder in context.scratch(kind.folder).iterdir():
            if datetime.fromtimestamp(folder.stat().st_mtime, UTC) < limit:
                shutil.rmtree(folder, ignore_errors=True)


def expire(kind: RequestKind[R], context: JobContext) -> None:
    """Remove requests that were kept long enough, with their files."""
    with context.sessions.begin() as session:
        expired = kind.expire(session, context.settings)
    for key in expired:
        if kind.files is not None and key is not None:
            context.part(kind.files).delete(key)
    if expired:
        logger.info("%d %s are removed: they were kept long enough", len(expired), kind.store.plural)


def sweep_files(kind: RequestKind[R], context: JobContext) -> list[str]:
    """Remove files that no request refers to, unless another database uses the store; their keys."""
    if kind.files is None:
        return []
    blobs = context.part(kind.files)
    if not (old := blobs.older(blobs.keys(), ORPHAN_AGE)):
        return []
    with context.sessions() as session:
        identity, referred = database_identity(session), kind.store.referred_blobs(session)
    if any(name != identity for name in blobs.databases()):
        return []
    orphans = [key for key in old if key not in referred]
    for key in orphans:
        blobs.delete(key)
    return orphans
