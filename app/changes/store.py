"""What changed since when: moments, the text of a version, and the SQL of "changed since".

A moment is the 64-bit number of a transaction. Each change is noted with the number of the transaction that made it
(``segment_changes``, by triggers), and numbers are given out before transactions end, in any order. So what is told
ends at the *horizon*: every transaction below it has ended, and no change below it can come any more. "Changes from one
horizon to the next" are each change exactly once, in whatever order transactions commit.

The numbers are one server's. A version names the *epoch* in which its number counts: a random word in a table of one
row, with the server, the database and the timeline (of recoveries) in which it was written, and the transaction that
wrote it. Where a dump was brought in, a database copied or a server recovered to an earlier moment, one of these is
another one: then a new epoch begins, numbers that are not of this server are put before all others, and versions of the
former epoch are refused.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session, sessionmaker

from app.core.db import Bounds, Sessions
from app.core.errors import BadQueryError, GoneError, NotReadyError
from app.core.messages import say
from app.network.locks import own_network

Moment = int

ANEW = say("changes.anew")

MOST_AT_ONCE = 10_000
"""Changes that a question numbers anew by itself; more are for a worker."""
PRUNED_AT_ONCE = 5000

_PARSED = re.compile(r"([a-z0-9]{10})-([0-9]{1,18})(?:\.([0-9]{1,18}))?", re.ASCII)
_LETTERS = "abcdefghijklmnopqrstuvwxyz234567"
_LENGTH = 10

_PLACE = """
    (SELECT CAST(c.system_identifier AS text) || '-' || d.oid || '-'
            || substr(pg_walfile_name(pg_current_wal_lsn()), 1, 8)
     FROM pg_control_system() AS c, pg_database AS d WHERE d.datname = current_database())
"""
# The number of the transaction that wrote a row stands in the row itself, without its upper half: a row that a dump
# brought back was written by another.
_SOUND = f"e.place = {_PLACE} AND CAST(CAST(e.xmin AS text) AS bigint) = e.xid & 4294967295"
_LOWEST_RUNNING = "CAST(CAST(pg_snapshot_xmin(pg_current_snapshot()) AS text) AS bigint)"
_NEXT = "CAST(CAST(pg_snapshot_xmax(pg_current_snapshot()) AS text) AS bigint)"

_STATE = text(f"""
    SELECT e.epoch, e.pruned_xid, {_SOUND} AS sound, {_NEXT} AS next_xid,
           (SELECT coalesce(max(c.xid), 0) + 1 FROM segment_changes AS c WHERE c.xid < {_LOWEST_RUNNING}) AS horizon
    FROM change_epoch AS e
""")  # noqa: S608 - constants

_IS_SOUND = text(f"SELECT {_SOUND} FROM change_epoch AS e")  # noqa: S608 - constants
# What was noted elsewhere is older than all that this server notes from now on.
_RENUMBER = (
    text("UPDATE segment_changes SET xid = 0 WHERE xid >= versant_xid()"),
    text("UPDATE cells SET changed_xid = 0 WHERE changed_xid >= versant_xid()"),
)
_AHEAD = text(
    f"SELECT count(*) FROM (SELECT FROM segment_changes WHERE xid >= {_NEXT} LIMIT :most + 1) AS ahead"  # noqa: S608
)
_BEGIN = text(f"""
    INSERT INTO change_epoch (id, epoch, place, xid) SELECT 1, :epoch, {_PLACE}, versant_xid()
    ON CONFLICT (id) DO UPDATE SET epoch = excluded.epoch, place = excluded.place, xid = excluded.xid,
        begun_at = excluded.begun_at, pruned_xid = 0
""")

_CHANGED_SINCE = """{alias}.id IN (
    SELECT changed.segment_id FROM segment_changes AS changed
    WHERE changed.xid >= coalesce(CAST(:since_xid AS bigint), 0) AND changed.xid < CAST(:until_xid AS bigint)
        AND changed.changed_at >= coalesce(CAST(:since_time AS timestamptz), '-infinity') AND NOT changed.gone)"""


class State(NamedTuple):
    """How far what is told goes, as the statement's snapshot sees it."""

    epoch: str
    pruned_xid: Moment
    """What was gone before is not told any more."""
    sound: bool
    next_xid: Moment
    """No transaction has had this number or a higher one yet."""
    horizon: Moment


class Since(NamedTuple):
    """Where somebody goes on: after all changes below ``xid``, and after those of ``xid`` up to ``segment_id``."""

    epoch: str
    xid: Moment
    segment_id: int = 0


def state(session: Session) -> State:
    """Epoch and horizon now: two looks into indexes.

    A database that was restored or copied begins its epoch here, at the first question. ``NotReadyError`` where that
    is under way.
    """
    current = _state(session)
    if current is None and begin_epoch(sessionmaker(session.get_bind()), MOST_AT_ONCE) is not None:
        current = _state(session)
    if current is None:  # much to do, or a snapshot from before
        raise NotReadyError(say("service.restored"))
    return current


