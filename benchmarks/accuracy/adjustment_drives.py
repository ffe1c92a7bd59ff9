"""Drives for ``adjustment.py``: made-up drives on random routes through a real map, as pass factors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from fusion.frames import LocalProjection
from fusion.network.curve import grade_weights, height_weights, knot_length, variable_count
from fusion.network.pass_factor import NUISANCES, PLACE_PART_S, PLACE_TAU_S, PassFactor
from fusion.network.road_beliefs import DEFAULT_ROUGHNESS
from fusion.profile.factors import sum_passes
from fusion.profile.model import WANDER_SIGMA
from fusion.profile.traversals import OnTraversals
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

SPEED_MPS = 10.0
ALTITUDE_M, DRIFT_M2_PER_S = 0.5, 0.05
BARO_M, BARO_DRIFT_M2_PER_S = 0.2, 0.01
DOPPLER, PITCH, FORCE = 0.01, 0.012, 0.02
"""White noise of grades from vertical speeds, an attitude sensor and an accelerometer, at 1 Hz."""
MOUNT_SIGMA, BIAS_SIGMA, SQUAT_SIGMA, LAG_S = 0.05, 0.01, 0.002, (1.5, 1.0)
ACCELERATION_MPS2 = 0.5
PLACE_M = 2.0
"""One axis of the error of positions, as a receiver states it (of ``PLACE_TAU_S``)."""
BEND_OVER_M = 10.0
BEND_S = 3
"""Changes of grade are taken over so many seconds: about the distance of knots."""
BAROMETERS = 3
"""Every so many drives one has a barometer as well."""
HILLS = ((3000.0, 40.0), (700.0, 8.0), (150.0, 1.0))
"""Wave lengths and heights of the land, m."""


class Land:
    """Heights of a made-up land, as a sum of waves: roads that meet agree, and loops close."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.waves = []
        for length, height in HILLS:
            for _ in range(3):
                angle = rng.uniform(0, 2 * np.pi)
                self.waves.append(
                    (2 * np.pi / length * np.array([np.cos(angle), np.sin(angle)]), height, rng.uniform(0, 7))
                )

    def height(self, x: Floats, y: Floats) -> Floats:
        """Heights (n,) at places (n,), m."""
        total = np.zeros(len(x))
        for (kx, ky), height, phase in self.waves:
            total += height * np.sin(kx * x + ky * y + phase)
        return total


