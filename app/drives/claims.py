"""What a worker writes of a drive that it has claimed: nothing once another run has it, or its result is complete.

Queued drives are claimed by a generation (``mark_running``); whoever asks for one anew takes it away by the next.

Drives are done when they are published, and deleted when nothing of them is left on the map. Both wait for marks
(``app.network.marks``). A cell that no solver can solve keeps no drive from being done: the rest of it is published,
and its document names the cell for as long as that is so (``app.drives.store``). It does keep a removed drive, whose
row is what tells that something of it is still shown. Callers own the transaction (``app.drives.publishing``).
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.access.quotas import count_records
from app.core.db import Bounds, plain_text
from app.core.telemetry.logs import reason_text, said_of_failure
from app.core.version import code_version
from app.drives.documents import Drive
from app.drives.store import changed, get_drive, json_text
from app.network.marks import GIVEN_UP

PUBLISHING_PROGRESS = 0.97
"""Of a drive that waits for its cells to be solved."""

_WHERE_CLAIMED = """
    WHERE id = :id AND generation = :generation AND status = 'running' AND stage IS DISTINCT FROM 'publishing'
"""
"""What a worker writes while it runs: nothing once the drive is no longer its own, or has said all."""

# A running drive may be claimed as well: its worker may have died and its job have come back. Not one that has said
# all: it only waits to be published.
_CLAIM = text("""
    UPDATE drives
    SET status = 'running', stage = NULL, progress = 0, started_at = clock_timestamp(), finished_at = NULL
    WHERE id = :id AND generation = :generation AND status IN ('queued', 'running')
        AND stage IS DISTINCT FROM 'publishing' RETURNING id
""")
_FAILED = """
    status = 'failed', stage = :stage, failure_kind = :kind, failure_reason = :reason, failure_where = :where,
    failure_said = CAST(:said AS jsonb), failure_version = :version, finished_at = clock_timestamp()
"""
# Also of a drive that then finds no roads: by it new ones find the drive.
_BOUNDS = "bounds = ST_MakeEnvelope(:west, :south, :east, :north, 4326)"
# Of each drive once. The day is that of its upload, whenever it is computed.
_RECORDS = text(f"""
    UPDATE drives SET records = :records {_WHERE_CLAIMED} AND records IS NULL
    RETURNING owner_id, CAST(created_at AT TIME ZONE 'UTC' AS date) AS day
""")  # noqa: S608 - a constant

# The end of a run: the row is locked first, so that it is still the worker's when its result is written. Tables that
# refer to it may be written meanwhile.
_LOCK_RUNNING = text(f"SELECT id FROM drives {_WHERE_CLAIMED} FOR NO KEY UPDATE")  # noqa: S608 - a constant
_SET_PUBLISHING = text(
    f"""
    UPDATE drives
    SET stage = 'publishing', progress = :progress, failure_kind = NULL, failure_reason = NULL, failure_where = NULL,
        failure_said = NULL, report = CAST(:report AS jsonb), {_BOUNDS},
        epochs = :epochs, distance_m = :distance_m, drive_time = :drive_time, computed_at = clock_timestamp()
    WHERE id = :id
    """  # noqa: S608 - a constant
)

# What no mark waits for any more, but in cells that solvers have given up; another worker may be about
# to say so, too.
_PUBLISHED = text("""
    SELECT d.id, d.report, d.method, d.distance_m,
           CAST(greatest(extract(epoch FROM clock_timestamp() - d.computed_at), 0) AS float8) AS waited_s
    FROM drives AS d
    WHERE d.status = 'running' AND d.stage = 'publishing' AND NOT EXISTS (
        SELECT FROM network_marks AS m
        WHERE m.drive_id = d.id AND m.generation = d.generation AND m.tries < :given_up)
    ORDER BY d.created_at, d.id FOR NO KEY UPDATE OF d SKIP LOCKED
""")
_FINISH = text("""
    UPDATE drives SET status = 'done', stage = NULL, progress = 1, finished_at = clock_timestamp() WHERE id = :id
""")

_SET_REMOVING = text("""
    UPDATE drives SET stage = 'removing'
    WHERE id = :id AND generation = :generation AND status = 'cancelled' AND stage IS NULL RETURNING blob_key
""")
# Asked much more often than there is any: to plan the statement below takes some milliseconds.
_ANY_REMOVING = text("SELECT EXISTS (SELECT FROM drives WHERE status = 'cancelled' AND stage = 'removing')")
_REMOVED = text("""
    DELETE FROM drives WHERE id IN (
        SELECT d.id FROM drives AS d
        WHERE d.status = 'cancelled' AND d.stage = 'removing' AND NOT EXISTS (
            SELECT FROM network_marks AS m WHERE m.drive_id = d.id AND m.generation = d.generation)
        FOR UPDATE OF d SKIP LOCKED)
    RETURNING id, blob_key, CASE WHEN bounds IS NOT NULL
        THEN ARRAY[ST_XMin(bounds), ST_YMin(bounds), ST_XMax(bounds), ST_YMax(bounds)] END AS bbox
