"""Drives and their life: queued -> running -> done or failed, perhaps again; deleted at any time."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import Row, func, select, text, tuple_, update
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.orm import Session

from app.core.db import Bounds, plain_json, plain_text
from app.core.tables import Drive
from app.map import store as map_store
from app.map.store import DriveSegmentRow
from app.network import results as slopes
from app.network import versions as locks

_BOUNDS = (
    func.ST_XMin(Drive.bounds).label("west"),
    func.ST_YMin(Drive.bounds).label("south"),
    func.ST_XMax(Drive.bounds).label("east"),
    func.ST_YMax(Drive.bounds).label("north"),
)
_PLAIN = tuple(column for column in Drive.__table__.columns if column.key != "bounds")


def create_drive(
    session: Session,
    *,
    sha256: str,
    filename: str,
    size_bytes: int,
    blob_key: str,
    method: str,
    options: Mapping[str, Any],
    drive_id: uuid.UUID | None = None,
) -> tuple[DriveRow, bool]:
    """Insert a queued drive, or find the one that holds the same bytes; the flag says whether it is new.

    Two uploads of the same bytes at the same moment meet at the unique ``sha256``: the second waits for the
    first to commit and gets its drive.
    """
    row = insert(Drive).values(
        id=drive_id or uuid.uuid4(),
        sha256=sha256,
        filename=plain_text(filename),
        size_bytes=size_bytes,
        blob_key=blob_key,
        status="queued",
        method=method,
        options=plain_json(dict(options)),
    )
    created = session.execute(
        row.on_conflict_do_nothing(index_elements=["sha256"]).returning(Drive.id)
    ).scalar()
    found = session.execute(_select().where(Drive.sha256 == sha256)).one_or_none()
    if found is None:  # the other upload's drive was deleted between the two statements
        return create_drive(
            session,
            sha256=sha256,
            filename=filename,
            size_bytes=size_bytes,
            blob_key=blob_key,
            method=method,
            options=options,
            drive_id=drive_id,
        )
    return _row(found), created is not None


def get_drive(session: Session, drive_id: uuid.UUID) -> DriveRow | None:
    """The drive, or None."""
    found = session.execute(_select().where(Drive.id == drive_id)).one_or_none()
    return None if found is None else _row(found)


def list_drives(
    session: Session, *, status: str | None = None, limit: int = 100, after: DrivePlace | None = None
) -> list[DriveRow]:
    """At most ``limit`` drives, newest upload first, that come after the place ``after`` in that order."""
    query = _select().order_by(Drive.created_at.desc(), Drive.id.desc()).limit(limit)
    if status is not None:
        query = query.where(Drive.status == status)
    if after is not None:
        query = query.where(tuple_(Drive.created_at, Drive.id) < tuple_(after.created_at, after.id))
    return [_row(found) for found in session.execute(query)]


def mark_running(session: Session, drive_id: uuid.UUID, generation: int) -> DriveRow | None:
    """Claim the drive for a worker; None when it is gone, finished, or was asked for anew since."""
    claimed = session.execute(
        update(Drive)
        .where(Drive.id == drive_id, Drive.generation == generation, Drive.status.in_(("queued", "running")))
        .values(
            status="running",
            stage=None,
            progress=0.0,
            started_at=func.clock_timestamp(),
            finished_at=None,
        )
        .returning(Drive.id)
    ).scalar()
    return None if claimed is None else get_drive(session, drive_id)


def set_progress(session: Session, drive_id: uuid.UUID, generation: int, stage: str, progress: float) -> bool:
    """Show the stage and the share of the work done, 0..1; False: the drive is no longer this worker's."""
    return _while_running(session, drive_id, generation, stage=plain_text(stage), progress=progress)


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
    return _while_running(
        session,
        drive_id,
        generation,
        status="failed",
        stage=plain_text(stage),
        failure_kind=kind,
        failure_reason=plain_text(reason),
        failure_where=plain_text(where),
        finished_at=func.clock_timestamp(),
    )


