"""Drives for ``adjustment.py``: factors of simulated drives, perturbed copies of them, routes through a real map."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from fusion.formats import read_log
from fusion.network.curve import grade_rows, knot_length, slope_row, smoothness
from fusion.network.pass_factor import PassFactor
from fusion.pipeline import run_drive
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem

RECEIVERS = ("m8", "f9p", "phone", "m8")
SIMULATED_S = 600.0
GRADE_SIGMA, MOUNT_SIGMA = 0.02, 0.005
"""A synthetic pass measures grades with this noise every ``EVERY_M``, and a mount's tilt with them."""
EVERY_M = 8.0
_HIDDEN = 1e-7


@dataclass(frozen=True)
class Copies:
    """Drives over the same roads as a few real ones: each factor with another draw of its own noise."""

    originals: tuple[tuple[PassFactor, ...], ...]
    roots: tuple[tuple[np.ndarray, ...], ...]
    """Square roots of the factors' information."""

    @classmethod
    def of(cls, originals: Sequence[Sequence[PassFactor]]) -> Copies:
        """Prepare copying."""
        return cls(
            tuple(map(tuple, originals)),
            tuple(tuple(_root(f.information) for f in drive) for drive in originals),
        )

    def drive(self, number: int) -> list[PassFactor]:
        """The factors of copy ``number``; the originals by turns."""
        rng = np.random.default_rng(number)
        which = number % len(self.originals)
        return [
            replace(
                factor,
                vector=factor.vector + root @ rng.normal(size=len(factor.vector)),
                slope_percent=factor.slope_percent + factor.slope_sigma_percent * float(rng.normal()),
            )
            for factor, root in zip(self.originals[which], self.roots[which], strict=True)
        ]


def _root(information: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(information)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def town_drives(town: Town) -> list[list[PassFactor]]:
    """The factors of simulated drives that ``profile`` estimated, by row of the town's roads."""
    row_of = {key: row for row, key in enumerate(_keys(town.roads))}
    drives, visits = [], np.zeros(len(town.roads), np.int64)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_dem(town, folder / "dem.tif")
        dem = Dem.open([folder / "dem.tif"])
        for seed, receiver in enumerate(RECEIVERS):
            write_csv(
                simulate_drive(town, seed, SIMULATED_S, receiver=receiver, visits=visits), folder / "log.csv"
            )
            network, result = run_drive(read_log(folder / "log.csv"), town.roads, dem, method="profile")
            rows = [row_of[key] for key in _keys(network.table)]
            drives.append([replace(f, segments=tuple(rows[s] for s in f.segments)) for f in result.factors])
    return drives


def _keys(roads: RoadTable) -> Iterator[tuple[int, int, int]]:
    return zip(roads.osm_way_id.tolist(), roads.from_node.tolist(), roads.to_node.tolist(), strict=True)


class Synthetic:
    """Made-up drives over a real map: random routes, and passes that measured grades on them."""

    def __init__(self, roads: RoadTable, seed: int = 1) -> None:
        self.roads = roads
        self.length = knot_length(roads.length_m)
        self.rng = np.random.default_rng(seed)
        _, node = np.unique(np.concatenate([roads.from_node, roads.to_node]), return_inverse=True)
        self.start, self.end = node[: len(roads)], node[len(roads) :]
        size = int(node.max()) + 1
        cost = np.maximum(roads.length_m, 0.1)
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        order = np.lexsort((cost, high, low))
        first = np.ones(len(order), bool)
        first[1:] = (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)
        keep = order[first]
        self.graph = sparse.csr_matrix((cost[keep], (low[keep], high[keep])), shape=(size, size))
        self.row_between = {(int(low[r]), int(high[r])): int(r) for r in keep}
        _, part = connected_components(self.graph, directed=False)
        self.nodes = np.flatnonzero(part == np.bincount(part).argmax())
        self.grade = self.rng.normal(0.0, 0.03, len(roads))

    def route(self, length_m: float) -> list[int]:
        """Rows one after another, from random place to random place by the shortest way, at least ``length_m``."""
        rows: list[int] = []
        driven, here = 0.0, int(self.rng.choice(self.nodes))
        while driven < length_m:
            distance, before = dijkstra(
                self.graph, directed=False, indices=here, limit=length_m, return_predecessors=True
            )
            there = int(self.rng.choice(np.flatnonzero(np.isfinite(distance))))
            leg, node = [], there
            while node != here:
                previous = int(before[node])
                leg.append(self.row_between[min(node, previous), max(node, previous)])
                node = previous
            rows += leg[::-1]
            driven += float(distance[there])
            here = there
        return rows

    def drive(self, rows: Sequence[int]) -> list[PassFactor]:
        """One pass over each of the rows, as a receiver with an attitude sensor makes it."""
        return [self.factor(row) for row in rows]

    def everywhere(self) -> Iterator[PassFactor]:
        """One pass over every segment of the map."""
        return (self.factor(row) for row in range(len(self.roads)))

    def factor(self, row: int) -> PassFactor:
        """A pass over one segment."""
        length = float(self.length[row])
        count = max(1, round(length / EVERY_M))
        rows = grade_rows(length * (np.arange(count) + 0.5) / count, length)
        value = self.grade[row] + self.rng.normal(0, MOUNT_SIGMA) + GRADE_SIGMA * self.rng.normal(size=count)
        # The mount's tilt is the same all along: the mean of the rows is known less well than their differences.
        share = MOUNT_SIGMA**2 / (GRADE_SIGMA**2 + count * MOUNT_SIGMA**2)
        weighed = (rows - share * rows.sum(axis=0)) / GRADE_SIGMA**2
        information, vector = weighed.T @ rows, weighed.T @ value
        total = information + smoothness(length, 1e-3) + _HIDDEN * np.eye(len(vector))
        design = slope_row(0.0, length, length)
        solved = np.linalg.solve(total, np.column_stack([design, vector]))
        return PassFactor(
            (row,), 0.5 * (information + information.T), vector, 100 * float(design @ solved[:, 1]),
            100 * float(np.sqrt(design @ solved[:, 0])), 0.0, length, 1e-5, count, 1.7e9, 1.7e9 + 1,
        )  # fmt: skip
