"""Addresses and their messages in the database. A message commits together with what it tells of.

Messages are no jobs of the queue: a lane of a worker would wait for strangers while drives wait for the lane. The rows
are their own queue: whoever sends takes an address for a minute, and whoever dies at it holds it no longer.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import OPERATOR_OWNER, seeing_all
from app.core.db import plain_json

SEGMENTS_CHANGED, DRIVE_DONE, DRIVE_FAILED = "segments.changed", "drive.done", "drive.failed"
EVENTS: Mapping[str, str] = {
    SEGMENTS_CHANGED: "Segments changed: how many, and the versions between which they did, for /v1/changes.",
    DRIVE_DONE: "A drive is done: what it says of slopes is on the map.",
    DRIVE_FAILED: "A drive failed, and why.",
}
TEST = "test"
"""Is sent to whoever asks for it, whatever its events are."""

PAUSES_S = (5.0, 30.0, 120.0, 600.0, 1800.0, 3600.0)
"""After the first failure, the second, ...; the last one again and again."""
CLAIM_S = 60.0
"""For so long an address is whose who sends to it; an attempt takes less."""
KEPT_DAYS = 7.0
"""For so long messages are shown that were taken or given up."""


class WebhookRow(NamedTuple):
    """An address, without its secret."""

    id: uuid.UUID
    url: str
    events: list[str]
    bbox: list[float] | None
    active: bool
    off_reason: str | None
    reported_version: str | None
    failures: int
    failing_since: datetime | None
    last_success_at: datetime | None
    created_at: datetime


_COLUMNS = ", ".join(WebhookRow._fields)

_ADD = text(f"""
    INSERT INTO webhooks (id, url, secret, events, bbox, reported_version)
    VALUES (:id, :url, :secret, CAST(:events AS text[]), CAST(:bbox AS float8[]), :reported_version)
    RETURNING {_COLUMNS}
""")  # noqa: S608 - constants
_COUNT = text("SELECT count(*) FROM webhooks")
_LIST = text(f"SELECT {_COLUMNS} FROM webhooks ORDER BY created_at, id")  # noqa: S608 - constants
_GET = text(f"SELECT {_COLUMNS} FROM webhooks WHERE id = :id")  # noqa: S608 - constants
_DELETE = text("DELETE FROM webhooks WHERE id = :id RETURNING id")
# Who is switched on again, or has moved, begins with a clean sheet.
_CHANGE = text(f"""
    UPDATE webhooks AS w
    SET url = new.url, events = new.events, bbox = new.bbox, reported_version = new.reported_version,
        active = new.active,
        off_reason = CASE WHEN NOT new.active THEN w.off_reason END,
        failures = CASE WHEN new.clean THEN 0 ELSE w.failures END,
        failing_since = CASE WHEN NOT new.clean THEN w.failing_since END,
        next_at = CASE WHEN new.clean THEN clock_timestamp() ELSE w.next_at END
    FROM (
        SELECT o.id, o.url <> CAST(:url AS text) OR (CAST(:active AS boolean) AND NOT o.active) AS clean,
               CAST(:url AS text) AS url, CAST(:events AS text[]) AS events, CAST(:bbox AS float8[]) AS bbox,
               CAST(:reported_version AS text) AS reported_version,
               CAST(:active AS boolean) AS active
        FROM webhooks AS o WHERE o.id = :id FOR NO KEY UPDATE
    ) AS new
    WHERE w.id = new.id
    RETURNING {", ".join(f"w.{name}" for name in WebhookRow._fields)}
""")  # noqa: S608 - constants
_LAST = text("""
    SELECT 'msg_' || replace(CAST(id AS text), '-', '') AS id, event, state, attempts, status, problem, created_at,
           CASE WHEN state = 'waiting' THEN due_at END AS next_at, ended_at
    FROM webhook_deliveries
    WHERE webhook_id = :id ORDER BY created_at DESC, webhook_deliveries.id LIMIT :limit
""")

_AREA = """
    CASE WHEN w.bbox[1] <= w.bbox[3] THEN ST_MakeEnvelope(w.bbox[1], w.bbox[2], w.bbox[3], w.bbox[4], 4326)
    ELSE ST_Collect(ST_MakeEnvelope(w.bbox[1], w.bbox[2], 180, w.bbox[4], 4326),
                    ST_MakeEnvelope(-180, w.bbox[2], w.bbox[3], w.bbox[4], 4326)) END
"""
_ANNOUNCE_DRIVE = text(f"""
    INSERT INTO webhook_deliveries (id, webhook_id, event, data)
    SELECT gen_random_uuid(), w.id, CAST(:event AS text), CAST(:data AS jsonb)
    FROM drives AS d JOIN webhooks AS w ON w.owner_id = d.owner_id
    WHERE d.id = :drive_id AND w.active AND CAST(:event AS text) = ANY(w.events)
        AND (w.bbox IS NULL OR ST_Intersects(d.bounds, {_AREA}))
