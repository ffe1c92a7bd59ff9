"""Turns the best path into stays, first on chains and then on segments; compiled.

A chain is entered by a state or by a route between two states. Once the stays are laid, each sample gets its place on
the path, and these places give the times at which the stays on segments begin and end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph, end_of, rank_at
from fusion.matching.lattice import ROUTE, START, TURN, Candidates, Lattice
from fusion.matching.posterior import Posterior
from fusion.matching.samples import DriveSamples
from fusion.types import Floats, Ints

_NEGLIGIBLE_M = 1e-6  # a stay no longer than that has no length


class ChainStays(NamedTuple):
    """The path as stays on directed chains, p rows: from ``enter_m`` to ``leave_m`` from the chain's tail, on
    connected stretch ``run``, with probability ``confidence``.
    """

    edge: Ints
    enter_m: Floats
    leave_m: Floats
    run: Ints
    confidence: Floats

    def first(self, count: int) -> ChainStays:
        """The first so many rows."""
        return ChainStays._make(column[:count] for column in self)


class Stays(NamedTuple):
    """The path as stays on segments; rows as in ``PathMatch``, ``rank`` instead of the segment's number."""

    rank: Ints
    forward: NDArray[np.bool_]
    enter_m: Floats
    leave_m: Floats
    start_m: Floats
    run: Ints
    confidence: Floats


class KeptSamples(NamedTuple):
    """The m kept samples of a drive on its path: their indices among all samples, their distance along the path (NaN
    off the road), and the connected stretch that each is on (-1).
    """

    sample: Ints
    along_m: Floats
    run: Ints


@compiled
def lay_chain_stays(
    graph: ChainGraph,
    cand: Candidates,
    lattice: Lattice,
    state: Ints,
    joined: Ints,
    route_start: Ints,
    route: Ints,
    chance: Posterior,
) -> tuple[ChainStays, int, Floats, Ints]:
    """The stays on chains (with room for more), how many they are, and ``along_m`` and ``run`` of the kept samples."""
    m = len(state)
    most = 2 * m + len(route)
    on_chains = ChainStays(
        np.empty(most, np.int64), np.empty(most), np.empty(most), np.empty(most, np.int64), np.zeros(most)
    )
    along, runs = np.full(m, np.nan), np.full(m, -1, np.int64)
    last, run, before = -1, -1, 0.0  # ``before``: the length of all stays before the last
    for k in range(m):
        b = state[k]
        if b < 0:
            continue
        e, at = cand.edge[b], cand.at_m[b]
        if joined[k] == START:
            before += on_chains.leave_m[last] - on_chains.enter_m[last] if last >= 0 else 0.0
            run += 1
            last = _open(on_chains, last, e, at, run)
        elif lattice.kind[b] == TURN:
            length = graph.length_m[e >> 1]
            on_chains.leave_m[last] = max(on_chains.leave_m[last], length - at)
            on_chains.confidence[last] = max(on_chains.confidence[last], chance.out[k])
            before += on_chains.leave_m[last] - on_chains.enter_m[last]
            last = _open(on_chains, last, e, length - on_chains.leave_m[last], run)
            on_chains.confidence[last] = chance.into[k]
        elif lattice.kind[b] == ROUTE:
            on_chains.leave_m[last] = graph.length_m[on_chains.edge[last] >> 1]
            on_chains.confidence[last] = max(on_chains.confidence[last], chance.out[k])
            before += on_chains.leave_m[last] - on_chains.enter_m[last]
            for i in range(route_start[k], route_start[k + 1]):
                last = _open(on_chains, last, route[i], 0.0, run)
                on_chains.leave_m[last] = graph.length_m[route[i] >> 1]
                on_chains.confidence[last] = chance.between[k]
                before += on_chains.leave_m[last]
            last = _open(on_chains, last, e, 0.0, run)
            on_chains.confidence[last] = chance.into[k]
        on_chains.leave_m[last] = max(on_chains.leave_m[last], at)
        on_chains.confidence[last] = max(on_chains.confidence[last], chance.at[k])
        along[k], runs[k] = before + on_chains.leave_m[last] - on_chains.enter_m[last], run
    return on_chains, last + 1, along, runs


@compiled
def _open(on_chains: ChainStays, last: int, edge: int, at: float, run: int) -> int:
    """Begin a stay on a chain after row ``last``; its row."""
    row = last + 1
    on_chains.edge[row], on_chains.run[row] = edge, run
    on_chains.enter_m[row] = on_chains.leave_m[row] = at
    return row


