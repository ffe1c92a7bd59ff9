"""The statements that choose what is told, in one transaction: first of the live tables, then of those of ``told``."""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import TOLD
from app.core.db import fetch_binary
from app.core.tables import IS_SHOWN

# Passes that a solution rejected say nothing, so nobody counts by them; and a segment that an import took away is
# driven by nobody.
_ELIGIBLE = f"""
    CREATE TEMPORARY TABLE eligible ON COMMIT DROP AS
    SELECT p.drive_id, d.owner_id, p.segment_id, p.partition, p.id, md5(p.factor) AS content
    FROM drive_passes AS p
    JOIN drives AS d ON d.id = p.drive_id AND {IS_SHOWN.format("d")} AND d.duplicate_of IS NULL
    JOIN told.examined AS e ON e.drive_id = p.drive_id AND p.sequence <> ALL (e.hidden)
    JOIN segments AS s ON s.id = p.segment_id
    LEFT JOIN rejected_passes AS r ON r.segment_id = p.segment_id AND r.pass_id = p.id
    WHERE r.pass_id IS NULL AND p.condensed_weight IS DISTINCT FROM 0
"""  # noqa: S608 - constants
# A drive over a segment, with what it may tell there now and what is told of it.
_PAIRS = """
    CREATE TEMPORARY TABLE pairs ON COMMIT DROP AS
    SELECT drive_id, segment_id, e.owner_id, e.content AS eligible, t.content AS told
    FROM (SELECT drive_id, segment_id, min(owner_id) AS owner_id, string_agg(content, '' ORDER BY content) AS content
          FROM eligible GROUP BY drive_id, segment_id) AS e
    FULL JOIN (SELECT drive_id, segment_id, string_agg(md5(factor), '' ORDER BY md5(factor)) AS content
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
_CHOSEN = """
    CREATE TEMPORARY TABLE chosen ON COMMIT DROP AS
    SELECT p.drive_id, p.segment_id, p.entered_s, p.factor
    FROM changes AS c
    JOIN eligible AS e ON e.drive_id = c.drive_id AND e.segment_id = c.segment_id
    JOIN drive_passes AS p ON p.id = e.id AND p.partition = e.partition
    WHERE c.is_told
    UNION ALL
    SELECT t.drive_id, t.segment_id, t.entered_s, t.factor
    FROM told.drive_passes AS t
    WHERE t.drive_id IN (SELECT drive_id FROM changes)
        AND NOT EXISTS (SELECT FROM changes AS c WHERE c.drive_id = t.drive_id AND c.segment_id = t.segment_id)
"""
_INDEXES = (
    "CREATE INDEX ON pairs (segment_id)",
    "CREATE INDEX ON eligible (drive_id, segment_id)",
    "CREATE INDEX ON changes (drive_id, segment_id)",
    "CREATE INDEX ON chosen (drive_id)",
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
_CHOSEN_OF = """
    SELECT drive_id, segment_id, factor FROM chosen WHERE drive_id = ANY(%(ids)s)
    ORDER BY drive_id, entered_s, segment_id
"""
# What is left of segments that an import took away: no pass can be subtracted from their sums any more.
_FORGET_ROADS = tuple(
    f"DELETE FROM told.{table} AS t WHERE NOT EXISTS (SELECT FROM segments AS s WHERE s.id = t.segment_id)"  # noqa: S608
    for table in ("condensed_passes", "network_slopes", "segment_slopes")
)
_UNCONDENSE = """
    UPDATE told.drive_passes AS t SET condensed_weight = 0
    WHERE condensed_weight > 0 AND NOT EXISTS (SELECT FROM segments AS s WHERE s.id = t.segment_id)
"""
_FORGET_DRIVES = text("""
    DELETE FROM told.drives AS d WHERE NOT EXISTS (SELECT FROM told.drive_constants AS c WHERE c.drive_id = d.id)
""")


def choose(session: Session, owners_needed: int) -> None:
    """Choose what is told from now on, as the transaction sees the live map; kept until it ends."""
    steps = (*_FORGET_ROADS, _UNCONDENSE, _ELIGIBLE, _PAIRS, *_INDEXES[:2])
    for statement in steps:
        session.execute(text(statement))
    session.execute(text(_ACTIONS), {"owners_needed": owners_needed})
    for statement in (_CHANGES, _INDEXES[2], _CHOSEN, _INDEXES[3], _DRIVES):
        session.execute(text(statement))


def affected_drives(session: Session) -> list[uuid.UUID]:
    """The drives of which anything is told, or taken back."""
    return list(session.execute(_AFFECTED).scalars())


def changed_segments(session: Session) -> list[int]:
    """The segments at which anything changes."""
    return list(session.execute(_CHANGED).scalars())


def read_told(session: Session) -> None:
    """From here to the end of the transaction tables are those of ``told``."""
    session.execute(_READ_TOLD)


def chosen_passes(session: Session, drive_ids: Sequence[uuid.UUID]) -> Iterable[tuple[Any, ...]]:
    """What is told of these drives from now on: drive, segment and factor, in the order of driving."""
    return fetch_binary(session, _CHOSEN_OF, {"ids": list(drive_ids)})


def forget_drives(session: Session) -> None:
    """Of drives of which nothing is told nothing is kept."""
    session.execute(_FORGET_DRIVES)
