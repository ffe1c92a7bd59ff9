"""Where on which chains each sample may be, and what that costs; compiled.

Knows each sample by itself, nothing of those before and after.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph
from fusion.matching.lattice import Candidates
from fusion.roads.grid import SegmentGrid, clamp_cell
from fusion.types import Floats, Ints


@compiled
def find_candidates(
    graph: ChainGraph,
    grid: SegmentGrid,
    x: Floats,
    y: Floats,
    heading: Floats,
    sigma: Floats,
    radius: Floats,
    weight: float,
    cap: float,
    off_near: float,
    off_far: float,
) -> Candidates:
    """For each kept sample the places, within its radius, at which the distance to a chain has a local minimum.

    A place at the very start of a chain is left out where another chain arrives, since the end of that one is the same
    place. Being off the road costs ``off_near``, or ``off_far`` where no place is likelier than that.
    """
    m = len(x)
    start = np.zeros(m + 1, np.int64)
    size = 16 * m + 64
    edge, at, cost = np.empty(size, np.int64), np.empty(size), np.empty(size)
    off = np.full(m, off_far)
    seen = np.full(len(graph.segment), -1, np.int64)
    count = 0
    shape, items = graph.shape, grid.items
    for k in range(m):
        px, py, reach, square = x[k], y[k], radius[k], radius[k] * radius[k]
        scale = 0.5 / (sigma[k] * sigma[k])
        cosine, sine = np.nan, np.nan
        if not math.isnan(heading[k]):
            cosine, sine = math.cos(heading[k]), math.sin(heading[k])
        low = clamp_cell(px - reach - grid.west, grid.cell_m, grid.columns)
        high = clamp_cell(px + reach - grid.west, grid.cell_m, grid.columns)
        bottom = clamp_cell(py - reach - grid.south, grid.cell_m, grid.rows)
        top = clamp_cell(py + reach - grid.south, grid.cell_m, grid.rows)
        for row in range(bottom, top + 1):
            begin = grid.start[row * grid.columns + low]
            end = grid.start[row * grid.columns + high + 1]
            if count + 2 * (end - begin) > size:
                size = 2 * (count + 2 * (end - begin))
                edge, at, cost = _grown(edge, at, cost, count, size)
            for item in range(begin, end):
                r = items[item]
                dx, dy = px - shape[r, 0], py - shape[r, 1]
                share = (dx * shape[r, 2] + dy * shape[r, 3]) * shape[r, 4]
                t = min(max(share, 0.0), 1.0)
                dx, dy = dx - t * shape[r, 2], dy - t * shape[r, 3]
                d2 = dx * dx + dy * dy
                if d2 > square or seen[r] == k:
                    continue
                seen[r] = k
                if d2 * scale < off_near:
                    off[k] = off_near
                if not _local_minimum(graph, r, share, px, py):
                    continue
                count = _add(graph, r, t, d2 * scale, cosine, sine, weight, cap, edge, at, cost, count)
        start[k + 1] = count
    return Candidates(start, edge[:count], at[:count], cost[:count], off)


@inlined
def _add(
    graph: ChainGraph,
    r: int,
    t: float,
    base: float,
    cosine: float,
    sine: float,
    weight: float,
    cap: float,
    edge: Ints,
    at: Floats,
    cost: Floats,
    count: int,
) -> int:
    """Write the one or two directions of a place on segment r; the new count."""
    c = graph.chain[r]
    length = graph.length_m[c]
    end = graph.cum_m[r + 1] if r + 1 < graph.first[c + 1] else length
    along = end if t >= 1.0 else graph.cum_m[r] + t * (end - graph.cum_m[r])
    with_heading = weight > 0.0 and not math.isnan(cosine)
    for turn in range(2):
        if turn == 1 and not graph.both[c]:
            break
        e = 2 * c + turn
        place = along if turn == 0 else length - along
        if place <= 0.0:
            others = graph.arrivals[graph.tail[e]] - (1 if graph.both[c] else 0)
            if others > 0:
                continue
        edge[count], at[count], cost[count] = e, place, base
        if with_heading:
            sign = 1.0 if turn == 0 else -1.0
            cost[count] += _heading_cost(graph, r, sign * cosine, sign * sine, weight, cap)
        count += 1
    return count


@inlined
def _share(shape: Floats, r: int, x: float, y: float) -> float:
    """Where along segment r the point projects, 0..1 inside."""
    return float(((x - shape[r, 0]) * shape[r, 2] + (y - shape[r, 1]) * shape[r, 3]) * shape[r, 4])


@inlined
def _local_minimum(graph: ChainGraph, r: int, share: float, x: float, y: float) -> bool:
    """Whether the distance to the chain has a minimum on segment r; one at a vertex belongs to its first."""
    if share >= 1.0:
        following = r + 1
        if following < graph.first[graph.chain[r] + 1]:
            return _share(graph.shape, following, x, y) <= 0.0
        return True
    return share > 0.0 or r == graph.first[graph.chain[r]]


@inlined
def _heading_cost(graph: ChainGraph, r: int, cosine: float, sine: float, weight: float, cap: float) -> float:
    """Cost of driving along segment r with a course: bounded, as courses may be wild."""
    along = (graph.shape[r, 2] * cosine + graph.shape[r, 3] * sine) * math.sqrt(graph.shape[r, 4])
    return cap * (1.0 - math.exp(-weight * (1.0 - along) / cap))


@compiled
def _grown(edge: Ints, at: Floats, cost: Floats, count: int, size: int) -> tuple[Ints, Floats, Floats]:
    """The first ``count`` rows in longer arrays."""
    more_edge, more_at, more_cost = np.empty(size, np.int64), np.empty(size), np.empty(size)
    more_edge[:count], more_at[:count], more_cost[:count] = edge[:count], at[:count], cost[:count]
    return more_edge, more_at, more_cost