@compiled
def lay_stays(graph: ChainGraph, on_chains: ChainStays) -> Stays:
    """Split stays on chains into stays on segments; those without length go, unless a run has no other."""
    count = 0
    for p in range(len(on_chains.edge)):
        first, last = _ranks_of(graph, on_chains, p)
        count += last - first + 1
    stays = Stays(
        np.empty(count, np.int64),
        np.empty(count, np.bool_),
        np.empty(count),
        np.empty(count),
        np.empty(count),
        np.empty(count, np.int64),
        np.empty(count),
    )
    row, travelled = 0, 0.0
    for p in range(len(on_chains.edge)):
        first, last = _ranks_of(graph, on_chains, p)
        forward = (on_chains.edge[p] & 1) == 0
        low, high = _span(graph, on_chains, p)
        for i in range(last - first + 1):
            r = first + i if forward else last - i
            begin, end = max(graph.cum_m[r], low), min(end_of(graph, r), high)
            _write(graph, stays, row, r, forward, begin, max(begin, end), travelled)
            stays.run[row], stays.confidence[row] = on_chains.run[p], on_chains.confidence[p]
            travelled += max(end - begin, 0.0)
            row += 1
    return stays


@compiled
def _span(graph: ChainGraph, on_chains: ChainStays, p: int) -> tuple[float, float]:
    """The part of its chain that stay p covers, from the chain's first node."""
    enter, leave = on_chains.enter_m[p], on_chains.leave_m[p]
    if on_chains.edge[p] & 1:
        length = graph.length_m[on_chains.edge[p] >> 1]
        return length - leave, length - enter
    return enter, leave


@compiled
def _ranks_of(graph: ChainGraph, on_chains: ChainStays, p: int) -> tuple[int, int]:
    """First and last segment of stay p, last < first for none."""
    low, high = _span(graph, on_chains, p)
    if high - low <= _NEGLIGIBLE_M and not _alone(on_chains, p):
        return 0, -1
    first, last = rank_at(graph, on_chains.edge[p] >> 1, low), rank_at(graph, on_chains.edge[p] >> 1, high)
    if first < last and end_of(graph, first) - low <= _NEGLIGIBLE_M:
        first += 1
    if first < last and high - graph.cum_m[last] <= _NEGLIGIBLE_M:
        last -= 1
    return first, last


@compiled
def _alone(on_chains: ChainStays, p: int) -> bool:
    """Whether stay p is the first of a run whose stays all have no length."""
    if p > 0 and on_chains.run[p - 1] == on_chains.run[p]:
        return False
    q = p
    while q < len(on_chains.edge) and on_chains.run[q] == on_chains.run[p]:
        if on_chains.leave_m[q] - on_chains.enter_m[q] > _NEGLIGIBLE_M:
            return False
        q += 1
    return True


@compiled
def _write(
    graph: ChainGraph, stays: Stays, row: int, r: int, forward: bool, low: float, high: float, start: float
) -> None:
    """One stay: from the lower and upper distance along the chain to distances from from_node."""
    flipped = graph.flipped[r]
    begin, end = (low, high) if forward else (high, low)
    length = math.hypot(graph.shape[r, 2], graph.shape[r, 3])
    enter, leave = begin - graph.cum_m[r], end - graph.cum_m[r]
    if flipped:
        enter, leave = length - enter, length - leave
    stays.rank[row], stays.forward[row], stays.start_m[row] = r, forward != flipped, start
    stays.enter_m[row] = min(max(enter, 0.0), length)
    stays.leave_m[row] = min(max(leave, 0.0), length)


