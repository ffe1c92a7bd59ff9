"""Drives in the database and their life: queued -> running -> done or failed, perhaps again; deleted at any time.

The place with SQL on drives, but for many at once (``batches``) and for their ends (``endings``); what it returns is
detached from any session. Callers own the transaction, enqueue the jobs and delete the blobs (``app.drives.intake``).
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

from app.core.db import plain_json, plain_text
from app.core.telemetry.tracing import traceparent
from app.drives.documents import Drive, DrivePlace
from app.network.hearing import hearings
from app.network.marks import PATIENCE

# What a Drive is made of; the table is called d. Few drives have marks, and these an index.
_SHOWN = f"""
    d.*, ARRAY(SELECT DISTINCT m.cell FROM network_marks AS m
               WHERE m.drive_id = d.id AND m.generation = d.generation AND m.tries > {PATIENCE}
               ORDER BY m.cell) AS unsolved_cells, CASE WHEN d.bounds IS NOT NULL
         THEN ARRAY[ST_XMin(d.bounds), ST_YMin(d.bounds), ST_XMax(d.bounds), ST_YMax(d.bounds)] END AS bbox
"""  # noqa: S608 - constants
_DRIVES = "SELECT" + _SHOWN + "FROM drives AS d "

_GET = text(_DRIVES + "WHERE d.id = :id")
_GET_EACH = text(_DRIVES + "WHERE d.id = ANY(:ids)")
# Of drives from before contents were told only the bytes are known, plain ones perhaps; the very same bytes first.
_GET_BY_CONTENT = text(
    _DRIVES
    + """
    WHERE d.content_sha256 = :content_sha256 OR d.sha256 IN (:sha256, :content_sha256)
    ORDER BY d.sha256 = :sha256 DESC, d.created_at LIMIT 1
    """
)

# Answered from the indexes on (created_at, id) and (status, created_at, id): what is not asked for is left out.
_OF_STATUS = " AND d.status = :status"
_OF_FAILURE = " AND d.status = 'failed' AND d.failure_kind = :failure"
_SINCE = " AND d.created_at >= :created_after"
_OF_BATCH = " AND d.batch_id = :batch"
_AFTER = " AND (d.created_at, d.id) < (:after_created_at, :after_id)"
_NEWEST_FIRST = " ORDER BY d.created_at DESC, d.id DESC LIMIT :limit"

# Another upload of the same bytes or content that has not committed yet is waited for.
_CREATE = text(
    """
    INSERT INTO drives (id, sha256, content_sha256, filename, size_bytes, blob_key, status, method, options,
                        traceparent)
    VALUES (:id, :sha256, :content_sha256, :filename, :size_bytes, :blob_key, 'queued', :method,
            CAST(:options AS jsonb), :traceparent)
    ON CONFLICT DO NOTHING RETURNING id
    """
)
# Nothing when the drive is gone, or another upload was faster.
_GIVE_BLOB = text(
    """
    UPDATE drives SET blob_key = :blob_key, sha256 = :sha256, size_bytes = :size_bytes
    WHERE id = :id AND blob_key = :lost_key RETURNING id
    """
)

# A worker that computes the drive finds by the generation that its result is unwanted. What it is known by is free
# from here on: the same log uploaded again is another drive, and does not go with this one.
_CANCEL = text(
    """
    UPDATE drives
    SET status = 'cancelled', stage = NULL, generation = generation + 1, finished_at = clock_timestamp(),
        sha256 = 'removed ' || id, content_sha256 = NULL
    WHERE id = :id AND status <> 'cancelled' RETURNING generation
    """
)
# By the higher generation a worker that still computes the older request finds that its result is unwanted.
ANEW = """
    status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL, failure_where = NULL,
    generation = generation + 1, queued_at = clock_timestamp(), started_at = NULL, finished_at = NULL,
    traceparent = :traceparent
