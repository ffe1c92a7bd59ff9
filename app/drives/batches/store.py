"""Many drives at once in the database: asked for anew in batches, followed, called off; and drives without a job.

All of it goes in pieces, each a short transaction of the caller (``app.drives.batches.enqueuing``): drives never come
to the client, and a batch that is cut off goes on where it stood. Workers go on with it, and see what every owner has:
a batch knows whose drives it is about (``drives_of``, which the database notes).
"""

from __future__ import annotations

import uuid
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.tables import HAS_LOG
from app.drives.batches.documents import LOG_DELETED, Batch, BatchState, Selection, Standing
from app.drives.batches.selection import conditions, includes_hopeless
from app.drives.queue import TASK, jobs_behind
from app.drives.store import ANEW

PIECE_DRIVES = 1000
"""In one transaction: a tenth of a second or so, as long as somebody who deletes one of them may wait."""

_FIND = text("""
    SELECT id FROM batches
    WHERE state = 'enqueuing' AND owner_id = (SELECT versant_owner())
        AND drives_of IS NOT DISTINCT FROM (SELECT versant_confined_to()) AND selection = CAST(:selection AS jsonb)
        AND coalesce(method, '') = coalesce(CAST(:method AS text), '')
""")
_OPEN = text("""
    INSERT INTO batches (selection, method, state)
    VALUES (CAST(:selection AS jsonb), :method, 'enqueuing') ON CONFLICT DO NOTHING RETURNING id
""")

# Held while a piece is enqueued: the next piece, whoever takes it, begins after this one.
_HOLD = text("""
    SELECT id, asked_at, selection, method, after_created_at, after_id, drives_of FROM batches
    WHERE id = :batch AND state = 'enqueuing' FOR UPDATE
""")

# In the order of uploads, as the queue will be; drives that were asked for since the batch was are of no concern.
_ENDED = """
    FROM drives AS d
    WHERE d.status IN ('done', 'failed') AND d.queued_at <= coalesce(CAST(:asked_at AS timestamptz), now())
"""
_SELECTED = f"{_ENDED} AND d.{HAS_LOG}"
_WITHOUT_LOG = f"SELECT count(*) {_ENDED} AND NOT d.{HAS_LOG}"
_OF_OWNER = " AND d.owner_id = :drives_of"
_SKIPPED = "SELECT d.failure_kind, count(*) {selected} GROUP BY 1 ORDER BY 2 DESC, 1"
_STANDING = text("""
    SELECT coalesce(sum(drives) FILTER (WHERE status IN ('done', 'failed')), 0),
           coalesce(sum(drives) FILTER (WHERE status IN ('queued', 'running')), 0)
    FROM drive_counts
""")
_AFTER = " AND (d.created_at, d.id) > (:after_created_at, :after_id)"
BEFORE_BATCH = """jsonb_strip_nulls(jsonb_build_object(
                'status', d.status, 'stage', d.stage, 'progress', d.progress, 'failure_kind', d.failure_kind,
                'failure_reason', d.failure_reason, 'failure_where', d.failure_where,
                'failure_said', d.failure_said, 'method', d.method,
                'started_at', d.started_at, 'finished_at', d.finished_at, 'queued_at', d.queued_at))
                || jsonb_build_object('options', d.options)"""
"""What a drive (d) was, for a batch that is called off"""
_ENQUEUE = """
    WITH chosen AS MATERIALIZED (
        SELECT d.id {selected} ORDER BY d.created_at, d.id LIMIT :piece FOR UPDATE OF d
    ), asked AS (
        UPDATE drives AS d
        SET {anew}, method = coalesce(CAST(:method AS text), d.method),
            options = CASE WHEN CAST(:method AS text) IS NULL THEN d.options
                -- columns belong to the file, and not to the method
                ELSE jsonb_strip_nulls(jsonb_build_object('columns', d.options -> 'columns')) END,
            batch_id = :batch, before_batch = {before}
        FROM chosen WHERE d.id = chosen.id
        RETURNING d.id, d.generation, d.created_at
    ), last AS (SELECT created_at, id FROM asked ORDER BY created_at DESC, id DESC LIMIT 1),
    deferred AS (SELECT {jobs} AS drives FROM asked)
    UPDATE batches AS b
    SET drives = b.drives + deferred.drives, after_created_at = coalesce(last.created_at, b.after_created_at),
        after_id = coalesce(last.id, b.after_id),
        state = CASE WHEN deferred.drives < :piece THEN 'enqueued' ELSE b.state END,
        -- the box may be where somebody drives, and batches outlast drives
        selection = CASE WHEN deferred.drives < :piece THEN b.selection - 'bbox' ELSE b.selection END
    FROM deferred LEFT JOIN last ON true
    WHERE b.id = :batch
    RETURNING b.state = 'enqueuing'
"""

