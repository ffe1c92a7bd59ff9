"""The state of the roads of each cell: a number that grows with every change, so that nobody works on with old roads.

An import changes roads in many short steps (``app.roads.changing``). The number of a step has that of the import in its
upper bits, and each cell holds the step that last changed a road in it. Whoever caches roads (``cell_roads``), or
computes a drive on them, compares the numbers of the cells that were read.
"""

from __future__ import annotations

from collections.abc import Collection

from sqlalchemy import text
from sqlalchemy.orm import Session

STEP_BITS = 20
LAST_STEP = (1 << STEP_BITS) - 1

WIDE = -1
"""Stands for all cells: a line that is as long as ten of them counts as changed everywhere."""
_WIDE_CELLS = 100

_STATES = text("SELECT id, road_state FROM cells WHERE id = ANY(CAST(:ids AS integer[])) ORDER BY id")

# By boxes, as roads are read, and a little wider: indexes hold boxes in single precision.
_MET = text("""
    WITH corner AS (
        SELECT DISTINCT versant_cell(ST_XMin(geom_3857) - 5, ST_YMax(geom_3857) + 5) AS first,
               versant_cell(ST_XMax(geom_3857) + 5, ST_YMin(geom_3857) - 5) AS last
        FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))
    ), box AS (
        SELECT first >> 14 AS x0, first & 16383 AS y0, last >> 14 AS x1, last & 16383 AS y1 FROM corner
    )
    SELECT DISTINCT (x << 14) | y
    FROM box, generate_series(x0, x1) AS x, generate_series(y0, y1) AS y
    WHERE (x1 - x0 + 1) * (y1 - y0 + 1) <= :wide
    UNION ALL SELECT :all_cells WHERE EXISTS (SELECT FROM box WHERE (x1 - x0 + 1) * (y1 - y0 + 1) > :wide)
""")

# Together with the versions of cells, in one order, so that two writers do not deadlock.
_RAISE = text("""
    INSERT INTO cells AS c (id, version, road_state, course_state)
    SELECT id, CAST(shown AS integer), CASE WHEN met THEN :state ELSE 0 END, CASE WHEN course THEN :state ELSE 0 END
    FROM (SELECT id, bool_or(kind = 0) AS shown, bool_or(kind = 1) AS met, bool_or(kind = 2) AS course
          FROM (SELECT unnest(CAST(:shown AS integer[])) AS id, 0 AS kind
                UNION ALL SELECT unnest(CAST(:met AS integer[])), 1
                UNION ALL SELECT unnest(CAST(:courses AS integer[])), 2) AS change
          GROUP BY id) AS one
    ORDER BY id
    ON CONFLICT (id) DO UPDATE
        SET version = c.version + excluded.version, road_state = greatest(c.road_state, excluded.road_state),
            course_state = greatest(c.course_state, excluded.course_state),
            changed_at = CASE WHEN excluded.version > 0 THEN clock_timestamp() ELSE c.changed_at END
""")


def state_of(version_id: int, step: int) -> int:
    """The number of a step of an import of roads; later steps and imports have higher ones."""
    return version_id << STEP_BITS | min(step, LAST_STEP)


def cells_met(session: Session, segment_ids: Collection[int]) -> set[int]:
    """The cells with which segments are read, perhaps ``WIDE``."""
    values = {"ids": list(segment_ids), "wide": _WIDE_CELLS, "all_cells": WIDE}
    return set(session.execute(_MET, values).scalars())


def raise_roads(
    session: Session, state: int, *, shown: Collection[int], met: Collection[int], courses: Collection[int]
) -> None:
    """Note the cells of which something ``shown`` has changed, those with whose roads it is read (``met``), and those
    in which a drive would notice it (``courses``)."""
    values = {"shown": sorted(shown), "met": sorted(met), "courses": sorted(courses), "state": state}
    session.execute(_RAISE, values)


def road_states(session: Session, cells: Collection[int]) -> dict[int, int]:
    """The state of the roads that meet each of these cells."""
    states = {row.id: row.road_state for row in session.execute(_STATES, {"ids": [WIDE, *cells]})}
    everywhere = states.get(WIDE, 0)
    return {cell: max(states.get(cell, 0), everywhere) for cell in cells}
