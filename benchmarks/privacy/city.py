"""The roads of a town as a graph: shortest ways by anybody's taste, chains and their ends. What everybody knows."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from fusion.frames import LocalProjection
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

Window = tuple[float, float, float, float]
"""West, south, east, north, degrees."""
HEIDELBERG: Window = (8.66, 49.38, 8.72, 49.42)
SPEEDS_KMH = {
    "motorway": 110.0, "motorway_link": 60.0, "trunk": 80.0, "trunk_link": 50.0, "primary": 55.0, "primary_link": 40.0,
    "secondary": 48.0, "secondary_link": 40.0, "tertiary": 42.0, "tertiary_link": 35.0, "unclassified": 35.0,
    "residential": 25.0, "living_street": 10.0,
}  # fmt: skip
"""Kinds of roads that the town drives on."""
QUIET = frozenset({"residential", "living_street", "unclassified"})
"""Where people live."""


class City:
    """Roads within a window, all of one connected part. Rows are those of the whole table."""

    def __init__(self, roads: RoadTable, window: Window = HEIDELBERG) -> None:
        self.roads = roads
        self.length_m = np.asarray(roads.length_m)
        plane = LocalProjection.around(roads.lon0_deg, roads.lat0_deg)
        x0, y0 = plane.to_xy(roads.lon0_deg, roads.lat0_deg)
        x1, y1 = plane.to_xy(roads.lon1_deg, roads.lat1_deg)
        names, node = np.unique(np.concatenate([roads.from_node, roads.to_node]), return_inverse=True)
        self.start, self.end = node[: len(roads)], node[len(roads) :]
        self.place = np.zeros((len(names), 2))
        self.place[self.start] = np.column_stack([x0, y0])
        self.place[self.end] = np.column_stack([x1, y1])
        self.degrees = np.zeros((len(names), 2))
        self.degrees[self.start] = np.column_stack([roads.lon0_deg, roads.lat0_deg])
        self.degrees[self.end] = np.column_stack([roads.lon1_deg, roads.lat1_deg])
        self.seconds = self.length_m / np.array([SPEEDS_KMH.get(h, 10.0) / 3.6 for h in roads.highway])
        self.rows = self._inside(window)
        self.nodes = np.unique(np.concatenate([self.start[self.rows], self.end[self.rows]]))
        quiet = self.rows[np.isin(roads.highway[self.rows].astype(str), list(QUIET))]
        self.quiet = np.unique(np.concatenate([self.start[quiet], self.end[quiet]]))
        busy = np.setdiff1d(self.rows, quiet)
        self.busy = np.unique(np.concatenate([self.start[busy], self.end[busy]]))

    def _inside(self, window: Window) -> Ints:
        """Rows of the largest part of the network within the window from any place of which any other is reached."""
        west, south, east, north = window
        inside = np.all((self.degrees >= (west, south)) & (self.degrees <= (east, north)), axis=1)
        known = np.isin(self.roads.highway.astype(str), list(SPEEDS_KMH))
        rows = np.flatnonzero(known & inside[self.start] & inside[self.end] & (self.start != self.end))
        tails, heads, _, _ = self._arcs(rows)
        ones = sparse.csr_matrix((np.ones(len(tails)), (tails, heads)), shape=(len(self.place),) * 2)
        _, part = connected_components(ones, connection="strong")
        largest = part == np.bincount(part).argmax()
        return np.asarray(rows[largest[self.start[rows]] & largest[self.end[rows]]], np.int64)

    def _arcs(self, rows: Ints) -> tuple[Ints, Ints, Ints, Bools]:
        """Directed arcs (tail, head, row, along the line) of rows, one or two of each."""
        oneway = self.roads.oneway[rows]
        ahead, back = rows[oneway >= 0], rows[oneway <= 0]
        tails = np.concatenate([self.start[ahead], self.end[back]])
        heads = np.concatenate([self.end[ahead], self.start[back]])
        along = np.concatenate([np.ones(len(ahead), bool), np.zeros(len(back), bool)])
        return tails, heads, np.concatenate([ahead, back]), along

    @cached_property
    def neighbours(self) -> list[list[int]]:
        """Rows at each node."""
        out: list[list[int]] = [[] for _ in self.place]
        for row in self.rows.tolist():
            out[self.start[row]].append(row)
            out[self.end[row]].append(row)
        return out

    def ways(self, cost: Floats) -> Ways:
        """Shortest ways where a row costs ``cost`` (rows of the table,)."""
        return Ways(self, cost)

    def tips(self, rows: Collection[int]) -> Iterator[tuple[int, int]]:
        """Where chains of these rows end: (node, its only row)."""
        mine = np.fromiter(rows, int, len(rows))
        nodes = np.concatenate([self.start[mine], self.end[mine]])
        found, first, count = np.unique(nodes, return_index=True, return_counts=True)
        both = np.concatenate([mine, mine])
        yield from zip(found[count == 1].tolist(), both[first[count == 1]].tolist(), strict=True)

    def chains(self, rows: Collection[int], jump: int = 2) -> list[list[int]]:
        """Connected parts of these rows; gaps of up to ``jump`` rows do not part them."""
        mine = np.fromiter(rows, int, len(rows))
        wide = set(mine.tolist())
        for _ in range(jump):
            nodes = {int(n) for r in wide for n in (self.start[r], self.end[r])}
            wide |= {r for n in nodes for r in self.neighbours[n]}
        size = len(self.place)
        each = np.fromiter(wide, int, len(wide))
        graph = sparse.csr_matrix(
            (np.ones(len(each)), (self.start[each], self.end[each])), shape=(size, size)
        )
        _, part = connected_components(graph, directed=False)
        label = part[self.start[mine]]
        return [mine[label == one].tolist() for one in np.unique(label)]

    def metres(self, rows: Sequence[int] | Ints) -> float:
        """The length of rows."""
        return float(self.length_m[np.asarray(rows, int)].sum())


class Ways:
    """Shortest ways through a city at given costs of its rows."""

    def __init__(self, city: City, cost: Floats) -> None:
        tails, heads, rows, along = city._arcs(city.rows)
        value = np.maximum(cost[rows], 1e-6)
        order = np.lexsort((value, heads, tails))
        first = np.ones(len(order), bool)
        first[1:] = (np.diff(tails[order]) != 0) | (np.diff(heads[order]) != 0)
        kept = order[first]
        size = len(city.place)
        self._key = tails[kept].astype(np.int64) * size + heads[kept]
        self._size, self._rows, self._along = size, rows[kept], along[kept]
        self._graph = sparse.csr_matrix((value[kept], (tails[kept], heads[kept])), shape=(size, size))

    def tree(self, node: int, limit: float = np.inf) -> tuple[Floats, Ints]:
        """Costs from a node to all, and each node's predecessor."""
        cost, before = dijkstra(self._graph, indices=node, limit=limit, return_predecessors=True)
        return cost, before.astype(np.int64)

    def along(self, before: Ints, to: int) -> tuple[Ints, Bools]:
        """Rows to a node by the predecessors of a tree, in the order of driving, and whether along their lines."""
        nodes = [to]
        while before[nodes[-1]] >= 0:
            nodes.append(int(before[nodes[-1]]))
        path = np.array(nodes[::-1], np.int64)
        at = np.searchsorted(self._key, path[:-1] * self._size + path[1:])
        return self._rows[at], self._along[at]

    def between(self, one: int, other: int) -> tuple[Ints, Bools]:
        """Rows from a node to another; none where there is no way."""
        return self.along(self.tree(one)[1], other)

    def fan(self, node: int, to: Ints) -> list[Ints]:
        """Rows of the shortest ways from a node to each of others, in no order; none where there is no way."""
        before = self.tree(node)[1]
        here, which = np.asarray(to, np.int64), np.arange(len(to))
        found, owner = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        while True:
            goes_on = before[here] >= 0
            here, which = here[goes_on], which[goes_on]
            if not len(here):
                break
            found.append(self._rows[np.searchsorted(self._key, before[here] * self._size + here)])
            owner.append(which)
            here = before[here]
        rows, whose = np.concatenate(found), np.concatenate(owner)
        order = np.argsort(whose, kind="stable")
        return np.split(rows[order], np.searchsorted(whose[order], np.arange(1, len(to))))
