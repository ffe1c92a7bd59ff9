"""Drives in the database and their life: queued -> running -> done or failed, perhaps again; deleted at any time.

The place with SQL on drives, but for many at once (``bulk``); what it returns is detached from any session. Callers own
the transaction, enqueue the jobs and delete the blobs (``app.drives.intake``).
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import TextClause, text
from sqlalchemy.orm import Session

from app.core.db import Bounds, plain_json, plain_text
from app.drives.documents import Drive, DrivePlace
from app.network import results as slopes
from app.network import versions as locks

# What a Drive is made of; the table is called d.
_SHOWN = """
    d.*, CASE WHEN d.bounds IS NOT NULL
         THEN ARRAY[ST_XMin(d.bounds), ST_YMin(d.bounds), ST_XMax(d.bounds), ST_YMax(d.bounds)] END AS bbox
"""
_DRIVES = "SELECT" + _SHOWN + "FROM drives AS d "

_GET = text(_DRIVES + "WHERE d.id = :id")
_GET_EACH = text(_DRIVES + "WHERE d.id = ANY(:ids)")
_GET_BY_SHA256 = text(_DRIVES + "WHERE d.sha256 = :sha256")

# Answered from the indexes on (created_at, id) and (status, created_at, id): what is not asked for is left out.
_OF_STATUS = " AND d.status = :status"
_AFTER = " AND (d.created_at, d.id) < (:after_created_at, :after_id)"
_NEWEST_FIRST = " ORDER BY d.created_at DESC, d.id DESC LIMIT :limit"

# Another upload of the same bytes that has not committed yet is waited for.
_CREATE = text(
    """
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options)
    VALUES (:id, :sha256, :filename, :size_bytes, :blob_key, 'queued', :method, CAST(:options AS jsonb))
    ON CONFLICT (sha256) DO NOTHING RETURNING id
    """
)

# A running drive may be claimed as well: its worker may have died and its job have come back.
_CLAIM = text(
    """
    UPDATE drives
    SET status = 'running', stage = NULL, progress = 0, started_at = clock_timestamp(), finished_at = NULL
    WHERE id = :id AND generation = :generation AND status IN ('queued', 'running') RETURNING id
    """
)

# What a worker writes while it runs: nothing once the drive is no longer its own.
_SET_PROGRESS = text(
    """
    UPDATE drives SET stage = :stage, progress = :progress
    WHERE id = :id AND generation = :generation AND status = 'running' RETURNING id
    """
)
_PUT_BACK = text(
    """
    UPDATE drives SET status = 'queued', stage = NULL, progress = 0
    WHERE id = :id AND generation = :generation AND status = 'running' RETURNING id
    """
)
_FAIL = text(
    """
    UPDATE drives
    SET status = 'failed', stage = :stage, failure_kind = :kind, failure_reason = :reason, failure_where = :where,
        finished_at = clock_timestamp()
    WHERE id = :id AND generation = :generation AND status = 'running' RETURNING id
    """
)

# The end of a run: the row is locked first, so that it is still the worker's when its result is written.
_LOCK_RUNNING = text(
    "SELECT id FROM drives WHERE id = :id AND generation = :generation AND status = 'running' FOR UPDATE"
)
_FINISH = text(
    """
    UPDATE drives
    SET status = 'done', stage = NULL, progress = 1, failure_kind = NULL, failure_reason = NULL, failure_where = NULL,
        report = CAST(:report AS jsonb), bounds = ST_MakeEnvelope(:west, :south, :east, :north, 4326),
        epochs = :epochs, distance_m = :distance_m, drive_time = :drive_time, finished_at = clock_timestamp()
    WHERE id = :id
    """
)

# By the higher generation a worker that still computes the older request finds that its result is unwanted.
ASK_ANEW = text(
    """
    UPDATE drives
    SET status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL,
        failure_where = NULL, method = :method, options = CAST(:options AS jsonb), generation = generation + 1,
        queued_at = coalesce(CAST(:queued_at AS timestamptz), clock_timestamp()), started_at = NULL,
        finished_at = NULL
    WHERE id = ANY(CAST(:ids AS uuid[])) RETURNING id, generation
    """
)

_LOCK = text("SELECT id FROM drives WHERE id = :id FOR UPDATE")
_DELETE = text("DELETE FROM drives WHERE id = :id")
_BLOBS = text("SELECT blob_key FROM drives")


def create_drive(
    session: Session,
    *,
    sha256: str,
    filename: str,
    size_bytes: int,
    blob_key: str,
    method: str,
    options: Mapping[str, Any],
) -> tuple[Drive, bool]:
    """Insert a queued drive, or find the one that holds the same bytes; the flag says whether it is new.

    Two uploads of the same bytes at the same moment meet at the unique ``sha256``: the second waits for the
    first to commit and gets its drive.
    """
    values = {
        "id": uuid.uuid4(),
        "sha256": sha256,
        "filename": plain_text(filename),
        "size_bytes": size_bytes,
        "blob_key": blob_key,
        "method": method,
        "options": _json(options),
    }
    while True:
        created = _changed(session, _CREATE, values)
        if drive := _one(session, _GET_BY_SHA256, {"sha256": sha256}):
            return drive, created
        # the other upload's drive was deleted between the two statements


def get_drive(session: Session, drive_id: uuid.UUID) -> Drive | None:
    """The drive, or None."""
    return _one(session, _GET, {"id": drive_id})


def get_drives(session: Session, ids: Collection[uuid.UUID]) -> dict[uuid.UUID, Drive]:
    """Those of the drives that there are, by id."""
    rows = session.execute(_GET_EACH, {"ids": list(ids)})
    return {row.id: Drive.of(dict(row._mapping)) for row in rows}


def list_drives(
    session: Session, *, status: str | None = None, limit: int = 100, after: DrivePlace | None = None
) -> list[Drive]:
    """At most ``limit`` drives, newest upload first, that come after the place ``after`` in that order."""
    query = _DRIVES + "WHERE true"
    query += _OF_STATUS if status is not None else ""
    values: dict[str, Any] = {"status": status, "limit": limit}
    if after is not None:
        query += _AFTER
        values |= {"after_created_at": after.created_at, "after_id": after.id}
    return [Drive.of(dict(row._mapping)) for row in session.execute(text(query + _NEWEST_FIRST), values)]


def mark_running(session: Session, drive_id: uuid.UUID, generation: int) -> Drive | None:
    """Claim the drive for a worker; None when it is gone, finished, or was asked for anew since."""
    claimed = _changed(session, _CLAIM, {"id": drive_id, "generation": generation})
    return get_drive(session, drive_id) if claimed else None


def set_progress(session: Session, drive_id: uuid.UUID, generation: int, stage: str, progress: float) -> bool:
    """Show the stage and the share of the work done, 0..1; False: the drive is no longer this worker's."""
    values = {"id": drive_id, "generation": generation, "stage": plain_text(stage), "progress": progress}
    return _changed(session, _SET_PROGRESS, values)


