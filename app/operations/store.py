"""Operations in the database: asked for, planned, approved, done. A row and its job commit together.

Whoever cancels an operation takes it away from the worker that plans it, which finds that out when it wants to say
something of it. One that has begun to change something is nobody's to cancel.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_json, plain_text
from app.core.errors import BusyError
from app.core.telemetry.logs import reason_text
from app.jobs.task import Kind as JobKind
from app.jobs.task import add_job
from app.operations.documents import Operation

OPERATE = JobKind("run_operation", -60)
"""Behind uploads and exports, before drives that are computed again by the thousand."""
ONE_AT_A_TIME = "operations"
"""The lock of their jobs: what changes the ground of the map does so one after the other."""
MOST_WAITING = 50
PLAN_KEPT = timedelta(days=7)

_COLUMNS = """
    id, kind, subject, request, status, progress, stage, run, yields, state, approved, plan, result, failure_kind,
    failure_reason, blob_key, created_at, started_at, finished_at
"""

# Two that ask for the same at the same moment: the second waits for the first to commit.
_ONE_BY_ONE = text("SELECT pg_advisory_xact_lock(hashtextextended('versant operations', 0))")
_SAME = text(
    f"""
    SELECT {_COLUMNS} FROM operations
    WHERE status IN ('queued', 'planned') AND kind = :kind AND request = CAST(:request AS jsonb)
    ORDER BY created_at LIMIT 1
    """  # noqa: S608 - constants
)
# What is planned waits for a person, and its file with it.
_WAITING = text(
    """
    SELECT count(*) FILTER (WHERE status <> 'running') AS operations,
        coalesce(sum(CAST(request ->> 'size_bytes' AS bigint)) FILTER (WHERE blob_key IS NOT NULL), 0) AS bytes
    FROM operations WHERE status IN ('queued', 'planned', 'running')
    """
)
_ADD = text(
    f"""
    INSERT INTO operations (id, kind, subject, request, status, blob_key)
    VALUES (:id, :kind, :subject, CAST(:request AS jsonb), 'queued', :blob_key) RETURNING {_COLUMNS}
    """  # noqa: S608 - constants
)
_GET = text(f"SELECT {_COLUMNS} FROM operations WHERE id = :id")  # noqa: S608 - constants
_LIST = text(
    f"""
    SELECT {_COLUMNS} FROM operations
    WHERE CAST(:after_id AS uuid) IS NULL
        OR (created_at, id) < (CAST(:after_created_at AS timestamptz), CAST(:after_id AS uuid))
    ORDER BY created_at DESC, id DESC LIMIT :limit
    """  # noqa: S608 - constants
)
# A running one may be claimed as well: its worker may have died and its job have come back.
_CLAIM = text(
    f"""
    UPDATE operations SET status = 'running', run = run + 1, progress = 0, stage = NULL,
        started_at = coalesce(started_at, clock_timestamp())
    WHERE id = :id AND status IN ('queued', 'running') RETURNING {_COLUMNS}
    """  # noqa: S608 - constants
)
_OURS = "WHERE id = :id AND run = :run AND status = 'running' RETURNING id"
_SET_PROGRESS = text(
    f"UPDATE operations SET progress = :progress, stage = :stage {_OURS}"  # noqa: S608 - constants
)
_SET_STATE = text(
    f"UPDATE operations SET state = state || CAST(:state AS jsonb) {_OURS}"  # noqa: S608 - constants
)
_PUT_BACK = text(
    f"""
    UPDATE operations SET status = 'queued', progress = 0, stage = NULL, yields = yields + :yielded {_OURS}
    """  # noqa: S608 - constants
)
_LET_WAIT = text(
    "UPDATE operations SET status = 'queued', progress = 0 WHERE id = :id AND status = 'running'"
)
_PLAN = text(
    f"""
    UPDATE operations SET status = 'planned', approved = false, plan = CAST(:plan AS jsonb), progress = 1, stage = NULL,
        planned_at = clock_timestamp()
    {_OURS}
    """  # noqa: S608 - constants
)
_FINISH = text(
    f"""
    UPDATE operations SET status = 'done', result = CAST(:result AS jsonb), progress = 1, stage = NULL, blob_key = NULL,
        finished_at = clock_timestamp()
    {_OURS}
    """  # noqa: S608 - constants
)
_FAIL = text(
    """
    UPDATE operations AS o SET status = 'failed', failure_kind = :kind, failure_reason = :reason, stage = NULL,
        blob_key = NULL, finished_at = clock_timestamp()
    FROM (SELECT id, blob_key FROM operations WHERE id = :id FOR UPDATE) AS was
    WHERE o.id = was.id AND o.status IN ('queued', 'running') AND (CAST(:run AS integer) IS NULL OR o.run = :run)
    RETURNING was.blob_key
    """
)
_APPROVE = text(
    f"""
    UPDATE operations SET status = 'queued', approved = true, progress = 0, stage = NULL
    WHERE id = :id AND status = 'planned' RETURNING {_COLUMNS}
    """  # noqa: S608 - constants
)
# What only plans has changed nothing: its run finds that it is not its own any more.
_CANCEL = text(
    f"""
    UPDATE operations AS o SET status = 'cancelled', stage = NULL, blob_key = NULL, finished_at = clock_timestamp()
    FROM (SELECT id AS found, blob_key AS key FROM operations WHERE id = :id FOR UPDATE) AS was
    WHERE o.id = was.found AND NOT coalesce(CAST(o.state ->> 'begun' AS boolean), false) AND (
        o.status IN ('queued', 'planned') OR o.status = 'running' AND NOT o.approved AND o.kind = ANY(:planning))
    RETURNING {_COLUMNS}, was.key
    """  # noqa: S608 - constants
)
_FORGET_PLANS = text(
    """
    UPDATE operations AS o SET status = 'cancelled', blob_key = NULL, finished_at = clock_timestamp()
    FROM (SELECT id, blob_key FROM operations
          WHERE status = 'planned' AND planned_at < now() - :age FOR UPDATE SKIP LOCKED) AS was
    WHERE o.id = was.id RETURNING was.blob_key
    """
)
_BLOBS = text("SELECT blob_key FROM operations WHERE blob_key IS NOT NULL")
# Their job is gone: a worker of a version that knew no operations took it, say.
_JOBLESS = text(
    """
    SELECT id FROM operations AS o WHERE status IN ('queued', 'running') AND NOT EXISTS (
        SELECT FROM procrastinate_jobs AS j WHERE j.status IN ('todo', 'doing') AND j.task_name = :task
            AND j.args ->> 'operation_id' = CAST(o.id AS text))
    ORDER BY created_at FOR UPDATE SKIP LOCKED
    """
)
_OTHERS_WAIT = text(
    """
    SELECT EXISTS (
        SELECT FROM procrastinate_jobs
        WHERE status = 'todo' AND priority > :priority AND (scheduled_at IS NULL OR scheduled_at <= now()))
    """
)


def require_place(session: Session, size_bytes: int, kept_bytes: int) -> None:
    """``BusyError`` where so many operations wait that no other may, or where with a file of this size the files of all
    would take more than ``kept_bytes``.
    """
    waiting = session.execute(_WAITING).one()
    if waiting.operations >= MOST_WAITING:
        raise BusyError(
            f"{waiting.operations} operations wait already. Try again when some of them are done; planned ones wait to "
            "be approved or cancelled."
        )
    if waiting.bytes + size_bytes > kept_bytes:
        raise BusyError(
            f"Files of operations that are not done take {waiting.bytes} bytes, and with this one they would take more "
            f"than {kept_bytes} (VERSANT_IMPORTS_KEPT_BYTES). Approve or cancel what is planned, or wait for what runs."
        )


def ask(
    session: Session,
    *,
    kind: str,
    subject: str,
    request: Mapping[str, Any],
    kept_bytes: int,
    blob_key: str | None = None,
) -> tuple[Operation, bool]:
    """An operation with its job, or the same one that waits or is planned; the flag says whether it is new.

    ``BusyError`` where too many wait (``require_place``).
    """
    session.execute(_ONE_BY_ONE)
    wanted = {"kind": kind, "request": json.dumps(plain_json(request))}
    if (row := session.execute(_SAME, wanted).one_or_none()) is not None:
        return Operation.of(row._asdict()), False
    require_place(session, int(request.get("size_bytes", 0)), kept_bytes)
    number = uuid.uuid4()
    values = {**wanted, "id": number, "subject": plain_text(subject), "blob_key": blob_key}
    row = session.execute(_ADD, values).one()
    _add_job(session, number)
    return Operation.of(row._asdict()), True


def get_operation(session: Session, number: uuid.UUID) -> Operation | None:
    """The operation; None where there is none."""
    row = session.execute(_GET, {"id": number}).one_or_none()
    return None if row is None else Operation.of(row._asdict())


def list_operations(
    session: Session, *, limit: int, after: tuple[datetime, uuid.UUID] | None
) -> list[Operation]:
    """At most ``limit`` operations, the newest first, that come after that place in this order."""
    created_at, number = after or (None, None)
    values = {"limit": limit, "after_created_at": created_at, "after_id": number}
    return [Operation.of(row._asdict()) for row in session.execute(_LIST, values)]


def claim(session: Session, number: uuid.UUID) -> Operation | None:
    """Take an operation for a worker; None: it is at its end, or waits for a person."""
    row = session.execute(_CLAIM, {"id": number}).one_or_none()
    return None if row is None else Operation.of(row._asdict())


def set_progress(session: Session, operation: Operation, stage: str, progress: float) -> bool:
    """Show what is done and how much of it; False: it is no longer this run's."""
    return _is_ours(session, _SET_PROGRESS, operation, stage=plain_text(stage), progress=progress)


