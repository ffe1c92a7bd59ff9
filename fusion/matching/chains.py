"""A network as chains: roads between junctions, each a run of segments that can only be driven through.

With shortest paths from a node over the chains, as far as a budget goes. Knows no drive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.roads.grid import SegmentGrid, build_grid
from fusion.roads.network import RoadNetwork
from fusion.types import Bools, Floats, Ints


class ChainGraph(NamedTuple):
    """n segments in C chains between N nodes, as plain arrays for compiled loops.

    Segments are renumbered by *rank*: chain after chain, each in order from its first node to its last.
    Chain c holds the ranks ``first[c]`` to ``first[c + 1]``. Directed chain ``2 c`` runs in that order,
    ``2 c + 1`` against it; a one-way chain has only the former.

    Per rank: ``segment`` in the network, ``flipped`` (drawn against the chain), ``chain``, ``cum_m`` the
    distance along the chain where it begins; ``shape`` (n, 5): x, y, dx, dy of the segment along the chain,
    and 1 / length^2. Per chain: ``length_m``, ``both`` ways. Per directed chain: ``tail`` and ``head`` node.
    ``out_edge[out_start[v]:out_start[v + 1]]`` are the directed chains that leave node v, ``arrivals[v]``
    counts those that reach it.
    """

    segment: Ints
    flipped: Bools
    chain: Ints
    cum_m: Floats
    shape: Floats
    first: Ints
    length_m: Floats
    both: Bools
    tail: Ints
    head: Ints
    out_start: Ints
    out_edge: Ints
    arrivals: Ints


def build_chains(network: RoadNetwork) -> tuple[ChainGraph, SegmentGrid]:
    """Contract a network: nodes where exactly two segments meet that are driven alike vanish inside a chain.

    The second part of the result indexes the segments by rank.
    """
    n = len(network)
    ends, number = np.unique(
        np.concatenate([network.table.from_node, network.table.to_node]), return_inverse=True
    )
    a, b = number[:n].astype(np.int64), number[n:].astype(np.int64)
    nodes = len(ends)
    oneway = network.table.oneway.astype(np.int64)
    incident_start, incident = _group(np.concatenate([a, b]), nodes)
    incident %= max(n, 1)
    segment, flipped, chain = _walk(a, b, oneway, incident_start, incident)
    chains = int(chain[-1]) + 1 if n else 0
    first = np.searchsorted(chain, np.arange(chains + 1)).astype(np.int64)
    length = network.length_m[segment]
    total = np.concatenate([[0.0], np.cumsum(length)])
    x0, y0 = (np.where(flipped, v1[segment], v0[segment]) for v0, v1 in _ends(network))
    x1, y1 = (np.where(flipped, v0[segment], v1[segment]) for v0, v1 in _ends(network))
    square = length**2
    shape = np.column_stack([x0, y0, x1 - x0, y1 - y0, 1.0 / np.where(square > 0, square, np.inf)])
    begin, end = first[:-1], first[1:] - 1
    node_a = np.where(flipped[begin], b[segment[begin]], a[segment[begin]])
    node_b = np.where(flipped[end], a[segment[end]], b[segment[end]])
    both = oneway[segment[begin]] == 0
    tail, head = (np.column_stack(pair).ravel() for pair in ((node_a, node_b), (node_b, node_a)))
    usable = np.column_stack([np.ones(chains, bool), both]).ravel()
    edges = np.flatnonzero(usable)
    out_start, order = _group(tail[edges], nodes)
    grid = build_grid(x0, y0, x1, y1, network.table.oneway[segment])
    graph = ChainGraph(
        segment=segment,
        flipped=flipped,
        chain=chain,
        cum_m=total[:-1] - total[first[chain]],
        shape=np.ascontiguousarray(shape),
        first=first,
        length_m=total[first[1:]] - total[first[:-1]],
        both=both,
        tail=tail,
        head=head,
        out_start=out_start,
        out_edge=edges[order],
        arrivals=np.bincount(head[edges], minlength=nodes).astype(np.int64),
    )
    return graph, grid


@compiled
def position_of(graph: ChainGraph, edge: int, at_m: float) -> tuple[float, float]:
    """Coordinates of the place at a distance from the tail of a directed chain."""
    chain = edge >> 1
    along = at_m if edge % 2 == 0 else graph.length_m[chain] - at_m
    r = rank_at(graph, chain, along)
    share = share_at(graph, r, along)
    return graph.shape[r, 0] + share * graph.shape[r, 2], graph.shape[r, 1] + share * graph.shape[r, 3]


@compiled
def rank_at(graph: ChainGraph, chain: int, at: float) -> int:
    """The last segment of a chain that begins before ``at`` (m from the chain's first node)."""
    low, high = int(graph.first[chain]), int(graph.first[chain + 1])
    while high - low > 1:
        middle = (low + high) >> 1
        if graph.cum_m[middle] <= at:
            low = middle
        else:
            high = middle
    return low


@compiled
def share_at(graph: ChainGraph, r: int, along_m: float) -> float:
    """The share of segment r at a distance from the beginning of its chain, 0..1."""
    span = end_of(graph, r) - graph.cum_m[r]
    return float(min(max((along_m - graph.cum_m[r]) / span, 0.0), 1.0)) if span > 0.0 else 0.0


@compiled
def end_of(graph: ChainGraph, r: int) -> float:
    """Distance along its chain where segment r ends."""
    chain = graph.chain[r]
    return float(graph.cum_m[r + 1] if r + 1 < graph.first[chain + 1] else graph.length_m[chain])


def _ends(network: RoadNetwork) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    return (network.x0, network.x1), (network.y0, network.y1)


def _group(key: Ints, groups: int) -> tuple[Ints, Ints]:
    """Rows by key: ``order[start[g]:start[g + 1]]`` have key g."""
    start = np.zeros(groups + 1, np.int64)
    np.cumsum(np.bincount(key, minlength=groups), out=start[1:])
    return start, np.argsort(key, kind="stable").astype(np.int64)


@compiled
def _through(v: int, a: Ints, oneway: Ints, start: Ints, incident: Ints) -> bool:
    """Whether node v joins exactly two segments that continue each other in the same directions."""
    if start[v + 1] - start[v] != 2:
        return False
    s, t = incident[start[v]], incident[start[v] + 1]
    # +1: driven only towards v; -1: only away from v; 0: both.
    toward_s = oneway[s] if a[s] != v else -oneway[s]
    toward_t = oneway[t] if a[t] != v else -oneway[t]
    return s != t and bool(toward_s == -toward_t)


@compiled
def _next(s: int, v: int, start: Ints, incident: Ints) -> int:
    """The segment that goes on from s at the through node v."""
    t = int(incident[start[v]])
    return int(incident[start[v] + 1]) if t == s else t


@compiled
def _chain_start(s: int, a: Ints, b: Ints, oneway: Ints, start: Ints, incident: Ints) -> tuple[int, int]:
    """First segment and first node of the chain of s, walking back from it; in a ring, s itself."""
    v = b[s] if oneway[s] < 0 else a[s]
    at = s
    while _through(v, a, oneway, start, incident):
        following = _next(at, v, start, incident)
        if following == s:
            break
        at = following
        v = a[at] if b[at] == v else b[at]
    return at, v


@compiled
def _walk(a: Ints, b: Ints, oneway: Ints, start: Ints, incident: Ints) -> tuple[Ints, Bools, Ints]:
    """All segments chain by chain: their number, whether drawn against the chain, the chain's number."""
    n = len(a)
    segment, flipped, chain = np.empty(n, np.int64), np.empty(n, np.bool_), np.empty(n, np.int64)
    done = np.zeros(n, np.bool_)
    rank, count = 0, 0
    for seed in range(n):
        if done[seed]:
            continue
        s, v = _chain_start(seed, a, b, oneway, start, incident)
        while not done[s]:
            done[s] = True
            segment[rank], flipped[rank], chain[rank] = s, a[s] != v, count
            rank += 1
            v = a[s] if a[s] != v else b[s]
            if _through(v, a, oneway, start, incident):
                s = _next(s, v, start, incident)
        count += 1
    return segment, flipped, chain


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
    dist, via, reached, key, node = reach
    search_arrays(
        graph.out_start, graph.out_edge, graph.head, graph.length_m, dist, via, reached, key, node,
        source, budget, stamp,
    )  # fmt: skip


@compiled
def search_arrays(
    out_start: Ints,
    out_edge: Ints,
    head: Ints,
    length_m: Floats,
    dist: Floats,
    via: Ints,
    reached: Ints,
    key: Floats,
    node: Ints,
    source: int,
    budget: float,
    stamp: int,
) -> None:
    """As ``search_from``, for hot loops: the columns of the graph and of ``Reach`` (its ``stamp`` is ``reached``)."""
    dist[source], via[source], reached[source] = 0.0, -1, stamp
    size = _push(key, node, 0, 0.0, source)
    while size > 0:
        d, v = key[0], node[0]
        size = _pop(key, node, size)
        if d > dist[v]:
            continue
        for i in range(out_start[v], out_start[v + 1]):
            e = out_edge[i]
            far = d + length_m[e >> 1]
            u = head[e]
            if far <= budget and (reached[u] != stamp or far < dist[u]):
                dist[u], via[u], reached[u] = far, e, stamp
                size = _push(key, node, size, far, u)


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
