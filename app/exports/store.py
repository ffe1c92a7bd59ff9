"""Exports in the database: asked for, claimed by a worker, done, removed. A row and its job commit together.

Whoever removes an export takes it away from the worker that makes it, which finds that out when it wants to say
something of it.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds, plain_json
from app.core.errors import BusyError
from app.core.telemetry.logs import reason_text
from app.exports.documents import Export
from app.jobs.task import Kind, add_job

MAKE_EXPORT = Kind("make_export", -50)
"""Behind uploads and what is published of them, before drives that are computed again by the thousand."""
ONE_AT_A_TIME = "exports"
"""The lock of their jobs: however many wait, all lanes but one are left to drives."""
MOST_WAITING = 100

_COLUMNS = """
    id, status, progress, request, failure_kind, failure_reason, data_version, provenance, companions, notes, entries,
    file_name, media_type, blob_key, sha256, size_bytes, created_at, started_at, finished_at, expires_at, run
"""

# Two that ask for the same at the same moment: the second waits for the first to commit.
_ONE_BY_ONE = text("SELECT pg_advisory_xact_lock(hashtextextended('versant exports', 0))")

# One that waits will see the data of when it begins, which are no older than those of now.
_SAME = text(
    f"""
    SELECT {_COLUMNS} FROM exports
    WHERE request_sha256 = :request_sha256
        AND (status = 'queued' OR (status IN ('running', 'done') AND data_version = :data_version))
        AND (expires_at IS NULL OR expires_at > now())
    ORDER BY status = 'done' DESC, created_at LIMIT 1
    """  # noqa: S608 - constants
)
_WAITING = text("SELECT count(*) FROM exports WHERE status = 'queued'")
_ADD = text(
    f"""
    INSERT INTO exports (id, request, request_sha256, status, file_name, media_type)
    VALUES (:id, CAST(:request AS jsonb), :request_sha256, 'queued', :file_name, :media_type)
    RETURNING {_COLUMNS}
    """  # noqa: S608 - constants
)
_GET = text(f"SELECT {_COLUMNS} FROM exports WHERE id = :id")  # noqa: S608 - constants
_LIST = text(
    f"""
    SELECT {_COLUMNS} FROM exports
    WHERE (CAST(:status AS text) IS NULL OR status = :status)
        AND (CAST(:after_id AS uuid) IS NULL
             OR (created_at, id) < (CAST(:after_created_at AS timestamptz), CAST(:after_id AS uuid)))
    ORDER BY created_at DESC, id DESC LIMIT :limit
    """  # noqa: S608 - constants
)

# A running one may be claimed as well: its worker may have died and its job have come back.
_CLAIM = text(
    f"""
    UPDATE exports SET status = 'running', run = run + 1, progress = 0, data_version = NULL,
        started_at = clock_timestamp()
    WHERE id = :id AND status IN ('queued', 'running') RETURNING {_COLUMNS}, yields
    """  # noqa: S608 - constants
)
_OURS = "WHERE id = :id AND run = :run AND status = 'running' RETURNING id"
_NOTE_VERSION = text(f"UPDATE exports SET data_version = :data_version {_OURS}")  # noqa: S608 - constants
_SET_PROGRESS = text(f"UPDATE exports SET progress = :progress {_OURS}")  # noqa: S608 - constants
_PUT_BACK = text(
    f"UPDATE exports SET status = 'queued', progress = 0, yields = yields + :yielded {_OURS}"  # noqa: S608 - constants
)
# By who knows of no run: its worker ended without a word.
_LET_WAIT = text("UPDATE exports SET status = 'queued', progress = 0 WHERE id = :id AND status = 'running'")
_FINISH = text(
    f"""
    UPDATE exports SET status = 'done', progress = 1, entries = :entries, provenance = CAST(:provenance AS jsonb),
        companions = CAST(:companions AS jsonb), notes = CAST(:notes AS jsonb), blob_key = :blob_key,
        sha256 = :sha256, size_bytes = :size_bytes, finished_at = clock_timestamp(),
        expires_at = clock_timestamp() + make_interval(secs => 86400 * :keep_days)
    {_OURS}
    """  # noqa: S608 - constants
)
_FAIL = text(
    """
    UPDATE exports SET status = 'failed', failure_kind = :kind, failure_reason = :reason,
        finished_at = clock_timestamp(),
        expires_at = clock_timestamp() + make_interval(secs => 86400 * :keep_days)
    WHERE id = :id AND status IN ('queued', 'running') AND (CAST(:run AS integer) IS NULL OR run = :run)
    """
)
_CANCEL = text(
    """
    UPDATE exports AS e SET status = 'cancelled', blob_key = NULL, companions = '{}', finished_at = clock_timestamp(),
        expires_at = coalesce(e.expires_at, clock_timestamp() + make_interval(secs => 86400 * :keep_days))
    FROM (SELECT id, blob_key FROM exports WHERE id = :id FOR UPDATE) AS was
    WHERE e.id = was.id AND e.status <> 'cancelled' RETURNING was.blob_key
    """
)

# Of the moment before a drive was removed that lay in one of these boxes. One that is being made begins anew.
_OVER = """
    e.request ->> 'bbox' IS NULL OR CAST(e.request #>> '{bbox,0}' AS float8) > CAST(e.request #>> '{bbox,2}' AS float8)
    OR EXISTS (
        SELECT FROM unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]),
                           CAST(:north AS float8[])) AS b (west, south, east, north)
        WHERE CAST(e.request #>> '{bbox,0}' AS float8) <= b.east AND CAST(e.request #>> '{bbox,2}' AS float8) >= b.west
            AND CAST(e.request #>> '{bbox,1}' AS float8) <= b.north
            AND CAST(e.request #>> '{bbox,3}' AS float8) >= b.south)
"""
_END_OVER = text(
    f"""
    UPDATE exports AS e SET status = 'cancelled', blob_key = NULL, companions = '{{}}', notes = '{{}}'
    FROM (SELECT e.id, e.blob_key FROM exports AS e WHERE e.status = 'done' AND ({_OVER}) FOR UPDATE) AS was
    WHERE e.id = was.id RETURNING was.blob_key
    """  # noqa: S608 - constants
)
_BEGIN_OVER = text(
    f"""
    UPDATE exports AS e SET status = 'queued', run = run + 1, progress = 0 WHERE e.status = 'running' AND ({_OVER})
    RETURNING e.id
    """  # noqa: S608 - constants
)

# What is to go: what has expired, and of what is kept the oldest, as far as it is too much together.
_REMOVE = text(
    """
    DELETE FROM exports WHERE id IN (
        SELECT id FROM exports WHERE expires_at < now()
        UNION ALL
        SELECT id FROM (
            SELECT id, sum(size_bytes) OVER (ORDER BY finished_at DESC, id) AS together FROM exports
            WHERE status = 'done') AS kept
        WHERE together > :max_bytes)
    RETURNING blob_key
    """
)
_BLOBS = text("SELECT blob_key FROM exports WHERE blob_key IS NOT NULL")

# Their job is gone: a worker of a version that knew no exports took it, say.
_JOBLESS = text(
    """
    SELECT id FROM exports AS e WHERE status IN ('queued', 'running') AND NOT EXISTS (
        SELECT FROM procrastinate_jobs AS j WHERE j.status IN ('todo', 'doing') AND j.task_name = :task
            AND j.args ->> 'export_id' = CAST(e.id AS text))
    ORDER BY created_at FOR UPDATE SKIP LOCKED
    """
)

# Jobs that go first, and that no lane has taken yet.
_OTHERS_WAIT = text(
    """
    SELECT EXISTS (
        SELECT FROM procrastinate_jobs
        WHERE status = 'todo' AND priority > :priority AND (scheduled_at IS NULL OR scheduled_at <= now()))
    """
)


def ask(
    session: Session,
    *,
    request: Mapping[str, Any],
    request_sha256: str,
    data_version: str,
    file_name: str,
    media_type: str,
) -> tuple[Export, bool]:
    """The export of this request at this version of the data, or a new one with its job; the flag says whether new.

    ``BusyError`` where too many wait.
    """
    session.execute(_ONE_BY_ONE)
    values = {"request_sha256": request_sha256, "data_version": data_version}
    if (row := session.execute(_SAME, values).one_or_none()) is not None:
        return Export.of(row._asdict()), False
    if (waiting := session.execute(_WAITING).scalar_one()) >= MOST_WAITING:
        raise BusyError(f"{waiting} exports wait already. Try again when some of them are done.")
    number = uuid.uuid4()
    new = {"id": number, "request": json.dumps(plain_json(request)), "request_sha256": request_sha256}
    row = session.execute(_ADD, {**new, "file_name": file_name, "media_type": media_type}).one()
    _add_job(session, number)
    return Export.of(row._asdict()), True


def get_export(session: Session, export_id: uuid.UUID) -> Export | None:
    """The export; None where there is none."""
    row = session.execute(_GET, {"id": export_id}).one_or_none()
    return None if row is None else Export.of(row._asdict())


def list_exports(
    session: Session, *, status: str | None, limit: int, after: tuple[datetime, uuid.UUID] | None
) -> list[Export]:
    """At most ``limit`` exports, the newest first, that come after that place in this order."""
    created_at, number = after or (None, None)
    values = {"status": status, "limit": limit, "after_created_at": created_at, "after_id": number}
    return [Export.of(row._asdict()) for row in session.execute(_LIST, values)]


def claim(session: Session, export_id: uuid.UUID) -> tuple[Export, int] | None:
    """Take an export for a worker, and how often it has let others go first; None: it is gone or at its end."""
    row = session.execute(_CLAIM, {"id": export_id}).one_or_none()
    return None if row is None else (Export.of(row._asdict()), int(row.yields))


def note_version(session: Session, export: Export, data_version: str) -> bool:
    """Note what state of the data it is made from; False: it is no longer this run's."""
    return _is_ours(session, _NOTE_VERSION, export, data_version=data_version)


def set_progress(session: Session, export: Export, progress: float) -> bool:
    """Show the share of the work done; False: it is no longer this run's."""
    return _is_ours(session, _SET_PROGRESS, export, progress=progress)


def put_back(session: Session, export: Export, *, yielded: bool) -> bool:
    """Let it wait again; ``yielded``: because others go first."""
    return _is_ours(session, _PUT_BACK, export, yielded=int(yielded))


def let_wait(session: Session, export_id: uuid.UUID) -> None:
    """Let it wait again, whoever made it."""
    session.execute(_LET_WAIT, {"id": export_id})


def finish(
    session: Session,
    export: Export,
    *,
    entries: int,
    provenance: Mapping[str, Any],
    companions: Mapping[str, str],
    notes: Sequence[str],
    blob_key: str,
    sha256: str,
    size_bytes: int,
    keep_days: float,
) -> bool:
    """It is done; False: it is no longer this run's, and nobody wants its file."""
    documents = {
        "provenance": json.dumps(plain_json(provenance)),
        "companions": json.dumps(plain_json(companions)),
        "notes": json.dumps(plain_json({"notes": list(notes)})),
    }
    file = {"entries": entries, "blob_key": blob_key, "sha256": sha256, "size_bytes": size_bytes}
    return _is_ours(session, _FINISH, export, **documents, **file, keep_days=keep_days)


def fail(
    session: Session, export_id: uuid.UUID, kind: str, reason: str, keep_days: float, run: int | None = None
) -> None:
    """It failed, unless it is at its end already, or has another run than ``run``."""
    values = {
        "id": export_id,
        "kind": kind,
        "reason": reason_text(reason),
        "keep_days": keep_days,
        "run": run,
    }
    session.execute(_FAIL, values)


def cancel(session: Session, export_id: uuid.UUID, keep_days: float) -> str | None:
    """Cancel it, whatever its status; the blob that nobody refers to any more. Once more changes nothing."""
    blob_key: str | None = session.execute(_CANCEL, {"id": export_id, "keep_days": keep_days}).scalar()
    return blob_key


def end_over(session: Session, boxes: Sequence[Bounds]) -> list[str]:
    """End the exports of maps that reach into one of these boxes, degrees, and have those that are being made begin
    anew; the blobs that nobody refers to any more."""
    west, south, east, north = ([float(x) for x in side] for side in zip(*boxes, strict=True))
    values = {"west": west, "south": south, "east": east, "north": north}
    for number in session.execute(_BEGIN_OVER, values).scalars().all():
        _add_job(session, number)
    return [key for key in session.execute(_END_OVER, values).scalars() if key is not None]


def remove_old(session: Session, max_bytes: int) -> tuple[int, list[str]]:
    """Remove what has expired or is too much, the oldest first; how many, and the blobs that nobody refers to."""
    rows = session.execute(_REMOVE, {"max_bytes": max_bytes}).all()
    return len(rows), [row.blob_key for row in rows if row.blob_key is not None]


def give_jobs(session: Session) -> int:
    """Give those that wait without a job one; how many."""
    numbers = list(session.execute(_JOBLESS, {"task": MAKE_EXPORT.name}).scalars())
    for number in numbers:
        _add_job(session, number)
    return len(numbers)


def referred_blobs(session: Session) -> set[str]:
    """The blobs of all exports."""
    return set(session.execute(_BLOBS).scalars())


def others_wait(session: Session) -> bool:
    """Whether a job waits that goes before exports."""
    return bool(session.execute(_OTHERS_WAIT, {"priority": MAKE_EXPORT.priority}).scalar_one())


def _add_job(session: Session, export_id: uuid.UUID) -> None:
    add_job(session, MAKE_EXPORT, lock=ONE_AT_A_TIME, export_id=str(export_id))


def _is_ours(session: Session, statement: Any, export: Export, **values: Any) -> bool:
    found = session.execute(statement, {"id": export.id, "run": export.run, **values})
    return found.scalar() is not None