def horizon(session: Session) -> Moment:
    """The moment up to which everything is told, and to go on from: "since <= xid < horizon" is each change once.

    Ask for it before the data are read, or in one snapshot with them. It is the lowest such moment (one after the last
    change of any segment that no running transaction can precede), so it stays as it is for as long as nothing
    changes, and also if the server crashes: numbers of transactions that left nothing behind are given out again then.
    """
    return state(session).horizon


def version_text(session: Session, xid: Moment) -> str:
    """A moment as a text that no other database takes for one of its own."""
    return text_of(Since(state(session).epoch, xid))


def parse_version(session: Session, value: str, *, field: str = "since") -> Moment:
    """The moment that ``version_text`` wrote; in the middle of one, of a version that a page of changes ends with.

    Raises as ``parse_since`` does.
    """
    return parse_since(state(session), value, field=field).xid


def parse_since(now: State, value: str, *, field: str = "since") -> Since:
    """The place in the changes that a version names.

    Raises ``BadQueryError`` for what is no version, ``GoneError`` for one of another epoch or from before what is still
    told.
    """
    parsed = _PARSED.fullmatch(value)
    if parsed is None:
        raise BadQueryError.about(field, say("changes.no_version", text=value[:80]))
    since = Since(parsed[1], int(parsed[2]), int(parsed[3] or 0))
    if since.epoch != now.epoch or since.xid > now.next_xid:
        raise GoneError.about(field, say("changes.other_database", advice=ANEW))
    if since.xid < now.pruned_xid:
        raise GoneError.about(
            field,
            say("changes.too_old", advice=ANEW),
        )
    return since


def text_of(since: Since) -> str:
    """The text of a place in the changes."""
    return f"{since.epoch}-{since.xid}" + (f".{since.segment_id}" if since.segment_id else "")


def changed_since_sql(alias: str) -> str:
    """An SQL condition on rows ``alias`` of ``segments``: changed since a moment or a time, and told by now.

    Parameters: ``since_xid`` (from ``parse_version``) and ``since_time`` (an aware time), either may be NULL;
    ``until_xid`` (from ``horizon``, kept over all pages of one listing), whose ``version_text`` is what the answer
    names to go on from.

    With a version this misses nothing and repeats nothing. A time is for the beginning: a change is noted with the
    moment at which it was written, and seen when its transaction ends, maybe later; whoever goes on by times has to
    overlap them, whoever goes on by the version in the answer does not. Segments that are gone are told by
    ``/v1/changes`` alone. A segment that changes while somebody pages leaves the listing and is in the next one.
    """
    return _CHANGED_SINCE.format(alias=alias)


def begin_epoch(sessions: Sessions, most: int | None = None) -> bool | None:
    """Begin a new epoch where the database's numbers are not of one history with its present server.

    Whether it was begun; None: more than ``most`` are to be numbered anew. Safe to call at any time and by several at
    once. Changes of the map wait meanwhile: of a restored database with a million segments some twenty seconds.
    """
    with sessions() as session:
        if session.execute(_IS_SOUND).scalar():
            return False
        if most is not None and session.execute(_AHEAD, {"most": most}).scalar_one() > most:
            return None
    with sessions.begin() as session:
        own_network(session)
        if session.execute(_IS_SOUND).scalar():
            return False
        for statement in _RENUMBER:
            session.execute(statement)
        epoch = "".join(secrets.choice(_LETTERS) for _ in range(_LENGTH))
        session.execute(_BEGIN, {"epoch": epoch})
    return True


def _state(session: Session) -> State | None:
    row = session.execute(_STATE).one_or_none()
    return State(*row) if row is not None and row.sound else None


LOOKED_AT = 10_000
"""Changes that one request for a part of the map looks at: less than 100 ms. The next page goes on behind them."""

