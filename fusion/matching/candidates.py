"""Where on which chains each sample may be, and what that costs; compiled.

Knows each sample by itself, nothing of those before and after.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph
from fusion.matching.lattice import Candidates
from fusion.roads.grid import SegmentGrid, cells_around, items_in
from fusion.types import Bools, Floats, Ints


class Likelihoods(NamedTuple):
    """How likely places are: weight and bound of the course, costs of being off the road; see ``MatchOptions``."""

    heading_weight: float
    heading_cap: float
    off_point: float
    off_far: float


class Seen(NamedTuple):
    """Samples as the search for candidates takes them: shape (m,) each, ``heading`` NaN where it says nothing."""

    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    sigma_m: Floats
    radius_m: Floats


@compiled
def find_candidates(graph: ChainGraph, grid: SegmentGrid, seen: Seen, likely: Likelihoods) -> Candidates:
    """For each kept sample the places, within its radius, at which the distance to a chain has a local minimum.

    A place at the very start of a chain is left out where another chain arrives, since the end of that one is the same
    place. Being off the road costs ``off_point``, or ``off_far`` where no place is likelier than that.
    """
    m = len(seen.x_m)
    size = 8 * m + 256
    found = Candidates(
        np.zeros(m + 1, np.int64),
        np.empty(size, np.int64),
        np.empty(size),
        np.empty(size),
        np.full(m, likely.off_far),
    )
    last_seen = np.full(len(graph.segment), -1, np.int64)
    k, count = 0, 0
    while True:
        k, count = _search(graph, grid, seen, likely, found, last_seen, k, count)
        if k == m:
            break
        found = _larger(found, count)
    return Candidates(found.start, found.edge[:count], found.at_m[:count], found.cost[:count], found.off)


@compiled
def _search(
    graph: ChainGraph,
    grid: SegmentGrid,
    seen: Seen,
    likely: Likelihoods,
    found: Candidates,
    last_seen: Ints,
    k: int,
    count: int,
) -> tuple[int, int]:
    """Go on from sample k as long as there is room: the sample that has none, the new count of candidates.

    ``last_seen`` holds, by segment, the last sample that met it: a segment lies in several cells.
    """
    shape, chain, first, cum_m, length_m = graph.shape, graph.chain, graph.first, graph.cum_m, graph.length_m
    both, tail, arrivals = graph.both, graph.tail, graph.arrivals
    x, y, heading, sigma, radius = seen
    start, edge, at, cost, off = found
    cell, items = grid.start, grid.items
    while k < len(x):
        px, py, square, scale = x[k], y[k], radius[k] * radius[k], 0.5 / (sigma[k] * sigma[k])
        low, high, bottom, top = cells_around(grid, px, py, radius[k])
        most = items_in(cell, grid.columns, low, high, bottom, top)
        if count + 2 * most > len(edge):
            break
        with_heading = likely.heading_weight > 0.0 and not math.isnan(heading[k])
        cosine, sine = math.cos(heading[k]), math.sin(heading[k])
        for row in range(bottom, top + 1):
            for item in range(cell[row * grid.columns + low], cell[row * grid.columns + high + 1]):
                r = items[item]
                if last_seen[r] == k:
                    continue
                last_seen[r] = k
                share = _share(shape, r, px, py)
                t = min(max(share, 0.0), 1.0)
                dx, dy = px - shape[r, 0] - t * shape[r, 2], py - shape[r, 1] - t * shape[r, 3]
                d2 = dx * dx + dy * dy
                if d2 > square:
                    continue
                if d2 * scale < likely.off_point:
                    off[k] = likely.off_point
                c = chain[r]
                if not _local_minimum(shape, first[c], first[c + 1], r, share, px, py):
                    continue
                end = cum_m[r + 1] if r + 1 < first[c + 1] else length_m[c]
                along = end if t >= 1.0 else cum_m[r] + t * (end - cum_m[r])
                before = count
                count = _note(both, arrivals, tail, edge, at, cost, count, c, along, length_m[c], d2 * scale)
                if with_heading:
                    _add_heading(shape, r, cosine, sine, likely, edge, cost, before, count)
        k += 1
        start[k] = count
    return k, count


@inlined
def _share(shape: Floats, r: int, x: float, y: float) -> float:
    """Where along segment r the point projects, 0..1 inside."""
    return float(((x - shape[r, 0]) * shape[r, 2] + (y - shape[r, 1]) * shape[r, 3]) * shape[r, 4])


@inlined
def _local_minimum(shape: Floats, first: int, end: int, r: int, share: float, x: float, y: float) -> bool:
    """Whether the distance to the chain of the segments from ``first`` to ``end`` has a minimum on segment r.

    One at a vertex belongs to its first segment.
    """
    if share >= 1.0:
        return r + 1 == end or _share(shape, r + 1, x, y) <= 0.0
    return share > 0.0 or r == first


@inlined
def _note(
    both: Bools,
    arrivals: Ints,
    tail: Ints,
    edge: Ints,
    at: Floats,
    cost: Floats,
    count: int,
    c: int,
    along: float,
    length: float,
    value: float,
) -> int:
    """Write the one or two directions of a place on chain c; the new count."""
    for turn in range(2 if both[c] else 1):
        e, place = 2 * c + turn, along if turn == 0 else length - along
        if place <= 0.0 and arrivals[tail[e]] > (1 if both[c] else 0):
            continue
        edge[count], at[count], cost[count] = e, place, value
        count += 1
    return count


@inlined
def _add_heading(
    shape: Floats,
    r: int,
    cosine: float,
    sine: float,
    likely: Likelihoods,
    edge: Ints,
    cost: Floats,
    begin: int,
    end: int,
) -> None:
    """Add the cost of driving along segment r with a course: bounded, as courses may be wild."""
    along = (shape[r, 2] * cosine + shape[r, 3] * sine) * math.sqrt(shape[r, 4])
    for b in range(begin, end):
        agree = -along if edge[b] & 1 else along
        cost[b] += likely.heading_cap * (
            1.0 - math.exp(-likely.heading_weight * (1.0 - agree) / likely.heading_cap)
        )


@compiled
def _larger(old: Candidates, count: int) -> Candidates:
    """The first ``count`` candidates with twice as much room."""
    size = 2 * len(old.edge)
    new = Candidates(old.start, np.empty(size, np.int64), np.empty(size), np.empty(size), old.off)
    new.edge[:count], new.at_m[:count], new.cost[:count] = (
        old.edge[:count],
        old.at_m[:count],
        old.cost[:count],
    )
    return new
