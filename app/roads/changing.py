"""The steps of an import that write: each a short transaction of the caller that leaves everything consistent.

In one transaction, a step changes roads, raises the states of their cells (``app.network.cells``), marks what has
to be solved again, and names the drives to be computed again. So an import may be interrupted after any step, and
another continues it. Steps that move evidence own the network; steps that only add or rename roads share it.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.network.cells import WIDE, beside, cells_met, cells_over, count_driven, raise_roads
from app.network.marks import append_marks
from app.network.passes import partitions_of
from app.roads.comparing import AGAIN
from app.roads.retired import DELETE_OF, Return, put_passes, restore, retire
from fusion.network.transfer import Carrying

_GEOMETRY = """
    ST_X(ST_StartPoint({0}.geom)), ST_Y(ST_StartPoint({0}.geom)),
    ST_X(ST_EndPoint({0}.geom)), ST_Y(ST_EndPoint({0}.geom)), {0}.length_m
"""
_TAGS = """
    highway = t.highway, name = t.name, oneway = i.oneway, bridge = i.bridge, tunnel = i.tunnel, layer = i.layer,
    dem_slope_percent = nullif(i.dem_slope_percent, 'NaN'), dem_heights_m = nullif(i.dem_heights_m, '{}'),
    regions = CASE WHEN :region = ANY(s.regions) THEN s.regions ELSE s.regions || CAST(:region AS smallint) END
"""
_MATCHED = """
    FROM unnest(CAST(:ids AS bigint[]), CAST(:n AS integer[])) AS m (id, n)
    JOIN road_import AS i ON i.n = m.n JOIN road_import_tags AS t USING (tag)
    WHERE s.id = m.id
"""
_RENAME = text(f"UPDATE segments AS s SET {_TAGS} {_MATCHED}")  # noqa: S608 - constants
_REPLACE = text(f"""
    UPDATE segments AS s
    SET osm_way_id = i.osm_way_id, from_node = i.from_node, to_node = i.to_node, geom = i.geom,
        geom_3857 = i.geom_3857, length_m = i.length_m, road_version_id = :version, {_TAGS} {_MATCHED}
""")  # noqa: S608 - constants
_ADD = text("""
    INSERT INTO segments (id, osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, name, oneway, bridge,
                          tunnel, layer, dem_slope_percent, dem_heights_m, road_version_id, regions)
    SELECT coalesce(m.id, nextval(pg_get_serial_sequence('segments', 'id'))), i.osm_way_id, i.from_node, i.to_node,
           i.geom, i.geom_3857, i.length_m, t.highway, t.name, i.oneway, i.bridge, i.tunnel, i.layer,
           nullif(i.dem_slope_percent, 'NaN'), nullif(i.dem_heights_m, '{}'), :version, ARRAY[CAST(:region AS smallint)]
    FROM unnest(CAST(:ids AS bigint[]), CAST(:n AS integer[])) AS m (id, n)
    JOIN road_import AS i ON i.n = m.n JOIN road_import_tags AS t USING (tag)
    ORDER BY m.n
    RETURNING id
""")
_RELEASE = text("""
    UPDATE segments SET regions = array_remove(regions, CAST(:region AS smallint))
    WHERE id = ANY(CAST(:ids AS bigint[]))
""")
_DROP = text("DELETE FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))")

_NODES = text("SELECT from_node, to_node FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))")
# Neighbours of roads that are added, moved or deleted: their slopes depend on each other, and gaps open and close.
_NEIGHBOURS = text("""
    SELECT s.id FROM segments AS s JOIN network_slopes AS n ON n.segment_id = s.id
    WHERE s.cell = ANY(CAST(:cells AS integer[]))
        AND (s.from_node = ANY(CAST(:nodes AS bigint[])) OR s.to_node = ANY(CAST(:nodes AS bigint[])))
""")
_SLOPE_ONLY = text(
    "SELECT DISTINCT segment_id FROM drive_segments WHERE segment_id = ANY(CAST(:ids AS bigint[])) AND NOT in_network"
)
_WITH_PASSES = text("""
    SELECT s.id FROM segments AS s WHERE s.id = ANY(CAST(:ids AS bigint[])) AND EXISTS (
        SELECT FROM drive_passes AS p WHERE p.segment_id = s.id AND p.partition = versant_partition(s.cell))
