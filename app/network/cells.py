"""Cells: tiles of zoom 14, in which the map is solved and by whose versions its tiles are new or unchanged.

A cell is a number, ``x << 14 | y``. A segment is solved with the cell of its middle and shown in all cells that it
meets. Each cell has a version, raised if and only if something that is shown of it changes; a tile is as new as the
cells under it. ``cells`` is written in short transactions, at the end of which everything is consistent.

Each cell also has the state of its roads: a number that grows with every change, so that nobody works on with old
roads. An import changes roads in many short steps (``app.roads.changing``). The number of a step has that of the import
in its upper bits, and each cell holds the step that last changed a road in it. Whoever caches roads (``extracts``), or
computes a drive on them, compares the numbers of the cells that were read.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from datetime import datetime
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds, bigints
from app.network import ZOOM
from fusion.types import Ints

_SIDE = 1 << ZOOM

TILE_MARGIN = 1 / 32
"""Twice what a tile draws beyond its edge, as a share of its side."""

# The cells in which segments (s) are shown. Few segments reach from one cell into another, and only these cost more.
OVER = """
    SELECT DISTINCT id FROM (
        SELECT s.cell AS id FROM segments AS s WHERE {where}
        UNION ALL
        SELECT along FROM segments AS s, versant_cells_along(s.geom_3857) AS along
        WHERE {where}
            AND versant_cell(ST_X(ST_StartPoint(s.geom_3857)), ST_Y(ST_StartPoint(s.geom_3857)))
                <> versant_cell(ST_X(ST_EndPoint(s.geom_3857)), ST_Y(ST_EndPoint(s.geom_3857)))) AS shown
"""
_CELLS_OVER = text(OVER.format(where="s.id = ANY(CAST(:ids AS bigint[]))") + "ORDER BY id")

_MAKE = text("""
    INSERT INTO cells (id) SELECT unnest(CAST(:ids AS integer[])) ORDER BY 1 ON CONFLICT (id) DO NOTHING
""")
_VERSIONS = text("SELECT id, version FROM cells WHERE id = ANY(CAST(:ids AS integer[])) ORDER BY id")
# Nobody waits: a server logs every wait that times out as an error.
_TAKE = text(
    "SELECT id, version FROM cells WHERE id = ANY(CAST(:ids AS integer[])) ORDER BY id FOR UPDATE SKIP LOCKED"
)

_SUM_DRIVEN = text("""
    WITH by_class AS (
        SELECT s.cell, s.highway, count(*) AS n, sum(s.length_m) AS m
        FROM segments AS s JOIN segment_slopes AS a ON a.segment_id = s.id
        WHERE s.cell = ANY(CAST(:ids AS integer[])) AND a.drives > 0 GROUP BY s.cell, s.highway
    ), summed AS (
        SELECT cell, jsonb_object_agg(highway, jsonb_build_array(n, m)) AS driven FROM by_class GROUP BY cell
    )
    UPDATE cells AS c SET driven = coalesce(summed.driven, '{}')
    FROM unnest(CAST(:ids AS integer[])) AS one (id) LEFT JOIN summed ON summed.cell = one.id
    WHERE c.id = one.id AND c.driven <> coalesce(summed.driven, '{}')
""")

# Neighbours are so near that a wide subnetwork over one cell reaches into the other.
_UNSETTLE = text("""
    UPDATE cells SET unsettled_since = clock_timestamp()
    WHERE unsettled_since IS NULL AND id IN (
        SELECT id + (dx << 14) + dy FROM unnest(CAST(:ids AS integer[])) AS near (id),
            generate_series(-1, 1) AS dx, generate_series(-1, 1) AS dy)
""")
_TAKE_UNSETTLED = text("UPDATE cells SET unsettled_since = NULL WHERE id = ANY(CAST(:ids AS integer[]))")
# Of two workers each takes another.
_TAKE_DUE = text("""
    UPDATE cells SET unsettled_since = NULL WHERE id = (
        SELECT id FROM cells WHERE unsettled_since < clock_timestamp() - make_interval(secs => :age_s)
        ORDER BY unsettled_since, id LIMIT 1 FOR UPDATE SKIP LOCKED)
    RETURNING id
""")
# In no order: workers that settle cells side by side are rarely beside each other.
_MAKE_DUE = text("""
    UPDATE cells SET unsettled_since = clock_timestamp() - make_interval(secs => :age_s * (1 + random()))
    WHERE id = ANY(CAST(:ids AS integer[]))
""")

# The sum changes with every cell; the time differs between two databases behind one address.
_TAG = text("""
    SELECT coalesce(sum(version), 0) AS version,
           coalesce(CAST(extract(epoch FROM max(changed_at)) * 1000000 AS bigint), 0) AS changed_us
    FROM cells
    WHERE id BETWEEN (CAST(:x0 AS integer) << 14) AND (CAST(:x1 AS integer) << 14 | 16383)
        AND (id & 16383) BETWEEN :y0 AND :y1
