"""Operations in the database: found or added, planned, approved, cancelled. The rest is ``app.jobs.requests.store``'s.

An operation that has begun to change something is nobody's to cancel.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from datetime import timedelta
from typing import Any

from sqlalchemy import func, text
from sqlalchemy.orm import Session

from app.core.db import plain_json
from app.core.errors import BusyError
from app.core.messages import say
from app.core.settings import Settings
from app.core.tables import requests as tables
from app.jobs.requests.store import NOW, RequestStore
from app.jobs.task import Kind as JobKind
from app.operations.documents import PLANNED_FIRST, Operation, Status

OPERATE = JobKind("run_operation", -60)
"""Behind uploads and exports, before drives that are computed again by the thousand."""
MOST_WAITING = 50
PLAN_KEPT = timedelta(days=7)

_BEGUN_ONCE = {"started_at": func.coalesce(tables.Operation.started_at, NOW)}
operations = RequestStore(
    "operation", tables.Operation, Operation.of, OPERATE, "operations", on_claim=_BEGUN_ONCE
)

_SAME = text("""
    SELECT id FROM operations
    WHERE status IN ('queued', 'planned') AND kind = :kind AND request = CAST(:request AS jsonb)
    ORDER BY created_at LIMIT 1
""")
# What is planned waits for a person, and its file with it.
_WAITING = text("""
    SELECT count(*) FILTER (WHERE status <> 'running') AS operations,
        coalesce(sum(CAST(request ->> 'size_bytes' AS bigint)) FILTER (WHERE blob_key IS NOT NULL), 0) AS bytes
    FROM operations WHERE status IN ('queued', 'planned', 'running')
""")
_FORGET_PLANS = text("""
    UPDATE operations AS o SET status = 'cancelled', blob_key = NULL, finished_at = clock_timestamp()
    FROM (SELECT id, blob_key FROM operations
          WHERE status = 'planned' AND planned_at < now() - :age FOR UPDATE SKIP LOCKED) AS was
    WHERE o.id = was.id RETURNING was.blob_key
""")
# In the order in which they were asked for, by its index: few that were asked for so long ago are there.
_FORGET_ENDED = text("""
    DELETE FROM operations WHERE status IN ('done', 'failed', 'cancelled')
        AND created_at < now() - make_interval(secs => :age_s)
        AND finished_at < now() - make_interval(secs => :age_s)
""")


def require_place(session: Session, size_bytes: int, kept_bytes: int) -> None:
    """``BusyError`` where so many operations wait that no other may, or where with a file of this size the files of all
    would take more than ``kept_bytes``.
    """
    waiting = session.execute(_WAITING).one()
    if waiting.operations >= MOST_WAITING:
        raise BusyError(say("operation.many_wait", n=waiting.operations))
    if waiting.bytes + size_bytes > kept_bytes:
        raise BusyError(say("operation.many_bytes", bytes=waiting.bytes, most=kept_bytes))


def ask(
    session: Session, *, kind: str, request: Mapping[str, Any], kept_bytes: int, **columns: Any
) -> tuple[Operation, bool]:
    """An operation with its job, or the same one that waits or is planned; the flag says whether it is new.

    ``columns`` are its subject and the key of its file. ``BusyError`` where too many wait (``require_place``).
    """
    operations.one_by_one(session)
    document = plain_json(request)
    same = session.execute(_SAME, {"kind": kind, "request": json.dumps(document)}).scalar()
    if same is not None and (operation := operations.get(session, same)) is not None:
        return operation, False
    require_place(session, int(request.get("size_bytes", 0)), kept_bytes)
    return operations.add(session, kind=kind, request=document, **columns), True


def plan(session: Session, operation: Operation, document: Mapping[str, Any]) -> bool:
    """It has said what it would do, and waits for a person; False: it is no longer this run's."""
    planned = {"status": "planned", "approved": False, "plan": plain_json(document), "planned_at": NOW}
    return operations.update(session, operation, stage=None, progress=1, **planned)


def approve(session: Session, number: uuid.UUID) -> Operation | None:
    """Have the plan carried out; None: there is none to be approved."""
    operation = operations.hold(session, number)
    if operation is None or operation.status is not Status.PLANNED:
        return None
    operations.write(session, number, status="queued", approved=True, progress=0, stage=None)
    return operations.enqueue(session, number)


def cancel(session: Session, number: uuid.UUID) -> tuple[Operation, str | None] | None:
    """Cancel what has changed nothing yet, and the file that nobody wants now; None: it cannot be.

    What only plans has changed nothing: its run finds that it is not its own any more.
    """
    operation = operations.hold(session, number)
    if operation is None or operation.begun:
        return None
    plans = operation.status is Status.RUNNING and not operation.approved and operation.kind in PLANNED_FIRST
    if operation.status not in {Status.QUEUED, Status.PLANNED} and not plans:
        return None
    operations.write(session, number, status="cancelled", stage=None, blob_key=None, finished_at=NOW)
    cancelled = operations.get(session, number)
    return None if cancelled is None else (cancelled, operation.blob_key)


def forget(session: Session, settings: Settings) -> list[str | None]:
    """Cancel what has been planned for long and nobody wanted; of each the file, which nobody wants now.

    What ended very long ago goes.
    """
    session.execute(_FORGET_ENDED, {"age_s": 86400.0 * settings.history_kept_days})
    return list(session.execute(_FORGET_PLANS, {"age": PLAN_KEPT}).scalars())