"""
_ASK_ANEW = text(
    f"""
    UPDATE drives
    SET {ANEW}, method = :method, options = CAST(:options AS jsonb), batch_id = NULL, before_batch = NULL
    WHERE id = :id AND status <> 'cancelled' RETURNING id
    """  # noqa: S608 - constants
)

_WAIT_AT_MOST = text("SELECT set_config('lock_timeout', :timeout, true)")
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
    content_sha256: str | None = None,
) -> tuple[Drive, bool]:
    """Insert a queued drive, or find the one that holds the same content; the flag says whether it is new.

    Two uploads of the same content at the same moment, in whatever form, meet at the unique columns: the second
    waits for the first to commit and gets its drive.
    """
    values = {
        "id": uuid.uuid4(),
        "sha256": sha256,
        "content_sha256": content_sha256,
        "filename": plain_text(filename),
        "size_bytes": size_bytes,
        "blob_key": blob_key,
        "method": method,
        "options": json_text(options),
        "traceparent": traceparent(),
    }
    same = {"sha256": sha256, "content_sha256": content_sha256 or sha256}
    while True:
        if drive := _one(session, _GET_BY_CONTENT, same):
            return drive, False
        if changed(session, _CREATE, values) and (drive := get_drive(session, values["id"])):
            return drive, True
        # the other upload's drive is there now, or was deleted between the two statements


def wait_at_most(session: Session, timeout_s: float) -> None:
    """Let this transaction fail rather than wait longer for another one."""
    session.execute(_WAIT_AT_MOST, {"timeout": f"{round(timeout_s * 1000)}ms"})


def give_blob(session: Session, drive: Drive, *, sha256: str, size_bytes: int, blob_key: str) -> bool:
    """Let a drive whose blob is lost have another of the same content; False: it is gone, or has one by now."""
    values = {"sha256": sha256, "size_bytes": size_bytes, "blob_key": blob_key}
    return changed(session, _GIVE_BLOB, {"id": drive.id, "lost_key": drive.blob_key, **values})


def get_drive(session: Session, drive_id: uuid.UUID) -> Drive | None:
    """The drive, or None."""
    return _one(session, _GET, {"id": drive_id})


def get_drives(session: Session, ids: Collection[uuid.UUID]) -> dict[uuid.UUID, Drive]:
    """Those of the drives that there are, by id."""
    rows = session.execute(_GET_EACH, {"ids": list(ids)})
    return {drive.id: drive for drive in _shown(session, rows)}


def list_drives(
    session: Session,
    *,
    status: str | None = None,
    failure: str | None = None,
    created_after: datetime | None = None,
    batch: int | None = None,
    limit: int = 100,
    after: DrivePlace | None = None,
) -> list[Drive]:
    """At most ``limit`` drives, newest upload first, that come after the place ``after`` in that order.

    Those for which all holds that is said: their status, the kind of their failure, uploaded then or later, of a batch.
    """
    values: dict[str, Any] = {"limit": limit}
    asked: dict[str, dict[str, Any]] = {
        _OF_STATUS: {"status": status},
        _OF_FAILURE: {"failure": failure},
        _SINCE: {"created_after": created_after},
        _OF_BATCH: {"batch": batch},
        _AFTER: {} if after is None else {"after_created_at": after.created_at, "after_id": after.id},
    }
    query = _DRIVES + "WHERE true"
    for condition, named in asked.items():
        if named and None not in named.values():
            query += condition
            values |= named
    return _shown(session, session.execute(text(query + _NEWEST_FIRST), values))


def request_reprocess(
    session: Session, drive_id: uuid.UUID, method: str, options: Mapping[str, Any]
) -> Drive | None:
    """Queue the drive again, perhaps for another method; None when there is no such drive.

    A worker that still computes the older request discards its result. What is published stays until the new
    run replaces it. The caller enqueues the job in the same transaction (``app.drives.intake.reprocess``).
    """
    values = {"id": drive_id, "method": method, "options": json_text(options), "traceparent": traceparent()}
    return get_drive(session, drive_id) if changed(session, _ASK_ANEW, values) else None


def request_removal(session: Session, drive_id: uuid.UUID) -> tuple[Drive | None, int | None]:
    """Cancel the drive whatever its status: the drive, None: there is none; and its generation if it was not yet.

    The caller enqueues the job that takes it back in the same transaction (``app.drives.intake.remove_drive``).
    """
    generation = session.execute(_CANCEL, {"id": drive_id}).scalar()
    return get_drive(session, drive_id), generation


def unreferenced_blobs(session: Session, keys: Sequence[str]) -> list[str]:
    """Those of ``keys`` that no drive refers to, sorted."""
    referred = set(session.execute(_BLOBS).scalars()) if keys else set()
    return sorted(set(keys) - referred)


def _one(session: Session, statement: TextClause, values: Mapping[str, Any]) -> Drive | None:
    """The drive of a query of one drive or of none."""
    return next(iter(_shown(session, session.execute(statement, values))), None)


def _shown(session: Session, rows: Iterable[Row[Any]]) -> list[Drive]:
    """The drives of these rows, each with how it agrees with the others by now."""
    found = [dict(row._mapping) for row in rows]
    heard = hearings(session, [columns["id"] for columns in found if columns["report"] is not None])
    return [Drive.of({**columns, "hearing": heard.get(columns["id"])}) for columns in found]


def changed(session: Session, statement: TextClause, values: Mapping[str, Any]) -> bool:
    """Whether the statement found its drive."""
    return session.execute(statement, values).scalar() is not None


def json_text(value: Mapping[str, Any]) -> str:
    """As a column of documents takes it."""
    return json.dumps(plain_json(value))
