"""Streams of points in the database, and the drives that were made of them. Callers own the transaction.

A batch costs one statement: it marks the stream as seen and adds the points that are not there. Whose streams a
statement finds is the database's to say (``app.core.caller``).
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import present_caller
from app.core.db import bigints, fetch_binary, plain_text
from app.core.errors import TooManyError
from app.core.messages import say
from app.core.tables import HAS_LOG, IS_SHOWN
from app.drives.live.points import LivePoint

MOST_STREAMS = 20_000
"""Of one key: whoever has an address names its devices as he likes."""
KEPT_DAYS = 30
"""For so long after its last point a stream is known; then nobody is told of it any more."""

_COLUMNS = LivePoint._fields
_MEASURED = _COLUMNS[1:]
_OF_KEY = {True: "key_id IS NULL", False: "key_id = %(key_id)s"}
_ADD = """
    WITH stream AS (
        UPDATE live_streams
        SET seen_at = clock_timestamp(), unusable = unusable + %(unusable)s,
            unusable_why = coalesce(%(why)s, unusable_why),
            due_at = least(due_at, clock_timestamp() + make_interval(secs => %(silence_s)s))
        WHERE owner_id = %(owner_id)s AND {of_key} AND sender = %(sender)s AND device = %(device)s RETURNING id
    ), added AS (
        INSERT INTO live_points (stream_id, {columns}) SELECT stream.id, p.* FROM stream, unnest({vectors}) AS p
        ON CONFLICT DO NOTHING RETURNING 1
    )
    SELECT (SELECT id FROM stream), (SELECT count(*) FROM added)
"""
_ADDS = {
    keyless: _ADD.format(
        of_key=of_key,
        columns=", ".join(_COLUMNS),
        vectors=", ".join(f"%({name})s" for name in _COLUMNS),
    )
    for keyless, of_key in _OF_KEY.items()
}
_BEGIN = text("""
    INSERT INTO live_streams (owner_id, key_id, sender, device)
    SELECT :owner_id, :key_id, :sender, :device
    WHERE (SELECT count(*) FROM live_streams WHERE owner_id = :owner_id AND key_id IS NOT DISTINCT FROM :key_id) < :most
    ON CONFLICT DO NOTHING
""")
_IS_THERE = text("""
    SELECT EXISTS (SELECT FROM live_streams WHERE owner_id = :owner_id AND key_id IS NOT DISTINCT FROM :key_id
                   AND sender = :sender AND device = :device)
""")

_LISTED = f"""
    SELECT s.id, s.key_id AS key, k.label, k.revoked_at IS NOT NULL AS revoked, s.sender, s.device, s.seen_at,
           s.unusable, s.unusable_why, s.due_at IS NOT NULL AS under_way,
           CAST(extract(epoch FROM clock_timestamp() - s.seen_at) AS float8) AS seen_ago_s,
           p.time_us, p.lat_deg, p.lon_deg,
           (SELECT d.drive_id FROM live_drives AS d JOIN drives AS r ON r.id = d.drive_id AND {IS_SHOWN.format("r")}
            WHERE d.stream_id = s.id ORDER BY d.ends_us DESC LIMIT 1) AS drive
    FROM live_streams AS s LEFT JOIN keys AS k ON k.id = s.key_id
    LEFT JOIN LATERAL (SELECT * FROM live_points WHERE stream_id = s.id ORDER BY time_us DESC LIMIT 1) AS p ON true
    WHERE s.owner_id = :owner_id {{of}} ORDER BY s.seen_at DESC LIMIT :most
"""  # noqa: S608 - constants
_OF_OWNER = text(_LISTED.format(of=""))
_OF_PRESENT_KEY = text(_LISTED.format(of="AND s.key_id IS NOT DISTINCT FROM CAST(:key_id AS uuid)"))

_DUE = text("""
    SELECT id FROM live_streams WHERE due_at <= clock_timestamp() ORDER BY due_at LIMIT :most
""")
# Workers are many. Batches are not held up: what comes meanwhile is told by seen_at.
_TAKE = text("""
    SELECT s.id, s.owner_id, s.key_id, s.sender, s.device, s.seen_at,
           CAST(extract(epoch FROM clock_timestamp() - s.seen_at) AS float8) AS silent_s
    FROM live_streams AS s
    WHERE s.id = :id AND s.due_at <= clock_timestamp()
        AND pg_try_advisory_xact_lock(:lock, CAST(s.id % 2147483647 AS integer))
""")
_LOCK = 0x6C697665
_POINTS = f"""
    SELECT {", ".join(_COLUMNS)} FROM live_points WHERE stream_id = %(id)s ORDER BY time_us LIMIT %(most)s
"""  # noqa: S608 - constants
_LOOK_AGAIN = text("""
    UPDATE live_streams
    SET due_at = CASE WHEN seen_at = :seen_at THEN clock_timestamp() + make_interval(secs => CAST(:after_s AS float8))
                      ELSE clock_timestamp() END
    WHERE id = :id
""")
_CLOSED = text(f"""
    SELECT l.drive_id, l.begins_us, l.ends_us, d.{HAS_LOG} AS has_log, d.blob_key
    FROM live_drives AS l JOIN drives AS d ON d.id = l.drive_id AND {IS_SHOWN.format("d")}
    WHERE l.stream_id = :id AND l.ends_us >= :from_us AND l.begins_us <= :to_us ORDER BY l.begins_us
""")  # noqa: S608 - constants
_NOTE = text("""
    INSERT INTO live_drives (drive_id, stream_id, begins_us, ends_us)
    VALUES (:drive_id, :id, :begins_us, :ends_us)
    ON CONFLICT (stream_id, drive_id) DO UPDATE SET begins_us = excluded.begins_us, ends_us = excluded.ends_us
