"""Trials in the database: asked for, claimed by a worker, done, forgotten. A row and its job commit together.

Whoever removes a trial, or its drive, takes it away from the worker that computes it, which finds that out when it
wants to say something of it.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import plain_text
from app.core.errors import BusyError, NotFoundError, TooManyError
from app.core.tables import IS_SHOWN
from app.core.telemetry.logs import reason_text
from app.drives.store import json_text
from app.drives.trials.documents import KEPT, MOST_OF_A_DRIVE, Trial
from app.jobs.task import Kind, add_job

TRY_DRIVE = Kind("try_drive", -10)
"""Behind uploads and what is published of them: somebody waits for it, but nothing of the map does."""
ONE_AT_A_TIME = "trials"
"""The lock of their jobs: however many wait, all lanes but one are left to drives."""
MOST_WAITING = 100

_COLUMNS = """
    t.id, t.drive_id, t.method, t.options, t.status, t.stage, t.progress, t.run, t.failure_kind, t.failure_reason,
    t.failure_where, t.report, t.created_at, t.started_at, t.finished_at
"""
_TRIALS = f"""
    SELECT {_COLUMNS}, d.blob_key FROM drive_trials AS t
    JOIN drives AS d ON d.id = t.drive_id AND {IS_SHOWN.format("d")}
"""  # noqa: S608 - constants

# Two that ask for the same at the same moment: the second waits for the first to commit.
_ONE_BY_ONE = text("SELECT pg_advisory_xact_lock(hashtextextended('versant trials', 0))")

# A removal that is under way is waited for.
_KEEP_DRIVE = text(f"SELECT d.id FROM drives AS d WHERE d.id = :id AND {IS_SHOWN.format('d')} FOR KEY SHARE")  # noqa: S608

_GET = text(f"{_TRIALS} WHERE t.id = :id AND t.drive_id = :drive_id")
_SAME = text(f"{_TRIALS} WHERE t.drive_id = :drive_id AND t.asked_sha256 = :asked_sha256")
_LIST = text(f"{_TRIALS} WHERE t.drive_id = :drive_id ORDER BY t.created_at DESC, t.id")
_COUNT = text("SELECT count(*) FROM drive_trials WHERE drive_id = :drive_id")
_WAITING = text(
    "SELECT count(*) FROM procrastinate_jobs WHERE status = 'todo' AND task_name = :task AND priority = :priority"
)
_ADD = text(
    """
    INSERT INTO drive_trials (id, drive_id, method, options, asked_sha256, status)
    VALUES (:id, :drive_id, :method, CAST(:options AS jsonb), :asked_sha256, 'queued')
    """
)
_ANEW = text(
    """
    UPDATE drive_trials SET status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL,
        failure_where = NULL, started_at = NULL, finished_at = NULL
    WHERE id = :id
    """
)

# A running one may be claimed as well: its worker may have died and its job have come back.
_CLAIM = text(
    f"""
    UPDATE drive_trials AS t SET status = 'running', run = t.run + 1, stage = NULL, progress = 0,
        started_at = clock_timestamp()
    FROM drives AS d
    WHERE t.id = :id AND d.id = t.drive_id AND {IS_SHOWN.format("d")} AND t.status IN ('queued', 'running')
    RETURNING {_COLUMNS}, d.blob_key
    """  # noqa: S608 - constants
)
_OURS = "WHERE id = :id AND run = :run AND status = 'running' RETURNING id"
_SET_PROGRESS = text(f"UPDATE drive_trials SET stage = :stage, progress = :progress {_OURS}")  # noqa: S608 - constants
_FINISH = text(
    f"""
    UPDATE drive_trials SET status = 'done', stage = NULL, progress = 1, report = CAST(:report AS jsonb),
        track = :track, measurements = :measurements, slopes = :slopes, finished_at = clock_timestamp()
    {_OURS}
    """  # noqa: S608 - constants
)
# By who knows of no run: its worker ended without a word.
_LET_WAIT = text(
    "UPDATE drive_trials SET status = 'queued', stage = NULL, progress = 0 WHERE id = :id AND status = 'running'"
)
_FAIL = text(
    """
    UPDATE drive_trials SET status = 'failed', stage = :stage, failure_kind = :kind, failure_reason = :reason,
        failure_where = :where, finished_at = clock_timestamp()
    WHERE id = :id AND status IN ('queued', 'running') AND (CAST(:run AS integer) IS NULL OR run = :run)
    """
)
_REMOVE = text("DELETE FROM drive_trials WHERE id = :id AND drive_id = :drive_id RETURNING id")
_FORGET = text(
    """
    DELETE FROM drive_trials WHERE finished_at < now() - make_interval(secs => :kept_s) RETURNING id
    """
)

# Their job is gone: a worker of a version that knew no trials took it, say.
_JOBLESS = text(
    """
    SELECT id FROM drive_trials AS t WHERE status IN ('queued', 'running') AND NOT EXISTS (
        SELECT FROM procrastinate_jobs AS j WHERE j.status IN ('todo', 'doing') AND j.task_name = :task
            AND j.args ->> 'trial_id' = CAST(t.id AS text))
    ORDER BY created_at FOR UPDATE SKIP LOCKED
    """
)
_RESULT = text(
    "SELECT track, measurements, slopes FROM drive_trials WHERE id = :id AND drive_id = :drive_id AND status = 'done'"
)


class Result(NamedTuple):
    """What a trial yielded, as it is stored (``app.drives.tracks``, ``app.drives.trials.results``)."""

    track: bytes
    measurements: bytes | None
    slopes: bytes


def ask(
    session: Session, drive_id: uuid.UUID, method: str, options: Mapping[str, Any], asked_sha256: str
) -> tuple[Trial, bool]:
    """The trial of this drive that was asked for by the same, or a new one with its job; the flag says whether one
    was queued. One that failed is queued again.

    ``NotFoundError`` where the drive is being removed, ``TooManyError`` where it has as many as it may, ``BusyError``
    where too many of all drives wait.
    """
    session.execute(_ONE_BY_ONE)
    if session.execute(_KEEP_DRIVE, {"id": drive_id}).scalar() is None:
        raise NotFoundError(f"There is no drive {drive_id}. It may have been deleted.")
    row = session.execute(_SAME, {"drive_id": drive_id, "asked_sha256": asked_sha256}).one_or_none()
    if row is not None and row.status != "failed":
        return Trial.of(row._asdict()), False
    _require_room(session)
    if row is not None:
        number = row.id
        session.execute(_ANEW, {"id": number})
    else:
        if (count := session.execute(_COUNT, {"drive_id": drive_id}).scalar_one()) >= MOST_OF_A_DRIVE:
            raise TooManyError(
                f"This drive has {count} trials already, the most that there may be. Delete one that is not needed "
                "any more; each is forgotten a week after its end."
            )
        number = uuid.uuid4()
        new = {"id": number, "drive_id": drive_id, "method": method, "options": json_text(options)}
        session.execute(_ADD, {**new, "asked_sha256": asked_sha256})
    _add_job(session, number)
    row = session.execute(_GET, {"id": number, "drive_id": drive_id}).one()
    return Trial.of(row._asdict()), True


def get_trial(session: Session, drive_id: uuid.UUID, trial_id: uuid.UUID) -> Trial | None:
    """The trial of this drive; None where there is none."""
    row = session.execute(_GET, {"id": trial_id, "drive_id": drive_id}).one_or_none()
    return None if row is None else Trial.of(row._asdict())


def list_trials(session: Session, drive_id: uuid.UUID) -> list[Trial]:
    """The trials of a drive, the newest first."""
    return [Trial.of(row._asdict()) for row in session.execute(_LIST, {"drive_id": drive_id})]


def result_of(session: Session, trial: Trial) -> Result | None:
    """What it yielded; None where it is not done."""
    row = session.execute(_RESULT, {"id": trial.id, "drive_id": trial.drive_id}).one_or_none()
    return None if row is None else Result(*row)


def claim(session: Session, trial_id: uuid.UUID) -> Trial | None:
    """Take a trial for a worker; None: it is gone or at its end, or its drive is about to go."""
    row = session.execute(_CLAIM, {"id": trial_id}).one_or_none()
    return None if row is None else Trial.of(row._asdict())


def set_progress(session: Session, trial: Trial, stage: str, progress: float) -> bool:
    """Show the stage and the share of the work done; False: it is no longer this run's."""
    return _is_ours(session, _SET_PROGRESS, trial, stage=plain_text(stage), progress=progress)


