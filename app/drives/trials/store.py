"""Trials in the database: found or added, removed, forgotten. The rest is ``app.jobs.requests.store``'s.

What a trial yielded is kept beside it, the slopes of its segments as an Arrow IPC stream.

Whoever removes a trial, or its drive, takes it away from the worker that computes it.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from sqlalchemy import Select, Table, select, text
from sqlalchemy.orm import Session

from app.core.errors import LogDeletedError, NotFoundError, TooManyError
from app.core.messages import say
from app.core.settings import Settings
from app.core.tables import HAS_LOG, IS_SHOWN, Drive
from app.core.tables.requests import DriveTrial
from app.drives.tracks import stream
from app.drives.trials.documents import KEPT, MOST_OF_A_DRIVE, Trial
from app.jobs.requests.store import RequestStore
from app.jobs.task import Kind
from app.map.segment import Segment
from app.map.store import DriveSegmentRow
from fusion.types import Ints, SegmentSlope

TRY_DRIVE = Kind("try_drive", -10)
"""Behind uploads and what is published of them: somebody waits for it, but nothing of the map does."""
MOST_WAITING = 100
_NAMES = tuple(spec.name for spec in fields(SegmentSlope))
_RESULT = ("track", "measurements", "slopes")


def _rows(table: Table) -> Select[Any]:
    """Trials of drives that are shown, without their results, which are large."""
    columns = [column for column in table.columns if column.name not in _RESULT]
    of_drive = select(*columns, Drive.blob_key).join(Drive, Drive.id == table.c.drive_id)
    return of_drive.where(text(IS_SHOWN.format("drives")))


trials = RequestStore("trial", DriveTrial, Trial.of, TRY_DRIVE, "trials", rows=_rows, one_of_lanes=4)

# A removal that is under way is waited for.
_KEEP_DRIVE = text(f"""
    SELECT {HAS_LOG} AS has_log FROM drives AS d WHERE d.id = :id AND {IS_SHOWN.format("d")} FOR KEY SHARE
""")  # noqa: S608 - constants
_COUNT = text("SELECT count(*) FROM drive_trials WHERE drive_id = :drive_id")
_REMOVE = text("DELETE FROM drive_trials WHERE id = :id AND drive_id = :drive_id RETURNING id")
_FORGET = text(
    "DELETE FROM drive_trials WHERE finished_at < now() - make_interval(secs => :kept_s) RETURNING NULL"
)
_GET_RESULT = text("SELECT track, measurements, slopes FROM drive_trials WHERE id = :id AND status = 'done'")

_FORMER = (
    "stage",
    "failure_kind",
    "failure_reason",
    "failure_where",
    "failure_said",
    "started_at",
    "finished_at",
)
_ANEW: Mapping[str, Any] = {"status": "queued", "progress": 0, **dict.fromkeys(_FORMER)}


class Result(NamedTuple):
    """What a trial yielded, as it is stored (``app.drives.tracks``, ``encode_slopes``)."""

    track: bytes
    measurements: bytes | None
    slopes: bytes


def ask(
    session: Session, drive_id: uuid.UUID, method: str, options: Mapping[str, Any], asked_sha256: str
) -> tuple[Trial, bool]:
    """The trial of this drive that was asked for by the same, or a new one with its job; the flag says whether one
    was queued. One that failed is queued again.

    ``NotFoundError`` where the drive is being removed, ``LogDeletedError`` where it has no log any more,
    ``TooManyError`` where it has as many as it may, ``BusyError``
    where too many of all drives wait.
    """
    trials.one_by_one(session)
    has_log = session.execute(_KEEP_DRIVE, {"id": drive_id}).scalar()
    if has_log is None:
        raise NotFoundError(say("drives.not_there", id=drive_id))
    trial = next(iter(trials.page(session, drive_id=drive_id, asked_sha256=asked_sha256)), None)
    if trial is not None and trial.failure is None:
        return trial, False
    if not has_log:
        raise LogDeletedError(say("trial.log_deleted", id=drive_id))
    trials.require_place(session, MOST_WAITING)
    if trial is not None:
        trials.write(session, trial.id, **_ANEW)
        return trials.enqueue(session, trial.id), True
    if (count := session.execute(_COUNT, {"drive_id": drive_id}).scalar_one()) >= MOST_OF_A_DRIVE:
        raise TooManyError(say("trial.too_many", n=count))
    new = {"drive_id": drive_id, "method": method, "options": dict(options)}
    return trials.add(session, asked_sha256=asked_sha256, **new), True


def result_of(session: Session, trial: Trial) -> Result | None:
    """What it yielded; None where it is not done."""
    row = session.execute(_GET_RESULT, {"id": trial.id}).one_or_none()
    return None if row is None else Result(*row)


def remove(session: Session, drive_id: uuid.UUID, trial_id: uuid.UUID) -> bool:
    """Remove it, whatever its status; False: there is none."""
    return session.execute(_REMOVE, {"id": trial_id, "drive_id": drive_id}).scalar() is not None


def expire(session: Session, _settings: Settings) -> list[str | None]:
    """Forget what ended long ago; a trial has no file."""
    return list(session.execute(_FORGET, {"kept_s": KEPT.total_seconds()}).scalars())


def encode_slopes(slopes: Iterable[SegmentSlope], segment_ids: Ints) -> bytes:
    """The slopes in the order of driving; ``segment`` becomes the database's id of each."""
    ordered = sorted(slopes, key=lambda slope: (slope.first_time_s, slope.segment))
    columns = {name: np.array([getattr(slope, name) for slope in ordered]) for name in _NAMES}
    columns["segment"] = segment_ids[columns["segment"].astype(np.int64)]
    kinds = {"segment": np.int64, "observations": np.int64, "passes": np.int64}
    return stream({name: column.astype(kinds.get(name, np.float64)) for name, column in columns.items()})


def decode_slopes(data: bytes) -> list[SegmentSlope]:
    """The inverse of ``encode_slopes``; ``segment`` is the database's id."""
    table = pa.ipc.open_stream(data).read_all()
    columns = (table.column(name).to_pylist() for name in _NAMES)
    return [SegmentSlope(*values) for values in zip(*columns, strict=True)]


def beside_the_map(slopes: Sequence[SegmentSlope], segments: Sequence[Segment]) -> list[DriveSegmentRow]:
    """The slopes as a drive's estimates are shown, each beside what all drives together say.

    A segment that an import dropped since is left out.
    """
    by_id = {segment.stored_id: segment for segment in segments}
    return [
        DriveSegmentRow(
            segment=by_id[slope.segment],
            slope_percent=slope.slope_percent,
            slope_sigma_percent=slope.slope_sigma_percent,
            observations=slope.observations,
            passes=slope.passes,
            first_at=datetime.fromtimestamp(slope.first_time_s, UTC),
            last_at=datetime.fromtimestamp(slope.last_time_s, UTC),
            in_network=False,
            accepted=None,
        )
        for slope in slopes
        if slope.segment in by_id
    ]