def mark_queued(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Put a running drive back into the queue (its worker stops); False: no longer this worker's."""
    return _while_running(session, drive_id, generation, status="queued", stage=None, progress=0.0)


def lock_running(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Hold the drive's row until the transaction ends; False when it is gone or no longer this worker's."""
    mine = select(Drive.id).where(
        Drive.id == drive_id, Drive.generation == generation, Drive.status == "running"
    )
    return session.execute(mine.with_for_update()).scalar() is not None


def mark_done(
    session: Session,
    drive_id: uuid.UUID,
    *,
    report: Mapping[str, Any],
    bounds: Bounds,
    epochs: int,
    distance_m: float | None,
    drive_time: datetime | None,
) -> None:
    """End a drive whose row is locked as done, with what its run says."""
    session.execute(
        update(Drive)
        .where(Drive.id == drive_id)
        .values(
            status="done",
            stage=None,
            progress=1.0,
            failure_kind=None,
            failure_reason=None,
            failure_where=None,
            report=plain_json(dict(report)),
            bounds=func.ST_MakeEnvelope(*bounds, 4326),
            epochs=epochs,
            distance_m=distance_m,
            drive_time=drive_time,
            finished_at=func.clock_timestamp(),
        )
    )


def request_reprocess(
    session: Session, drive_id: uuid.UUID, method: str, options: Mapping[str, Any]
) -> DriveRow | None:
    """Queue the drive again, perhaps for another method; None when there is no such drive.

    A worker that still computes the older request discards its result. What is published stays until the new
    run replaces it. The caller enqueues the job in the same transaction (``app.drives.intake.reprocess``).
    """
    changed = session.execute(
        update(Drive)
        .where(Drive.id == drive_id)
        .values(
            status="queued",
            stage=None,
            progress=0.0,
            failure_kind=None,
            failure_reason=None,
            failure_where=None,
            method=method,
            options=plain_json(dict(options)),
            generation=Drive.generation + 1,
            queued_at=func.clock_timestamp(),
            started_at=None,
            finished_at=None,
        )
        .returning(Drive.id)
    ).scalar()
    return None if changed is None else get_drive(session, drive_id)


def delete_drive(session: Session, drive_id: uuid.UUID) -> bool:
    """Remove the drive whatever its status, and its influence on every aggregate; False when there is none.

    The blob is the caller's to delete after the commit (``app.drives.intake.remove_drive``).
    """
    locks.own_network(session)
    if session.execute(select(Drive.id).where(Drive.id == drive_id).with_for_update()).scalar() is None:
        return False
    slopes.remove_result(session, drive_id)
    session.execute(text("DELETE FROM drives WHERE id = :id"), {"id": drive_id})
    return True


def unreferenced_blobs(session: Session, keys: Sequence[str]) -> list[str]:
    """Those of ``keys`` that no drive refers to, sorted."""
    referred = set(session.execute(select(Drive.blob_key)).scalars()) if keys else set()
    return sorted(set(keys) - referred)


def drive_slopes(session: Session, drive_id: uuid.UUID) -> list[DriveSegmentRow]:
    """The drive's estimates in the order of their first observation."""
    return map_store.drive_segment_rows(session, drive_id)


def _select() -> Any:
    return select(*_PLAIN, *_BOUNDS)


def _row(found: Row[Any]) -> DriveRow:
    values = dict(found._mapping)
    west, south, east, north = (values.pop(side) for side in ("west", "south", "east", "north"))
    return DriveRow(**values, bounds=None if west is None else (west, south, east, north))


def _while_running(session: Session, drive_id: uuid.UUID, generation: int, **values: Any) -> bool:
    changed = session.execute(
        update(Drive)
        .where(Drive.id == drive_id, Drive.generation == generation, Drive.status == "running")
        .values(**values)
        .returning(Drive.id)
    ).scalar()
    return changed is not None


# In the order of ids, so that two who ask at once do not wait for each other. now() is the transaction's: one
# moment for all of them.
_REQUEST = text(
    """
    WITH chosen AS (
        SELECT id FROM drives
        WHERE status IN ('done', 'failed') AND method <> :method
            AND (CAST(:from_method AS text) IS NULL OR method = :from_method)
        ORDER BY id FOR UPDATE
    )
    UPDATE drives AS d
    SET status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL,
        failure_where = NULL, method = :method, options = '{}', generation = d.generation + 1,
        queued_at = now(), started_at = NULL, finished_at = NULL
    FROM chosen WHERE d.id = chosen.id
    RETURNING d.id, d.generation
    """
)
_MOMENT = text("SELECT now()")

_PROGRESS = text(
    """
    SELECT count(*) AS drives, count(*) FILTER (WHERE status = 'queued') AS queued,
           count(*) FILTER (WHERE status = 'running') AS running,
           count(*) FILTER (WHERE status = 'done') AS done,
           count(*) FILTER (WHERE status IN ('failed', 'cancelled')) AS failed,
           coalesce(avg(CASE WHEN status = 'queued' THEN 0 WHEN status = 'running' THEN progress ELSE 1 END), 1)
               AS progress
    FROM drives WHERE queued_at = :queued_at
    """
)


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch is; drives that were deleted or asked for anew since are no longer of it."""

    drives: int
    queued: int
    running: int
    done: int
    failed: int
    progress: float


def request_batch(
    session: Session, method: str, from_method: str | None = None
) -> tuple[datetime, list[tuple[uuid.UUID, int]]]:
    """Queue all finished drives that are not of ``method`` (and are of ``from_method``) again, with its defaults.

    Returns the batch's moment, and drive and generation of each. The caller enqueues the jobs in the same
    transaction (``app.drives.intake.reprocess_all``).
    """
    moment = session.execute(_MOMENT).scalar_one()
    rows = session.execute(_REQUEST, {"method": method, "from_method": from_method})
    return moment, [(row.id, row.generation) for row in rows]


def batch_progress(session: Session, queued_at: datetime) -> BatchProgress:
    """How far the batch of that moment is."""
    row = session.execute(_PROGRESS, {"queued_at": queued_at}).one()
    return BatchProgress(row.drives, row.queued, row.running, row.done, row.failed, float(row.progress))


@dataclass(frozen=True)
class DriveRow:
    """A drive as it stands. ``stage`` of a failed drive is the stage in which it failed."""

    id: uuid.UUID
    sha256: str
    filename: str
    size_bytes: int
    blob_key: str
    status: str
    stage: str | None
    progress: float
    failure_kind: str | None
    failure_reason: str | None
    failure_where: str | None
    method: str
    options: dict[str, Any]
    generation: int
    report: dict[str, Any] | None
    bounds: Bounds | None
    epochs: int | None
    distance_m: float | None
    drive_time: datetime | None
    created_at: datetime
    queued_at: datetime
    started_at: datetime | None
    finished_at: datetime | None


class DrivePlace(NamedTuple):
    """A place in the list of drives, whether or not the drive is still there."""

    created_at: datetime
    id: uuid.UUID
