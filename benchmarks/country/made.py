"""A made-up country: copies of a real town, roads between them, and drives kept block by block."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra

from accuracy.adjustment_drives import Land, Synthetic
from fusion.frames import METRES_PER_DEGREE
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

GAP_M, STEP_M = 3000.0, 60.0
"""What lies between two towns, and the segments of the roads over it."""
ROUTE_M = 10_000.0
LAND_SEED = 1
NAMES_APART = 1 << 40
"""Names of ways and nodes of one town and of the next, beyond all of OpenStreetMap's."""
DRIVES_APART = 1_000_000


def town(roads: RoadTable, most: int) -> RoadTable:
    """At most so many segments about the middle of a map that hang together: in the order in which roads lead there
    from a place in the middle of the largest part, by the number of segments."""
    _, node = np.unique(np.concatenate([roads.from_node, roads.to_node]), return_inverse=True)
    start, end = np.split(node, 2)
    size = int(node.max()) + 1
    graph = csr_matrix((np.ones(len(roads)), (start, end)), (size, size))
    part = connected_components(graph, directed=False)[1]
    largest = part[start] == np.bincount(part[start]).argmax()
    far = np.hypot(roads.lat0_deg - np.median(roads.lat0_deg), roads.lon0_deg - np.median(roads.lon0_deg))
    middle = int(start[np.argmin(np.where(largest, far, np.inf))])
    order = breadth_first_order(graph, middle, directed=False, return_predecessors=False)
    rank = np.full(size, size)
    rank[order] = np.arange(len(order))
    later = np.maximum(rank[start], rank[end])
    chosen = np.argsort(later, kind="stable")[: min(most, int(np.count_nonzero(largest)))]
    return roads.subset(np.sort(chosen))


