"""What an import would change: the file's roads, copied beside the stored ones, compared with them. Nothing is written.

A trial run and the import itself take the same ``Plan`` and the same figures of it. Only imports change where roads
lie, and one runs at a time, so a plan holds until it is carried out, however long that takes.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.tables import MIDDLE_CELL
from app.network import ZOOM
from app.network.extracts import ROAD_COLUMNS, ROAD_ORDER, road_table
from app.roads.named_extracts import NO_ROADS
from app.roads.retired import MEASURED, Return, returns_among
from fusion.roads.changes import Change, RoadChanges, compare
from fusion.roads.table import RoadTable
from fusion.types import Ints

NOBODY = 0
"""The number of a region that is not there yet."""

_ON = "i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node"

# What is not as the file has it: the region's own segments, those of ways that it has, and those between two nodes that
# it has. (=) on geometries compares every coordinate bit for bit. Of all segments those are looked at that may be of
# these: two nodes that an edit has moved are a cell away at most.
_OTHER = text(f"""
    WITH near AS MATERIALIZED (
        SELECT id FROM segments WHERE regions @> ARRAY[CAST(:region AS smallint)]
        UNION SELECT s.id FROM (SELECT DISTINCT osm_way_id FROM road_import) AS way, LATERAL (
            SELECT id FROM segments WHERE osm_way_id = way.osm_way_id OFFSET 0) AS s
        UNION SELECT s.id FROM (SELECT DISTINCT {MIDDLE_CELL} AS id FROM road_import) AS own, LATERAL (
            SELECT id FROM segments WHERE cell IN (SELECT own.id + (x << {ZOOM}) + y FROM generate_series(-1, 1) AS x,
                                                   generate_series(-1, 1) AS y) OFFSET 0) AS s
    )
    SELECT {ROAD_COLUMNS}, :region = ANY(s.regions) AS member, s.regions <> ARRAY[CAST(:region AS smallint)] AS others
    FROM near CROSS JOIN LATERAL (SELECT * FROM segments WHERE id = near.id OFFSET 0) AS s
    LEFT JOIN road_import AS i ON {_ON}
    LEFT JOIN (SELECT DISTINCT osm_way_id FROM road_import) AS way ON way.osm_way_id = s.osm_way_id
    LEFT JOIN (SELECT DISTINCT least(from_node, to_node) AS a, greatest(from_node, to_node) AS b FROM road_import)
        AS pair ON pair.a = least(s.from_node, s.to_node) AND pair.b = greatest(s.from_node, s.to_node)
    WHERE i.n IS NULL AND (:region = ANY(s.regions) OR way.osm_way_id IS NOT NULL OR pair.a IS NOT NULL)
        OR NOT s.geom = i.geom
    ORDER BY {ROAD_ORDER}
""")  # noqa: S608 - constants
# New rows cell by cell: rows that are added together are near each other.
_NEW = text(f"""
    SELECT i.n FROM road_import AS i LEFT JOIN segments AS s ON {_ON} WHERE s.id IS NULL
    ORDER BY versant_cell(ST_X(ST_StartPoint(i.geom_3857)), ST_Y(ST_StartPoint(i.geom_3857))), i.n
""")  # noqa: S608 - constants
# Rows that lie where they lay, but are called or signed otherwise, or were not in the region.
_RENAMED = text(f"""
    SELECT s.id, i.n, s.oneway <> i.oneway AS turned
    FROM segments AS s JOIN road_import AS i ON {_ON} JOIN road_import_tags AS t USING (tag)
    WHERE s.geom = i.geom AND (
        (s.highway, s.name, s.oneway, s.bridge, s.tunnel, s.layer, s.dem_slope_percent, s.dem_heights_m)
            IS DISTINCT FROM (t.highway, t.name, i.oneway, i.bridge, i.tunnel, i.layer,
                              nullif(i.dem_slope_percent, 'NaN'), nullif(i.dem_heights_m, '{{}}'))
        OR NOT :region = ANY(s.regions))
    ORDER BY s.cell, s.id