_CANCEL = text(
    "UPDATE batches SET state = 'cancelled', selection = selection - 'bbox' "
    "WHERE id = :batch AND selection <> :renewal AND selection ->> 'which' <> 'import' RETURNING id"
)

# A job that a worker has just taken stays; the worker finds that the drive is not its own.
_PUT_BACK = text("""
    WITH waiting AS MATERIALIZED (
        SELECT id FROM drives WHERE status = 'queued' AND batch_id = :batch AND before_batch IS NOT NULL
        ORDER BY created_at, id LIMIT :piece FOR UPDATE
    ), back AS (
        UPDATE drives AS d
        SET (status, stage, progress, failure_kind, failure_reason, failure_where, failure_said, method, options,
             queued_at, started_at, finished_at)
            = (SELECT b.status, b.stage, b.progress, b.failure_kind, b.failure_reason, b.failure_where,
                      b.failure_said, b.method, b.options, b.queued_at, b.started_at, b.finished_at
               FROM jsonb_populate_record(CAST(NULL AS drives), d.before_batch) AS b),
            batch_id = NULL, before_batch = NULL
        FROM waiting WHERE d.id = waiting.id RETURNING d.id
    ), gone AS (
        DELETE FROM procrastinate_jobs AS j USING back
        WHERE j.args ->> 'drive_id' = CAST(back.id AS text) AND j.task_name = :task AND j.status = 'todo'
    )
    SELECT count(*) FROM back
""")

# To be gone on with: batches that are not all in the queue yet, and cancelled ones of which drives still wait.
_UNFINISHED = text("""
    SELECT id, state = 'cancelled' FROM batches WHERE state = 'enqueuing'
        OR state = 'cancelled' AND id IN (
            SELECT batch_id FROM drive_counts WHERE status = 'queued' GROUP BY batch_id HAVING sum(drives) > 0)
    ORDER BY id
""")

_GET = text("SELECT state, asked_at, method, selection, drives FROM batches WHERE id = :batch")
_COUNTS = """
    SELECT coalesce(sum(drives), 0) AS drives,
           coalesce(sum(drives) FILTER (WHERE status = 'queued'), 0) AS queued,
           coalesce(sum(drives) FILTER (WHERE status = 'running'), 0) AS running,
           coalesce(sum(drives) FILTER (WHERE status = 'done'), 0) AS done,
           coalesce(sum(drives) FILTER (WHERE status IN ('failed', 'cancelled')), 0) AS failed,
           (SELECT coalesce(sum(progress), 0) FROM drives WHERE status = 'running' {of_batch}) AS half_done
    FROM drive_counts
"""
_COUNTS_OF_BATCH = text(_COUNTS.format(of_batch="AND batch_id = :batch") + "WHERE batch_id = :batch")
_UNDER_WAY = """
    WHERE batch_id IS NULL AND status IN ('queued', 'running') OR batch_id IN (
        SELECT batch_id FROM drive_counts WHERE status IN ('queued', 'running')
        GROUP BY batch_id HAVING sum(drives) > 0)
"""
_COUNTS_UNDER_WAY = text(_COUNTS.format(of_batch="") + _UNDER_WAY)

# What is still to be put into the queue, or was asked for so recently, is not over; a drive names its last batch.
_FORGET = text("""
    DELETE FROM batches AS b WHERE state <> 'enqueuing' AND asked_at < now() - make_interval(secs => :age_s)
        AND NOT EXISTS (SELECT FROM drives AS d WHERE d.batch_id = b.id)
""")

