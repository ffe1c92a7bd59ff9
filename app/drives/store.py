"""Drives in the database: queued -> running -> done or failed, perhaps again; deleted at any time.

The SQL on drives stands here, but for many at once (``batches``) and for their runs and ends (``claims``). Records
are detached from any session. Callers own the transaction, enqueue the jobs and delete the blobs
(``app.drives.intake``). Whose drives a statement finds is the database's to say (``app.core.caller``); only what is
the same log is asked among an owner's drives, also by an operator, who sees all.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

from app.changes.webhooks.store import forget_drives
from app.core.caller import present_caller, seeing_all
from app.core.db import plain_json, plain_text
from app.core.errors import ConflictError
from app.core.messages import say
from app.core.tables import HAS_LOG, IS_SHOWN
from app.core.telemetry.tracing import traceparent
from app.drives.documents import ROADS_STAGE, Drive, DrivePlace
from app.drives.listing import Order, key_of, matching, stretches
from app.network.marks import PATIENCE
from app.network.rejections import Rejections, rejections_of
from app.roads.named_extracts import NO_ROADS

# What a Drive is made of; the table is called d. Few drives have marks, and these an index.
_SHOWN = f"""
    d.*, ARRAY(SELECT DISTINCT m.cell FROM network_marks AS m
               WHERE m.drive_id = d.id AND m.generation = d.generation AND m.tries > {PATIENCE}
               ORDER BY m.cell) AS unsolved_cells,
    (SELECT w.id FROM drives AS w WHERE w.id = d.duplicate_of AND {IS_SHOWN.format("w")}) AS duplicate_of_shown,
    (SELECT w.owner_id <> d.owner_id FROM drives AS w WHERE w.id = d.duplicate_of) AS duplicate_is_anothers,
    CASE WHEN d.status = 'running'
         THEN CAST(extract(epoch FROM clock_timestamp() - d.started_at) AS float8) END AS ran_s,
    CASE WHEN d.bounds IS NOT NULL
         THEN ARRAY[ST_XMin(d.bounds), ST_YMin(d.bounds), ST_XMax(d.bounds), ST_YMax(d.bounds)] END AS bbox
"""  # noqa: S608 - constants
_FROM = f"FROM drives AS d WHERE {IS_SHOWN.format('d')}"
_DRIVES = "SELECT" + _SHOWN + _FROM

_GET = text(_DRIVES + " AND d.id = :id")
_IS_THERE = text("SELECT d.id " + _FROM + " AND d.id = :id")
_GET_EACH = text(_DRIVES + " AND d.id = ANY(:ids)")
# Of drives from before contents were told only the bytes are known, plain ones perhaps; the very same bytes first.
_GET_BY_CONTENT = text(
    _DRIVES
    + """
     AND d.owner_id = (SELECT versant_owner())
        AND (d.content_sha256 = :content_sha256 OR d.sha256 IN (:sha256, :content_sha256))
    ORDER BY d.sha256 = :sha256 DESC, d.created_at LIMIT 1
    """
)

WAITS_FOR_ROADS = f"""
    d.status = 'failed' AND d.failure_kind IN {NO_ROADS} AND d.stage = '{ROADS_STAGE}' AND d.{HAS_LOG}
"""
"""Drives (d) that ended for want of roads where they were, and are computed by themselves once these come. What
matches no road that is there fails in a later stage, and waits for nothing."""

# Answered from the indexes of the orders, of the status and of the failure: what is not asked for is left out.
_FILTERS = {
    "status": " AND d.status = :status",
    "failure": " AND d.status = 'failed' AND d.failure_kind = :failure",
    "waits_for=roads": f" AND {WAITS_FOR_ROADS}",
    "waits_for=nothing": f" AND ({WAITS_FOR_ROADS}) IS NOT TRUE",
    "created_after": " AND d.created_at >= :created_after",
    "created_before": " AND d.created_at < :created_before",
    "batch": " AND d.batch_id = :batch",
}
# Another upload of the same bytes or content that has not committed yet is waited for.
_CREATE = text("""
    INSERT INTO drives (id, sha256, content_sha256, filename, size_bytes, blob_key, status, method, options,
                        traceparent)
    VALUES (:id, :sha256, :content_sha256, :filename, :size_bytes, :blob_key, 'queued', :method,
            CAST(:options AS jsonb), :traceparent)
    ON CONFLICT DO NOTHING RETURNING id
""")
# Whoever may only upload follows what it sent: it has the log, so it may see what becomes of it.
_SENT = text(
    "UPDATE drives SET sent_by = versant_key() WHERE id = :id AND sent_by IS DISTINCT FROM versant_key()"
)
# Nothing when the drive is gone, or another upload was faster.
_GIVE_BLOB = text("""
    UPDATE drives SET blob_key = :blob_key, sha256 = :sha256, size_bytes = :size_bytes
    WHERE id = :id AND blob_key = :lost_key RETURNING id
