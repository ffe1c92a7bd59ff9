"""From the states of the kept samples to the path, its traversals, and every sample's place on it; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.matching.chains import ChainGraph
from fusion.matching.lattice import OFF, ROUTE, START, TURN, Candidates, Lattice, Pieces, Posterior, inlined
from fusion.types import Floats, Ints

_NEGLIGIBLE_M = 1e-6


class Stays(NamedTuple):
    """The path as stays on segments; rows as in ``PathMatch``, ``rank`` instead of the segment's number."""

    rank: Ints
    forward: NDArray[np.bool_]
    enter_m: Floats
    leave_m: Floats
    start_m: Floats
    run: Ints
    confidence: Floats


@compiled
def trace(lattice: Lattice, final: int) -> Ints:
    """The best state of every sample, from the last one's back to the first."""
    state = np.full(len(lattice.off_cost), final)
    for k in range(len(state) - 1, 0, -1):
        back = lattice.off_back[k] if state[k] == OFF else lattice.back[state[k]]
        # Over a gap the predecessor is written as -3 - state.
        state[k - 1] = back if back >= 0 or back == OFF else -3 - back
    return state


@compiled
def lay_pieces(
    graph: ChainGraph,
    cand: Candidates,
    lattice: Lattice,
    state: Ints,
    joined: Ints,
    route_start: Ints,
    route: Ints,
    chance: Posterior,
) -> tuple[Pieces, Floats, Ints]:
    """The stays on chains, and per kept sample its distance along the path (NaN off the road) and run (-1)."""
    m = len(state)
    most = 2 * m + len(route)
    pieces = Pieces(
        np.empty(most, np.int64), np.empty(most), np.empty(most), np.empty(most, np.int64), np.zeros(most)
    )
    along, runs = np.full(m, np.nan), np.full(m, -1, np.int64)
    last, run, before = -1, -1, 0.0  # ``before``: the length of all pieces before the last
    for k in range(m):
        b = state[k]
        if b < 0:
            continue
        e, at = cand.edge[b], cand.at_m[b]
        if joined[k] == START:
            before += pieces.leave_m[last] - pieces.enter_m[last] if last >= 0 else 0.0
            run += 1
            last = _open(pieces, last, e, at, run)
        elif lattice.kind[b] == TURN:
            length = graph.length_m[e >> 1]
            pieces.leave_m[last] = max(pieces.leave_m[last], length - at)
            pieces.confidence[last] = max(pieces.confidence[last], chance.out[k])
            before += pieces.leave_m[last] - pieces.enter_m[last]
            last = _open(pieces, last, e, length - pieces.leave_m[last], run)
            pieces.confidence[last] = chance.into[k]
        elif lattice.kind[b] == ROUTE:
            pieces.leave_m[last] = graph.length_m[pieces.edge[last] >> 1]
            pieces.confidence[last] = max(pieces.confidence[last], chance.out[k])
            before += pieces.leave_m[last] - pieces.enter_m[last]
            for i in range(route_start[k], route_start[k + 1]):
                last = _open(pieces, last, route[i], 0.0, run)
                pieces.leave_m[last] = graph.length_m[route[i] >> 1]
                pieces.confidence[last] = chance.between[k]
                before += pieces.leave_m[last]
            last = _open(pieces, last, e, 0.0, run)
            pieces.confidence[last] = chance.into[k]
        pieces.leave_m[last] = max(pieces.leave_m[last], at)
        pieces.confidence[last] = max(pieces.confidence[last], chance.at[k])
        along[k], runs[k] = before + pieces.leave_m[last] - pieces.enter_m[last], run
    count = last + 1
    return (
        Pieces(
            pieces.edge[:count],
            pieces.enter_m[:count],
            pieces.leave_m[:count],
            pieces.run[:count],
            pieces.confidence[:count],
        ),
        along,
        runs,
    )


@compiled
def _open(pieces: Pieces, last: int, edge: int, at: float, run: int) -> int:
    """Begin a stay on a chain after row ``last``; its row."""
    row = last + 1
    pieces.edge[row], pieces.enter_m[row], pieces.leave_m[row], pieces.run[row] = edge, at, at, run
    return row


@compiled
def _rank_at(graph: ChainGraph, chain: int, at: float) -> int:
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
def _end_of(graph: ChainGraph, r: int) -> float:
    """Distance along its chain where segment r ends."""
    chain = graph.chain[r]
    return float(graph.cum_m[r + 1] if r + 1 < graph.first[chain + 1] else graph.length_m[chain])