# Rows of one kind become one. Two who do so at once take different rows, or the second none.
_FOLD_COUNTS = text("""
    WITH gone AS (DELETE FROM drive_counts WHERE (SELECT count(*) FROM drive_counts) > :most_rows RETURNING *)
    INSERT INTO drive_counts (owner_id, day, status, failure_kind, batch_id, drives, distance_m, size_bytes)
    SELECT owner_id, day, status, failure_kind, batch_id, sum(drives), sum(distance_m), sum(size_bytes) FROM gone
    GROUP BY owner_id, day, status, failure_kind, batch_id HAVING sum(drives) <> 0 OR sum(size_bytes) <> 0
""")

# A drive and its job commit together; only what a migration asks for anew has no job. It becomes a batch of its own,
# the selection of which says so. One at a time, so that none gets two.
RENEWAL = '{"which": "renewal"}'
_ADOPTION = 0x5653_4144  # "VSAD": any constant that no other user of this database takes
_ONE_ADOPTS = text("SELECT pg_advisory_xact_lock(:key)")
_ADOPT = text(
    f"""
    WITH waiting AS MATERIALIZED (
        SELECT d.id FROM drives AS d
        WHERE d.status = 'queued'
            AND (CAST(:after_id AS uuid) IS NULL OR (d.created_at, d.id) > (:after_created_at, :after_id))
            AND NOT EXISTS (
                SELECT FROM procrastinate_jobs AS j
                WHERE j.args ->> 'drive_id' = CAST(d.id AS text) AND j.status IN ('todo', 'doing')
                    AND j.task_name = :task AND CAST(j.args ->> 'generation' AS integer) = d.generation)
        ORDER BY d.created_at, d.id LIMIT :piece FOR UPDATE OF d SKIP LOCKED
    ), made AS (
        INSERT INTO batches (selection, state, drives)
        SELECT CAST(:renewal AS jsonb), 'enqueued', 0 FROM waiting
        WHERE CAST(:batch AS bigint) IS NULL LIMIT 1 RETURNING id
    ), named AS (
        UPDATE drives AS d SET batch_id = coalesce(:batch, (SELECT id FROM made)), before_batch = NULL
        FROM waiting WHERE d.id = waiting.id RETURNING d.id, d.generation, d.created_at, d.batch_id
    ), deferred AS (SELECT {jobs_behind(TASK)} AS drives FROM named)
    SELECT deferred.drives, named.batch_id, named.created_at, named.id FROM deferred, named
    ORDER BY named.created_at DESC, named.id DESC LIMIT 1
    """  # noqa: S608 - constants
)

# The planner must not take a long queue for the empty one that it was until autovacuum comes round.
_ANALYZE = text("SELECT analyze_queue()")


class Adopted(NamedTuple):
    """A piece of drives without a job that got one: how many, their batch, and the last of them."""

    drives: int
    batch: int
    after_created_at: datetime
    after_id: uuid.UUID


def open_batch(session: Session, selection: Selection, method: str | None) -> int:
    """The number of a batch of these drives, none of which is in the queue yet; or of the same one that is under way.

    ``method`` None: each drive's own. Pieces follow (``enqueue_piece``).
    """
    values = {"selection": selection.model_dump_json(exclude_none=True), "method": method}
    while True:
        for statement in (_OPEN, _FIND):
            if (number := session.execute(statement, values).scalar()) is not None:
                return int(number)
        # the one that was in the way has just been enqueued to its end


def enqueue_piece(session: Session, batch: int) -> bool:
    """Queue the batch's next drives again, behind uploads; whether there may be more."""
    held = session.execute(_HOLD, {"batch": batch}).one_or_none()
    if held is None:
        return False
    where, values = conditions(Selection.model_validate(held.selection), held.method)
    of_owner = "" if held.drives_of is None else _OF_OWNER
    selected = _SELECTED + of_owner + where + (_AFTER if held.after_id else "")
    statement = text(
        _ENQUEUE.format(selected=selected, anew=ANEW, jobs=jobs_behind(TASK), before=BEFORE_BATCH)
    )
    parameters = {**held._mapping, **values, "batch": batch, "piece": PIECE_DRIVES, "traceparent": None}
    return bool(session.execute(statement, parameters).scalar_one())


def count_selected(session: Session, selection: Selection, method: str | None) -> int:
    """How many drives a batch of this selection would queue now. Reads the whole table."""
    where, values = conditions(selection, method)
    counted = text("SELECT count(*)" + _SELECTED + where)
    return int(session.execute(counted, {**values, "asked_at": None, "method": method}).scalar_one())


