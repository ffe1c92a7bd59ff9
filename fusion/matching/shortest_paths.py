"""Shortest paths from a node over the chains of a network, as far as a budget goes; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph
from fusion.types import Floats, Ints


class Reach(NamedTuple):
    """What a search reached, per node of a graph: the distance, the directed chain by which, and the search's stamp.

    One memory serves all searches, each with a stamp of its own: nothing has to be cleared. ``key`` and ``node`` are
    the heap.
    """

    dist: Floats
    via: Ints
    stamp: Ints
    key: Floats
    node: Ints

    @classmethod
    def of(cls, graph: ChainGraph) -> Reach:
        """Memory for searches in a graph, without any yet."""
        nodes, most = len(graph.arrivals), len(graph.out_edge) + 2
        return cls(
            np.empty(nodes),
            np.empty(nodes, np.int64),
            np.full(nodes, -1),
            np.empty(most),
            np.empty(most, np.int64),
        )


@compiled
def search_from(graph: ChainGraph, reach: Reach, source: int, budget: float, stamp: int) -> None:
    """Dijkstra from a node to all within ``budget`` metres; what was reached bears the stamp."""
    reach.dist[source], reach.via[source], reach.stamp[source] = 0.0, -1, stamp
    size = _push(reach.key, reach.node, 0, 0.0, source)
    while size > 0:
        d, v = reach.key[0], reach.node[0]
        size = _pop(reach.key, reach.node, size)
        if d > reach.dist[v]:
            continue
        for i in range(graph.out_start[v], graph.out_start[v + 1]):
            e = graph.out_edge[i]
            far = d + graph.length_m[e >> 1]
            u = graph.head[e]
            if far <= budget and (reach.stamp[u] != stamp or far < reach.dist[u]):
                reach.dist[u], reach.via[u], reach.stamp[u] = far, e, stamp
                size = _push(reach.key, reach.node, size, far, u)


@inlined
def _push(key: Floats, node: Ints, size: int, d: float, v: int) -> int:
    i = size
    while i > 0:
        up = (i - 1) >> 1
        if key[up] <= d:
            break
        key[i], node[i] = key[up], node[up]
        i = up
    key[i], node[i] = d, v
    return size + 1


@inlined
def _pop(key: Floats, node: Ints, size: int) -> int:
    """Take the first off the heap; the caller has read it."""
    size -= 1
    d, v = key[size], node[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        if child + 1 < size and key[child + 1] < key[child]:
            child += 1
        if key[child] >= d:
            break
        key[i], node[i] = key[child], node[child]
        i = child
    key[i], node[i] = d, v
    return size
