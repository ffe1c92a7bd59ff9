"""From drawn streets to what a map holds: ways, node pairs in the order of drawing, grades at their ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.roads.table import RoadTable
from fusion.simulate.scene.heights import node_grades
from fusion.simulate.scene.plan import BRIDGE, TUNNEL, Kind, Plan, Street
from fusion.types import Floats, Ints

FIRST_NODE_ID = 9_100_000_001
"""Beyond 32 bits, as real node ids are."""
FIRST_WAY_ID = 800_000_001
_LONGEST_WAY = 12
"""Segments of a way at most: longer streets are cut."""


@dataclass(frozen=True)
class Way:
    """A way as it is drawn: node indices in order, one kind for all of it."""

    way_id: int
    name: str | None
    kind: Kind
    nodes: tuple[int, ...]
    grades: Floats
    """Grade of the road at each node in the direction of drawing, shape (nodes,)."""


def cut_into_ways(plan: Plan, height_m: Floats) -> list[Way]:
    """Cut streets where their kind changes or they grow long; draw some two-way ways the other way round."""
    ways: list[Way] = []
    for street in plan.streets:
        grades = node_grades(plan, street, height_m)
        for start, stop in _stretches(plan, street):
            nodes, along = street.nodes[start : stop + 1], grades[start : stop + 1]
            kind = street.kinds[start]
            if kind.oneway == 0 and plan.rng.random() < 0.5:
                nodes, along = nodes[::-1], -along[::-1]
            ways.append(Way(FIRST_WAY_ID + 7 * len(ways), street.name, kind, tuple(nodes), along))
    return ways


def _stretches(plan: Plan, street: Street) -> list[tuple[int, int]]:
    """First and last node position of each way of a street."""
    cuts = [0]
    for k in range(1, len(street.kinds)):
        changed = street.kinds[k] != street.kinds[k - 1]
        grown = not street.closed and k - cuts[-1] >= _LONGEST_WAY - int(plan.rng.integers(0, 5))
        if changed or grown:
            cuts.append(k)
    return list(zip(cuts, [*cuts[1:], len(street.kinds)], strict=True))


@dataclass(frozen=True)
class Segments:
    """The node pairs of all ways in the order of ``roads``; ``start`` and ``end`` are node indices."""

    roads: RoadTable
    start: Ints
    end: Ints
    grade_start: Floats
    grade_end: Floats


def node_ids(count: int) -> Ints:
    """OpenStreetMap ids of the first ``count`` nodes, increasing."""
    return FIRST_NODE_ID + 3 * np.arange(count, dtype=np.int64)


def tabulate(ways: list[Way], lon_deg: Floats, lat_deg: Floats) -> Segments:
    """Turn ways into segments; ``lon_deg`` and ``lat_deg`` are those of the nodes."""
    start = np.concatenate([w.nodes[:-1] for w in ways])
    end = np.concatenate([w.nodes[1:] for w in ways])
    way = np.repeat(np.arange(len(ways)), [len(w.nodes) - 1 for w in ways])
    way_id = np.array([w.way_id for w in ways], np.int64)
    order = np.lexsort((end, start, way_id[way]))
    start, end, way = start[order], end[order], way[order]
    kinds = [ways[w].kind for w in way]
    ids = node_ids(len(lon_deg))
    roads = RoadTable.from_columns(
        osm_way_id=way_id[way],
        from_node=ids[start],
        to_node=ids[end],
        lon0_deg=lon_deg[start],
        lat0_deg=lat_deg[start],
        lon1_deg=lon_deg[end],
        lat1_deg=lat_deg[end],
        oneway=[k.oneway for k in kinds],
        bridge=[k.structure == BRIDGE for k in kinds],
        tunnel=[k.structure == TUNNEL for k in kinds],
        layer=[layer_of(k) for k in kinds],
        highway=[k.highway for k in kinds],
        name=[ways[w].name for w in way],
    )
    if len(roads) != len(start):
        raise AssertionError("the plan draws a segment twice")
    grade_start = np.concatenate([w.grades[:-1] for w in ways])[order]
    grade_end = np.concatenate([w.grades[1:] for w in ways])[order]
    return Segments(roads, start.astype(np.int64), end.astype(np.int64), grade_start, grade_end)


def layer_of(kind: Kind) -> int:
    """OpenStreetMap's layer of a kind of road."""
    return {BRIDGE: 1, TUNNEL: -1}.get(kind.structure, 0)
