"""What needs a person first: a few looks into indexes, each of which finds nothing while all is well."""

from __future__ import annotations

import math
from typing import Any

from sqlalchemy import TextClause, text
from sqlalchemy.orm import Session

from app.core.messages import say
from app.drives.store import WAITS_FOR_ROADS
from app.network.marks import PATIENCE
from app.ops import store
from fusion.messages import said

FAILED_DAYS = 7
STUCK_S = 3600.0
"""A run that lasts so long is as a rule none any more; a worker ends its own at VERSANT_RUN_LIMIT_S."""
WAIT_LOOK_S, WAIT_ACT_S = 600.0, 3600.0
"""Uploads that wait longer: something is slow, something is wrong."""
REMOVAL_S = 900.0
BEHIND_S = 900.0
LITTLE_ROOM = 4
"""So many times the room that is to stay free: time to look."""

FAULTS = frozenset(
    {"internal", "interrupted", "out-of-memory", "processing-failed", "no-roads", "bad-roads", "bad-terrain"}
)
"""Kinds of failures that are the service's own, or its machine's; others are the log's."""

_FAILED = text("""
    SELECT failure_kind AS kind, CAST(sum(drives) AS bigint) AS drives FROM drive_counts
    WHERE status = 'failed' AND day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
    GROUP BY failure_kind HAVING sum(drives) > 0 ORDER BY 2 DESC, 1
""")
# Of the same days, which are those of the uploads.
_FOR_ROADS = text(f"""
    SELECT d.failure_kind AS kind, count(*) AS drives,
           extract(epoch FROM clock_timestamp() - min(d.created_at)) AS oldest_s
    FROM drives AS d
    WHERE {WAITS_FOR_ROADS}
        AND d.created_at >= date_trunc('day', now(), 'UTC') - make_interval(days => CAST(:days AS integer) - 1)
    GROUP BY d.failure_kind
""")  # noqa: S608 - a constant


def _drives_since(moment: str, condition: str) -> TextClause:
    """How many drives have been in a state for longer than ``age_s``, and for how long the first of them."""
    return text(f"""
        SELECT count(*), extract(epoch FROM clock_timestamp() - min({moment})) FROM drives
        WHERE {condition} AND {moment} < clock_timestamp() - make_interval(secs => :age_s)
    """)  # noqa: S608 - constants


# What runs and what is removed are few, and have an index by status; what waits has one of its own. Drives of batches
# may wait: they are behind all others.
_STUCK = _drives_since("started_at", "status = 'running'")
_REMOVALS = _drives_since("finished_at", "status = 'cancelled'")
_WAITING = _drives_since("queued_at", "status = 'queued' AND batch_id IS NULL")
_UNSOLVED = text("""
    SELECT count(DISTINCT cell), extract(epoch FROM clock_timestamp() - min(made_at)) FROM network_marks
    WHERE tries > :patience
""")
_WEBHOOKS = text("""
    SELECT count(*), extract(epoch FROM clock_timestamp() - min(failing_since)) FROM webhooks
    WHERE NOT active AND off_reason IS NOT NULL
""")
_OPERATIONS = text("""
    SELECT status, count(*) AS operations, extract(epoch FROM clock_timestamp() - min(coalesce(planned_at, created_at)))
        AS oldest_s
    FROM operations
    WHERE status = 'planned'
        OR status = 'failed' AND finished_at > now() - make_interval(days => CAST(:days AS integer))
    GROUP BY status ORDER BY status DESC
""")


def attention(session: Session, free_bytes: int | None, least_bytes: int) -> list[dict[str, Any]]:
    """Rows with ``kind``, ``severity`` (act before look), ``count``, ``oldest_s``, ``what`` and ``link``.

    ``free_bytes``: room for logs, None: nothing tells; ``least_bytes`` is to stay free.
    """
    rows = [
        *_workers(session),
        *_room(free_bytes, least_bytes),
        *_waits(session),
        *_cells(session),
        *_failed(session),
        *_operations(session),
    ]
    return sorted(rows, key=lambda row: (row["severity"] != "act", -(row["oldest_s"] or 0.0)))