@compiled
def place_samples(
    graph: ChainGraph, stays: Stays, drive: DriveSamples, kept: KeptSamples, reach: Floats, slack: float
) -> tuple[Ints, Floats, Floats]:
    """Per sample: stay (-1: none), distance along the path, offset. Each between its neighbouring kept samples.

    ``reach`` is the largest offset accepted, per sample; half of it beyond the end of a run.
    """
    (thinned, along, run), x, y = kept, drive.x_m, drive.y_m
    n, m, rows = len(x), len(thinned), len(stays.rank)
    row, distance, offset = np.full(n, -1, np.int64), np.full(n, np.nan), np.full(n, np.nan)
    line, stay_run, stay_start = _lines(graph, stays), stays.run, stays.start_m
    first = 0  # the first stay that the window of the current kept sample can touch
    for j in range(m):
        if run[j] < 0:
            continue
        ends = j + 1 == m or run[j + 1] != run[j]
        ahead = along[j] if ends else along[j + 1]
        while first + 1 < rows and (
            stay_run[first] < run[j]
            or (stay_run[first + 1] == run[j] and stay_start[first + 1] < along[j] - slack)
        ):
            first += 1
        for i in range(thinned[j], thinned[j + 1] if j + 1 < m else n):
            if not (math.isfinite(x[i]) and math.isfinite(y[i])):
                continue
            high = along[j] if i == thinned[j] else ahead
            best, where, least = _nearest_stay(
                line, stay_run, stay_start, x[i], y[i], first, run[j], along[j] - slack, high + slack
            )
            if best >= 0 and least <= (0.5 * reach[i] if ends and i != thinned[j] else reach[i]):
                row[i], distance[i], offset[i] = best, where, least
    return row, distance, offset


@inlined
def _nearest_stay(
    line: Floats,
    stay_run: Ints,
    start_m: Floats,
    x: float,
    y: float,
    first: int,
    run: int,
    low: float,
    high: float,
) -> tuple[int, float, float]:
    """Stay, distance along the path and offset of the nearest point of the path from ``low`` to ``high``."""
    best, where, least = -1, np.nan, np.inf
    for s in range(first, len(line)):
        start = start_m[s]
        if stay_run[s] != run or start > high:
            break
        dx, dy = x - line[s, 0], y - line[s, 1]
        moved = dx * line[s, 2] + dy * line[s, 3]
        begin = min(max(low - start, 0.0), line[s, 4])
        end = max(min(high - start, line[s, 4]), begin)
        moved = min(max(moved, begin), end)
        dx, dy = dx - moved * line[s, 2], dy - moved * line[s, 3]
        square = dx * dx + dy * dy
        if square < least:
            best, where, least = s, start + moved, square
    return best, where, math.sqrt(least)


@compiled
def _lines(graph: ChainGraph, stays: Stays) -> Floats:
    """Per stay: x and y of its beginning, its direction as a unit vector, its length."""
    line = np.zeros((len(stays.rank), 5))
    for s in range(len(stays.rank)):
        r = stays.rank[s]
        dx, dy = graph.shape[r, 2], graph.shape[r, 3]
        length = math.hypot(dx, dy)
        if length > 0.0:
            dx, dy = dx / length, dy / length
        at = length - stays.enter_m[s] if graph.flipped[r] else stays.enter_m[s]
        line[s, 0], line[s, 1] = graph.shape[r, 0] + at * dx, graph.shape[r, 1] + at * dy
        along = 1.0 if stays.forward[s] != graph.flipped[r] else -1.0
        line[s, 2], line[s, 3] = along * dx, along * dy
        line[s, 4] = abs(stays.leave_m[s] - stays.enter_m[s])
    return line


def stay_times(
    time: Floats, stays: Stays, kept: KeptSamples, row: Ints, distance: Floats
) -> tuple[Floats, Floats]:
    """Times of entry and exit of each stay, by distance along the path between the samples of its run."""
    span = np.abs(stays.leave_m - stays.enter_m)
    enter, leave = np.empty(len(span)), np.empty(len(span))
    known, of = distance.copy(), np.where(row >= 0, stays.run[row] if len(span) else -1, -1)
    on = kept.run >= 0
    known[kept.sample[on]], of[kept.sample[on]] = kept.along_m[on], kept.run[on]
    samples = np.flatnonzero(of >= 0)
    borders = np.searchsorted(of[samples], np.arange(int(stays.run[-1]) + 2 if len(span) else 1))
    rows = np.searchsorted(stays.run, np.arange(len(borders)))
    for r in range(len(borders) - 1):
        mine = samples[borders[r] : borders[r + 1]]
        way = np.maximum.accumulate(known[mine])
        here = slice(rows[r], rows[r + 1])
        ends = np.append(stays.start_m[here], stays.start_m[rows[r + 1] - 1] + span[rows[r + 1] - 1])
        # Where the vehicle stands a distance has many times, and rounding must not turn their order round.
        at = np.maximum.accumulate(np.interp(ends, way, time[mine]))
        enter[here], leave[here] = at[:-1], at[1:]
    return enter, leave
