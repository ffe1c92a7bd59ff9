"""Every sample's place on the path, and by these the times at which the stays on segments begin and end."""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph
from fusion.matching.stays import Stays
from fusion.types import Floats, Ints


@compiled
def place_samples(
    graph: ChainGraph,
    stays: Stays,
    x: Floats,
    y: Floats,
    thinned: Ints,
    along: Floats,
    run: Ints,
    reach: Floats,
    slack: float,
) -> tuple[Ints, Floats, Floats]:
    """Per sample: stay (-1: none), distance along the path, offset. Each between its neighbouring kept samples.

    ``reach`` is the largest offset accepted, per sample; half of it beyond the end of a run.
    """
    n, m, rows = len(x), len(thinned), len(stays.rank)
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
        for i in range(thinned[j], thinned[j + 1] if j + 1 < m else n):
            if not (math.isfinite(x[i]) and math.isfinite(y[i])):
                continue
            high = along[j] if i == thinned[j] else ahead
            best, where, least = _nearest_stay(
                line, stays, x[i], y[i], first, run[j], along[j] - slack, high + slack
            )
            if best >= 0 and least <= (0.5 * reach[i] if ends and i != thinned[j] else reach[i]):
                row[i], distance[i], offset[i] = best, where, least
    return row, distance, offset


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


def stay_times(
    time: Floats, stays: Stays, thinned: Ints, along: Floats, run: Ints, row: Ints, distance: Floats
) -> tuple[Floats, Floats]:
    """Times of entry and exit of each stay, by distance along the path between the samples of its run."""
    span = np.abs(stays.leave_m - stays.enter_m)
    enter, leave = np.empty(len(span)), np.empty(len(span))
    known, of = distance.copy(), np.where(row >= 0, stays.run[row] if len(span) else -1, -1)
    on = run >= 0
    known[thinned[on]], of[thinned[on]] = along[on], run[on]
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
