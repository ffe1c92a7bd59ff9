"""Many drives removed at once, in the database: counted, and cancelled piece by piece with the jobs that take back
what they said."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from datetime import datetime
from typing import Any, NamedTuple

from pydantic import BaseModel
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.drives.batches.documents import Selection
from app.drives.batches.selection import conditions
from app.drives.documents import DrivePlace
from app.drives.queue import BEHIND, REMOVE_DRIVE, jobs_behind
from app.drives.store import CANCELLED, forget
from app.jobs.task import Kind, add_job

REMOVE_DRIVES = Kind("remove_drives", BEHIND // 2)
ONE_AT_A_TIME = "remove_drives"
PIECE_DRIVES = 500

# Drives that were asked for since are of no concern. Those that are named go whatever they do just now.
_MEANT = """
    FROM drives AS d
    WHERE d.status = ANY(:statuses) AND d.queued_at <= coalesce(CAST(:asked_at AS timestamptz), now())
        AND (CAST(:drives_of AS bigint) IS NULL OR d.owner_id = :drives_of)
        AND (CAST(:ids AS uuid[]) IS NULL OR d.id = ANY(CAST(:ids AS uuid[])))
"""
_COUNT = """
    SELECT count(*) AS drives, coalesce(sum(d.distance_m), 0) / 1000 AS km,
           CAST(coalesce(sum(d.size_bytes), 0) AS bigint) AS uploaded_bytes
"""
_AFTER = " AND (d.created_at, d.id) > (:after_created_at, :after_id)"

# A request and a worker may be at the same drives: each sees what the other has cancelled.
_ONE_BY_ONE = text("SELECT pg_advisory_xact_lock(hashtextextended('versant removals', 0))")

# As each is removed by itself (``app.drives.store``), its job behind uploads.
_REMOVE = f"""
    WITH chosen AS MATERIALIZED (
        SELECT d.id {{meant}} ORDER BY d.created_at, d.id LIMIT :piece FOR UPDATE OF d
    ), gone AS (
        UPDATE drives AS d SET {CANCELLED} FROM chosen WHERE d.id = chosen.id
        RETURNING d.id, d.generation, d.created_at
    ), last AS (SELECT created_at, id FROM gone ORDER BY created_at DESC, id DESC LIMIT 1),
    deferred AS (
        SELECT {jobs_behind(REMOVE_DRIVE.name)} AS drives FROM gone)
    SELECT ARRAY(SELECT id FROM gone) AS ids, deferred.drives, last.created_at, last.id
    FROM deferred LEFT JOIN last ON true
"""  # noqa: S608 - constants
_NOW = text("SELECT clock_timestamp() AS now, versant_confined_to() AS drives_of")


class Targets(BaseModel, frozen=True):
    """Which drives are to go: by a selection, or by their ids. As JSON it is the arguments of a job."""

    selection: Selection
    method: str | None
    ids: tuple[uuid.UUID, ...] | None
    drives_of: int | None = None
    """The owner whose drives alone are meant: a worker that goes on sees those of all."""
    whatever_they_do: bool = False
    """Also those that wait or run: as drives that are named."""


class Sums(NamedTuple):
    """Of the drives that are meant."""

    drives: int
    km: float
    uploaded_bytes: int


def sums_of(session: Session, targets: Targets) -> Sums:
    """What would go now. Reads the whole table."""
    where, values = _where(targets, None)
    return Sums(*session.execute(text(_COUNT + where), values).one())


def ask(session: Session, targets: Targets) -> datetime:
    """Have a worker remove them, those that are meant at this moment."""
    row = session.execute(_NOW).one()
    arguments = {**targets.model_dump(mode="json"), "drives_of": row.drives_of}
    add_job(session, REMOVE_DRIVES, lock=ONE_AT_A_TIME, asked_at=row.now.isoformat(), **arguments)
    asked_at: datetime = row.now
    return asked_at


def remove_piece(
    session: Session, targets: Targets, asked_at: datetime | None, after: DrivePlace | None
) -> tuple[int, DrivePlace | None]:
    """Cancel the next drives after a place; how many, and the last of them: None, there are no more."""
    where, values = _where(targets, asked_at)
    if after is not None:
        where, values = where + _AFTER, {**values, "after_created_at": after.created_at, "after_id": after.id}
    session.execute(_ONE_BY_ONE)
    row = session.execute(text(_REMOVE.format(meant=where)), {**values, "piece": PIECE_DRIVES}).one()
    forget(session, row.ids)
    return row.drives, None if row.id is None else DrivePlace(row.created_at, row.id)


def _where(targets: Targets, asked_at: datetime | None) -> tuple[str, Mapping[str, Any]]:
    where, values = conditions(targets.selection, targets.method)
    statuses = ["done", "failed"]
    if targets.ids is not None or targets.whatever_they_do:
        statuses += ["queued", "running"]
    ids = None if targets.ids is None else list(targets.ids)
    meant = {"statuses": statuses, "ids": ids, "asked_at": asked_at, "drives_of": targets.drives_of}
    return _MEANT + where, {**values, **meant}
