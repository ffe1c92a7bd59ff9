"""Mean grades between places of known height that lie far apart, from the slopes of the segments between them.

A stretch is the shortest way along the network between two such places. Which pairs count is the rule of the tool
``stretches.py``: each place with the two nearest others 200 to 3000 m away. The tool prints errors only; here stand the
segments of each stretch as well, so that it can be asked whether a mean grade's sigma is true.
"""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from pyproj import Transformer
from scipy.sparse.csgraph import dijkstra

from accuracy.sequences import Slopes
from accuracy.truth import Key
from fusion.types import Floats

SHORTEST_M, LONGEST_M = 200.0, 3000.0
"""Length of a stretch."""
FARTHEST_M = 40.0
"""How far from a road a known height may lie."""
_NEIGHBOURS = 2
Shares = dict[int, float]
"""By segment the share of it that a way goes along, negative where it goes against the direction of drawing."""


@dataclass(frozen=True)
class Stretch:
    """A way between two known heights; ``keys`` and ``shares``, shape (n,), are of its segments."""

    length_m: float
    rise_m: float
    keys: tuple[Key, ...]
    shares: Floats
    segment_m: Floats

    def grade_percent(self, slopes: Slopes) -> float | None:
        """The mean grade by slopes, None unless all of them are known."""
        if any(key not in slopes for key in self.keys):
            return None
        slope = np.array([slopes[key][0] for key in self.keys])
        return float(np.sum(self.shares * self.segment_m * slope)) / self.length_m

    def true_grade_percent(self) -> float:
        """The mean grade by the known heights."""
        return 100 * self.rise_m / self.length_m


def grade_sigma_percent(stretch: Stretch, slopes: Slopes) -> float:
    """One sigma of a stretch's mean grade, as a result states it. THE PLACE TO CHANGE when results say more.

    Today a result has a sigma for each segment and nothing of how their errors hang together: they are taken as
    independent. With node heights and their covariances it is the sigma of the difference of two heights.
    """
    sigma = np.array([slopes[key][1] for key in stretch.keys])
    return float(np.sqrt(np.sum((stretch.shares * stretch.segment_m * sigma) ** 2))) / stretch.length_m


def find_stretches(tool: ModuleType, heights: Path, roads: Path) -> list[Stretch]:
    """All stretches between the known heights of a file; ``tool`` is the module ``stretches``."""
    with heights.open(newline="") as file:
        lon, lat, height = np.array(
            [[float(r[c]) for c in ("lon_deg", "lat_deg", "height_m")] for r in csv.DictReader(file)]
        ).T
    zone = 32600 + int((lon[0] + 180) // 6) + 1
    plane = Transformer.from_crs(4326, zone, always_xy=True)
    graph = _Graph(tool.Roads(roads, plane))
    places = [graph.roads.onto(x, y) for x, y in zip(*plane.transform(lon, lat), strict=True)]
    near = [k for k, (off, *_) in enumerate(places) if off < FARTHEST_M]
    on_road = [(int(places[k][1]), float(places[k][2])) for k in near]
    return [graph.stretch(ways, height[near[j]] - height[near[i]]) for i, j, ways in graph.pairs(on_road)]


Way = tuple[float, Shares]
Place = tuple[int, float]
"""A segment, and how far along it, 0..1."""


@dataclass(frozen=True)
class _Graph:
    """The tool's reading of a road file, an instance of its ``Roads``: ``E`` node pairs, ``L`` lengths, ``key`` ..."""

    roads: Any

    def pairs(self, places: Sequence[Place]) -> Iterator[tuple[int, int, Way]]:
        """Which places make a stretch, each pair once, with the way between them."""
        chosen: dict[tuple[int, int], Way] = {}
        for i, start in enumerate(places):
            ways = [(way, j) for j, way in self._ways(start, places).items() if j != i]
            for way, j in sorted(ways, key=lambda one: one[0][0])[:_NEIGHBOURS]:
                turned = {k: -share for k, share in way[1].items()}
                chosen[min(i, j), max(i, j)] = way if i < j else (way[0], turned)
        return ((i, j, way) for (i, j), way in chosen.items())

    def stretch(self, way: Way, rise_m: float) -> Stretch:
        """A way as a stretch."""
        length_m, shares = way
        rows = list(shares)
        keys = tuple((int(w), int(a), int(b)) for w, a, b in (self.roads.key[k] for k in rows))
        return Stretch(length_m, float(rise_m), keys, np.array(list(shares.values())), self.roads.L[rows])

    def _ways(self, start: Place, places: Sequence[Place]) -> dict[int, Way]:
        """By place the shortest way to it of an allowed length."""
        nodes = self.roads.E[start[0]]
        far, before = dijkstra(self.roads.graph, indices=nodes, limit=LONGEST_M, return_predecessors=True)
        ways: dict[int, Way] = {}
        for j, goal in enumerate(places):
            lengths = {
                (a, b): self._lead_m(start, a) + far[a, self.roads.E[goal[0]][b]] + self._lead_m(goal, b)
                for a, b in itertools.product((0, 1), repeat=2)
            }
            allowed = {ends: length for ends, length in lengths.items() if SHORTEST_M < length < LONGEST_M}
            if allowed:
                a, b = min(allowed, key=lambda ends: allowed[ends])
                middle = self._path(before[a], int(nodes[a]), int(self.roads.E[goal[0]][b]))
                back = {k: -share for k, share in self._lead(goal, b).items()}
                ways[j] = (float(allowed[a, b]), _added(self._lead(start, a), middle, back))
        return ways

    def _lead_m(self, place: Place, end: int) -> float:
        """From a place to an end of its segment."""
        return float(self.roads.L[place[0]] * (place[1] if end == 0 else 1 - place[1]))

    def _lead(self, place: Place, end: int) -> Shares:
        return {place[0]: -place[1] if end == 0 else 1 - place[1]}

    def _path(self, before: Floats, start: int, goal: int) -> Shares:
        """The segments from one node to another, by the predecessors of each node."""
        shares: Shares = {}
        while goal != start:
            last = int(before[goal])
            forward = self.roads.edge.get((last, goal))
            row, share = (forward, 1.0) if forward is not None else (self.roads.edge[goal, last], -1.0)
            shares[row] = shares.get(row, 0.0) + share
            goal = last
        return shares


def _added(*parts: Mapping[int, float]) -> Shares:
    total: Shares = {}
    for part in parts:
        for row, share in part.items():
            total[row] = total.get(row, 0.0) + share
    return {row: share for row, share in total.items() if share}
