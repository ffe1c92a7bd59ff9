"""Widenings of device classes: learned from repeats when the operator asks, and applied wherever drives are solved.

``device_classes`` holds what was learned of each class, and what is applied. A drive's passes are widened as they are
read for a solution; what is stored of a drive stays as the drive stated it. So a widening that goes back to 1 leaves no
trace. Where a widening changes, the drives of its class are marked one by one, as if they came anew, and whoever is
interrupted goes on where it was: until then both old and new slopes are published.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.messages import say
from app.core.tables import IS_SHOWN
from app.network.locks import share_network
from app.network.marks import append_marks
from app.network.repeats import DEVICE_CLASS, read_repeats
from fusion.messages import joined
from fusion.network.repeats import Widening, learn_widenings, repeat_statistics
from fusion.types import Progress, no_progress

LEAST_CHANGE = 0.05
"""A widening that would change by a smaller share stays: slopes need not be solved again for it."""
DELAY_S = 3600.0
"""Marks wait for so long while drives come, which go first."""
_FIRST = uuid.UUID(int=0)

_APPLIED = text("SELECT name FROM device_classes WHERE applied <> 1")
_OF_DRIVES = text(f"""
    SELECT d.id, c.applied FROM drives AS d JOIN device_classes AS c ON c.name = {DEVICE_CLASS.format("d")}
    WHERE d.id = ANY(CAST(:ids AS uuid[])) AND c.applied <> 1
""")  # noqa: S608 - constants
_ALL = text("""
    SELECT name, applied, learned, sigma, pairs, drive_pairs, drives, learned_at, marked_after IS NOT NULL AS marking
    FROM device_classes ORDER BY name
""")
_LOCK = text("LOCK TABLE device_classes IN SHARE ROW EXCLUSIVE MODE")
_WRITE = text("""
    INSERT INTO device_classes AS c (name, applied, learned, sigma, pairs, drive_pairs, drives, marked_after)
    VALUES (:name, :applied, :learned, :sigma, :pairs, :drive_pairs, :drives, :marked_after)
    ON CONFLICT (name) DO UPDATE SET applied = excluded.applied, learned = excluded.learned, sigma = excluded.sigma,
        pairs = excluded.pairs, drive_pairs = excluded.drive_pairs, drives = excluded.drives, learned_at = now(),
        marked_after = coalesce(excluded.marked_after, c.marked_after)
""")
_RESET = text(
    "UPDATE device_classes SET applied = 1, marked_after = :first WHERE applied <> 1 RETURNING name"
)
_MARKING = text("""
    SELECT name, marked_after FROM device_classes WHERE marked_after IS NOT NULL ORDER BY name LIMIT 1 FOR UPDATE
""")
_MARKED = text("UPDATE device_classes SET marked_after = :after WHERE name = :name")
_NEXT = text(f"""
    SELECT d.id FROM drives AS d
    WHERE d.id > :after AND d.duplicate_of IS NULL AND {IS_SHOWN.format("d")} AND {DEVICE_CLASS.format("d")} = :name
        AND EXISTS (SELECT FROM drive_constants AS c WHERE c.drive_id = d.id)
    ORDER BY d.id LIMIT 1
""")  # noqa: S608 - constants
_LOCK_DRIVE = text("SELECT FROM drives WHERE id = :drive_id FOR NO KEY UPDATE")
_SEGMENTS = "SELECT DISTINCT segment_id FROM drive_passes WHERE {}"


def widenings_of(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, float]:
    """What sigmas of these drives are to be multiplied by; those that stay as they are are left out."""
    if not drive_ids or not session.execute(_APPLIED).first():
        return {}
    rows = session.execute(_OF_DRIVES, {"ids": list(drive_ids)})
    return {row.id: row.applied for row in rows}


def device_classes(session: Session) -> list[dict[str, Any]]:
    """What is known of each class, by name."""
    return [dict(row._mapping) for row in session.execute(_ALL)]


def sentence(classes: Sequence[Mapping[str, Any]]) -> str:
    """What is applied, for people."""
    wide = [
        say("widenings.of", name=one["name"], by=one["applied"]) for one in classes if one["applied"] != 1.0
    ]
    if not wide:
        return say("widenings.none", n=len(classes))
    return say("widenings.some", n=len(classes), wide=joined(wide, "; "))


def repeat_rows(session: Session) -> list[dict[str, Any]]:
    """Statistics of repeats; those of a class, with what its sigmas are multiplied by as well."""
    applied = {row["name"]: row["applied"] for row in device_classes(session)}
    rows = repeat_statistics(read_repeats(session))
    return [
        {**row, "widening": applied.get(row["group"]) if row["kind"] == "class" else None} for row in rows
    ]


def learn(sessions: Sessions, progress: Progress = no_progress) -> list[dict[str, Any]]:
    """Learn the widenings of all classes from the repeats that there are, and mark what they change; all classes.

    Once more changes nothing. A class of which nothing is repeated any more goes back to 1.
    """
    progress("repeats", 0.0)
    with sessions() as session:
        found = {one.name: one for one in learn_widenings(read_repeats(session))}
    with sessions.begin() as session:
        session.execute(_LOCK)
        stored: Mapping[str, Row[Any]] = {row.name: row for row in session.execute(_ALL)}
        for name in sorted(found.keys() | stored.keys()):
            one = found.get(name) or Widening(name, 1.0, 1.0, 0, 0, 0)
            was = stored[name].applied if name in stored else 1.0
            changed = abs(math.log(one.applied / was)) > LEAST_CHANGE or (one.applied == 1.0 != was)
            values = {**vars(one), "applied": one.applied if changed else was}
            session.execute(_WRITE, {**values, "marked_after": _FIRST if changed else None})
    return _mark(sessions, progress)


def reset(sessions: Sessions, progress: Progress = no_progress) -> list[dict[str, Any]]:
    """Take all drives at their word again, and mark what that changes; all classes."""
    with sessions.begin() as session:
        session.execute(_LOCK)
        session.execute(_RESET, {"first": _FIRST})
    return _mark(sessions, progress)


def _mark(sessions: Sessions, progress: Progress) -> list[dict[str, Any]]:
    """Mark the drives of all classes whose widening has changed, one in a transaction."""
    progress("marking", 0.0)
    while _mark_next(sessions):
        progress("marking", 0.0)
    with sessions() as session:
        return device_classes(session)


def _mark_next(sessions: Sessions) -> bool:
    """Mark the next drive, its condensed passes recent again so that they are condensed anew; whether there was one."""
    from app.network.condensed import OF_DRIVE, of_drive, uncondense_drive  # noqa: PLC0415 - loads the estimator

    with sessions.begin() as session:
        share_network(session)
        waiting = session.execute(_MARKING).one_or_none()
        if waiting is None:
            return False
        values = {"name": waiting.name, "after": waiting.marked_after}
        drive_id = session.execute(_NEXT, values).scalar()
        if drive_id is not None:
            session.execute(_LOCK_DRIVE, {"drive_id": drive_id})
            uncondense_drive(session, drive_id)
            touched = session.execute(
                text(_SEGMENTS.format(OF_DRIVE.format(":", ""))), of_drive(session, drive_id)
            ).scalars()
            append_marks(session, list(touched), delay_s=DELAY_S)
        session.execute(_MARKED, {"name": waiting.name, "after": drive_id})
    return True
