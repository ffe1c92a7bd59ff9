"""Which part of a network is solved again when passes changed: what a change can reach, and which gaps it bridges.

A gap here is a stretch of undriven segments between driven ones. Only lengths and nodes of roads count: evidence and
slopes are not known here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from fusion.arrays import counted
from fusion.frames import SHORTEST_DEGREE_M
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

PUBLISH_RADIUS_M = 300.0
"""Beyond this distance along driven roads a further drive changes no slope by a tenth of its sigma (at most 0.04 of
it, ``benchmarks/adjustment.py``)."""
SOLVE_RADIUS_M = 500.0
"""So far the network is solved, so that of what lies within ``PUBLISH_RADIUS_M`` 99 % come out within a tenth of their
sigma of the solution of all (0.10 with a hundred drives over Heidelberg, ``benchmarks/adjustment.py``). Those that do
not are gaps and what joins them, whose ends' heights are known over a long way round."""
LONGEST_GAP_M = 200.0
"""Longer ways between driven nodes get no slope."""

_SHORTEST_M = 0.1  # a row without length would join its nodes
_STRIP_M = 200.0
_HIGHEST_DEG = 89.9


@dataclass(frozen=True, eq=False)
class Subnetwork:
    """Masks of shape (n,) over a road table: ``solved`` together, driven ones and gaps; ``published`` of it."""

    solved: Bools
    published: Bools
    """Rows whose slope is replaced; one that is not solved has none any more."""
    outward: Bools
    """Gaps among them that hang on what lies outside: left as they are until all is settled"""
    ring: Bools
    """Driven rows just outside: where their slopes move, the change reaches farther than was thought."""


def subnetwork_around(
    network: RoadTable, driven: Bools, touched: Bools, shown: Bools, scale: float = 1.0
) -> Subnetwork:
    """What to solve when the passes over ``touched`` rows changed.

    ``shown`` rows have a published slope, among them former gaps that must vanish. Gaps count as roads: what
    they join influences each other. ``scale`` multiplies the library's radii.
    """
    open_rows = driven | gap_rows(network, driven)
    reach = open_rows | shown | touched
    solved = neighbourhood(network, reach, touched, scale * SOLVE_RADIUS_M) & open_rows
    published = neighbourhood(network, reach, touched, scale * PUBLISH_RADIUS_M)
    outward = outward_gaps(network, driven, touched, reach, solved, scale * SOLVE_RADIUS_M)
    middle = 0.5 * scale * (PUBLISH_RADIUS_M + SOLVE_RADIUS_M)
    ring = neighbourhood(network, reach, touched, middle) & driven & ~published
    # One that was driven until now is not left as it was.
    return Subnetwork(solved, published, published & outward & ~touched, ring)


def neighbourhood(network: RoadTable, driven: Bools, touched: Bools, radius_m: float) -> Bools:
    """The driven rows that begin within ``radius_m`` of a touched row, along driven rows; masks of shape (n,)."""
    near, start, end = _near_nodes(network, driven, touched, radius_m)
    return np.asarray((driven & (near[start] | near[end])) | touched, np.bool_)


def outward_gaps(
    network: RoadTable, driven: Bools, touched: Bools, reach: Bools, solved: Bools, radius_m: float
) -> Bools:
    """The gaps of a window between roads whose heights only what lies outside can compare; masks of shape (n,).

    Driven rows that hang together in the window know their heights from each other. Where a gap joins two such parts
    that both go on beyond ``radius_m``, its slope is the difference of two heights that the window knows nothing of.
    """
    near, start, end = _near_nodes(network, reach, touched, radius_m)
    along = np.flatnonzero(solved & driven)
    gap = np.flatnonzero(solved & ~driven)
    known = np.zeros(len(near), bool)
    known[start[along]] = known[end[along]] = True
    part = joined_parts(len(near), start[along], end[along])
    open_parts = np.unique(part[known & ~near])
    # Gaps hang together at nodes that nobody drove over: each end of one is such a node, or one of its own.
    row = np.concatenate([gap, gap])
    node = np.concatenate([start[gap], end[gap]])
    own = len(near) + np.tile(np.arange(len(gap)), 2)
    cluster = joined_parts(len(near) + len(gap), own, np.where(known[node], own, node))[own]
    outer = known[node] & np.isin(part[node], open_parts)
    meets = np.unique(np.column_stack([cluster[outer], part[node[outer]]]), axis=0)
    between = np.bincount(meets[:, 0], minlength=len(near) + len(gap)) > 1
    out = np.zeros(len(network), bool)
    out[row[between[cluster]]] = True
    return out