class Synthetic:
    """Made-up drives over a real map: random routes, and what receivers of every kind measured on them."""

    def __init__(self, roads: RoadTable, seed: int = 1, place_m: float = PLACE_M) -> None:
        self.roads, self.place_m = roads, place_m
        self.length = knot_length(roads.length_m)
        self.rng = np.random.default_rng(seed)
        self.land = Land(self.rng)
        plane = LocalProjection.around(roads.lon0_deg, roads.lat0_deg)
        self.ends = np.column_stack(
            [*plane.to_xy(roads.lon0_deg, roads.lat0_deg), *plane.to_xy(roads.lon1_deg, roads.lat1_deg)]
        )
        self.drives = 0
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

    def _directions(self, rows: Ints) -> Ints:
        """1 where a row of a route is driven as it is drawn, else -1."""
        start, end = self.start[rows], self.end[rows]
        out = np.ones(len(rows), np.int64)
        if len(rows) > 1:
            joined = (end[:-1] == start[1:]) | (end[:-1] == end[1:])
            out[:-1] = np.where(joined, 1, -1)
            out[-1] = 1 if start[-1] in (start[-2], end[-2]) else -1
        return out

    def height(self, row: Ints, share: Floats) -> Floats:
        """Height of the road at shares of rows, m."""
        x0, y0, x1, y1 = self.ends[row].T
        return self.land.height(x0 + share * (x1 - x0), y0 + share * (y1 - y0))

    def drive(self, route: Sequence[int]) -> list[PassFactor]:
        """One pass over each of the rows, at 1 Hz and ``SPEED_MPS``."""
        rng, rows = self.rng, np.asarray(route, np.int64)
        self.drives += 1
        barometer = self.drives % BAROMETERS == 0
        forward, length = self._directions(rows), self.length[rows]
        leave_s = np.cumsum(length) / SPEED_MPS
        enter_s = leave_s - length / SPEED_MPS
        time_s = np.arange(0.5, leave_s[-1])
        k = np.minimum(np.searchsorted(leave_s, time_s), len(rows) - 1)
        driven = np.clip((time_s - enter_s[k]) / (leave_s[k] - enter_s[k]), 0, 1)
        part = np.floor(0.5 * (enter_s + leave_s) / PLACE_PART_S).astype(np.int64)
        common, own_m = self._place(rows, forward, leave_s - enter_s)
        shift_m = np.sum(common * self._positions(int(part[-1]) + 1)[part], axis=1)
        shift_m += own_m * rng.normal(size=len(rows))
        share = np.where(forward[k] > 0, driven, 1 - driven)
        # Where the vehicle was, and the grade there in the direction of driving.
        ahead = forward[k] / length[k]
        at = share + ahead * shift_m[k]
        height, grade = self.height(rows[k], at), self._grade(rows[k], at, ahead)
        further = self._grade(rows[k], share + ahead * BEND_OVER_M, ahead)
        bend = (further - self._grade(rows[k], share - ahead * BEND_OVER_M, ahead)) / (2 * BEND_OVER_M)
        n = len(time_s)
        mount, bias, squat = rng.normal(size=3) * (MOUNT_SIGMA, BIAS_SIGMA, SQUAT_SIGMA)
        acceleration, wander = (
            ACCELERATION_MPS2 * rng.normal(size=n),
            WANDER_SIGMA * rng.normal(size=len(rows)),
        )
        zero, one = np.zeros(n), np.ones(n)
        late_s = rng.normal(*LAG_S)
        variable, high = height_weights(share * length[k], length[k])
        _, steep = grade_weights(share * length[k], length[k])
        steep = forward[k][:, None] * steep
        # (knots, constants, wander, sensor of height, value, sigma) of each sensor
        sensors = [
            (high, (zero, zero, zero, zero, grade), zero, 0, height + self._walk(n, DRIFT_M2_PER_S), ALTITUDE_M),
            (steep, (zero, zero, zero, zero, bend), zero, -1, grade, DOPPLER),
            (steep, (one, zero, acceleration, zero, bend), one, -1,
             grade + mount + squat * acceleration + wander[k], PITCH),
            (steep, (one, one, zero, zero, bend), zero, -1, grade + mount + bias, FORCE),
        ]  # fmt: skip
        if barometer:
            climb = -grade * SPEED_MPS
            late = height + climb * late_s + self._walk(n, BARO_DRIFT_M2_PER_S)
            sensors.append((high, (zero, zero, zero, climb, grade), zero, 1, late, BARO_M))
        m = len(sensors)
        order = np.argsort(np.tile(k, m) * (n * m + 1.0) + np.tile(np.arange(n), m), kind="stable")
        sigma = np.repeat([s[5] for s in sensors], n)
        value = np.concatenate([s[4] for s in sensors]) + sigma * rng.normal(size=n * m)
        return self._factors(
            rows, enter_s, leave_s,
            np.tile(variable, m)[order],
            np.concatenate([s[0] for s in sensors])[order],
            np.concatenate([np.column_stack([*s[1][:4], s[1][4][:, None] * common[k], zero]) for s in sensors])[order],
            np.concatenate([np.column_stack([WANDER_SIGMA * s[2], s[1][4] * own_m[k], zero]) for s in sensors])[order],
            np.repeat([s[3] for s in sensors], n)[order],
            value[order],
            sigma[order] ** 2,
            np.tile(time_s, m)[order],
            np.searchsorted(np.tile(k, m)[order], np.arange(len(rows) + 1)),
            _roughness(grade, k),
            part,
        )  # fmt: skip

    def _grade(self, row: Ints, share: Floats, ahead: Floats) -> Floats:
        """By how much the road rises over a metre, ``ahead`` being that in shares."""
        return self.height(row, share + 0.5 * ahead) - self.height(row, share - 0.5 * ahead)

    def _place(self, rows: Ints, forward: Ints, took_s: Floats) -> tuple[Floats, Floats]:
        """How far along the road n passes are moved by one sigma of the positions' error to the east and the north,
        (n, 2), and one sigma of what is each pass's own, (n,), m; as ``methods.profile.factors`` has it."""
        x0, y0, x1, y1 = self.ends[rows].T
        along = forward[:, None] * np.column_stack([x1 - x0, y1 - y0])
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
        decay = np.exp(-took_s / PLACE_TAU_S)
        return self.place_m * np.sqrt(decay)[:, None] * along, self.place_m * np.sqrt(1 - decay)

    def _positions(self, parts: int) -> Floats:
        """Errors of positions in each part of a drive, to the east and the north, in sigmas: (parts, 2)."""
        decay, out = np.exp(-PLACE_PART_S / PLACE_TAU_S), self.rng.normal(size=(parts, 2))
        for k in range(1, parts):
            out[k] = decay * out[k - 1] + np.sqrt(1 - decay**2) * out[k]
        return out

    def _walk(self, n: int, rate: float) -> Floats:
        start = 3.0 * self.rng.normal()
        return np.asarray(start + np.cumsum(np.sqrt(rate) * self.rng.normal(size=n)))

    def _factors(
        self, rows: Ints, enter_s: Floats, leave_s: Floats, variable: Ints, weights: Floats, constants: Floats,
        passing: Floats, sensor: Ints, value: Floats, variance: Floats, time_s: Floats, first: Ints,
        roughness: float, part: Ints,
    ) -> list[PassFactor]:  # fmt: skip
        """The sums over each pass; columns as ``OnTraversals`` has them."""
        size = variable_count(self.length[rows]) + NUISANCES
        information, vector, square = (np.zeros(int(v)) for v in ((size**2).sum(), size.sum(), len(rows)))
        walk, begin = (DRIFT_M2_PER_S, BARO_DRIFT_M2_PER_S), 1.7e9 + 1e5 * self.drives
        data = OnTraversals(variable, weights, constants, passing, sensor, value, variance, time_s, first)
        sum_passes(
            data, size, enter_s, leave_s, np.array(walk), np.empty(0), 0.0, information, vector, square
        )
        ends, squares = np.cumsum(size), np.cumsum(size**2)
        out = []
        for j, (row, n) in enumerate(zip(rows.tolist(), size.tolist(), strict=True)):
            count = int(first[j + 1] - first[j])
            out.append(
                PassFactor(
                    row, j, 0, information[squares[j] - n * n : squares[j]].reshape(n, n),
                    vector[ends[j] - n : ends[j]], float(square[j]), count, walk, 0.0,
                    float(self.length[row]), roughness, max(1, count // 4),
                    begin + float(enter_s[j]), begin + float(leave_s[j]), int(part[j]),
                )
            )  # fmt: skip
        return out


def _roughness(grade: Floats, row: Ints) -> float:
    """What a drive learns of its roads, from true grades (n,) once a second: variance of their change in a metre."""
    apart = BEND_S
    same = row[apart:] == row[:-apart]
    change = (grade[apart:] - grade[:-apart])[same]
    return float(np.mean(np.square(change)) / (apart * SPEED_MPS)) if len(change) else DEFAULT_ROUGHNESS