""")  # noqa: S608 - constants

_LOST_BY_REGION = text(f"""
    SELECT r.name, r.id, count(s.id) AS lost,
           array_agg(DISTINCT s.osm_way_id) FILTER (WHERE s.osm_way_id IN (SELECT osm_way_id FROM road_import)) AS ways
    FROM segments AS s LEFT JOIN LATERAL unnest(s.regions) AS one (id) ON true LEFT JOIN regions AS r ON r.id = one.id
    WHERE s.id = ANY(CAST(:ids AS bigint[])) AND {MEASURED} GROUP BY r.name, r.id ORDER BY r.name
""")  # noqa: S608 - constants
_LOST = text(
    f"SELECT count(*) FROM segments AS s WHERE s.id = ANY(CAST(:ids AS bigint[])) AND {MEASURED}"  # noqa: S608
)
_MEASURED_OF = text(
    f"SELECT count(*) FROM segments AS s WHERE s.regions @> ARRAY[CAST(:region AS smallint)] AND {MEASURED}"  # noqa: S608
)

_PASSES_ON = text("""
    SELECT coalesce(p.passes, 0)
    FROM unnest(CAST(:ids AS bigint[])) WITH ORDINALITY AS one (id, place)
    LEFT JOIN LATERAL (
        SELECT count(*) AS passes FROM segments AS s JOIN drive_passes AS p
            ON p.segment_id = s.id AND p.partition = versant_partition(s.cell)
        WHERE s.id = one.id) AS p ON true
    ORDER BY one.place
""")

_FAILED = text("""
    SELECT id, ST_XMin(bounds) AS west, ST_YMin(bounds) AS south, ST_XMax(bounds) AS east, ST_YMax(bounds) AS north
    FROM drives WHERE status = 'failed' AND failure_kind = ANY(CAST(:kinds AS text[]))
        AND (CAST(:since AS timestamptz) IS NULL OR finished_at >= :since)
""")
# Drives that measured on what goes, and others that are named.
AGAIN = """
    SELECT d.id FROM drives AS d WHERE d.status <> 'cancelled' AND d.id IN (
        SELECT drive_id FROM drive_segments WHERE segment_id = ANY(CAST(:lost AS bigint[]))
        UNION SELECT p.drive_id FROM unnest(CAST(:lost AS bigint[])) AS one (id),
            LATERAL (SELECT cell FROM segments WHERE id = one.id OFFSET 0) AS s,
            LATERAL (SELECT drive_id FROM drive_passes
                     WHERE segment_id = one.id AND partition = versant_partition(s.cell) OFFSET 0) AS p
        UNION SELECT unnest(CAST(:others AS uuid[])))
