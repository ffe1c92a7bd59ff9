"""A dense reference for the network adjustment, in more digits than the library's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dense_equations import Equation, inverted, observed
from dense_roughness import DenseUsual
from dense_terrain import DenseTerrain
from fusion.network import curve as knots
from fusion.network import drive_beliefs as drives
from fusion.network import joints as turns
from fusion.network import pass_factor as factors
from fusion.network import road_beliefs as roads
from fusion.network import segment_slopes as shown
from fusion.network.adjust import ROUNDS
from fusion.network.curve import interval_count, place_rows, slope_rows, smoothness_block, variable_count
from fusion.network.pass_factor import PassFactor
from fusion.network.terrain import Terrain
from fusion.roads.table import RoadTable
from fusion.types import Floats

CONSTANTS, SENSORS = len(factors.CONSTANTS), len(factors.HEIGHT_SENSORS)


class DenseAdjustment:
    """The same model as ``fusion.network.adjust``, written down equation by equation and solved densely.

    Every rule is restated here from ``docs/explanation/network.md``, so that a slip there does not repeat itself here;
    only the numbers that are a matter of tuning are the modules', and so is what is learned of the elevation model:
    ``quality`` is its sigma and length, m.
    """

    def __init__(
        self,
        table: RoadTable,
        said: Mapping[int, Sequence[PassFactor]],
        terrain: Terrain | None = None,
        quality: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        self.table, self.said = table, said
        self.length = np.maximum(table.length_m, knots.SHORTEST_M)
        self.nodes = sorted({*table.from_node.tolist(), *table.to_node.tolist()})
        self.size = len(self.nodes)
        self.first = [self._new(int(variable_count(length))) for length in self.length]
        self.fixed: list[Equation] = []
        self.ties = [
            observed({self.nodes.index(node): -1.0, height: 1.0}, 0.0, roads.NODE_SIGMA_M)
            for node, _, height, _, _ in self._ends()
        ]
        self._grades()
        self._levels()
        self._roughness()
        self._drives()
        heights = [self._knots(row) for row in range(len(table))]
        self.model = DenseTerrain(table, self.length, heights, terrain, *quality)
        for turn in range(ROUNDS):
            self._solve()
            if turn < ROUNDS - 1:
                self._learn(turn == 0)

    def _new(self, count: int) -> int:
        self.size += count
        return self.size - count

    def _knots(self, row: int) -> list[int]:
        """Where the heights of the knots stand; the grade is the next."""
        return [self.first[row] + 2 * j for j in range(int(interval_count(self.length[row])) + 1)]

    def _own(self, row: int) -> list[int]:
        return list(range(self.first[row], self.first[row] + int(variable_count(self.length[row]))))

    # Roads

    def _ends(self) -> list[tuple[int, int, int, float, np.ndarray]]:
        """Each end of each segment: node, row, height unknown, sign of the grade and unit vector away from the node."""
        t, out = self.table, []
        narrow = np.cos(np.radians(0.5 * (t.lat0_deg + t.lat1_deg)))
        east, north = (t.lon1_deg - t.lon0_deg) * narrow, t.lat1_deg - t.lat0_deg
        for row in range(len(t)):
            along = np.array([east[row], north[row]]) / np.hypot(east[row], north[row])
            heights = self._knots(row)
            out.append((int(t.from_node[row]), row, heights[0], 1.0, along))
            out.append((int(t.to_node[row]), row, heights[-1], -1.0, -along))
        return out

    def _grades(self) -> None:
        """Roads are not steep, and grades go on where segments meet."""
        for row in range(len(self.table)):
            own = self._own(row)
            weak = np.diag(np.where(np.arange(len(own)) % 2, roads.GRADE_SIGMA**-2, 0.0)) + 1e-12
            self.fixed.append(Equation(own, weak))
        for node in self.nodes:
            ends = [end for end in self._ends() if end[0] == node]
            for k, (_, row_a, height_a, sign_a, away_a) in enumerate(ends):
                for _, row_b, height_b, sign_b, away_b in ends[k + 1 :]:
                    turned = 1 + float(away_a @ away_b)  # 1 minus the cosine of the turn
                    level, turn = turns.PLAIN_SIGMA, turns.TURN_SIGMA
                    if len(ends) > 2:
                        level, turn = turns.JUNCTION_SIGMA, turns.JUNCTION_TURN_SIGMA
                    kinds = {(bool(self.table.bridge[r]), bool(self.table.tunnel[r])) for r in (row_a, row_b)}
                    ramp = turns.STRUCTURE_SIGMA if len(kinds) > 1 else 0.0
                    sigma = float(np.linalg.norm([level, turn * turned, ramp]))
                    # Uphill away from the node on one side is downhill away from it on the other.
                    self.fixed.append(observed({height_a + 1: sign_a, height_b + 1: sign_b}, 0.0, sigma))

    def _levels(self) -> None:
        """All knots that hang together are lifted by a metre for the price of ``LEVEL_SIGMA_M``, shared by them."""
        part = {node: {node} for node in self.nodes}
        for start, end in zip(self.table.from_node.tolist(), self.table.to_node.tolist(), strict=True):
            both = part[start] | part[end]
            part |= dict.fromkeys(both, both)
        self.levels: list[Equation] = []
        for own in {id(p): p for p in part.values()}.values():
            rows = [row for row in range(len(self.table)) if int(self.table.from_node[row]) in own]
            heights = [h for row in rows for h in self._knots(row)]
            sigma = roads.LEVEL_SIGMA_M * np.sqrt(len(heights))
            self.levels += [observed({h: 1.0}, 0.0, sigma) for h in heights]

    def _roughness(self) -> None:
        """Each interval for q = 1, beside its row, and whether any pass goes over it."""
        self.usual = DenseUsual(self.table, [p for d in sorted(self.said) for p in self.said[d] if p.rows])
        self.intervals: list[tuple[Equation, int, bool]] = []
        for row, length in enumerate(self.length):
            reached = [
                v
                for d in self.said
                for p in self.said[d]
                if p.segment == row and p.rows
                for v in (p.start_m, p.end_m)
            ]
            heights = self._knots(row)
            d = length / (len(heights) - 1)
            walk = np.array([[d**3 / 3, d**2 / 2], [d**2 / 2, d]])
            step = np.array([[-1.0, -d, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])
            for j, h in enumerate(heights[:-1]):
                one = Equation([h, h + 1, h + 2, h + 3], step.T @ np.linalg.inv(walk) @ step)
                one.weight = 1 / self.usual.at[row]
                seen = bool(reached) and min(reached) <= (j + 0.5) * d <= max(reached)
                self.intervals.append((one, row, seen))

    # Drives

    def _drives(self) -> None:
        self.passes: list[tuple[int, PassFactor, Equation]] = []
        self.pass_scale = dict.fromkeys(self.said, 1.0)
        self.walks: list[list[Equation]] = []
        self.lag: dict[int, int] = {}
        for d in sorted(self.said):
            self._drive(d, sorted(self.said[d], key=lambda p: p.sequence))
        self.scale = [1.0] * len(self.walks)
        if self.lag:
            self.lag_mean = self._new(1)
            self.fixed.append(observed({self.lag_mean: 1.0}, *drives.LAG_MEAN_S))
            for lag in self.lag.values():
                self.fixed.append(observed({lag: 1.0, self.lag_mean: -1.0}, 0.0, drives.LAG_SIGMA_S))

    def _drive(self, d: int, passes: Sequence[PassFactor]) -> None:
        constant: dict[tuple[int, int], int] = {}
        exits: list[tuple[int, float] | None] = [None] * SENSORS
        walks: list[list[Equation]] = [[] for _ in range(SENSORS)]
        for one in passes:
            # What the factor does not speak of is not an unknown.
            speaks = np.diagonal(one.information)[-factors.NUISANCES :] > 0
            own, kept = self._own(one.segment), list(range(len(one.vector) - factors.NUISANCES))
            for kind in np.flatnonzero(speaks).tolist():
                kept.append(len(one.vector) - factors.NUISANCES + kind)
                if kind >= CONSTANTS:
                    own.append(self._error(one, kind - CONSTANTS, exits, walks))
                    continue
                setting = {factors.MOUNT: one.mount, factors.EAST: one.place, factors.NORTH: one.place}
                key = (kind, setting.get(kind, -1))
                if key not in constant:
                    constant[key] = self._new(1)
                    if kind == factors.LAG:
                        self.lag[d] = constant[key]
                    else:
                        sigma = factors.CONSTANT_SIGMA[kind]
                        self.fixed.append(observed({constant[key]: 1.0}, 0.0, sigma))
                own.append(constant[key])
            equation = Equation(own, one.information[np.ix_(kept, kept)], one.vector[kept])
            self.passes.append((d, one, equation))
        self.walks += walks

    def _error(
        self,
        one: PassFactor,
        number: int,
        exits: list[tuple[int, float] | None],
        walks: list[list[Equation]],
    ) -> int:
        """The unknown of a height sensor's error at entry or at exit, and the way from the last exit to it."""
        leaving, s = divmod(number, SENSORS)
        unknown = self._new(1)
        if leaving:
            exits[s] = (unknown, one.last_time_s)
            return unknown
        before = exits[s]
        if before is None:
            self.fixed.append(observed({unknown: 1.0}, 0.0, drives.START_SIGMA_M[s]))
        else:
            between_s = max(one.first_time_s - before[1], 0.0) + 1.0
            sigma = np.sqrt(one.walk_m2_per_s[s] * between_s)
            walks[s].append(observed({before[0]: -1.0, unknown: 1.0}, 0.0, sigma))
        return unknown

    # Rounds

    def _solve(self) -> None:
        whole, right = np.zeros((self.size, self.size), np.longdouble), np.zeros(self.size, np.longdouble)
        for one in [
            *self.fixed, *self.ties, *self.levels, *(e for e, *_ in self.intervals), *self.model.equations(),
            *(e for _, _, e in self.passes), *(e for series in self.walks for e in series),
        ]:  # fmt: skip
            whole[np.ix_(one.at, one.at)] += one.weight * one.information
            right[one.at] += one.weight * one.vector
        inverse = inverted(whole)
        self.solution = (inverse @ right).astype(float)
        self.covariance = inverse.astype(float)

    def _learn(self, first: bool) -> None:
        now = (self.solution, self.covariance)
        for one in self.levels:  # about where it was found to be
            one.vector = one.information[0] * self.solution[one.at]
        for one in self.ties:
            one.weight = (roads.NODE_FREEDOM + 1) / (roads.NODE_FREEDOM + one.square(*now))
        change = np.array([e.square(*now) for e, *_ in self.intervals])
        driven = [(row, c) for (_, row, seen), c in zip(self.intervals, change.tolist(), strict=True) if seen]
        self.usual.learn(*zip(*driven, strict=True) if driven else ([], []))
        free = roads.ROUGHNESS_FREEDOM
        for (one, row, seen), c in zip(self.intervals, change, strict=True):
            # Of intervals that nobody drove nothing tells which are even: their steps have Student's t's own variance.
            usual = self.usual.at[row]
            one.weight = 1 / ((free * usual + c) / (free + 2) if seen else free / (free - 2) * usual)
        self.scale = [
            self._learn_walk(series, scale) for series, scale in zip(self.walks, self.scale, strict=True)
        ]
        if not first:  # before jumps between passes are let go they tear at the passes
            self._learn_passes()
        self.model.learn(*now, first, {p.segment for _, p, _ in self.passes})

    def _learn_passes(self) -> None:
        """Student's t about what the passes of the same drive usually miss by, which is 1 at least."""
        free, prior = drives.PASS_FREEDOM, drives.SCALE_PRIOR_COUNT
        for d in self.said:
            own = [(e, self._misfit(p, e)) for name, p, e in self.passes if name == d]
            miss = np.array([c for _, c in own])
            # From the middle one, among imaginary passes that fit, so that the odd ones have no part in it.
            scale = max(float(np.median([*miss, *[1.0] * int(prior)])), 1.0)
            for _ in range(5):
                tail = (free + 1) / (free + miss / scale)
                accepted = np.minimum(1.0, drives.REJECT_SIGMAS**2 * scale / np.maximum(miss, 1e-9))
                scale = max(float(((tail * accepted) @ miss + prior) / (len(own) + prior)), 1.0)
            self.pass_scale[d] = scale
            for equation, c in own:
                scaled = c / self.pass_scale[d]
                limit = min(1.0, drives.REJECT_SIGMAS**2 / max(scaled, 1e-9))
                equation.weight = (free + 1) / (free + scaled) * limit / self.pass_scale[d]

    def _learn_walk(self, series: list[Equation], scale: float) -> float:
        """From the scale of the round before the next one's, and the weights."""
        squares = np.array([e.square(self.solution, self.covariance) for e in series])
        free, prior = drives.WALK_FREEDOM, drives.WALK_PRIOR_COUNT
        for _ in range(5):
            weight = (free + 1) / (free + squares / scale)
            scale = float((weight @ squares + prior) / (len(series) + prior)) if series else 1.0
        for one, square in zip(series, squares, strict=True):
            one.weight = (free + 1) / (free + square / scale) / scale
        return scale

    def _misfit(self, one: PassFactor, equation: Equation) -> float:
        """Chi-square of a pass for each of its measurements."""
        x = self.solution[equation.at]
        whole = one.square - 2 * equation.vector @ x + x @ equation.information @ x
        return float(max(whole, 0.0) / max(one.rows, 1))

    # What is published

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Slope and sigma of every row, percent."""
        slope, sigma = [], []
        for row, length in enumerate(self.length):
            own = self._own(row)
            x, spread = self.solution[own], self.covariance[np.ix_(own, own)]
            w = slope_row(0.0, float(length), float(length))
            variance = w @ spread @ w
            for moved in place_rows(np.array([length])):
                variance += shown.PLACE_SIGMA_M**2 * ((moved[0] @ x) ** 2 + moved[0] @ spread @ moved[0])
            turned = 1 - np.exp(-length / shown.LANE_LENGTH_M)
            variance += 2 * turned * (shown.LANE_SIGMA_M / length) ** 2
            slope.append(100 * float(w @ x))
            sigma.append(100 * float(np.sqrt(variance)))
        return np.array(slope), np.array(sigma)

    def accepted(self) -> list[bool]:
        """Whether each pass is, in the order of drives and of driving."""
        return [self._misfit(p, e) <= drives.REJECT_SIGMAS**2 for _, p, e in self.passes]


def slope_row(start_m: float, end_m: float, length_m: float) -> Floats:
    """``slope_rows`` for one segment: shape (variables,)."""
    row: Floats = slope_rows(*(np.array([v]) for v in (start_m, end_m, length_m)))[0]
    return row


def smoothness(length_m: float, roughness: ArrayLike) -> Floats:
    """Information matrix (variables, variables) of a grade that is a random walk of variance q per metre.

    ``roughness`` is q (1/m), one for the segment or one an interval.
    """
    intervals = int(interval_count(length_m))
    d = length_m / intervals
    out = np.zeros((2 * intervals + 2, 2 * intervals + 2))
    block = smoothness_block(d)
    for j, q in enumerate(np.broadcast_to(np.asarray(roughness, float), (intervals,))):
        out[2 * j : 2 * j + 4, 2 * j : 2 * j + 4] += block / q
    return out
