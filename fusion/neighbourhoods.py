"""Which part of a network a change can reach, and which undriven stretches lie between driven ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

PUBLISH_RADIUS_M = 300.0
"""Beyond this distance along driven roads a further drive changes no slope by as much as 0.005 %."""
WINDOW_RADIUS_M = 800.0
LONGEST_GAP_M = 200.0


def neighbourhood(
    network: RoadTable, driven: NDArray[np.bool_], touched: NDArray[np.bool_], radius_m: float
) -> NDArray[np.bool_]:
    """The driven rows that begin within ``radius_m`` of a touched row, along driven rows; masks of shape (n,)."""
    graph, start, end = _graph(network, driven | touched)
    sources = np.unique(np.concatenate([start[touched], end[touched]]))
    if not len(sources):
        return np.zeros(len(network), bool)
    distance = dijkstra(graph, directed=False, indices=sources, limit=radius_m, min_only=True)
    near = np.minimum(distance[start], distance[end]) <= radius_m
    return np.asarray((driven & near) | touched, np.bool_)


def gap_rows(
    network: RoadTable, driven: NDArray[np.bool_], longest_m: float = LONGEST_GAP_M
) -> NDArray[np.bool_]:
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
    length = np.maximum(network.length_m, 0.1)
    whole = distance[start] + length + distance[end]
    # Where two anchors' reaches meet, the way between them goes through; the rest are blind alleys.
    meets = open_rows[(whole[open_rows] <= longest_m) & (anchor[start] != anchor[end])[open_rows]]
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


def _graph(network: RoadTable, rows: NDArray[np.bool_]) -> tuple[sparse.csr_matrix, Ints, Ints]:
    """Nodes joined by the given rows (shortest of parallel ones), and each row's end nodes."""
    n = len(network)
    _, node = np.unique(np.concatenate([network.from_node, network.to_node]), return_inverse=True)
    start, end = node[:n], node[n:]
    size = int(node.max(initial=-1)) + 1
    use = np.flatnonzero(rows)
    length = np.maximum(network.length_m[use], 0.1)
    low, high = np.minimum(start[use], end[use]), np.maximum(start[use], end[use])
    order = np.lexsort((length, high, low))
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)
    keep = order[first]
    graph = sparse.csr_matrix((length[keep], (low[keep], high[keep])), shape=(size, size))
    return graph, start, end