"""
_COUNT_AGAIN = text(f"SELECT count(*) FROM ({AGAIN}) AS again")  # noqa: S608 - constants


@dataclass(frozen=True)
class Loss:
    """How many of the measured segments of a region would lose what was measured."""

    region: str
    lost: int
    measured: int
    ways: Sequence[int] = ()
    """Numbers of ways among what is lost that the file has too, with other nodes or elsewhere."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What an import does: ``ids`` (m,) of stored segments, what becomes of each (``Change``), and the row ``n`` of the
    file that takes its place (-1: none); rows that are ``added`` (k,); stored ones that are only ``renamed`` (j, 3: id,
    n, whether their direction of travel changes); and the retired roads that come back."""

    ids: Ints
    change: Ints
    n: Ints
    added: Ints
    renamed: Ints
    kept: int
    returns: Sequence[Return]

    def of(self, *changes: Change) -> Ints:
        """Positions of what becomes of segments this."""
        return np.flatnonzero(np.isin(self.change, changes))

    def count(self, change: Change) -> int:
        """Of how many segments it becomes this."""
        return int(np.count_nonzero(self.change == change))

    @property
    def lost(self) -> Ints:
        """The ids of segments that lose what was measured."""
        return self.ids[self.of(Change.FAR, Change.SPLIT, Change.MERGED, Change.DROPPED)]


def plan_import(session: Session, table: RoadTable, region_id: int, tolerance_m: float) -> Plan:
    """Compare what was copied (``app.roads.copy``) with what is stored; ``region_id`` is ``NOBODY`` of a new region."""
    rows = list(session.execute(_OTHER, {"region": region_id}))
    stored, ids = road_table(rows)
    new = np.array(session.execute(_NEW).scalars().all(), np.int64)
    changes, near = _changes(rows, stored, table, new, tolerance_m)
    real = np.flatnonzero(changes.stored < len(stored))
    at, change, row = changes.stored[real], changes.change[real], changes.row[real]
    n = np.append(near, -1)[row]
    added = new[~np.isin(new, n)]
    elsewhere = np.count_nonzero(np.isin(change, (Change.MOVED, Change.FAR)))
    targets = np.concatenate([added, n[change == Change.FAR]])
    renamed = [tuple(one) for one in session.execute(_RENAMED, {"region": region_id})]
    return Plan(
        ids=ids[at],
        change=change,
        n=n,
        added=added,
        renamed=np.array(renamed, np.int64).reshape(-1, 3),
        kept=len(table) - len(new) - int(elsewhere),
        returns=returns_among(session, table, targets, tolerance_m),
    )


def _changes(
    rows: Sequence[Row[Any]], stored: RoadTable, table: RoadTable, new: Ints, tolerance_m: float
) -> tuple[RoadChanges, Ints]:
    """Compare where anything differs, and with it what the file has of the same ways and nodes; those rows of it."""
    nodes = np.concatenate([stored.from_node, stored.to_node])
    near = np.flatnonzero(
        np.isin(table.osm_way_id, stored.osm_way_id)
        | np.isin(table.from_node, nodes)
        | np.isin(table.to_node, nodes)
    )
    # What is as it was stands for itself: it is not among the stored rows that were read.
    known = {(row.osm_way_id, row.from_node, row.to_node) for row in rows}
    columns = (table.osm_way_id[near], table.from_node[near], table.to_node[near])
    there = ~np.isin(near, new)
    other = np.array([key in known for key in zip(*(c.tolist() for c in columns), strict=True)], bool)
    same = table.subset(near[there & ~other])
    both: dict[str, Any] = {
        name: np.concatenate([getattr(stored, name), getattr(same, name)]) for name in RoadTable.columns()
    }
    extra = np.zeros(len(same), bool)
    member = np.concatenate([np.array([row.member for row in rows], bool), extra])
    others = np.concatenate([np.array([row.others for row in rows], bool), extra])
    return compare(RoadTable(**both), member, others, table.subset(near), tolerance_m), near


def losses(session: Session, plan: Plan) -> list[Loss]:
    """How many measured segments each region would lose, and of how many; regions that lose none are left out."""
    rows = session.execute(_LOST_BY_REGION, {"ids": plan.lost.tolist()}).all()
    return [
        Loss(
            row.name,
            row.lost,
            int(session.execute(_MEASURED_OF, {"region": row.id}).scalar_one()),
            row.ways or (),
        )
        for row in rows
        if row.name is not None
    ]


def count_lost(session: Session, plan: Plan) -> int:
    """How many measured segments lose what was measured."""
    return int(session.execute(_LOST, {"ids": plan.lost.tolist()}).scalar_one())


def waiting_for(
    session: Session, plan: Plan, table: RoadTable, since: datetime | None = None
) -> set[uuid.UUID]:
    """Drives to be computed again that need have nothing on what goes: those that lost what they said before and whose
    roads come back, and those that failed (since a moment) for want of roads where there are new ones."""
    drives = {drive for one in plan.returns for drive in one.void}
    if not len(plan.added):
        return drives
    came = table.subset(np.sort(plan.added))
    for row in session.execute(_FAILED, {"kinds": list(NO_ROADS), "since": since}):
        box = (row.west, row.south, row.east, row.north)
        if row.west is None or came.meets(np.array([box], float)).any():
            drives.add(row.id)
    return drives


def count_again(session: Session, plan: Plan, others: Collection[uuid.UUID]) -> int:
    """How many drives are to be computed again, these among them."""
    values = {"lost": plan.lost.tolist(), "others": list(others)}
    return int(session.execute(_COUNT_AGAIN, values).scalar_one())


def passes_on(session: Session, plan: Plan) -> Ints:
    """How many passes there are over each segment of the plan, shape (m,)."""
    counts = session.execute(_PASSES_ON, {"ids": plan.ids.tolist()}).scalars().all()
    return np.array(counts, np.int64)
