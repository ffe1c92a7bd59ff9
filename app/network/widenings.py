"""Widenings of device classes: learned from repeats when the operator asks, and applied wherever drives are solved.

``device_classes`` holds what was learned of each class, and what is applied. A drive's passes are widened as they are
read for a solution; what is stored of a drive stays as the drive stated it. So a widening that goes back to 1 leaves no
trace. Where a widening changes, the drives of its class are marked one by one, as if they came anew, and whoever is
interrupted goes on where it was: until then both old and new slopes are published.

Repeats are drives over one segment, paired with those before them (``fusion.network.repeats``). Each drive's own slope
and sigma are read as it stated them (``drive_segments``), never as they are widened: what is learned from repeats has
no part in what it is learned from.
"""

from __future__ import annotations

import math
import uuid
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import Sessions, fetch_binary
from app.core.messages import say
from app.core.tables import IS_SHOWN
from app.network.locks import share_network
from app.network.marks import append_marks
from fusion.messages import joined
from fusion.network.pass_factor import DRIVEN_BYTES, PassFactor
from fusion.network.repeats import OwnSlopes, RepeatPairs, Widening, learn_widenings, repeat_statistics
from fusion.types import Floats, Progress, no_progress

DEVICE_CLASS = """
    CASE WHEN jsonb_exists({0}.report -> 'sensors', 'doppler') THEN 'doppler'
         WHEN jsonb_exists({0}.report -> 'sensors', 'barometer') THEN 'barometer'
         WHEN jsonb_exists({0}.report -> 'sensors', 'altitude')
             THEN CASE WHEN CAST({0}.report ->> 'altimeter' AS boolean) THEN 'altimeter' ELSE 'altitude' END
         WHEN jsonb_exists_any({0}.report -> 'sensors', ARRAY['pitch', 'specific force']) THEN 'inertial'
         ELSE 'elevation model' END || ', ' || CAST({0}.report ->> 'format' AS text)
"""
"""``fusion.network.repeats.device_class`` as SQL on a row of ``drives`` under that name; NULL without a report."""

MOST_ESTIMATES = 100_000
"""Of more drives' estimates of segments, those in an equal part of all cells are read: a few seconds' work."""
PARTS = 1024

_SHARE = text("SELECT reltuples FROM pg_class WHERE oid = CAST('drive_segments' AS regclass)")

# The next pass, or the one before, tells the direction: by which node it meets this one's segment.
_MEETS = """
    CASE WHEN {step}(p.sequence) OVER drive = p.sequence {sign} 1 THEN
        CAST({near} IN ({step}(s.from_node) OVER drive, {step}(s.to_node) OVER drive) AS integer)
        - CAST({far} IN ({step}(s.from_node) OVER drive, {step}(s.to_node) OVER drive) AS integer) ELSE 0 END
"""
# The planner takes a third of all cells for chosen, and would read everything: OFFSET 0 has it look up what is theirs.
_SINGLE = f"""
    WITH chosen AS MATERIALIZED (
        SELECT s.* FROM cells AS c, LATERAL (
            SELECT id, cell, from_node, to_node, length_m, oneway FROM segments WHERE cell = c.id OFFSET 0) AS s
        WHERE hashint4(c.id) & {PARTS - 1} < %(part)s
    ), every AS MATERIALIZED (
        SELECT p.drive_id, p.segment_id, p.id, p.entered_s, s.length_m, s.oneway,
               substring(p.factor FROM 1 FOR {DRIVEN_BYTES}) AS head,
               sign({_MEETS.format(step="lead", sign="+", near="s.to_node", far="s.from_node")}
                    + {_MEETS.format(step="lag", sign="-", near="s.from_node", far="s.to_node")}) AS way
        FROM chosen AS s, LATERAL (
            SELECT * FROM drive_passes WHERE segment_id = s.id AND partition = versant_partition(s.cell) OFFSET 0) AS p
        WINDOW drive AS (PARTITION BY p.drive_id ORDER BY p.sequence)
    ), known AS MATERIALIZED (
        SELECT d.id, {DEVICE_CLASS.format("d")} AS class,
               coalesce(CAST(extract(month FROM d.drive_time) AS integer) %% 12 / 3, -1) AS season
        FROM drives AS d WHERE d.duplicate_of IS NULL AND {IS_SHOWN.format("d")}
    )
    SELECT o.segment_id, o.drive_id, d.class, e.slope_percent, e.slope_sigma_percent, o.length_m,
           CAST(coalesce(nullif(o.way, 0), o.oneway) AS integer), d.season, o.head
    FROM every AS o
    JOIN known AS d ON d.id = o.drive_id
    CROSS JOIN LATERAL (
        SELECT passes, in_network, slope_percent, slope_sigma_percent FROM drive_segments
        WHERE drive_id = o.drive_id AND segment_id = o.segment_id OFFSET 0) AS e
    WHERE e.passes = 1 AND e.in_network AND d.class IS NOT NULL
        AND NOT EXISTS (SELECT FROM rejected_passes AS r WHERE r.segment_id = o.segment_id AND r.pass_id = o.id)
    ORDER BY o.segment_id, o.entered_s, o.drive_id
"""  # noqa: S608 - constants


def read_repeats(session: Session) -> RepeatPairs:
    """Each drive that passed a segment once, nearly whole and accepted, with the last that did so before it, and with
    the last of its own class."""
    estimates = float(session.execute(_SHARE).scalar_one())
    part = PARTS if estimates <= MOST_ESTIMATES else max(1, int(PARTS * MOST_ESTIMATES / estimates))
    rows = fetch_binary(session, _SINGLE, {"part": part}, prepare=False)
    if not rows:
        return pairs_of([], np.zeros((0, 4)))
    return pairs_of(rows, PassFactor.driven([row[-1] for row in rows]))


def pairs_of(rows: list[tuple[Any, ...]], driven: Floats) -> RepeatPairs:
    """Pairs of rows of ``_SINGLE``; ``driven`` (m, 4) is what the head of each says (``PassFactor.driven``)."""
    start, end, first, last = driven.T
    columns = list(zip(*rows, strict=True)) if rows else [()] * 9
    names = sorted(set(columns[2]))
    number: dict[uuid.UUID, int] = {drive: k for k, drive in enumerate(dict.fromkeys(columns[1]))}
    return RepeatPairs.of_neighbours(
        OwnSlopes(
            names=tuple(names),
            segment=np.array(columns[0], np.int64),
            drive=np.array([number[one] for one in columns[1]], np.int64),
            kind=np.array([names.index(one) for one in columns[2]], np.int64),
            slope_percent=np.array(columns[3], float),
            sigma_percent=np.array(columns[4], float),
            length_m=np.array(columns[5], float),
            driven_m=end - start,
            speed_mps=(end - start) / np.maximum(last - first, 0.1),
            way=np.array(columns[6], np.int64),
            season=np.array(columns[7], np.int64),
        )
    )


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
