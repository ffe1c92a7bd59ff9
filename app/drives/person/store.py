"""Owners that are removed, in the database, and the logs that are to be deleted. Callers own the transaction."""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from datetime import date
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import OPERATOR_OWNER
from app.core.tables import HAS_LOG, IS_SHOWN

# Uploads that end just now are waited for, and are counted; whoever comes after them finds that the owner goes.
_HOLD = text("SELECT name FROM owners WHERE id = :owner_id FOR UPDATE")
_FIND = text("SELECT id FROM owner_removals WHERE owner_id = :owner_id")
_COUNT = text(f"""
    SELECT coalesce(d.drives, 0) AS drives, coalesce(d.bytes, 0) AS bytes,
           (SELECT count(*) FROM drive_trials AS t JOIN drives AS o ON o.id = t.drive_id
            WHERE o.owner_id = :owner_id) AS trials,
           (SELECT count(*) FROM keys WHERE owner_id = :owner_id) AS keys,
           (SELECT count(*) FROM sessions WHERE owner_id = :owner_id) AS sessions,
           (SELECT count(*) FROM exports WHERE owner_id = :owner_id AND status <> 'cancelled') AS exports,
           (SELECT count(*) FROM webhooks WHERE owner_id = :owner_id) AS webhooks,
           (SELECT count(*) FROM owner_zones WHERE owner_id = :owner_id) AS zones
    FROM (SELECT count(*) AS drives,
                 CAST(coalesce(sum(size_bytes) FILTER (WHERE {HAS_LOG}), 0) AS bigint) AS bytes FROM drives
          WHERE owner_id = :owner_id AND {IS_SHOWN.format("drives")}) AS d
""")  # noqa: S608 - constants
_ADD = text("""
    INSERT INTO owner_removals (id, owner_id, asked_on, counts)
    VALUES (:id, :owner_id, (now() AT TIME ZONE 'UTC')::date, CAST(:counts AS jsonb))
""")
# The name is free at once: who logs in by it is somebody who has nothing. By the second every process learns that its
# callers are to be asked for anew.
_SHUT = (
    text("UPDATE owners SET removed_at = now(), name = 'removed ' || gen_random_uuid() WHERE id = :owner_id"),
    text("UPDATE keys SET revoked_at = coalesce(revoked_at, now()) WHERE owner_id = :owner_id"),
    text("DELETE FROM sessions WHERE owner_id = :owner_id"),
    text("DELETE FROM login_links AS l USING keys AS k WHERE k.id = l.key_id AND k.owner_id = :owner_id"),
)
# Also what was made by somebody who was let in before.
_CLEAR = (
    text("DELETE FROM webhooks WHERE owner_id = :owner_id"),
    text("DELETE FROM owner_zones WHERE owner_id = :owner_id"),
    text("DELETE FROM live_streams WHERE owner_id = :owner_id"),
)
# What others did for the owner names it.
_FORGET_NAME = text("UPDATE audit_log SET detail = detail - 'owner' WHERE detail ->> 'owner' = :name")
_DROP_EXPORTS = text("DELETE FROM exports WHERE owner_id = :owner_id RETURNING blob_key")
_GET = text("""
    SELECT r.id, r.owner_id, r.asked_on, r.ended_on, r.counts,
           (SELECT count(*) FROM drives AS d WHERE d.owner_id = r.owner_id) AS drives_left
    FROM owner_removals AS r WHERE r.id = :id
""")

_OPEN = text("SELECT owner_id FROM owner_removals WHERE ended_on IS NULL ORDER BY id")
# Whoever is at it already does the rest.
_TAKE = text(
    "SELECT id FROM owner_removals WHERE owner_id = :owner_id AND ended_on IS NULL FOR UPDATE SKIP LOCKED"
)
_IS_LEFT = text("SELECT EXISTS (SELECT FROM drives WHERE owner_id = :owner_id)")
_KEEP_AUDIT = text("""
    WITH kept AS (
        UPDATE audit_log SET owner_id = :operator, key_id = NULL, origin = '', at = date_trunc('day', at, 'UTC')
        WHERE owner_id = :owner_id RETURNING id
    ) SELECT count(*) FROM kept
""")
# A batch over the drives of all is the service's. One that is not in the queue yet keeps the owner until it is.
_DROP_OWNER = (
    text("""
        UPDATE batches SET owner_id = :operator
        WHERE owner_id = :owner_id AND drives_of IS NULL AND state <> 'enqueuing'
    """),
    text("DELETE FROM batches WHERE drives_of = :owner_id"),
    text("DELETE FROM drive_counts WHERE owner_id = :owner_id"),
    text("DELETE FROM owners WHERE id = :owner_id"),
)
_END = text("""
    UPDATE owner_removals
    SET ended_on = (now() AT TIME ZONE 'UTC')::date, counts = counts || jsonb_build_object('audit_rows_kept', :kept)
    WHERE owner_id = :owner_id
""")