def count_skipped(session: Session, selection: Selection, method: str | None) -> dict[str, int]:
    """How many drives are left out of a batch of this selection, by the kind of their failure, the commonest first;
    last, as ``LOG_DELETED``, those of which there is no log any more."""
    skipped: dict[str, int] = {}
    if not includes_hopeless(selection):
        where, values = conditions(selection, method, skipped=True)
        counted = text(_SKIPPED.format(selected=_SELECTED + where))
        skipped = {row[0]: row[1] for row in session.execute(counted, {**values, "asked_at": None})}
    where, values = conditions(selection, method)
    without = session.execute(text(_WITHOUT_LOG + where), {**values, "asked_at": None}).scalar_one()
    return {**skipped, LOG_DELETED: without} if without else skipped


def standing(session: Session) -> Standing:
    """How many drives there are to choose from."""
    return Standing(*session.execute(_STANDING).one())


def cancel_batch(session: Session, batch: int) -> bool:
    """Enqueue no more of it; False for one that cannot be called off, or that there is not."""
    return session.execute(_CANCEL, {"batch": batch, "renewal": RENEWAL}).scalar() is not None


def put_back_piece(session: Session, batch: int) -> bool:
    """Take drives of the batch that wait out of the queue, as they were before; whether there may be more."""
    values = {"batch": batch, "piece": PIECE_DRIVES, "task": TASK}
    return int(session.execute(_PUT_BACK, values).scalar_one()) == PIECE_DRIVES


def unfinished_batches(session: Session) -> list[tuple[int, bool]]:
    """Batches that are to be gone on with, and of each whether it was cancelled."""
    return [(row[0], row[1]) for row in session.execute(_UNFINISHED)]


def batch_progress(session: Session, batch: int | None = None) -> Batch | None:
    """How far the batch is (None: there is no such); drives that were deleted or asked for anew are no longer of it.

    Without a number: all that is under way, batches with what is done of them.
    """
    if batch is None:
        return _progress({"state": "enqueued"}, session.execute(_COUNTS_UNDER_WAY).one()._mapping)
    if (row := session.execute(_GET, {"batch": batch}).one_or_none()) is None:
        return None
    counts = session.execute(_COUNTS_OF_BATCH, {"batch": batch}).one()._mapping
    return _progress(dict(row._mapping), counts)


def _progress(row: dict[str, Any], counts: Any) -> Batch:
    finished, all_of_it = counts["done"] + counts["failed"], counts["drives"]
    state = row["state"]
    if state == "enqueued":
        state = BatchState.DONE if finished == all_of_it else BatchState.RUNNING
    share = 1.0 if not all_of_it else (finished + counts["half_done"]) / all_of_it
    if state == BatchState.ENQUEUING and not all_of_it:
        share = 0.0
    return Batch(**{**row, **counts, "state": state, "progress": min(share, 1.0)})


def enqueued(session: Session, batch: int) -> int:
    """How many drives the batch has put into the queue so far."""
    return int(session.execute(_GET, {"batch": batch}).one().drives)


def adopt_piece(session: Session, before: Adopted | None = None) -> Adopted | None:
    """Give jobs to drives that wait although no job is theirs, after ``before``; None when there is none."""
    session.execute(_ONE_ADOPTS, {"key": _ADOPTION})
    _, batch, created_at, drive = before or (0, None, None, None)
    values = {"batch": batch, "after_created_at": created_at, "after_id": drive}
    row = session.execute(
        _ADOPT, {**values, "renewal": RENEWAL, "task": TASK, "piece": PIECE_DRIVES}
    ).one_or_none()
    return None if row is None else Adopted(*row)


def forget_old(session: Session, age_s: float) -> None:
    """Forget batches of so long ago that no drive names any more: all were asked for anew since, or are removed."""
    session.execute(_FORGET, {"age_s": age_s})


def fold_counts(session: Session, most_rows: int) -> None:
    """Add the counts of drives up when there are more rows than that."""
    session.execute(_FOLD_COUNTS, {"most_rows": most_rows})


def refresh_statistics(session: Session) -> None:
    """Tell the planner how long the queue is."""
    session.execute(_ANALYZE)