""")  # noqa: S608 - constants
_FORGET_DRIVES = text(
    "DELETE FROM webhook_deliveries WHERE data ->> 'drive_id' = ANY(CAST(CAST(:ids AS uuid[]) AS text[]))"
)
_ADD_MESSAGE = text("""
    INSERT INTO webhook_deliveries (id, webhook_id, event, data)
    VALUES (gen_random_uuid(), :webhook_id, :event, CAST(:data AS jsonb)) RETURNING id
""")

# One message about segments waits at a time, and says all that came until it was written.
_FOLLOWERS = text(f"""
    SELECT {_COLUMNS} FROM webhooks AS w
    WHERE w.active AND w.reported_version IS NOT NULL
        AND coalesce((w.owner_id <> {OPERATOR_OWNER}) = CAST(:of_owners AS boolean), true) AND NOT EXISTS (
        SELECT FROM webhook_deliveries AS d WHERE d.webhook_id = w.id AND d.event = '{SEGMENTS_CHANGED}'
            AND (d.state = 'waiting' OR d.created_at > clock_timestamp() - make_interval(secs => :every_s)))
    ORDER BY w.id FOR NO KEY UPDATE OF w SKIP LOCKED
""")  # noqa: S608 - constants
_TELL = text(
    "UPDATE webhooks SET reported_version = :version WHERE id = :id AND reported_version IS NOT NULL"
)

_CLAIM = text("""
    UPDATE webhooks SET claimed_until = clock_timestamp() + make_interval(secs => :claim_s)
    WHERE id = (
        SELECT w.id FROM webhooks AS w
        WHERE w.active AND w.next_at <= clock_timestamp() AND coalesce(w.claimed_until < clock_timestamp(), true)
            AND EXISTS (
                SELECT FROM webhook_deliveries AS d
                WHERE d.webhook_id = w.id AND d.state = 'waiting' AND d.due_at <= clock_timestamp())
        ORDER BY w.next_at, w.id LIMIT 1 FOR NO KEY UPDATE OF w SKIP LOCKED)
    RETURNING id, url, secret
""")
_DUE = text("""
    SELECT id, event, data, created_at FROM webhook_deliveries
    WHERE webhook_id = :id AND state = 'waiting' AND due_at <= clock_timestamp() ORDER BY due_at, created_at, id LIMIT 1
""")
_FREE = text("UPDATE webhooks SET claimed_until = NULL WHERE id = :id")

_TAKEN = text("""
    UPDATE webhook_deliveries SET state = 'taken', attempts = attempts + 1, ended_at = clock_timestamp(),
        status = :status, problem = NULL
    WHERE id = :id AND state = 'waiting'
""")
_WENT_WELL = text("""
    UPDATE webhooks SET failures = 0, failing_since = NULL, last_success_at = clock_timestamp(),
        next_at = clock_timestamp(), claimed_until = NULL,
        reported_version = CASE WHEN reported_version IS NOT NULL
            THEN coalesce(CAST(:version AS text), reported_version) END
    WHERE id = :id
""")
_NOT_TAKEN = text("""
    UPDATE webhook_deliveries AS d SET attempts = d.attempts + 1, status = :status, problem = :problem,
        due_at = clock_timestamp() + make_interval(secs => (CAST(:pauses AS float8[]))[least(d.attempts + 1, :steps)]),
        state = CASE WHEN too.late THEN 'given up' ELSE 'waiting' END,
        ended_at = CASE WHEN too.late THEN clock_timestamp() END
    FROM (SELECT o.id, o.created_at < clock_timestamp() - make_interval(secs => :patience_s) AS late
          FROM webhook_deliveries AS o WHERE o.id = :id) AS too
    WHERE d.id = too.id AND d.state = 'waiting'
""")
_WENT_WRONG = text("""
    UPDATE webhooks SET failures = failures + 1, failing_since = coalesce(failing_since, clock_timestamp()),
        next_at = clock_timestamp() + make_interval(secs => (CAST(:pauses AS float8[]))[least(failures + 1, :steps)]),
        claimed_until = NULL
    WHERE id = :id
    RETURNING failing_since < clock_timestamp() - make_interval(secs => :patience_s) AS hopeless
""")
_SWITCH_OFF = text("UPDATE webhooks SET active = false, off_reason = :reason WHERE id = :id")
_SWITCH_ALL_OFF = text("UPDATE webhooks SET active = false, off_reason = :reason WHERE active")
_GIVE_UP = text("""
    UPDATE webhook_deliveries SET state = 'given up', ended_at = clock_timestamp()
    WHERE webhook_id = :id AND state = 'waiting'