def set_state(session: Session, operation: Operation, **state: Any) -> bool:
    """Note what a later run has to know; False: it is no longer this run's."""
    return _is_ours(session, _SET_STATE, operation, state=json.dumps(state))


def put_back(session: Session, operation: Operation, *, yielded: bool) -> bool:
    """Let it wait again; ``yielded``: because others go first."""
    return _is_ours(session, _PUT_BACK, operation, yielded=int(yielded))


def let_wait(session: Session, number: uuid.UUID) -> None:
    """Let it wait again, whoever was at it."""
    session.execute(_LET_WAIT, {"id": number})


def plan(session: Session, operation: Operation, found: Mapping[str, Any]) -> bool:
    """It has said what it would do, and waits for a person; False: it is no longer this run's."""
    return _is_ours(session, _PLAN, operation, plan=json.dumps(plain_json(found)))


def finish(session: Session, operation: Operation, result: Mapping[str, Any]) -> bool:
    """It is done; False: it is no longer this run's."""
    return _is_ours(session, _FINISH, operation, result=json.dumps(plain_json(result)))


def fail(session: Session, number: uuid.UUID, kind: str, reason: str, run: int | None = None) -> str | None:
    """It failed, unless it is at its end already, or has another run than ``run``; the file that nobody wants now."""
    values = {"id": number, "kind": kind, "reason": reason_text(reason), "run": run}
    blob_key: str | None = session.execute(_FAIL, values).scalar()
    return blob_key