_DUE = text(f"""
    SELECT d.id, d.blob_key
    FROM owners AS o
    CROSS JOIN LATERAL (SELECT coalesce(o.keep_logs_days, CAST(:days AS integer)) AS days) AS keep
    JOIN drives AS d ON d.owner_id = o.id AND d.{HAS_LOG}
        AND d.finished_at < now() - make_interval(days => CASE WHEN d.status = 'failed' THEN greatest(keep.days, 1)
                                                              ELSE keep.days END)
    WHERE keep.days IS NOT NULL AND d.status IN ('done', 'failed') AND NOT EXISTS (
        SELECT FROM drive_trials AS t WHERE t.drive_id = d.id AND t.status IN ('queued', 'running'))
    ORDER BY d.finished_at LIMIT :piece FOR UPDATE OF d SKIP LOCKED
""")  # noqa: S608 - constants
_NOTE_DELETED = text(
    "UPDATE drives SET log_deleted_at = clock_timestamp() WHERE id = ANY(CAST(:ids AS uuid[]))"
)


class Removal(NamedTuple):
    """The removal of an owner."""

    id: uuid.UUID
    owner_id: int
    asked_on: date
    ended_on: date | None
    counts: dict[str, Any]
    drives_left: int


class DueLog(NamedTuple):
    """A log that is to be deleted."""

    drive_id: uuid.UUID
    blob_key: str


def hold(session: Session, owner_id: int) -> str | None:
    """Let nobody make anything of the owner's before the transaction ends; its name, None: there is none."""
    return session.execute(_HOLD, {"owner_id": owner_id}).scalar()


def removal_of(session: Session, owner_id: int) -> uuid.UUID | None:
    """The removal of that owner, also one that is at its end; None: nobody asked for it."""
    found: uuid.UUID | None = session.execute(_FIND, {"owner_id": owner_id}).scalar()
    return found


def counts_of(session: Session, owner_id: int) -> dict[str, int]:
    """What there is of the owner, for the receipt."""
    return dict(session.execute(_COUNT, {"owner_id": owner_id}).one()._mapping)


def begin(session: Session, owner_id: int, name: str, counts: Mapping[str, int]) -> uuid.UUID:
    """Note the removal and let nobody in as the owner of that name any more."""
    removal_id = uuid.uuid4()
    session.execute(_ADD, {"id": removal_id, "owner_id": owner_id, "counts": json.dumps(dict(counts))})
    for statement in _SHUT:
        session.execute(statement, {"owner_id": owner_id})
    session.execute(_FORGET_NAME, {"name": name})
    return removal_id


def clear(session: Session, owner_id: int) -> list[str]:
    """Delete what the owner has beside drives; the blobs of its exports, which nobody refers to any more."""
    for statement in _CLEAR:
        session.execute(statement, {"owner_id": owner_id})
    dropped = session.execute(_DROP_EXPORTS, {"owner_id": owner_id}).scalars()
    return [key for key in dropped if key is not None]


def get(session: Session, removal_id: uuid.UUID) -> Removal | None:
    """The removal, or None."""
    row = session.execute(_GET, {"id": removal_id}).one_or_none()
    return None if row is None else Removal(*row)


def open_removals(session: Session) -> list[int]:
    """The owners of whom something is left."""
    return list(session.execute(_OPEN).scalars())


def take(session: Session, owner_id: int) -> bool:
    """Whether this transaction alone is at the removal from here to its end."""
    return session.execute(_TAKE, {"owner_id": owner_id}).first() is not None


def has_drives(session: Session, owner_id: int) -> bool:
    """Whether a drive of the owner is left, however little of it."""
    return bool(session.execute(_IS_LEFT, {"owner_id": owner_id}).scalar_one())


def end(session: Session, owner_id: int) -> None:
    """Delete the owner, of whom no drive is left; rows of the audit stay without what tells of a person.

    ``IntegrityError`` where somebody who was let in before has just made something of it: then it is to be tried again.
    """
    values = {"owner_id": owner_id, "operator": OPERATOR_OWNER}
    kept = session.execute(_KEEP_AUDIT, values).scalar_one()
    for statement in _DROP_OWNER:
        session.execute(statement, values)
    session.execute(_END, {"owner_id": owner_id, "kept": kept})


def due_logs(session: Session, keep_logs_days: int | None, piece: int) -> list[DueLog]:
    """Logs that were kept long enough, whose drives are held; ``keep_logs_days``: of owners that did not say it."""
    values = {"days": keep_logs_days, "piece": piece}
    return [DueLog(*row) for row in session.execute(_DUE, values)]


def note_deleted(session: Session, logs: list[DueLog]) -> None:
    """Note that the logs of these drives are gone."""
    session.execute(_NOTE_DELETED, {"ids": [one.drive_id for one in logs]})
