"""How drives end in the database: done when they are published, deleted when nothing of them is left on the map.

Both wait for marks (``app.network.marks``). A cell that no solver can solve keeps no drive from being done: the rest
of it is published, and its document names the cell for as long as that is so (``app.drives.store``). It does keep a
removed drive, whose row is what tells that something of it is still shown. Callers own the transaction
(``app.drives.publishing``).
"""

from __future__ import annotations

import uuid
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.network.marks import GIVEN_UP

# What no mark waits for any more, but in cells that solvers have given up; another worker may be about
# to say so, too.
_PUBLISHED = text(
    """
    SELECT d.id, d.report, d.method, d.distance_m,
           CAST(greatest(extract(epoch FROM clock_timestamp() - d.computed_at), 0) AS float8) AS waited_s
    FROM drives AS d
    WHERE d.status = 'running' AND d.stage = 'publishing' AND NOT EXISTS (
        SELECT FROM network_marks AS m
        WHERE m.drive_id = d.id AND m.generation = d.generation AND m.tries < :given_up)
    ORDER BY d.created_at, d.id FOR NO KEY UPDATE OF d SKIP LOCKED
    """
)
_FINISH = text(
    """
    UPDATE drives SET status = 'done', stage = NULL, progress = 1, finished_at = clock_timestamp() WHERE id = :id
    """
)

_LOCK_CANCELLED = text(
    """
    SELECT id FROM drives WHERE id = :id AND generation = :generation AND status = 'cancelled' AND stage IS NULL
    FOR NO KEY UPDATE
    """
)
_SET_REMOVING = text("UPDATE drives SET stage = 'removing' WHERE id = :id RETURNING blob_key")
_REMOVED = text(
    """
    DELETE FROM drives WHERE id IN (
        SELECT d.id FROM drives AS d
        WHERE d.status = 'cancelled' AND d.stage = 'removing' AND NOT EXISTS (
            SELECT FROM network_marks AS m WHERE m.drive_id = d.id AND m.generation = d.generation)
        FOR UPDATE OF d SKIP LOCKED)
    RETURNING id, blob_key, CASE WHEN bounds IS NOT NULL
        THEN ARRAY[ST_XMin(bounds), ST_YMin(bounds), ST_XMax(bounds), ST_YMax(bounds)] END AS bbox
    """
)


class Published(NamedTuple):
    """A drive whose cells are all solved, or given up for now."""

    id: uuid.UUID
    report: dict[str, Any]
    method: str
    distance_m: float | None
    waited_s: float | None
    """For them; None where it was computed by code that did not note when."""


def published_drives(session: Session) -> list[Published]:
    """The drives that wait for no cell any more. Their rows are held."""
    return [Published(*row) for row in session.execute(_PUBLISHED, {"given_up": GIVEN_UP})]


def mark_done(session: Session, drive_id: uuid.UUID) -> None:
    """End a drive whose row is held as done."""
    session.execute(_FINISH, {"id": drive_id})


def lock_cancelled(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Hold the row of a drive that is to be removed; False when that is no longer so, or done."""
    values = {"id": drive_id, "generation": generation}
    return session.execute(_LOCK_CANCELLED, values).scalar() is not None


def mark_removing(session: Session, drive_id: uuid.UUID) -> str:
    """All that the drive said is taken back; its row goes once its cells are solved without it. The key of its blob,
    which nobody needs any more."""
    blob_key: str = session.execute(_SET_REMOVING, {"id": drive_id}).scalar_one()
    return blob_key


class Removed(NamedTuple):
    """A drive that is gone: where its blob was, and where it had driven (degrees; None: it was never known)."""

    id: uuid.UUID
    blob_key: str
    bbox: Bounds | None


def delete_removed(session: Session) -> list[Removed]:
    """Delete the rows of drives of which nothing is left on the map."""
    return [Removed(*row) for row in session.execute(_REMOVED)]