@dataclass(frozen=True, eq=False)
class Country:
    """Roads of all towns, the town of each segment (n,), -1 between them, and which towns are neighbours (m, 2)."""

    roads: RoadTable
    town: Ints
    neighbours: Ints

    @classmethod
    def of(cls, roads: RoadTable, segments: int) -> Country:
        """At least so many segments: copies of a town, the last one as large as it takes, side by side in rows."""
        count = -(-segments // len(roads))
        across = int(np.ceil(np.sqrt(count)))
        west, south, east, north = roads.bounds_deg()
        gap_deg = GAP_M / METRES_PER_DEGREE
        step = (east - west + gap_deg / np.cos(np.radians(north)), north - south + gap_deg)
        last = town(roads, segments - (count - 1) * len(roads))
        tables = [
            _moved(last if k == count - 1 else roads, k, (k % across) * step[0], (k // across) * step[1])
            for k in range(count)
        ]
        beside = [(k, k + 1) for k in range(count - 1) if (k + 1) % across]
        above = [(k, k + across) for k in range(count - across)]
        neighbours = np.array([*beside, *above], np.int64).reshape(-1, 2)
        between = [
            _road(tables[a], tables[b], count + k, eastward=b == a + 1)
            for k, (a, b) in enumerate(neighbours.tolist())
        ]
        every = [*tables, *between]
        joined: dict[str, Any] = {
            c: np.concatenate([getattr(t, c) for t in every]) for c in RoadTable.columns()
        }
        of = np.concatenate([np.full(len(t), k if k < count else -1) for k, t in enumerate(every)])
        return cls(RoadTable(**joined), of, neighbours)


def _moved(roads: RoadTable, number: int, east_deg: float, north_deg: float) -> RoadTable:
    columns: dict[str, Any] = {c: getattr(roads, c) for c in RoadTable.columns()}
    for name in ("osm_way_id", "from_node", "to_node"):
        columns[name] = columns[name] + number * NAMES_APART
    for end in "01":
        columns[f"lon{end}_deg"] = columns[f"lon{end}_deg"] + east_deg
        columns[f"lat{end}_deg"] = columns[f"lat{end}_deg"] + north_deg
    return RoadTable(**columns)


def _road(a: RoadTable, b: RoadTable, number: int, eastward: bool) -> RoadTable:
    """A straight road between the nearest edges of two towns."""
    sides = ("lon0_deg" if eastward else "lat0_deg"), ("lon0_deg" if eastward else "lat0_deg")
    out, into = int(np.argmax(getattr(a, sides[0]))), int(np.argmin(getattr(b, sides[1])))
    start, end = (np.array([t.lon0_deg[k], t.lat0_deg[k]]) for t, k in ((a, out), (b, into)))
    long_m = METRES_PER_DEGREE * float(np.hypot(*((end - start) * (np.cos(np.radians(start[1])), 1.0))))
    n = max(int(long_m / STEP_M), 1)
    at = start + np.linspace(0.0, 1.0, n + 1)[:, None] * (end - start)
    nodes = number * NAMES_APART + np.arange(n + 1)
    nodes[0], nodes[-1] = a.from_node[out], b.from_node[into]
    return RoadTable.from_columns(
        osm_way_id=number * NAMES_APART + np.arange(n), from_node=nodes[:-1], to_node=nodes[1:],
        lon0_deg=at[:-1, 0], lat0_deg=at[:-1, 1], lon1_deg=at[1:, 0], lat1_deg=at[1:, 1],
        oneway=np.zeros(n), bridge=np.zeros(n), tunnel=np.zeros(n), layer=np.zeros(n),
        highway=["secondary"] * n, name=[None] * n,
    )  # fmt: skip


@dataclass(frozen=True)
class PassFiles:
    """Passes by blocks in a folder: what drives say of the segments of a block is read by who works on it."""

    folder: Path

    def passes(self, block: int) -> Mapping[int, Sequence[PassFactor]]:
        """Passes of a block, by drives."""
        drives: dict[int, list[PassFactor]] = {}
        for file in sorted(self.folder.glob(f"passes-{block}-*")):
            names, stored = pickle.loads(file.read_bytes())  # noqa: S301 - our own files
            for name, one in zip(names, PassFactor.decode_all(stored), strict=True):
                drives.setdefault(name, []).append(one)
        return drives

    def put(self, drives: Mapping[int, Sequence[PassFactor]], block: Ints, maker: int) -> None:
        """Keep passes by the block (n,) of each segment; ``maker``: a number that no other call has."""
        every = [(name, p) for name, passes in drives.items() for p in passes]
        of = block[[p.segment for _, p in every]]
        encoded = PassFactor.encode_all([p for _, p in every])
        for number in np.unique(of).tolist():
            mine = np.flatnonzero(of == number).tolist()
            stored = [(encoded[k], every[k][1].segment, every[k][1].sequence) for k in mine]
            names = [every[k][0] for k in mine]
            (self.folder / f"passes-{number}-{maker}").write_bytes(pickle.dumps((names, stored)))


def make_drives(files: PassFiles, country: Path, maker: int, count: int) -> int:
    """Make and keep the drives in the town of this number, or for -1 those from town to town; how many passes."""
    made, block = pickle.loads(country.read_bytes())  # noqa: S301 - our own files
    synthetic = Synthetic(made.roads, seed=maker + 2)
    synthetic.land = Land(np.random.default_rng(LAND_SEED))  # one for all
    if maker < 0:
        routes = journeys(synthetic, made)
    else:
        mine = np.unique(synthetic.start[made.town == maker])
        synthetic.nodes = np.intersect1d(mine, synthetic.nodes)
        routes = [synthetic.route(ROUTE_M) for _ in range(count)] if len(synthetic.nodes) else []
    drives = {DRIVES_APART * (maker + 1) + k: synthetic.drive(route) for k, route in enumerate(routes)}
    files.put(drives, block, maker)
    return sum(map(len, drives.values()))


def journeys(synthetic: Synthetic, country: Country) -> list[list[int]]:
    """A drive from every town to each neighbour and one through all towns, by the shortest ways."""
    home = []
    for k in range(int(country.town.max()) + 1):
        nodes = np.intersect1d(synthetic.start[country.town == k], synthetic.nodes)
        home.append(int(nodes[len(nodes) // 2]) if len(nodes) else -1)
    pairs = [(home[a], home[b]) for a, b in country.neighbours.tolist()]
    routes = [_way(synthetic, a, b) for a, b in pairs if min(a, b) >= 0]
    known = [h for h in home if h >= 0]
    whole = [row for a, b in pairwise(known) for row in _way(synthetic, a, b)]
    return [route for route in (*routes, whole) if route]


def _way(synthetic: Synthetic, start: int, end: int) -> list[int]:
    before: Floats = dijkstra(synthetic.graph, directed=False, indices=end, return_predecessors=True)[1]
    rows, node = [], start
    while node != end:
        following = int(before[node])
        rows.append(synthetic.row_between[min(node, following), max(node, following)])
        node = following
    return rows