""")
_REMOVE = """
    DELETE FROM live_points WHERE stream_id = %(id)s AND time_us = ANY(%(times_us)s)
        AND came_at <= now() - make_interval(days => %(days)s) RETURNING 1
"""
_FORGET = text("""
    DELETE FROM live_streams WHERE due_at IS NULL AND seen_at < clock_timestamp() - make_interval(days => :days)
""")


class Seen(NamedTuple):
    """A stream as people are told of it: what came last, of points that are in no log yet where it was."""

    id: int
    key: uuid.UUID | None
    label: str | None
    revoked: bool
    sender: str
    device: str
    seen_at: datetime
    unusable: int
    unusable_why: str | None
    under_way: bool
    seen_ago_s: float
    time_us: int | None
    lat_deg: float | None
    lon_deg: float | None
    drive: uuid.UUID | None
    """The last that was made of it."""


class Stream(NamedTuple):
    """A stream that this transaction alone looks at."""

    id: int
    owner_id: int
    key_id: uuid.UUID | None
    sender: str
    device: str
    seen_at: datetime
    silent_s: float


class Closed(NamedTuple):
    """A drive that was made of a stream."""

    drive_id: uuid.UUID
    begins_us: int
    ends_us: int
    has_log: bool
    blob_key: str


def add_points(
    session: Session,
    sender: str,
    device: str,
    points: Sequence[LivePoint],
    *,
    silence_s: float,
    unusable: int = 0,
    why: str | None = None,
) -> int:
    """Keep points of the caller's stream of that program and device; how many of them are new.

    ``TooManyError`` where the key has as many streams as one may.
    """
    caller = present_caller()
    whose = {"owner_id": caller.owner_id, "key_id": caller.key_id, "sender": sender}
    whose["device"] = plain_text(device)
    rows = list(zip(*sorted(points, key=_in_order), strict=True)) if points else [()] * len(_COLUMNS)
    values = {"unusable": unusable, "why": plain_text(why), "silence_s": silence_s, **whose}
    values["time_us"] = bigints(rows[0])
    values |= {name: _doubles(row) for name, row in zip(_MEASURED, rows[1:], strict=True)}
    while True:
        (stream_id, added) = fetch_binary(session, _ADDS[caller.key_id is None], values)[0]
        if stream_id is not None:
            return int(added)
        session.execute(_BEGIN, {**whose, "most": MOST_STREAMS})
        if not session.execute(_IS_THERE, whose).scalar_one():
            raise TooManyError(say("live.many_devices", most=MOST_STREAMS))


def _in_order(point: LivePoint) -> tuple[int, str]:
    """Of two points of one time that one message holds always the same is kept."""
    return point.time_us, repr(point)


def _doubles(values: Sequence[float | None]) -> np.ma.MaskedArray[Any, Any]:
    found = np.array([np.nan if one is None else one for one in values], float)
    return np.ma.masked_invalid(found)


def streams(session: Session, most: int) -> list[Seen]:
    """Those of the caller's owner, the last seen in front."""
    return _seen(session.execute(_OF_OWNER, {"owner_id": present_caller().owner_id, "most": most}))


def own_streams(session: Session, most: int) -> list[Seen]:
    """Those of the present key alone."""
    caller = present_caller()
    values = {"owner_id": caller.owner_id, "key_id": caller.key_id, "most": most}
    return _seen(session.execute(_OF_PRESENT_KEY, values))


def _seen(rows: Any) -> list[Seen]:
    return [Seen(*row) for row in rows]


def due_streams(session: Session, most: int) -> list[int]:
    """Streams that are to be looked at, those that wait for longest in front."""
    return list(session.execute(_DUE, {"most": most}).scalars())


def take(session: Session, stream_id: int) -> Stream | None:
    """The stream, which nobody else looks at before this transaction ends; None: somebody does, or it is not due."""
    row = session.execute(_TAKE, {"id": stream_id, "lock": _LOCK}).one_or_none()
    return None if row is None else Stream(*row)


def points_of(session: Session, stream_id: int, most: int) -> list[LivePoint]:
    """The stream's first points by time."""
    return [LivePoint(*row) for row in fetch_binary(session, _POINTS, {"id": stream_id, "most": most})]


def look_again(session: Session, stream: Stream, after_s: float | None) -> None:
    """Look at the stream again after so long, at once where something came since it was taken; None: when the next
    point comes."""
    session.execute(_LOOK_AGAIN, {"id": stream.id, "seen_at": stream.seen_at, "after_s": after_s})


def closed_between(session: Session, stream_id: int, from_us: int, to_us: int) -> list[Closed]:
    """Drives of the stream that have something of that time, in their order."""
    values = {"id": stream_id, "from_us": from_us, "to_us": to_us}
    return [Closed(*row) for row in session.execute(_CLOSED, values)]


def note_drive(session: Session, stream_id: int, drive_id: uuid.UUID, times_us: Sequence[int]) -> None:
    """Note that the drive is made of points of these times, and let them be in the stream no more."""
    values = {"id": stream_id, "drive_id": drive_id, "begins_us": min(times_us), "ends_us": max(times_us)}
    session.execute(_NOTE, values)
    remove_points(session, stream_id, times_us)


def remove_points(session: Session, stream_id: int, times_us: Sequence[int], *, waited_days: int = 0) -> int:
    """Let the points of these times be in the stream no more, but for those that came less long ago; how many."""
    if not times_us:
        return 0
    values = {"id": stream_id, "times_us": bigints(times_us), "days": waited_days}
    return len(fetch_binary(session, _REMOVE, values))


def forget_old(session: Session) -> None:
    """Forget streams that are silent for long."""
    session.execute(_FORGET, {"days": KEPT_DAYS})