""")
_TOUCH = text(f"""
    INSERT INTO touched_drives (drive_id, road_state) SELECT id, :state FROM ({AGAIN}) AS again ORDER BY id
    ON CONFLICT (drive_id) DO UPDATE SET road_state = excluded.road_state, made_at = clock_timestamp()
""")  # noqa: S608 - constants

_OLD = f"SELECT s.id, {_GEOMETRY.format('s')} FROM segments AS s WHERE s.id = ANY(%(ids)s::bigint[])"  # noqa: S608
_FILE = f"SELECT i.n, {_GEOMETRY.format('i')} FROM road_import AS i WHERE i.n = ANY(%(n)s::integer[])"  # noqa: S608
_TAKE_PASSES = """
    DELETE FROM drive_passes WHERE segment_id = ANY(%(ids)s::bigint[]) AND partition = ANY(%(partitions)s::smallint[])
    RETURNING drive_id, segment_id, sequence, entered_s, factor
"""
# Condensed and rejected passes of a road that moved are derived again from its passes.
_FORGET_DERIVED = [text(DELETE_OF.format(table)) for table in ("condensed_passes", "rejected_passes")]
_TURN_ESTIMATES = text(
    "UPDATE drive_segments SET slope_percent = -slope_percent WHERE segment_id = ANY(CAST(:ids AS bigint[]))"
)
_TURN = tuple(
    text(f"""
        UPDATE {table} AS n
        SET slope_percent = -n.slope_percent, steepest_percent = -n.steepest_percent, height_from_m = n.height_to_m,
            height_to_m = n.height_from_m,
            steepest_from_m = CASE WHEN n.steepest_to_m < s.length_m THEN s.length_m - n.steepest_to_m
                              ELSE 0 * n.steepest_to_m END,
            steepest_to_m = CASE WHEN n.steepest_from_m < s.length_m THEN s.length_m - n.steepest_from_m
                            ELSE 0 * n.steepest_from_m END
        FROM segments AS s WHERE s.id = n.segment_id AND n.segment_id = ANY(CAST(:ids AS bigint[]))