def _row(
    kind: str, act: bool, what: str, link: str | None, count: int = 1, oldest_s: Any = None
) -> dict[str, Any]:
    return {
        "kind": kind,
        "severity": "act" if act else "look",
        "count": count,
        "oldest_s": None if oldest_s is None else max(0.0, float(oldest_s)),
        "what": what,
        "said": said(what),
        "link": link,
    }


def _workers(session: Session) -> list[dict[str, Any]]:
    if store.workers(session):
        return []
    waiting = store.queue(session)
    what = say("attention.no_worker")
    return [
        _row("worker", bool(waiting.depth), what, "/v1/admin/queue", waiting.depth, waiting.oldest_wait_s)
    ]


def _room(free_bytes: int | None, least_bytes: int) -> list[dict[str, Any]]:
    if free_bytes is None or free_bytes >= LITTLE_ROOM * least_bytes:
        return []
    what = say("attention.room", gib=free_bytes / 2**30)
    if free_bytes < least_bytes:
        return [_row("disk", True, say("attention.no_room", what=what), "/readyz")]
    return [_row("disk", False, say("attention.little_room", what=what, gib=least_bytes / 2**30), "/readyz")]


def _counted(
    session: Session,
    statement: TextClause,
    kind: str,
    what: str,
    link: str,
    act_after_s: float = math.inf,
    **values: float,
) -> list[dict[str, Any]]:
    """A row where the statement counts any; a person has to act once the first of them is as old as that."""
    count, oldest_s = session.execute(statement, values).one()
    act = max(0.0, float(oldest_s or 0.0)) >= act_after_s
    return [_row(kind, act, what, link, count, oldest_s)] if count else []


def _waits(session: Session) -> list[dict[str, Any]]:
    what = say("attention.stuck")
    rows = _counted(session, _STUCK, "stuck", what, "/drives?status=running", 0.0, age_s=STUCK_S)
    what = say("attention.wait")
    rows += _counted(session, _WAITING, "wait", what, "/drives?status=queued", WAIT_ACT_S, age_s=WAIT_LOOK_S)
    what = say("attention.removal")
    rows += _counted(session, _REMOVALS, "removal", what, "/v1/admin/queue", age_s=REMOVAL_S)
    behind_s = store.behind(session).behind_s
    if behind_s is not None and behind_s > BEHIND_S:
        what = say("attention.derived")
        rows.append(_row("derived", False, what, "/v1/admin/stats", 1, behind_s))
    return rows


def _cells(session: Session) -> list[dict[str, Any]]:
    what = say("attention.cell")
    return _counted(session, _UNSOLVED, "cell", what, "/v1/admin/stats", 0.0, patience=PATIENCE)


def _failed(session: Session) -> list[dict[str, Any]]:
    waiting = {row.kind: row for row in session.execute(_FOR_ROADS, {"days": FAILED_DAYS})}
    rows = []
    if waiting:
        what = say("attention.roads")
        count, oldest_s = (
            sum(row.drives for row in waiting.values()),
            max(row.oldest_s for row in waiting.values()),
        )
        rows.append(_row("roads", False, what, "/drives?waits_for=roads", count, oldest_s))
    for kind, failed in session.execute(_FAILED, {"days": FAILED_DAYS}):
        count = failed - (waiting[kind].drives if kind in waiting else 0)
        if count <= 0:
            continue
        what = say("attention.failed", days=FAILED_DAYS, kind=kind or "for a reason that was not noted")
        link = f"/drives?status=failed&failure={kind}" if kind else "/drives?status=failed"
        rows.append(_row("failed", kind in FAULTS, what, link, count))
    return rows


def _operations(session: Session) -> list[dict[str, Any]]:
    rows = []
    texts = {
        "planned": (True, say("attention.planned")),
        "failed": (False, say("attention.operation_failed", days=FAILED_DAYS)),
    }
    for status, count, oldest_s in session.execute(_OPERATIONS, {"days": FAILED_DAYS}):
        act, what = texts[status]
        rows.append(_row(f"operation-{status}", act, what, "/v1/operations", count, oldest_s))
    what = say("attention.webhook")
    return rows + _counted(session, _WEBHOOKS, "webhook", what, "/v1/webhooks")
