"""The statements that choose what is told, in one transaction: first of the live tables, then of those of ``told``."""

from __future__ import annotations

import uuid
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import TOLD
from app.core.db import fetch_binary, send_binary
from app.core.tables import IS_SHOWN

# Every pass is looked at, with nobody waiting for it: in memory, and by two processes.
_ROOM = ("SET LOCAL work_mem = '128MB'", "SET LOCAL max_parallel_workers_per_gather = 1")

# Passes that a solution rejected say nothing, so nobody counts by them; and a segment that an import took away is
# driven by nobody.
_ELIGIBLE = f"""
    CREATE TEMPORARY TABLE eligible ON COMMIT DROP AS
    SELECT p.drive_id, d.owner_id, p.segment_id, p.partition, p.id
    FROM drive_passes AS p
    JOIN drives AS d ON d.id = p.drive_id AND {IS_SHOWN.format("d")} AND d.duplicate_of IS NULL
    JOIN told.examined AS e ON e.drive_id = p.drive_id AND p.sequence <> ALL (e.hidden)
    JOIN segments AS s ON s.id = p.segment_id
    LEFT JOIN rejected_passes AS r ON r.segment_id = p.segment_id AND r.pass_id = p.id
    WHERE r.pass_id IS NULL AND p.condensed_weight IS DISTINCT FROM 0
"""  # noqa: S608 - constants
# A drive over a segment, with the passes that it may tell there now and those that are told of it. A drive that is
# computed again has others.
_PAIRS = """
    CREATE TEMPORARY TABLE pairs ON COMMIT DROP AS
    SELECT drive_id, segment_id, e.owner_id, e.content AS eligible, t.content AS told
    FROM (SELECT drive_id, segment_id, min(owner_id) AS owner_id, array_agg(id ORDER BY id) AS content
          FROM eligible GROUP BY drive_id, segment_id) AS e
    FULL JOIN (SELECT drive_id, segment_id, array_agg(id ORDER BY id) AS content
               FROM told.drive_passes GROUP BY drive_id, segment_id) AS t USING (drive_id, segment_id)
"""
# tell: all that may be told there is; withdraw: nothing any more; drop: not what was removed.
_ACTIONS = """
    CREATE TEMPORARY TABLE actions ON COMMIT DROP AS
    SELECT segment_id, CASE WHEN waiting >= :owners_needed THEN 'tell' WHEN staying < :owners_needed THEN 'withdraw'
                            ELSE 'drop' END AS action
    FROM (SELECT segment_id,
                 count(DISTINCT owner_id) FILTER (WHERE eligible IS DISTINCT FROM told) AS waiting,
                 count(DISTINCT owner_id) FILTER (WHERE told IS NOT NULL) AS staying,
                 bool_or(told IS NOT NULL) AS was_told,
                 bool_or(told IS NOT NULL AND eligible IS NULL) AS leaves
          FROM pairs GROUP BY segment_id) AS counted
    WHERE waiting >= :owners_needed OR was_told AND (leaves OR staying < :owners_needed)
"""
# An owner is known of what is eligible alone: so nobody counts by what is not.
_CHANGES = """
    CREATE TEMPORARY TABLE changes ON COMMIT DROP AS
    SELECT p.drive_id, p.segment_id, a.action = 'tell' AND p.eligible IS NOT NULL AS is_told
    FROM pairs AS p JOIN actions AS a ON a.segment_id = p.segment_id
    WHERE CASE a.action WHEN 'tell' THEN p.eligible IS DISTINCT FROM p.told
                        WHEN 'withdraw' THEN p.told IS NOT NULL
                        ELSE p.told IS NOT NULL AND p.eligible IS NULL END
"""
# Every pass counts as condensed: a solution reads their sums alone (``app.releases.telling``).
_TAKE_BACK = """
    DELETE FROM told.drive_passes AS t USING changes AS c
    WHERE t.drive_id = c.drive_id AND t.segment_id = c.segment_id
"""
_TELL = """
    INSERT INTO told.drive_passes (id, drive_id, segment_id, entered_s, condensed_weight, sequence, partition, factor)
    SELECT p.id, p.drive_id, p.segment_id, p.entered_s, 1, p.sequence, p.partition, p.factor
    FROM changes AS c
    JOIN eligible AS e ON e.drive_id = c.drive_id AND e.segment_id = c.segment_id
    JOIN drive_passes AS p ON p.id = e.id AND p.partition = e.partition
    WHERE c.is_told
"""
_INDEXES = (
    "CREATE INDEX ON pairs (segment_id)",
    "CREATE INDEX ON eligible (drive_id, segment_id)",
    "CREATE INDEX ON changes (drive_id, segment_id)",
)
# What a solver asks of a drive; nothing else of it is kept.
_DRIVES = """
    INSERT INTO told.drives AS t (id, owner_id, report)
    SELECT d.id, d.owner_id, jsonb_build_object(
        'sensors', d.report -> 'sensors', 'altimeter', d.report -> 'altimeter', 'format', d.report -> 'format')
    FROM drives AS d WHERE d.id IN (SELECT drive_id FROM changes WHERE is_told)
    ON CONFLICT (id) DO UPDATE SET report = excluded.report
"""
_READ_TOLD = text(f"SET LOCAL search_path = {TOLD}, public")
_AFFECTED = text("SELECT DISTINCT drive_id FROM changes ORDER BY drive_id")
_CHANGED = text("SELECT segment_id FROM actions ORDER BY segment_id")
_DRIVES_OVER = text("""
    SELECT DISTINCT drive_id FROM drive_passes WHERE segment_id = ANY(CAST(:segments AS bigint[])) ORDER BY drive_id
""")
_PASSES = """
    SELECT drive_id, factor, segment_id, sequence FROM drive_passes
    WHERE drive_id = ANY(%(drives)s) AND (drive_id = ANY(%(whole)s) OR segment_id = ANY(%(segments)s::bigint[]))
    ORDER BY drive_id, entered_s, segment_id, sequence
"""
_LENGTHS = text("SELECT id, length_m FROM segments WHERE id = ANY(CAST(:segments AS bigint[]))")
_FORGET_CONSTANTS = text("DELETE FROM drive_constants WHERE drive_id = ANY(:drives)")
_FORGET_SUMS = text("DELETE FROM condensed_passes WHERE segment_id = ANY(CAST(:segments AS bigint[]))")
_ADD_CONSTANTS = """
    INSERT INTO drive_constants (drive_id, passes, evidence, measurements, epoch_s, partitions)
    SELECT t.drive_id, t.passes, t.evidence, 0, '', '{}'
    FROM unnest(%(drives)s::uuid[], %(passes)s::integer[], %(evidence)b::bytea[]) AS t (drive_id, passes, evidence)
"""
# What is left of segments that an import took away.
_FORGET_ROADS = tuple(
    f"DELETE FROM told.{table} AS t WHERE NOT EXISTS (SELECT FROM segments AS s WHERE s.id = t.segment_id)"  # noqa: S608
    for table in ("condensed_passes", "network_slopes", "segment_slopes")
)
_FORGET_DRIVES = text("""
    DELETE FROM told.drives AS d WHERE NOT EXISTS (SELECT FROM told.drive_constants AS c WHERE c.drive_id = d.id)
""")


