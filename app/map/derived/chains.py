"""Which stretches of road follow each other, and in which order. What was measured of them is not known here.

Segments of one way make chains. A segment knows its two nodes and not its place in the way, so that is found out: a way
that an extract cuts is several chains, one that comes back to where it was is still one, and where two of its nodes lie
in one place (pairs without length are no segments) it goes on. Across ways, where two of a kind meet and no third, they
go on as one line; there any stretches with two ends will do: segments, or pieces of a finer level.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fusion.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Chains:
    """Rows of segments chain after chain, each in its order: chain k has ``rows[first[k]:first[k + 1]]``."""

    rows: Ints
    first: Ints
    """One more than there are chains."""

    def __len__(self) -> int:
        return len(self.first) - 1

    def number(self) -> Ints:
        """For each of ``rows`` the chain that it is in."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))


def chains_of(key: Ints, ids: Ints, start: Ints, end: Ints) -> Chains:
    """Chains of n segments from place ``start`` to place ``end`` (``places``), within each key; shapes (n,).

    A chain is as long as it can be. A closed one begins with its segment of the lowest id; where a way meets itself,
    it goes through each of its segments once, if there is such a course, and turns to the lowest id first. The result
    depends on the ids and not on the order of the rows; chains are sorted by key, then by the id they begin with.
    """
    n = len(ids)
    if not n:
        return Chains(np.empty(0, np.int64), np.zeros(1, np.int64))
    order = np.lexsort((ids, key))
    rows, begins, ends = order.tolist(), start.tolist(), end.tolist()
    borders = [0, *(np.flatnonzero(np.diff(key[order])) + 1).tolist(), n]
    chains = [trail for a, b in pairwise(borders) for trail in _trails(rows[a:b], begins, ends)]
    head = np.array([rows[0] for rows in chains])
    chains = [chains[k] for k in np.lexsort((ids[head], key[head])).tolist()]
    first = np.cumsum([0, *(len(rows) for rows in chains)])
    return Chains(np.array([row for rows in chains for row in rows], np.int64), first)


def places(key: Ints, node: Ints, xy: Floats) -> Ints:
    """Numbers of the places that nodes (n,) of ways ``key`` lie in: one for each node of a way, and one for all nodes
    of it with the same coordinates (n, 2), which for a node are those of its first row.
    """
    order = np.lexsort((node, key))
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(key[order]) != 0) | (np.diff(node[order]) != 0)
    group = np.empty(len(order), np.int64)
    group[order] = np.cumsum(new) - 1
    one = order[new]  # stable: the first row of each node
    where = np.lexsort((xy[one, 1], xy[one, 0], key[one]))
    other = np.ones(len(where), bool)
    at = one[where]
    other[1:] = (np.diff(key[at]) != 0) | np.any(np.diff(xy[at], axis=0) != 0, axis=1)
    place = np.empty(len(where), np.int64)
    place[where] = np.cumsum(other) - 1
    return np.asarray(place[group], np.int64)


def _trails(rows: list[int], start: list[int], end: list[int]) -> list[list[int]]:
    """As few trails as there can be through each of these segments, sorted by id, once (Hierholzer's way)."""
    leaving: dict[int, list[int]] = defaultdict(list)
    for row in reversed(rows):
        leaving[start[row]].append(row)
    surplus = Counter(start[row] for row in rows)
    surplus.subtract(end[row] for row in rows)

    def walk(place: int) -> list[int]:
        trail = []
        while leaving[place]:
            trail.append(leaving[place].pop())
            place = end[trail[-1]]
        return trail

    def with_detours(trail: list[int]) -> list[int]:
        """What is left leads back to where it leaves from."""
        k = 0
        while k <= len(trail):
            detour = walk(start[trail[k]] if k < len(trail) else end[trail[-1]])
            trail[k:k] = detour
            k += not detour
        return trail

    trails = []
    for row in rows:
        place = start[row]
        while surplus[place] > 0:
            surplus[place] -= 1
            trails.append(walk(place))
    if sum(map(len, trails)) == len(rows):  # as of nearly all ways
        return trails
    # One after the other: what a detour takes up begins no trail.
    closed = (walk(start[row]) for row in rows if row in leaving[start[row]])
    return [with_detours(trail) for trail in chain(trails, closed)]


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
        rows, turned = line
        if turned[rows.index(min(rows, key=rank.__getitem__))]:
            line = Course(rows[::-1], [not one for one in turned[::-1]])
        lines.append(line)
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


def together_m(start: Ints, end: Ints, length_m: Floats) -> Floats:
    """For each stretch how long all are together that it hangs together with, (n,)."""
    places = int(max(start.max(initial=0), end.max(initial=0))) + 1
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(places, places))
    component = connected_components(graph, directed=False)[1][start]
    return np.asarray(np.bincount(component, length_m)[component], float)