""")

_REPLACE_LOG = text(f"""
    UPDATE drives SET blob_key = :blob_key, sha256 = :sha256, content_sha256 = :content_sha256, size_bytes = :size_bytes
    WHERE id = :id AND blob_key = :former_key AND status <> 'cancelled' AND {HAS_LOG} RETURNING id
""")  # noqa: S608 - a constant

CANCELLED = """
    status = 'cancelled', stage = NULL, generation = generation + 1, finished_at = clock_timestamp(),
    sha256 = 'removed ' || d.id, content_sha256 = NULL, filename = '', options = jsonb_build_object(), report = NULL,
    drive_time = NULL, failure_kind = NULL, failure_reason = NULL, failure_where = NULL, failure_said = NULL,
    before_batch = NULL, traceparent = NULL
"""
"""What becomes of a drive (d) whose removal is asked for. A worker that computes it finds by the generation that its
result is unwanted. What it is known by is free from here on: the same log uploaded again is another drive, and does not
go with this one. Its row may have to wait for its cells: what stays is what takes it back."""
_CANCEL = text(
    f"UPDATE drives AS d SET {CANCELLED} WHERE d.id = :id AND {IS_SHOWN.format('d')} RETURNING d.generation"  # noqa: S608
)
# Of drives whose removal is asked for. A worker that computes a trial finds that it is gone, and ends.
_FORGET = [
    text(f"DELETE FROM {table} WHERE drive_id = ANY(CAST(:ids AS uuid[]))")  # noqa: S608 - constants
    for table in ("drive_trials", "drive_tracks", "drive_pictures")
]
# By the higher generation a worker that still computes the older request finds that its result is unwanted.
ANEW = """
    status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL, failure_where = NULL,
    failure_said = NULL, generation = generation + 1, queued_at = clock_timestamp(), started_at = NULL,
    finished_at = NULL, traceparent = :traceparent
"""
_ASK_ANEW = text(
    f"""
    UPDATE drives
    SET {ANEW}, method = :method, options = CAST(:options AS jsonb), batch_id = NULL, before_batch = NULL
    WHERE id = :id AND status <> 'cancelled' AND {HAS_LOG} RETURNING id
    """  # noqa: S608 - constants
)

NEWEST_FIRST = Order()
MOST_READS = 3
"""Of one page, while drives of it are being removed."""

_WAIT_AT_MOST = text("SELECT set_config('lock_timeout', :timeout, true)")
_BLOBS = text(f"SELECT blob_key FROM drives WHERE {HAS_LOG}")  # noqa: S608 - a constant


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
    """Insert a queued drive, or find the caller's owner's that holds the same content; the flag says whether it is new.

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


def note_sender(session: Session, drive_id: uuid.UUID) -> None:
    """Let the key of the present upload see the drive from now on, in the place of the one that sent it before."""
    session.execute(_SENT, {"id": drive_id})


def give_blob(session: Session, drive: Drive, *, sha256: str, size_bytes: int, blob_key: str) -> bool:
    """Let a drive whose blob is lost have another of the same content; False: it is gone, or has one by now."""
    values = {"sha256": sha256, "size_bytes": size_bytes, "blob_key": blob_key}
    return changed(session, _GIVE_BLOB, {"id": drive.id, "lost_key": drive.blob_key, **values})


def replace_log(
    session: Session, drive_id: uuid.UUID, former_key: str, *, sha256: str, content_sha256: str, **blob: Any
) -> Drive | None:
    """Give the drive another log (``blob_key``, ``size_bytes``) in the place of that, and queue it again by its method.

    None: it is gone, or has another by now. The caller enqueues the job. Where the caller's owner has a drive of that
    content, ``ConflictError``.
    """
    same = _one(session, _GET_BY_CONTENT, {"sha256": sha256, "content_sha256": content_sha256})
    if same is not None and same.id != drive_id:
        raise ConflictError(say("live.same_log", id=same.id))
    values = {"sha256": sha256, "content_sha256": content_sha256, **blob}
    if not changed(session, _REPLACE_LOG, {"id": drive_id, "former_key": former_key, **values}):
        return None
    drive = get_drive(session, drive_id)
    return None if drive is None else request_reprocess(session, drive_id, drive.method, drive.options)


def get_drive(session: Session, drive_id: uuid.UUID) -> Drive | None:
    """The drive, or None."""
    return _one(session, _GET, {"id": drive_id})


def is_there(session: Session, drive_id: uuid.UUID) -> bool:
    """Whether the drive is there, and not being removed."""
    return changed(session, _IS_THERE, {"id": drive_id})


def get_drives(session: Session, ids: Collection[uuid.UUID]) -> dict[uuid.UUID, Drive]:
    """Those of the drives that there are, by id."""
    rows = session.execute(_GET_EACH, {"ids": list(ids)})
    return {drive.id: drive for drive in _shown(session, rows)}