def mark_queued(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Put a running drive back into the queue (its worker stops); False: no longer this worker's."""
    return _changed(session, _PUT_BACK, {"id": drive_id, "generation": generation})


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
    texts = {
        name: plain_text(value) for name, value in (("stage", stage), ("reason", reason), ("where", where))
    }
    return _changed(session, _FAIL, {"id": drive_id, "generation": generation, "kind": kind, **texts})


def lock_running(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Hold the drive's row until the transaction ends; False when it is gone or no longer this worker's."""
    return _changed(session, _LOCK_RUNNING, {"id": drive_id, "generation": generation})


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
    west, south, east, north = bounds
    box = {"west": west, "south": south, "east": east, "north": north}
    said = {"report": _json(report), "epochs": epochs, "distance_m": distance_m, "drive_time": drive_time}
    session.execute(_FINISH, {"id": drive_id, **box, **said})


def request_reprocess(
    session: Session, drive_id: uuid.UUID, method: str, options: Mapping[str, Any]
) -> Drive | None:
    """Queue the drive again, perhaps for another method; None when there is no such drive.

    A worker that still computes the older request discards its result. What is published stays until the new
    run replaces it. The caller enqueues the job in the same transaction (``app.drives.intake.reprocess``).
    """
    values = {"ids": [drive_id], "method": method, "options": _json(options), "queued_at": None}
    return get_drive(session, drive_id) if _changed(session, ASK_ANEW, values) else None


def delete_drive(session: Session, drive_id: uuid.UUID) -> bool:
    """Remove the drive whatever its status, and its influence on every aggregate; False when there is none.

    The blob is the caller's to delete after the commit (``app.drives.intake.remove_drive``).
    """
    locks.own_network(session)
    if not _changed(session, _LOCK, {"id": drive_id}):
        return False
    slopes.remove_result(session, drive_id)
    session.execute(_DELETE, {"id": drive_id})
    return True


def unreferenced_blobs(session: Session, keys: Sequence[str]) -> list[str]:
    """Those of ``keys`` that no drive refers to, sorted."""
    referred = set(session.execute(_BLOBS).scalars()) if keys else set()
    return sorted(set(keys) - referred)


def _one(session: Session, statement: TextClause, values: Mapping[str, Any]) -> Drive | None:
    """The drive of a query of one drive or of none."""
    row = session.execute(statement, values).one_or_none()
    return None if row is None else Drive.of(dict(row._mapping))


def _changed(session: Session, statement: TextClause, values: Mapping[str, Any]) -> bool:
    """Whether the statement found its drive."""
    return session.execute(statement, values).scalar() is not None


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(plain_json(value))
