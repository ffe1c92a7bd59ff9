"""Drives whose roads an import has changed are computed again, as batches behind uploads.

The import names them in the transactions that change their roads (``touched_drives``). When it is over, or was cut off,
a worker or the command that imported queues them. What a drive has published stays until its new run replaces it.
"""

from __future__ import annotations

from sqlalchemy import text

from app.core.db import Sessions
from app.core.tables import HAS_LOG
from app.drives.batches.store import BEFORE_BATCH, PIECE_DRIVES
from app.drives.queue import TASK, jobs_behind
from app.drives.store import ANEW
from app.network.locks import roads_change

ROADS = '{"which": "roads"}'
"""The selection of such a batch."""

_ANY = text("SELECT EXISTS (SELECT FROM touched_drives)")
# What waits or runs is looked at when it has ended. A run that knew the roads as they are need not be repeated; one
# that failed is. What has no log any more stays as it is.
_QUEUE = text(
    f"""
    WITH ended AS MATERIALIZED (
        SELECT d.id, d.{HAS_LOG} AND (d.status = 'failed' OR coalesce((
            SELECT max(v.road_state) FROM provenances AS v WHERE v.drive_id = d.id), -1) < t.road_state) AS wanted
        FROM touched_drives AS t JOIN drives AS d ON d.id = t.drive_id
        WHERE d.status IN ('done', 'failed')
        ORDER BY d.created_at, d.id LIMIT :piece FOR UPDATE OF d, t SKIP LOCKED
    ), settled AS (
        DELETE FROM touched_drives AS t USING ended WHERE t.drive_id = ended.id
    ), made AS (
        INSERT INTO batches (selection, state, drives)
        SELECT CAST(:roads AS jsonb), 'enqueued', (SELECT count(*) FROM ended WHERE wanted)
        WHERE EXISTS (SELECT FROM ended WHERE wanted) RETURNING id
    ), asked AS (
        UPDATE drives AS d
        SET {ANEW}, batch_id = made.id, before_batch = {BEFORE_BATCH}
        FROM ended, made WHERE d.id = ended.id AND ended.wanted
        RETURNING d.id, d.generation, d.created_at
    ), deferred AS (SELECT {jobs_behind(TASK)} AS drives FROM asked)
    SELECT (SELECT count(*) FROM ended) AS looked_at, deferred.drives FROM deferred
    """  # noqa: S608 - constants
)


def queue_touched(sessions: Sessions) -> int:
    """Queue them again, but for those that wait or run; of how many drives. None while an import is running."""
    count = 0
    while True:
        with sessions.begin() as session:
            if not session.execute(_ANY).scalar_one() or roads_change(session):
                return count
            row = session.execute(_QUEUE, {"piece": PIECE_DRIVES, "roads": ROADS, "traceparent": None}).one()
        count += int(row.drives)
        if row.looked_at < PIECE_DRIVES:
            return count
