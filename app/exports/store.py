"""Exports in the database: found or added, cancelled, expired. The rest is ``app.jobs.requests.store``'s."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from datetime import timedelta
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import OPERATOR_OWNER, present_caller
from app.core.db import Bounds, plain_json
from app.core.errors import QuotaError
from app.core.messages import say
from app.core.settings import Settings
from app.core.tables import requests as tables
from app.exports.documents import Export
from app.jobs.requests.store import NOW, RequestStore
from app.jobs.task import Kind

MAKE_EXPORT = Kind("make_export", -50)
"""Behind uploads and what is published of them, before drives that are computed again by the thousand."""
MOST_WAITING = 100
AGAIN_S = 30
"""Whoever has as many under way as may be is told to come again after so long."""

exports = RequestStore(
    "export",
    tables.Export,
    Export.of,
    MAKE_EXPORT,
    "exports",
    on_claim={"data_version": None},
    one_of_lanes=4,
)

_OWNER = text("SELECT owner_id FROM exports WHERE id = :id")
# Among those of the caller's owner: that somebody else has asked for the same is not to be told, and who removes an
# export removes none of somebody else's. One that waits will see the data of when it begins, which are no older than
# those of now.
_SAME = text("""
    SELECT id FROM exports
    WHERE owner_id = (SELECT versant_owner()) AND request_sha256 = :request_sha256
        AND (status = 'queued' OR (status IN ('running', 'done') AND data_version = :data_version))
        AND (expires_at IS NULL OR expires_at > now())
    ORDER BY status = 'done' DESC, created_at LIMIT 1
""")

# Of the moment before a drive was removed that lay in one of these boxes. One that is being made begins anew.
_OVER = """
    e.request ->> 'bbox' IS NULL OR CAST(e.request #>> '{bbox,0}' AS float8) > CAST(e.request #>> '{bbox,2}' AS float8)
    OR EXISTS (
        SELECT FROM unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]),
                           CAST(:north AS float8[])) AS b (west, south, east, north)
        WHERE CAST(e.request #>> '{bbox,0}' AS float8) <= b.east AND CAST(e.request #>> '{bbox,2}' AS float8) >= b.west
            AND CAST(e.request #>> '{bbox,1}' AS float8) <= b.north
            AND CAST(e.request #>> '{bbox,3}' AS float8) >= b.south)
"""
_END_OVER = text(f"""
    UPDATE exports AS e SET status = 'cancelled', blob_key = NULL, companions = '{{}}', notes = '{{}}'
    FROM (SELECT e.id, e.blob_key FROM exports AS e WHERE e.status = 'done' AND ({_OVER}) FOR UPDATE) AS was
    WHERE e.id = was.id RETURNING was.blob_key
""")  # noqa: S608 - constants
_BEGIN_OVER = text(f"""
    UPDATE exports AS e SET status = 'queued', run = run + 1, progress = 0 WHERE e.status = 'running' AND ({_OVER})
    RETURNING e.id
""")  # noqa: S608 - constants

# What is to go: what has expired, and of what is kept the oldest, as far as it is too much of one owner, or what is
# left is too much together.
_REMOVE = text("""
    DELETE FROM exports WHERE id IN (
        SELECT id FROM exports WHERE expires_at < now()
        UNION ALL
        SELECT id FROM (
            SELECT id, is_over,
                   sum(size_bytes) FILTER (WHERE NOT is_over) OVER (ORDER BY finished_at DESC, id) AS together
            FROM (SELECT id, size_bytes, finished_at, owner_id <> :operator AND
                         sum(size_bytes) OVER (PARTITION BY owner_id ORDER BY finished_at DESC, id) > :owner_bytes
                         AS is_over
                  FROM exports WHERE status = 'done') AS of_owners) AS kept
        WHERE is_over OR together > :max_bytes)
    RETURNING blob_key
""")


def owner_of(session: Session, export_id: uuid.UUID) -> int:
    """Whose the export is."""
    return int(session.execute(_OWNER, {"id": export_id}).scalar_one())


def ask(
    session: Session,
    *,
    request: Mapping[str, Any],
    request_sha256: str,
    data_version: str,
    quota: int,
    **columns: Any,
) -> tuple[Export, bool]:
    """The caller's owner's export of this request at this version of the data, or a new one with its job; the flag says
    whether new.

    ``columns`` are its name and media type. ``QuotaError`` where ``quota`` of the owner's wait or run, unless the
    caller is an operator, ``BusyError`` where too many wait, of all owners.
    """
    exports.one_by_one(session)
    same = session.execute(_SAME, {"request_sha256": request_sha256, "data_version": data_version}).scalar()
    if same is not None and (export := exports.get(session, same)) is not None:
        return export, False
    if not present_caller().may("operate"):
        _require_quota(exports.under_way(session), quota)
    exports.require_place(session, MOST_WAITING)
    document = plain_json(request)
    return exports.add(session, request=document, request_sha256=request_sha256, **columns), True


def _require_quota(under_way: int, most: int) -> None:
    if under_way >= most:
        raise QuotaError(
            say("export.quota", most=most, n=under_way),
            quota="exports",
            headers={"Retry-After": str(AGAIN_S)},
        )


def expiry(settings: Settings) -> dict[str, Any]:
    """The column that says until when an export is kept that ends now."""
    return {"expires_at": NOW + timedelta(days=settings.export_keep_days)}


def cancel(session: Session, export_id: uuid.UUID, settings: Settings) -> str | None:
    """Cancel it, whatever its status; the blob that nobody refers to any more. Once more changes nothing."""
    export = exports.hold(session, export_id)
    if export is None or export.status == "cancelled":
        return None
    until = {} if export.expires_at is not None else expiry(settings)
    exports.write(
        session, export_id, **until, status="cancelled", blob_key=None, companions={}, finished_at=NOW
    )
    return export.blob_key


def end_over(session: Session, boxes: Sequence[Bounds]) -> list[str]:
    """End the exports of maps that reach into one of these boxes, degrees, and have those that are being made begin
    anew; the blobs that nobody refers to any more."""
    west, south, east, north = ([float(x) for x in side] for side in zip(*boxes, strict=True))
    values = {"west": west, "south": south, "east": east, "north": north}
    for number in session.execute(_BEGIN_OVER, values).scalars().all():
        exports.enqueue(session, number)
    return [key for key in session.execute(_END_OVER, values).scalars() if key is not None]


def expire(session: Session, settings: Settings) -> list[str | None]:
    """Remove what has expired or is too much, the oldest first; the blob of each, which nobody refers to any more."""
    values = {"max_bytes": settings.exports_max_bytes, "owner_bytes": settings.exports_owner_bytes}
    return list(session.execute(_REMOVE, {**values, "operator": OPERATOR_OWNER}).scalars())