def finish(session: Session, trial: Trial, report: Mapping[str, Any], result: Result) -> bool:
    """It is done; False: it is no longer this run's, and nobody wants what it yielded."""
    return _is_ours(session, _FINISH, trial, report=json_text(report), **result._asdict())


def let_wait(session: Session, trial_id: uuid.UUID) -> None:
    """Let it wait again."""
    session.execute(_LET_WAIT, {"id": trial_id})


def fail(
    session: Session,
    trial_id: uuid.UUID,
    kind: str,
    reason: str,
    *,
    stage: str | None = None,
    where: str | None = None,
    run: int | None = None,
) -> None:
    """It failed, unless it is at its end already, or has another run than ``run``."""
    words = {"stage": plain_text(stage), "reason": reason_text(reason), "where": reason_text(where)}
    session.execute(_FAIL, {"id": trial_id, "kind": kind, "run": run, **words})


def remove(session: Session, drive_id: uuid.UUID, trial_id: uuid.UUID) -> bool:
    """Remove it, whatever its status; False: there is none."""
    return session.execute(_REMOVE, {"id": trial_id, "drive_id": drive_id}).scalar() is not None


def forget_old(session: Session) -> int:
    """Forget what ended long ago; how many."""
    return len(session.execute(_FORGET, {"kept_s": KEPT.total_seconds()}).all())


def give_jobs(session: Session) -> int:
    """Give those that wait without a job one; how many."""
    numbers = list(session.execute(_JOBLESS, {"task": TRY_DRIVE.name}).scalars())
    for number in numbers:
        _add_job(session, number)
    return len(numbers)


def _require_room(session: Session) -> None:
    values = {"task": TRY_DRIVE.name, "priority": TRY_DRIVE.priority}
    if (waiting := session.execute(_WAITING, values).scalar_one()) >= MOST_WAITING:
        raise BusyError(f"{waiting} trials wait already. Try again when some of them are done.")


def _add_job(session: Session, trial_id: uuid.UUID) -> None:
    add_job(session, TRY_DRIVE, lock=ONE_AT_A_TIME, trial_id=str(trial_id))


def _is_ours(session: Session, statement: Any, trial: Trial, **values: Any) -> bool:
    return session.execute(statement, {"id": trial.id, "run": trial.run, **values}).scalar() is not None