""")


def mark_running(session: Session, drive_id: uuid.UUID, generation: int) -> Drive | None:
    """Claim the drive for a worker; None when it is gone, finished, or was asked for anew since."""
    claimed = changed(session, _CLAIM, {"id": drive_id, "generation": generation})
    return get_drive(session, drive_id) if claimed else None


def set_progress(session: Session, drive_id: uuid.UUID, generation: int, stage: str, progress: float) -> bool:
    """Show the stage and the share of the work done, 0..1; False: the drive is no longer this worker's."""
    values = {"stage": plain_text(stage), "progress": progress}
    return _write(session, drive_id, generation, "stage = :stage, progress = :progress", values)


def note_bounds(session: Session, drive_id: uuid.UUID, generation: int, bounds: Bounds) -> bool:
    """Note where the drive is, degrees, whatever becomes of it; False: no longer this worker's."""
    return _write(session, drive_id, generation, _BOUNDS, _box(bounds))


def note_facts(
    session: Session,
    drive_id: uuid.UUID,
    generation: int,
    *,
    epochs: int,
    distance_m: float | None,
    drive_time: datetime | None,
) -> bool:
    """Note what a log says of itself, of a drive that has no result; False: no longer this worker's."""
    values = {"epochs": epochs, "distance_m": distance_m, "drive_time": drive_time}
    return _write(session, drive_id, generation, ", ".join(f"{name} = :{name}" for name in values), values)


def note_records(session: Session, drive_id: uuid.UUID, generation: int, records: int) -> None:
    """Note how many records the log has, and count them for the owner, unless a run before has done so."""
    values = {"id": drive_id, "generation": generation, "records": records}
    first = session.execute(_RECORDS, values).one_or_none()
    if first is not None:
        count_records(session, first.owner_id, first.day, records)


def mark_queued(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Put a running drive back into the queue (its worker stops); False: no longer this worker's."""
    return _write(session, drive_id, generation, "status = 'queued', stage = NULL, progress = 0", {})


def mark_failed(
    session: Session,
    drive_id: uuid.UUID,
    generation: int,
    *,
    kind: str,
    reason: str,
    stage: str | None,
    where: str | None = None,
) -> bool:
    """End a running drive as failed; what an earlier run published stays. False: no longer this worker's."""
    texts = {"stage": stage, "reason": reason, "where": where}
    values = {name: reason_text(value) for name, value in texts.items()}
    said = said_of_failure(reason, where)
    values["said"] = None if said is None else json_text(said)
    return _write(session, drive_id, generation, _FAILED, {"kind": kind, "version": code_version(), **values})


def lock_running(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Hold the drive's row until the transaction ends; False when it is gone or no longer this worker's."""
    return changed(session, _LOCK_RUNNING, {"id": drive_id, "generation": generation})


def mark_publishing(
    session: Session,
    drive_id: uuid.UUID,
    *,
    report: Mapping[str, Any],
    bounds: Bounds,
    epochs: int,
    distance_m: float | None,
    drive_time: datetime | None,
) -> None:
    """Note of a drive whose row is locked what its run says; it is done once its cells are solved."""
    results = {"epochs": epochs, "distance_m": distance_m, "drive_time": drive_time, **_box(bounds)}
    values = {"id": drive_id, "progress": PUBLISHING_PROGRESS, "report": json_text(report), **results}
    session.execute(_SET_PUBLISHING, values)


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


def mark_removing(session: Session, drive_id: uuid.UUID, generation: int) -> str | None:
    """Begin to take back what the drive said; its row goes once its cells are solved without it. The key of its blob,
    which nobody needs any more; None where it is not to be removed, or that was begun before."""
    return session.execute(_SET_REMOVING, {"id": drive_id, "generation": generation}).scalar()


class Removed(NamedTuple):
    """A drive that is gone: where its blob was, and where it had driven (degrees; None: it was never known)."""

    id: uuid.UUID
    blob_key: str
    bbox: Bounds | None


def delete_removed(session: Session) -> list[Removed]:
    """Delete the rows of drives of which nothing is left on the map."""
    if not session.execute(_ANY_REMOVING).scalar_one():
        return []
    return [Removed(*row) for row in session.execute(_REMOVED)]


def _box(bounds: Bounds) -> dict[str, float]:
    return dict(zip(("west", "south", "east", "north"), bounds, strict=True))


def _write(
    session: Session, drive_id: uuid.UUID, generation: int, columns: str, values: Mapping[str, Any]
) -> bool:
    """Write columns of a drive that this worker has claimed; False: it is no longer this worker's."""
    statement = text(f"UPDATE drives SET {columns} {_WHERE_CLAIMED} RETURNING id")  # noqa: S608 - constants
    return changed(session, statement, {"id": drive_id, "generation": generation, **values})