""")

_LAST_CHANGE = text("SELECT max(changed_at) FROM cells WHERE version > 0")


def cells_over(session: Session, segment_ids: Collection[int]) -> list[int]:
    """The cells in which these segments are shown, sorted."""
    return list(session.execute(_CELLS_OVER, {"ids": bigints(segment_ids)}).scalars())


def versions_of(session: Session, cells: Collection[int]) -> dict[int, int]:
    """The versions of cells; 0 of those that have no row yet."""
    versions = {row.id: row.version for row in session.execute(_VERSIONS, {"ids": list(cells)})}
    return {cell: versions.get(cell, 0) for cell in cells}


def lock_cells(session: Session, cells: Collection[int]) -> dict[int, int]:
    """Lock these cells until the transaction ends; the versions of those that nobody else has locked."""
    ids = sorted(cells)
    session.execute(_MAKE, {"ids": ids})
    return {row.id: row.version for row in session.execute(_TAKE, {"ids": ids})}


def raise_versions(session: Session, cells: Collection[int]) -> None:
    """Note that what is shown of these cells has changed, and count again what is driven there."""
    if cells:
        raise_roads(session, 0, shown=cells, met=(), courses=())
        count_driven(session, cells)


def count_driven(session: Session, cells: Collection[int]) -> None:
    """Count again what is driven in these cells."""
    session.execute(_SUM_DRIVEN, {"ids": sorted(cells)})


def unsettle(session: Session, cells: Collection[int]) -> None:
    """Note that these cells and those beside them wait to be settled."""
    if cells:
        session.execute(_UNSETTLE, {"ids": sorted(cells)})


def take_due(session: Session, age_s: float) -> int | None:
    """The cell that has waited longest to be settled, if for ``age_s``: only later changes make it wait again."""
    found: int | None = session.execute(_TAKE_DUE, {"age_s": age_s}).scalar()
    return found


def make_due(session: Session, cells: Collection[int], age_s: float) -> None:
    """Have these cells wait as if they had for ``age_s``."""
    session.execute(_MAKE_DUE, {"ids": sorted(cells), "age_s": age_s})


def take_unsettled(session: Session, cells: Collection[int]) -> None:
    """Note that these cells are being settled: only later changes make them wait again."""
    session.execute(_TAKE_UNSETTLED, {"ids": sorted(cells)})


def tile_tag(session: Session, z: int, x: int, y: int) -> str:
    """A short text that is equal for equal data of a tile, across databases too."""
    x0, x1 = span(z, x)
    y0, y1 = span(z, y)
    row: Any = session.execute(_TAG, {"x0": x0, "x1": x1, "y0": y0, "y1": y1}).one()
    return f"{row.version}.{row.changed_us:x}"


def data_version(session: Session) -> int:
    """How often anything that is shown of any cell has changed."""
    values = {"x0": 0, "x1": _SIDE - 1, "y0": 0, "y1": _SIDE - 1}
    return int(session.execute(_TAG, values).one().version)


def last_change(session: Session) -> datetime | None:
    """When anything that is shown of any cell changed last; None: nothing ever has."""
    moment: datetime | None = session.execute(_LAST_CHANGE).scalar_one()
    return moment


def partitions_around(cells: Ints) -> list[int]:
    """The partitions of the passes in these cells, as ``versant_partition`` numbers them: tiles of zoom 6."""
    return [int(partition) for partition in np.unique(cells >> 22 << 6 | (cells & (_SIDE - 1)) >> 8)]


def beside(cell: int) -> Iterable[int]:
    """The cells around one."""
    x, y = cell >> ZOOM, cell & (_SIDE - 1)
    return ((x + dx) << ZOOM | (y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy)


def cell_name(cell: int) -> str:
    """The cell as z/x/y."""
    return f"{ZOOM}/{cell >> ZOOM}/{cell & (_SIDE - 1)}"


def cell_bounds(cell: int) -> Bounds:
    """West, south, east, north, degrees."""
    x, y = cell >> ZOOM, cell & (_SIDE - 1)
    west, east = (360 * column / _SIDE - 180 for column in (x, x + 1))
    north, south = (math.degrees(math.atan(math.sinh(math.pi * (1 - 2 * row / _SIDE)))) for row in (y, y + 1))
    return west, south, east, north


def span(z: int, column: int) -> tuple[int, int]:
    """The columns, or rows, of cells that a tile draws from, its margin included."""
    scale = 2.0 ** (ZOOM - z)
    low, high = (column - TILE_MARGIN) * scale, (column + 1 + TILE_MARGIN) * scale
    return max(0, int(low // 1)), min(_SIDE - 1, int(high // 1))


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
    values = {"ids": bigints(segment_ids), "wide": _WIDE_CELLS, "all_cells": WIDE}
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
