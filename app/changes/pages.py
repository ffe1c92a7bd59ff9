"""The changes since a version, page by page, and the removal of old ones. ``store`` explains the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.changes.store import Since, State
from app.core.db import Bounds, Sessions

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
_PAGE_WITHIN = text(
    f"""
    SELECT c.segment_id, c.xid, c.changed_at, c.gone,
           coalesce(ST_Intersects(s.geom, area.of), false) OR coalesce(ST_Intersects(c.was, area.of), c.gone) AS inside
    FROM ({_SINCE}) AS c
    LEFT JOIN LATERAL (SELECT geom FROM segments WHERE id = c.segment_id LIMIT 1) AS s ON true
    CROSS JOIN (SELECT {_AREA} AS of) AS area
    ORDER BY c.xid, c.segment_id
    """  # noqa: S608 - constants
)

# What is derived from segments follows these notes as well (``app.map.derived``): it has been there first.
_PRUNE = text(
    """
    WITH old AS (
        SELECT segment_id, xid, gone FROM segment_changes
        WHERE (gone OR was IS NOT NULL) AND changed_at < clock_timestamp() - make_interval(secs => :age_s)
            AND (xid, segment_id) <= (SELECT xid, segment_id FROM derived_upto)
        ORDER BY segment_id FOR UPDATE SKIP LOCKED
    ), gone AS (
        DELETE FROM segment_changes AS c USING old WHERE c.segment_id = old.segment_id AND old.gone
    ), moved AS (
        UPDATE segment_changes AS c SET was = NULL FROM old WHERE c.segment_id = old.segment_id AND NOT old.gone
    ), counted AS (SELECT count(*) AS n, max(xid) + 1 AS next FROM old)
    UPDATE change_epoch AS e SET pruned_xid = greatest(e.pruned_xid, counted.next), xid = versant_xid()
    FROM counted WHERE counted.n > 0
    RETURNING counted.n
    """
)


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
    session: Session, now: State, since: Since, most: int, bbox: Bounds | None = None
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
    with sessions.begin() as session:
        return int(session.execute(_PRUNE, {"age_s": 86400.0 * kept_days}).scalar() or 0)


def _rows(session: Session, now: State, since: Since, limit: int, bbox: Bounds | None) -> Iterator[Any]:
    values: dict[str, Any] = {"xid": since.xid, "segment_id": since.segment_id, "until": now.horizon}
    if bbox is None:
        return iter(session.execute(_PAGE, {**values, "limit": limit}))
    corners = dict(zip(("west", "south", "east", "north"), bbox, strict=True))
    return iter(session.execute(_PAGE_WITHIN, {**values, **corners, "limit": limit}))
