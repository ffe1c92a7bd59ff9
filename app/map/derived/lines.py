"""Roads put together across ways: where two of a kind meet and no third, they go on as one line.

Any stretches with two ends will do: segments, or pieces of a finer level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fusion.types import Bools, Floats, Ints


class Course(NamedTuple):
    """Stretches one after the other, and which of them are gone through against their direction."""

    rows: list[int]
    turned: list[bool]


def courses(ids: Ints, start: Ints, end: Ints, kind: Ints, one_way: Bools) -> list[Course]:
    """The longest lines of n stretches between places; shapes (n,).

    Two go on as one where they meet, and nothing else does, if they are of one kind; such as are one-way only in their
    direction. In each line the stretch of the lowest id keeps its direction, in a ring it is the first; the result
    depends on the ids and not on the order of the rows. Sorted by lowest id.
    """
    onward = _partners(start, end, kind, one_way)
    lines, done = [], [False] * len(ids)
    order = np.argsort(ids).tolist()
    rank = np.argsort(order).tolist()
    for row in order:
        if done[row]:
            continue
        # Ends are numbers, 2 row and 2 row + 1. Back to where the line begins, or once around.
        at = 2 * row
        while (before := onward[at]) >= 0:
            at = before ^ 1
            if at == 2 * row:
                break
        line = Course([], [])
        while at >= 0 and not done[at >> 1]:
            done[at >> 1] = True
            line.rows.append(at >> 1)
            line.turned.append(bool(at & 1))
            at = onward[at ^ 1]
        lines.append(_directed(line, rank))
    return lines


def _partners(start: Ints, end: Ints, kind: Ints, one_way: Bools) -> list[int]:
    """By end of a stretch, the end of the other that it goes on with; -1 without one."""
    n = len(start)
    place = np.empty(2 * n, np.int64)
    place[0::2], place[1::2] = start, end
    order = np.argsort(place, kind="stable")
    new = np.flatnonzero(np.diff(place[order], prepend=-1) != 0)
    two = new[np.diff(np.append(new, 2 * n)) == 2]
    a, b = order[two], order[two + 1]
    left, right = a >> 1, b >> 1
    same = (left != right) & (kind[left] == kind[right]) & (one_way[left] == one_way[right])
    same &= ~one_way[left] | ((a ^ b) & 1).astype(bool)
    partner = np.full(2 * n, -1, np.int64)
    partner[a[same]], partner[b[same]] = b[same], a[same]
    return partner.tolist()


def _directed(line: Course, rank: Sequence[int]) -> Course:
    lowest = min(range(len(line.rows)), key=lambda k: rank[line.rows[k]])
    if not line.turned[lowest]:
        return line
    return Course(line.rows[::-1], [not turned for turned in line.turned[::-1]])


def together_m(start: Ints, end: Ints, length_m: Floats) -> Floats:
    """For each stretch how long all are together that it hangs together with, (n,)."""
    n = len(start)
    if not n:
        return np.empty(0)
    places = int(max(start.max(), end.max())) + 1
    graph = coo_array((np.ones(n), (start, end)), shape=(places, places))
    component = connected_components(graph, directed=False)[1][start]
    return np.asarray(np.bincount(component, length_m)[component], float)