""")
_PRUNE = text(
    "DELETE FROM webhook_deliveries WHERE ended_at < clock_timestamp() - make_interval(secs => :age_s)"
)


class Due(NamedTuple):
    """A message that is to be sent now, by whoever was handed it."""

    webhook_id: uuid.UUID
    url: str
    secret: str
    id: uuid.UUID
    event: str
    data: dict[str, Any]
    created_at: datetime


def add_webhook(
    session: Session,
    url: str,
    secret: str,
    events: Sequence[str],
    bbox: Sequence[float] | None,
    reported_version: str | None,
) -> WebhookRow:
    """Make one; ``reported_version``: the version from which on it is told of segments, if it asks for that."""
    values = {"id": uuid.uuid4(), "url": url, "secret": secret, "events": list(events)}
    values |= {"bbox": bbox, "reported_version": reported_version}
    return WebhookRow(*session.execute(_ADD, values).one())


def change_webhook(session: Session, changed: WebhookRow) -> WebhookRow:
    """Write the address, events, box and whether it is active."""
    return WebhookRow(*session.execute(_CHANGE, changed._asdict()).one())


def count_webhooks(session: Session) -> int:
    """How many there are, of all owners."""
    with seeing_all(session):
        return int(session.execute(_COUNT).scalar_one())


def list_webhooks(session: Session) -> list[WebhookRow]:
    """Those of the caller's owner, or all, the oldest first."""
    return [WebhookRow(*row) for row in session.execute(_LIST)]


def get_webhook(session: Session, webhook_id: uuid.UUID) -> WebhookRow | None:
    """One, or None."""
    row = session.execute(_GET, {"id": webhook_id}).one_or_none()
    return None if row is None else WebhookRow(*row)


def delete_webhook(session: Session, webhook_id: uuid.UUID) -> bool:
    """Forget it and its messages; False: there is none."""
    return session.execute(_DELETE, {"id": webhook_id}).scalar() is not None


def last_deliveries(session: Session, webhook_id: uuid.UUID, limit: int) -> list[dict[str, Any]]:
    """Its newest messages, each by name: ``next_at`` is when it is sent at the earliest, None where it has ended."""
    rows = session.execute(_LAST, {"id": webhook_id, "limit": limit})
    return [dict(row._mapping) for row in rows]


def announce_drive(session: Session, event: str, drive_id: uuid.UUID, data: Mapping[str, Any]) -> None:
    """Tell those of the drive's owner who ask for it, in the session's transaction."""
    payload = json.dumps(plain_json({"drive_id": str(drive_id), **data}))
    session.execute(_ANNOUNCE_DRIVE, {"event": event, "drive_id": drive_id, "data": payload})


def forget_drives(session: Session, drive_ids: Collection[uuid.UUID]) -> None:
    """Tell nobody any more of these drives, and forget who was told."""
    session.execute(_FORGET_DRIVES, {"ids": list(drive_ids)})


def add_message(session: Session, webhook_id: uuid.UUID, event: str, data: Mapping[str, Any]) -> uuid.UUID:
    """A message to one address."""
    values = {"webhook_id": webhook_id, "event": event, "data": json.dumps(data)}
    added: uuid.UUID = session.execute(_ADD_MESSAGE, values).scalar_one()
    return added


def followers(session: Session, every_s: float, of_owners: bool | None = None) -> list[WebhookRow]:
    """Those who are to be told of segments and wait for no such message; their rows are held.

    ``of_owners``: those of operators alone (False), or all others (True).
    """
    values = {"every_s": every_s, "of_owners": of_owners}
    return [WebhookRow(*row) for row in session.execute(_FOLLOWERS, values)]


def set_reported_version(session: Session, webhook_id: uuid.UUID, version: str) -> None:
    """Nothing up to this version concerns it any more."""
    session.execute(_TELL, {"id": webhook_id, "version": version})


def claim(session: Session) -> Due | None:
    """Take the address that has waited longest, with its next message; None: nothing is due."""
    webhook = session.execute(_CLAIM, {"claim_s": CLAIM_S}).one_or_none()
    if webhook is None:
        return None
    message = session.execute(_DUE, {"id": webhook.id}).one_or_none()
    if message is None:
        session.execute(_FREE, {"id": webhook.id})
        return None
    return Due(webhook.id, webhook.url, webhook.secret, *message)


def note_taken(session: Session, due: Due, status: int) -> None:
    """The message arrived."""
    version = due.data.get("version") if due.event == SEGMENTS_CHANGED else None
    session.execute(_TAKEN, {"id": due.id, "status": status})
    session.execute(_WENT_WELL, {"id": due.webhook_id, "version": version})


def note_failure(
    session: Session, due: Due, status: int | None, problem: str, patience_s: float, *, unwanted: bool
) -> bool:
    """It did not. Whether the address was switched off: it failed for too long, or said that it is ``unwanted``."""
    pauses = {"pauses": list(PAUSES_S), "steps": len(PAUSES_S), "patience_s": patience_s}
    session.execute(_NOT_TAKEN, {"id": due.id, "status": status, "problem": problem, **pauses})
    hopeless = session.execute(_WENT_WRONG, {"id": due.webhook_id, **pauses}).scalar()
    if not (hopeless or unwanted):
        return False
    session.execute(_SWITCH_OFF, {"id": due.webhook_id, "reason": problem})
    session.execute(_GIVE_UP, {"id": due.webhook_id})
    return True


def switch_all_off(session: Session, reason: str) -> None:
    """Tell nobody any more, until somebody switches each on again."""
    session.execute(_SWITCH_ALL_OFF, {"reason": reason})


def prune_messages(session: Session) -> None:
    """Forget messages that ended long ago."""
    session.execute(_PRUNE, {"age_s": 86400.0 * KEPT_DAYS})