def approve(session: Session, number: uuid.UUID) -> Operation | None:
    """Have the plan carried out; None: there is none to be approved."""
    row = session.execute(_APPROVE, {"id": number}).one_or_none()
    if row is None:
        return None
    _add_job(session, number)
    return Operation.of(row._asdict())


def cancel(session: Session, number: uuid.UUID, planning: list[str]) -> tuple[Operation, str | None] | None:
    """Cancel what has changed nothing yet, and the file that nobody wants now; None: it cannot be.

    ``planning`` are the kinds that change nothing before they are approved.
    """
    row = session.execute(_CANCEL, {"id": number, "planning": planning}).one_or_none()
    return None if row is None else (Operation.of(row._asdict()), row.key)


def forget_plans(session: Session, age: timedelta = PLAN_KEPT) -> list[str]:
    """Cancel what has been planned for so long and nobody wanted; the files that nobody wants now."""
    return [key for key in session.execute(_FORGET_PLANS, {"age": age}).scalars() if key is not None]


def give_jobs(session: Session) -> int:
    """Give those that wait without a job one; how many."""
    numbers = list(session.execute(_JOBLESS, {"task": OPERATE.name}).scalars())
    for number in numbers:
        _add_job(session, number)
    return len(numbers)


def referred_blobs(session: Session) -> set[str]:
    """The files of all operations."""
    return set(session.execute(_BLOBS).scalars())


def others_wait(session: Session) -> bool:
    """Whether a job waits that goes before operations."""
    return bool(session.execute(_OTHERS_WAIT, {"priority": OPERATE.priority}).scalar_one())


def _add_job(session: Session, number: uuid.UUID) -> None:
    add_job(session, OPERATE, lock=ONE_AT_A_TIME, operation_id=str(number))


def _is_ours(session: Session, statement: Any, operation: Operation, **values: Any) -> bool:
    found = session.execute(statement, {"id": operation.id, "run": operation.run, **values})
    return found.scalar() is not None