""")  # noqa: S608 - constants
    for table in ("network_slopes", "segment_slopes")
)


@dataclass(frozen=True)
class Step:
    """What every step of one import knows: the import's number, its own (``road_states``), and the region's."""

    version: int
    state: int
    region: int


@dataclass
class _Effects:
    """The cells and nodes that a step changes, to be noted at its end."""

    shown: set[int] = field(default_factory=set)
    met: set[int] = field(default_factory=set)
    nodes: set[int] = field(default_factory=set)

    def add(self, session: Session, ids: Collection[int], *, ends: bool = True) -> None:
        """Add the cells of segments as they are now, and their nodes."""
        self.shown |= set(cells_over(session, ids))
        self.met |= cells_met(session, ids)
        if ends:
            for row in session.execute(_NODES, {"ids": list(ids)}):
                self.nodes |= {row.from_node, row.to_node}

    def note(self, session: Session, step: Step, *, courses: bool, combined: Iterable[int] = ()) -> None:
        """Raise the states of the cells, and mark the segments around the nodes."""
        raise_roads(session, step.state, shown=self.shown, met=self.met, courses=self.met if courses else ())
        count_driven(session, self.shown)
        about = self.met | {near for cell in self.met - {WIDE} for near in beside(cell)} | self.shown
        touched: set[int] = set()
        if self.nodes:
            values = {"cells": sorted(about), "nodes": sorted(self.nodes)}
            touched = set(session.execute(_NEIGHBOURS, values).scalars())
        append_marks(session, touched, set(combined))


def touch(session: Session, state: int, lost: Sequence[int], others: Collection[uuid.UUID]) -> None:
    """Mark the drives that measured on ``lost`` segments, and ``others``, to be computed again."""
    session.execute(_TOUCH, {"lost": list(lost), "others": list(others), "state": state})


def add(session: Session, step: Step, n: Sequence[int], back: Mapping[int, Sequence[Return]]) -> None:
    """Add these rows of the file, and their retired evidence: ``back`` by row; the caller owns the network then."""
    rows = sorted(n)
    number = {one.n: one.segment_id for many in back.values() for one in many if one.segment_id is not None}
    values = {"ids": [number.get(k) for k in rows], "n": rows, **vars(step)}
    ids = list(session.execute(_ADD, values).scalars())
    combined = _restore(session, step, dict(zip(rows, ids, strict=True)), back)
    effects = _Effects()
    effects.add(session, ids)
    effects.note(session, step, courses=True, combined=combined)


def carry(session: Session, step: Step, ids: Sequence[int], n: Sequence[int], back: Sequence[bool]) -> None:
    """Give segments the geometry of rows of the file that are the same road (``back``: drawn the other way round), with
    all evidence on them. The caller owns the network."""
    effects = _Effects()
    effects.add(session, ids)
    partitions = partitions_of(session, ids)
    new = {row[0]: row[1:] for row in fetch_binary(session, _FILE, {"n": list(n)})}
    old = {row[0]: row[1:] for row in fetch_binary(session, _OLD, {"ids": list(ids)})}
    carried = {
        segment: _carrying(old[segment], new[row], back=turned)
        for segment, row, turned in zip(ids, n, back, strict=True)
    }
    moved = [one for one, row in zip(ids, n, strict=True) if carried[one].back or old[one] != new[row]]
    passes = fetch_binary(session, _TAKE_PASSES, {"ids": moved, "partitions": partitions})
    for statement in _FORGET_DERIVED:
        session.execute(statement, {"ids": moved})
    session.execute(_REPLACE, {"ids": list(ids), "n": list(n), **vars(step)})
    put_passes(session, [(*row,) for row in passes], [carried[row[1]] for row in passes])
    turned = [segment for segment, how in carried.items() if how.back]
    for statement in (_TURN_ESTIMATES, *_TURN):
        session.execute(statement, {"ids": turned})
    effects.add(session, ids)
    effects.note(
        session, step, courses=False, combined=session.execute(_SLOPE_ONLY, {"ids": list(ids)}).scalars()
    )


def move_away(
    session: Session, step: Step, ids: Sequence[int], n: Sequence[int], back: Mapping[int, Sequence[Return]]
) -> None:
    """Move segments to where rows of the file are: evidence of where they were is retired, and retired evidence of
    where they are now is restored. The caller owns the network."""
    effects = _Effects()
    effects.add(session, ids)
    touch(session, step.state, ids, ())
    retire(session, ids)
    session.execute(_REPLACE, {"ids": list(ids), "n": list(n), **vars(step)})
    combined = _restore(session, step, dict(zip(n, ids, strict=True)), back)
    effects.add(session, ids)
    effects.note(session, step, courses=True, combined=combined)


def drop(session: Session, step: Step, ids: Sequence[int]) -> None:
    """Delete segments; their evidence is retired. The caller owns the network."""
    effects = _Effects()
    effects.add(session, ids)
    touch(session, step.state, ids, ())
    retire(session, ids)
    session.execute(_DROP, {"ids": list(ids)})
    effects.note(session, step, courses=True)


def release(session: Session, step: Step, ids: Sequence[int]) -> None:
    """Take segments out of the region; other regions have them, so nothing that is shown changes."""
    session.execute(_RELEASE, {"ids": list(ids), "region": step.region})


def rename(session: Session, step: Step, ids: Sequence[int], n: Sequence[int], *, courses: bool) -> None:
    """Give segments that have not moved the tags and the region that the file has."""
    session.execute(_RENAME, {"ids": list(ids), "n": list(n), "region": step.region})
    effects = _Effects()
    effects.add(session, ids, ends=False)
    effects.note(session, step, courses=courses)


def _restore(
    session: Session, step: Step, id_of: Mapping[int, int], back: Mapping[int, Sequence[Return]]
) -> set[int]:
    """Restore the retired evidence of rows that are segments now; those of which only what is published changes."""
    returns = [one for n in id_of for one in back.get(n, ())]
    if not returns:
        return set()
    new = {row[0]: row[1:] for row in fetch_binary(session, _FILE, {"n": [one.n for one in returns]})}
    over = {}
    for one in returns:
        carried = _carrying((*one.ends_deg, one.length_m), new[one.n], back=one.back)
        over[one.retired_id] = (id_of[one.n], carried)
    touch(session, step.state, (), {drive for one in returns for drive in one.void})
    restore(session, returns, over)
    ids = sorted({segment for segment, _ in over.values()})
    append_marks(session, session.execute(_WITH_PASSES, {"ids": ids}).scalars().all())
    return set(session.execute(_SLOPE_ONLY, {"ids": ids}).scalars())


def _carrying(old: Sequence[float], new: Sequence[float], *, back: bool) -> Carrying:
    """From rows of ``_GEOMETRY``."""
    was, now = (old[0], old[1], old[2], old[3]), (new[0], new[1], new[2], new[3])
    return Carrying.between(was, old[4], now, new[4], back=back)