def _near_nodes(network: RoadTable, rows: Bools, touched: Bools, radius_m: float) -> tuple[Bools, Ints, Ints]:
    """Nodes within ``radius_m`` of a touched row, along ``rows`` and touched ones; and each row's end nodes."""
    graph, start, end = _graph(network, rows | touched)
    sources = np.unique(np.concatenate([start[touched], end[touched]]))
    if not len(sources):
        return np.zeros(graph.shape[0], bool), start, end
    distance = dijkstra(graph, directed=False, indices=sources, limit=radius_m, min_only=True)
    return np.asarray(distance <= radius_m, np.bool_), start, end


def joined_parts(size: int, one: Ints, other: Ints) -> Ints:
    """The number of the part that each of ``size`` nodes is in, which these pairs join."""
    joined = sparse.coo_matrix((np.ones(len(one)), (one, other)), shape=(size, size))
    return np.asarray(connected_components(joined, directed=False)[1], np.int64)


def gap_rows(network: RoadTable, driven: Bools, longest_m: float = LONGEST_GAP_M) -> Bools:
    """The undriven rows on a way of at most ``longest_m`` between two different driven nodes; mask of shape (n,)."""
    out = np.zeros(len(network), bool)
    open_rows = np.flatnonzero(~driven)
    graph, start, end = _graph(network, ~driven)
    anchors = np.unique(np.concatenate([start[driven], end[driven]]))
    if not len(anchors) or not len(open_rows):
        return out
    distance, before, anchor = dijkstra(
        graph, directed=False, indices=anchors, limit=longest_m, min_only=True, return_predecessors=True
    )
    length = np.maximum(network.length_m, _SHORTEST_M)
    total_m = distance[start] + length + distance[end]
    # Where two anchors' reaches meet, the way between them goes through; the rest are blind alleys.
    meets = open_rows[(total_m[open_rows] <= longest_m) & (anchor[start] != anchor[end])[open_rows]]
    row_between = _rows_by_ends(start, end, length, open_rows)
    for row in meets.tolist():
        out[row] = True
        for end_node in (int(start[row]), int(end[row])):
            node = end_node
            while before[node] >= 0:
                previous = int(before[node])
                out[row_between[min(node, previous), max(node, previous)]] = True
                node = previous
    return out


def _rows_by_ends(start: Ints, end: Ints, length: Floats, rows: Ints) -> dict[tuple[int, int], int]:
    """The shortest row between two nodes."""
    order = rows[np.argsort(-length[rows], kind="stable")]
    low, high = np.minimum(start[order], end[order]), np.maximum(start[order], end[order])
    return dict(zip(zip(low.tolist(), high.tolist(), strict=True), order.tolist(), strict=True))


def _graph(network: RoadTable, rows: Bools) -> tuple[sparse.csr_matrix, Ints, Ints]:
    """Nodes joined by the given rows (shortest of parallel ones), and each row's end nodes."""
    n = len(network)
    _, node = np.unique(np.concatenate([network.from_node, network.to_node]), return_inverse=True)
    start, end = node[:n], node[n:]
    size = int(node.max(initial=-1)) + 1
    use = np.flatnonzero(rows)
    length = np.maximum(network.length_m[use], _SHORTEST_M)
    low, high = np.minimum(start[use], end[use]), np.maximum(start[use], end[use])
    order = np.lexsort((length, high, low))
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)
    keep = order[first]
    graph = sparse.csr_matrix((length[keep], (low[keep], high[keep])), shape=(size, size))
    return graph, start, end


def boxes_around(lon0: Floats, lat0: Floats, lon1: Floats, lat1: Floats, radius_m: float) -> Floats:
    """Disjoint boxes (m, 4: west, south, east, north) that hold all within ``radius_m`` of the lines given.

    Strips of latitude, each cut into the runs of longitude that are needed: an index finds what lies in them
    once, and a long drive costs its own length, not the area that it spans.
    """
    margin = radius_m / SHORTEST_DEGREE_M
    step = _STRIP_M / SHORTEST_DEGREE_M
    south, north = np.minimum(lat0, lat1) - margin, np.maximum(lat0, lat1) + margin
    widening = margin / np.cos(np.radians(np.minimum(np.maximum(np.abs(south), np.abs(north)), _HIGHEST_DEG)))
    west, east = np.minimum(lon0, lon1) - widening, np.maximum(lon0, lon1) + widening
    first, last = np.floor(south / step).astype(np.int64), np.floor(north / step).astype(np.int64)
    line, strip = counted(last - first + 1)
    return _runs(first[line] + strip, west[line], east[line], step)


def _runs(strip: Ints, west: Floats, east: Floats, step: float) -> Floats:
    """Overlapping intervals of each strip joined into runs, as boxes."""
    order = np.lexsort((west, strip))
    boxes: list[list[float]] = []
    at: int | None = None
    for k in order.tolist():
        if at == strip[k] and west[k] <= boxes[-1][2]:
            boxes[-1][2] = max(boxes[-1][2], float(east[k]))
            continue
        at = int(strip[k])
        boxes.append([float(west[k]), at * step, float(east[k]), (at + 1) * step])
    return np.array(boxes, float).reshape(-1, 4)