def list_drives(
    session: Session,
    *,
    q: str | None = None,
    order: Order = NEWEST_FIRST,
    limit: int = 100,
    after: DrivePlace | None = None,
    before: DrivePlace | None = None,
    **asked: Any,
) -> list[Drive]:
    """At most ``limit`` drives in this order, those next behind the place ``after`` or the last before ``before``.

    Those with words of ``q`` in the file's name for which all holds that is ``asked`` and not None: ``status``,
    ``failure`` (the kind of it), ``waits_for`` (``roads`` or ``nothing``), ``created_after`` and ``created_before`` (of
    the upload), ``batch``.
    """
    values = {name: value for name, value in asked.items() if value is not None}
    conditions = "".join(
        _FILTERS[name if name in _FILTERS else f"{name}={value}"] for name, value in values.items()
    )
    if q is not None:
        named_so, words = matching(session, q)
        conditions, values = conditions + named_so, values | words
    if (owner_id := present_caller().confined_to) is not None:
        conditions, values = conditions + " AND d.owner_id = :owner_id", {**values, "owner_id": owner_id}
    for _ in range(MOST_READS):
        listed: list[Row[Any]] = []
        # Row level security keeps the planner from the index of words, and from knowing how few drives an owner has.
        # So the owner is named here, and what is shown of these drives is read as the caller below.
        with seeing_all(session):
            for part in stretches(order, after or before, backwards=before is not None):
                query = (
                    f"SELECT d.id, {key_of(order)} AS list_key {_FROM}{conditions}{part.condition} "
                    f"ORDER BY {part.order_by} LIMIT :limit"
                )
                listed += session.execute(
                    text(query), {**values, **part.values, "limit": limit - len(listed)}
                )
                if len(listed) == limit:
                    break
        there = get_drives(session, [row.id for row in listed])
        if len(there) == len(listed):
            break
        # one was removed between both
    shown = [there[row.id].model_copy(update={"list_key": row.list_key}) for row in listed if row.id in there]
    return shown if before is None else shown[::-1]


def request_reprocess(
    session: Session, drive_id: uuid.UUID, method: str, options: Mapping[str, Any]
) -> Drive | None:
    """Queue the drive again, perhaps for another method; None when there is no such drive.

    A worker that still computes the older request discards its result. What is published stays until the new
    run replaces it. The caller enqueues the job in the same transaction (``app.drives.intake.reprocess``).
    """
    values = {"id": drive_id, "method": method, "options": json_text(options), "traceparent": traceparent()}
    return get_drive(session, drive_id) if changed(session, _ASK_ANEW, values) else None


def request_removal(session: Session, drive_id: uuid.UUID) -> int | None:
    """Cancel the drive whatever its status: its generation; None: there is none, or it was cancelled before.

    The caller enqueues the job that takes it back in the same transaction (``app.drives.intake.remove_drive``).
    """
    generation: int | None = session.execute(_CANCEL, {"id": drive_id}).scalar()
    if generation is not None:
        forget(session, [drive_id])
    return generation


def forget(session: Session, drive_ids: Collection[uuid.UUID]) -> None:
    """Delete what is stored of cancelled drives to be shown, and nothing else: trials, tracks, pictures, messages."""
    for statement in _FORGET:
        session.execute(statement, {"ids": list(drive_ids)})
    forget_drives(session, drive_ids)


def unreferenced_blobs(session: Session, keys: Sequence[str]) -> list[str]:
    """Those of ``keys`` that no drive refers to whose log is kept, sorted."""
    referred = set(session.execute(_BLOBS).scalars()) if keys else set()
    return sorted(set(keys) - referred)


def _one(session: Session, statement: TextClause, values: Mapping[str, Any]) -> Drive | None:
    """The drive of a query of one drive or of none."""
    return next(iter(_shown(session, session.execute(statement, values))), None)


def _shown(session: Session, rows: Iterable[Row[Any]]) -> list[Drive]:
    """The drives of these rows, each with how it agrees with the others by now."""
    columns_of_each = [{**row._mapping, "duplicate_of": row.duplicate_of_shown} for row in rows]
    with_report = [columns["id"] for columns in columns_of_each if columns["report"] is not None]
    rejections: dict[uuid.UUID, Rejections] = {}
    if with_report:
        with seeing_all(session):  # of drives that the caller is shown anyhow
            rejections = rejections_of(session, with_report)
    return [Drive.of({**columns, "rejections": rejections.get(columns["id"])}) for columns in columns_of_each]


def changed(session: Session, statement: TextClause, values: Mapping[str, Any]) -> bool:
    """Whether the statement found its drive."""
    return session.execute(statement, values).scalar() is not None


def json_text(value: Mapping[str, Any]) -> str:
    """As a column of documents takes it."""
    return json.dumps(plain_json(value))