@compiled
def lay_stays(graph: ChainGraph, pieces: Pieces) -> Stays:
    """Split stays on chains into stays on segments; those without length go, unless a run has no other."""
    count = 0
    for p in range(len(pieces.edge)):
        first, last = _ranks_of(graph, pieces, p)
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
    for p in range(len(pieces.edge)):
        first, last = _ranks_of(graph, pieces, p)
        forward = (pieces.edge[p] & 1) == 0
        low, high = _span(graph, pieces, p)
        for i in range(last - first + 1):
            r = first + i if forward else last - i
            begin, end = max(graph.cum_m[r], low), min(_end_of(graph, r), high)
            _write(graph, stays, row, r, forward, begin, max(begin, end), travelled)
            stays.run[row], stays.confidence[row] = pieces.run[p], pieces.confidence[p]
            travelled += max(end - begin, 0.0)
            row += 1
    return stays


@compiled
def _span(graph: ChainGraph, pieces: Pieces, p: int) -> tuple[float, float]:
    """The part of its chain that piece p covers, from the chain's first node."""
    enter, leave = pieces.enter_m[p], pieces.leave_m[p]
    if pieces.edge[p] & 1:
        length = graph.length_m[pieces.edge[p] >> 1]
        return length - leave, length - enter
    return enter, leave


@compiled
def _ranks_of(graph: ChainGraph, pieces: Pieces, p: int) -> tuple[int, int]:
    """First and last segment of piece p, last < first for none."""
    low, high = _span(graph, pieces, p)
    if high - low <= _NEGLIGIBLE_M and not _alone(pieces, p):
        return 0, -1
    first, last = _rank_at(graph, pieces.edge[p] >> 1, low), _rank_at(graph, pieces.edge[p] >> 1, high)
    if first < last and _end_of(graph, first) - low <= _NEGLIGIBLE_M:
        first += 1
    if first < last and high - graph.cum_m[last] <= _NEGLIGIBLE_M:
        last -= 1
    return first, last


@compiled
def _alone(pieces: Pieces, p: int) -> bool:
    """Whether piece p is the first of a run whose pieces all have no length."""
    if p > 0 and pieces.run[p - 1] == pieces.run[p]:
        return False
    q = p
    while q < len(pieces.edge) and pieces.run[q] == pieces.run[p]:
        if pieces.leave_m[q] - pieces.enter_m[q] > _NEGLIGIBLE_M:
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


@inlined
def _nearest_stay(
    line: Floats, stays: Stays, x: float, y: float, first: int, run: int, low: float, high: float
) -> tuple[int, float, float]:
    """Stay, distance along the path and offset of the nearest point of the path from ``low`` to ``high``."""
    best, where, least = -1, np.nan, np.inf
    for s in range(first, len(line)):
        start = stays.start_m[s]
        if stays.run[s] != run or start > high:
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


@compiled
def place_samples(
    graph: ChainGraph,
    stays: Stays,
    x: Floats,
    y: Floats,
    kept: Ints,
    along: Floats,
    run: Ints,
    reach: Floats,
    slack: float,
) -> tuple[Ints, Floats, Floats]:
    """Per sample: stay (-1: none), distance along the path, offset. Each between its neighbouring kept samples.

    ``reach`` is the largest offset accepted, per sample; half of it beyond the end of a run.
    """
    n, m, rows = len(x), len(kept), len(stays.rank)
    row, distance, offset = np.full(n, -1, np.int64), np.full(n, np.nan), np.full(n, np.nan)
    line = _lines(graph, stays)
    first = 0  # the first stay that the window of the current kept sample can touch
    for j in range(m):
        if run[j] < 0:
            continue
        ends = j + 1 == m or run[j + 1] != run[j]
        ahead = along[j] if ends else along[j + 1]
        while first + 1 < rows and (
            stays.run[first] < run[j]
            or (stays.run[first + 1] == run[j] and stays.start_m[first + 1] < along[j] - slack)
        ):
            first += 1
        for i in range(kept[j], kept[j + 1] if j + 1 < m else n):
            if not (math.isfinite(x[i]) and math.isfinite(y[i])):
                continue
            high = along[j] if i == kept[j] else ahead
            best, where, least = _nearest_stay(
                line, stays, x[i], y[i], first, run[j], along[j] - slack, high + slack
            )
            if best >= 0 and least <= (0.5 * reach[i] if ends and i != kept[j] else reach[i]):
                row[i], distance[i], offset[i] = best, where, least
    return row, distance, offset