# West may exceed east: the box crosses the antimeridian.
_AREA = """
    (SELECT CASE WHEN CAST(:west AS float8) <= :east THEN ST_MakeEnvelope(:west, :south, :east, :north, 4326)
            ELSE ST_Collect(ST_MakeEnvelope(:west, :south, 180, :north, 4326),
                            ST_MakeEnvelope(-180, :south, :east, :north, 4326)) END)
"""
_SINCE = """
    SELECT c.segment_id, c.xid, c.changed_at, c.gone, c.was FROM segment_changes AS c
    WHERE (c.xid, c.segment_id) > (CAST(:xid AS bigint), CAST(:segment_id AS bigint)) AND c.xid < :until
    ORDER BY c.xid, c.segment_id LIMIT :limit
"""
_PAGE = text(f"SELECT segment_id, xid, changed_at, gone, true AS inside FROM ({_SINCE}) AS c")  # noqa: S608 - constants
# Where it was is asked as well: whoever follows a part of the map has it still. What went without a word on its place
# (a table that was emptied) may have been anywhere. One by one: joined, all segments would be read.
_PAGE_WITHIN = text(f"""
    SELECT c.segment_id, c.xid, c.changed_at, c.gone,
           coalesce(ST_Intersects(s.geom, area.of), false) OR coalesce(ST_Intersects(c.was, area.of), c.gone) AS inside
    FROM ({_SINCE}) AS c
    LEFT JOIN LATERAL (SELECT geom FROM segments WHERE id = c.segment_id LIMIT 1) AS s ON true
    CROSS JOIN (SELECT {_AREA} AS of) AS area
    ORDER BY c.xid, c.segment_id
""")  # noqa: S608 - constants

# What is derived from segments follows these notes as well (``app.map.derived``): it has been there first.
_PRUNE = text("""
    WITH old AS (
        SELECT segment_id, xid, gone FROM segment_changes
        WHERE (gone OR was IS NOT NULL) AND changed_at < clock_timestamp() - make_interval(secs => :age_s)
            AND (xid, segment_id) <= (SELECT xid, segment_id FROM derived_upto)
        ORDER BY changed_at LIMIT :piece FOR UPDATE SKIP LOCKED
    ), gone AS (
        DELETE FROM segment_changes AS c USING old WHERE c.segment_id = old.segment_id AND old.gone
    ), moved AS (
        UPDATE segment_changes AS c SET was = NULL FROM old WHERE c.segment_id = old.segment_id AND NOT old.gone
    ), counted AS (SELECT count(*) AS n, max(xid) + 1 AS next FROM old)
    UPDATE change_epoch AS e SET pruned_xid = greatest(e.pruned_xid, counted.next), xid = versant_xid()
    FROM counted WHERE counted.n > 0
    RETURNING counted.n
""")


class Change(NamedTuple):
    """That a segment changed, or is gone."""

    id: int
    changed_at: datetime
    gone: bool


class Page(NamedTuple):
    """Changes in the order of their moments, and where to go on."""

    changes: list[Change]
    until: Since
    more: bool
    """Whether there is more already."""


def page_since(session: Session, now: State, since: Since, limit: int, bbox: Bounds | None = None) -> Page:
    """At most ``limit`` changes behind ``since``, each segment once, with its last change.

    ``bbox`` (degrees; west > east: across the antimeridian) keeps the segments that are, or were, in the box. Then a
    page may hold fewer, even none, though there is more: it looks at ``LOOKED_AT`` changes at most.
    """
    most = limit + 1 if bbox is None else LOOKED_AT
    changes, until = list[Change](), since
    rows = _rows(session, now, since, most, bbox)
    for count, row in enumerate(rows, start=1):
        if len(changes) == limit:
            return Page(changes, until, more=True)
        until = Since(now.epoch, row.xid, row.segment_id)
        if row.inside:
            changes.append(Change(row.segment_id, row.changed_at, row.gone))
        if count == most:
            return Page(changes, until, more=True)
    return Page(changes, max(since, Since(now.epoch, now.horizon)), more=False)


def count_since(
    session: Session, now: State, since: Since, most: int, bbox: Sequence[float] | None = None
) -> tuple[int, int, bool]:
    """Of the first ``most`` changes: how many are in the box, how many of these gone; and whether these are all."""
    looked, inside, gone = 0, 0, 0
    for row in _rows(session, now, since, most + 1, bbox):
        looked += 1
        if row.inside and looked <= most:
            inside, gone = inside + 1, gone + row.gone
    return inside, gone, looked <= most


def prune(sessions: Sessions, kept_days: float) -> int:
    """Tell no more of what went, or moved, so long ago; of how many segments. Versions of before are refused then."""
    values = {"age_s": 86400.0 * kept_days, "piece": PRUNED_AT_ONCE}
    count, pruned = 0, PRUNED_AT_ONCE
    while pruned == PRUNED_AT_ONCE:  # a country may have gone
        with sessions.begin() as session:
            pruned = int(session.execute(_PRUNE, values).scalar() or 0)
        count += pruned
    return count


def _rows(
    session: Session, now: State, since: Since, limit: int, bbox: Sequence[float] | None
) -> Iterator[Any]:
    values: dict[str, Any] = {"xid": since.xid, "segment_id": since.segment_id, "until": now.horizon}
    if bbox is None:
        return iter(session.execute(_PAGE, {**values, "limit": limit}))
    corners = dict(zip(("west", "south", "east", "north"), bbox, strict=True))
    return iter(session.execute(_PAGE_WITHIN, {**values, **corners, "limit": limit}))