def choose(session: Session, owners_needed: int) -> tuple[list[uuid.UUID], list[int]]:
    """Choose what is told from now on, as the transaction sees the live map, and let the passes of ``told`` be that.

    The drives of which anything is told or taken back, and the segments at which anything changes. For the rest of the
    transaction tables are those of ``told``.
    """
    for statement in (*_ROOM, *_FORGET_ROADS, _ELIGIBLE, _PAIRS, *_INDEXES[:2]):
        session.execute(text(statement))
    session.execute(text(_ACTIONS), {"owners_needed": owners_needed})
    for statement in (_CHANGES, _INDEXES[2], _TAKE_BACK, _TELL, _DRIVES):
        session.execute(text(statement))
    session.execute(_READ_TOLD)
    return list(session.execute(_AFFECTED).scalars()), list(session.execute(_CHANGED).scalars())


def drives_over(session: Session, segments: Sequence[int]) -> list[uuid.UUID]:
    """The drives of which anything is told over these segments."""
    return list(session.execute(_DRIVES_OVER, {"segments": list(segments)}).scalars())


def told_passes(
    session: Session, drives: Sequence[uuid.UUID], whole: Collection[uuid.UUID], segments: Sequence[int]
) -> list[tuple[Any, ...]]:
    """What is told of these drives, in the order of driving: drive, factor, segment, number.

    All of those that are in ``whole``, of the others what is told over ``segments``.
    """
    values = {"drives": list(drives), "whole": list(whole), "segments": list(segments)}
    return fetch_binary(session, _PASSES, values)


def lengths_m(session: Session, segments: Sequence[int]) -> dict[int, float]:
    """The length of each of these segments."""
    return {row.id: row.length_m for row in session.execute(_LENGTHS, {"segments": list(segments)})}


def forget_sums(session: Session, drives: Sequence[uuid.UUID], segments: Sequence[int]) -> None:
    """Forget what was condensed of these drives' constants and over these segments."""
    session.execute(_FORGET_CONSTANTS, {"drives": list(drives)})
    session.execute(_FORGET_SUMS, {"segments": list(segments)})


def add_constants(session: Session, constants: Mapping[uuid.UUID, tuple[bytes, int]]) -> None:
    """Store what drives say of their constants, and by how many passes."""
    columns = {
        "drives": list(constants),
        "passes": [passes for _, passes in constants.values()],
        "evidence": [evidence for evidence, _ in constants.values()],
    }
    send_binary(session, _ADD_CONSTANTS, columns)


def forget_drives(session: Session) -> None:
    """Of drives of which nothing is told nothing is kept."""
    session.execute(_FORGET_DRIVES)
