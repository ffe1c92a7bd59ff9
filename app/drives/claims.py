"""What a worker writes of a drive that it has claimed: nothing once another run has it, or its result is complete.

Queued drives are claimed by a generation (``mark_running``); whoever asks for one anew takes it away by the next.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds, plain_text
from app.core.telemetry.logs import reason_text
from app.core.version import code_version
from app.drives.documents import Drive
from app.drives.store import changed, get_drive, json_text

PUBLISHING_PROGRESS = 0.97
"""Of a drive that waits for its cells to be solved."""

# A running drive may be claimed as well: its worker may have died and its job have come back. Not one that has said
# all: it only waits to be published.
_CLAIM = text(
    """
    UPDATE drives
    SET status = 'running', stage = NULL, progress = 0, started_at = clock_timestamp(), finished_at = NULL
    WHERE id = :id AND generation = :generation AND status IN ('queued', 'running')
        AND stage IS DISTINCT FROM 'publishing' RETURNING id
    """
)

# What a worker writes while it runs: nothing once the drive is no longer its own, or has said all.
_SET_PROGRESS = text(
    """
    UPDATE drives SET stage = :stage, progress = :progress
    WHERE id = :id AND generation = :generation AND status = 'running'
        AND stage IS DISTINCT FROM 'publishing' RETURNING id
    """
)
_PUT_BACK = text(
    """
    UPDATE drives SET status = 'queued', stage = NULL, progress = 0
    WHERE id = :id AND generation = :generation AND status = 'running'
        AND stage IS DISTINCT FROM 'publishing' RETURNING id
    """
)
_FAIL = text(
    """
    UPDATE drives
    SET status = 'failed', stage = :stage, failure_kind = :kind, failure_reason = :reason, failure_where = :where,
        failure_version = :version, finished_at = clock_timestamp()
    WHERE id = :id AND generation = :generation AND status = 'running'
        AND stage IS DISTINCT FROM 'publishing' RETURNING id
    """
)

# Also of a drive that then finds no roads: by it new ones find the drive.
_SET_BOUNDS = text(
    """
    UPDATE drives SET bounds = ST_MakeEnvelope(:west, :south, :east, :north, 4326)
    WHERE id = :id AND generation = :generation AND status = 'running'
        AND stage IS DISTINCT FROM 'publishing' RETURNING id
    """
)

# The end of a run: the row is locked first, so that it is still the worker's when its result is written. Tables that
# refer to it may be written meanwhile.
_LOCK_RUNNING = text(
    """
    SELECT id FROM drives WHERE id = :id AND generation = :generation AND status = 'running'
        AND stage IS DISTINCT FROM 'publishing' FOR NO KEY UPDATE
    """
)
_SET_PUBLISHING = text(
    """
    UPDATE drives
    SET stage = 'publishing', progress = :progress, failure_kind = NULL, failure_reason = NULL, failure_where = NULL,
        report = CAST(:report AS jsonb), bounds = ST_MakeEnvelope(:west, :south, :east, :north, 4326),
        epochs = :epochs, distance_m = :distance_m, drive_time = :drive_time, computed_at = clock_timestamp()
    WHERE id = :id
    """
)


def mark_running(session: Session, drive_id: uuid.UUID, generation: int) -> Drive | None:
    """Claim the drive for a worker; None when it is gone, finished, or was asked for anew since."""
    claimed = changed(session, _CLAIM, {"id": drive_id, "generation": generation})
    return get_drive(session, drive_id) if claimed else None


def set_progress(session: Session, drive_id: uuid.UUID, generation: int, stage: str, progress: float) -> bool:
    """Show the stage and the share of the work done, 0..1; False: the drive is no longer this worker's."""
    values = {"id": drive_id, "generation": generation, "stage": plain_text(stage), "progress": progress}
    return changed(session, _SET_PROGRESS, values)


def note_bounds(session: Session, drive_id: uuid.UUID, generation: int, bounds: Bounds) -> bool:
    """Note where the drive is, degrees, whatever becomes of it; False: no longer this worker's."""
    west, south, east, north = bounds
    box = {"west": west, "south": south, "east": east, "north": north}
    return changed(session, _SET_BOUNDS, {"id": drive_id, "generation": generation, **box})


def mark_queued(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Put a running drive back into the queue (its worker stops); False: no longer this worker's."""
    return changed(session, _PUT_BACK, {"id": drive_id, "generation": generation})


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
        name: reason_text(value) for name, value in (("stage", stage), ("reason", reason), ("where", where))
    }
    run = {"id": drive_id, "generation": generation, "version": code_version()}
    return changed(session, _FAIL, {**run, "kind": kind, **texts})


def lock_running(session: Session, drive_id: uuid.UUID, generation: int) -> bool:
    """Hold the drive's row until the transaction ends; False when it is gone or no longer this worker's."""
    return changed(session, _LOCK_RUNNING, {"id": drive_id, "generation": generation})


def mark_publishing(
    session: Session,
    drive_id: uuid.UUID,
    *,
    report: Mapping[str, Any],
    bounds: Bounds,
    epochs: int,
    distance_m: float | None,
    drive_time: datetime | None,
) -> None:
    """Note of a drive whose row is locked what its run says; it is done once its cells are solved."""
    west, south, east, north = bounds
    box = {"west": west, "south": south, "east": east, "north": north}
    results = {
        "report": json_text(report),
        "epochs": epochs,
        "distance_m": distance_m,
        "drive_time": drive_time,
    }
    session.execute(_SET_PUBLISHING, {"id": drive_id, "progress": PUBLISHING_PROGRESS, **box, **results})
