"""The heights of a road network from all drives together: one sparse least-squares solution.

Unknowns are heights and grades at the knots of every segment (``fusion.network.curve``), a height at every node, and
what each drive carries along (``fusion.network.unknowns``). The idea is geodesy's network adjustment. Heavy tails are
Student's t, found in rounds of reweighting: of the road's roughness, of the agreement at nodes, of whole passes, and of
a height sensor's way from one pass to the next. Sensors are not known here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.network.curve import place_rows, slope_rows, smoothness_block
from fusion.network.equations import Blocks, EquationSystem, Solution
from fusion.network.joints import couplings
from fusion.network.pass_factor import CONSTANT_SIGMA, ENTRY, EXIT, HEIGHT_SENSORS, LAG, PassFactor
from fusion.network.terrain import Terrain, TerrainBlocks
from fusion.network.unknowns import DriveUnknowns, RoadUnknowns
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

ROUNDS = 4
DEFAULT_ROUGHNESS = 3e-5
ROUGHNESS_BOUNDS = (3e-7, 1e-3)
ROUGHNESS_FREEDOM = 3.0
ROUGHNESS_START = 3.0
STRUCTURE_FACTOR = 0.1
NODE_SIGMA_M = 0.2
NODE_FREEDOM = 2.0
PASS_FREEDOM = 4.0
WALK_FREEDOM = 2.0
WALK_PRIOR_COUNT = 10.0
START_SIGMA_M = (30.0, 300.0)
GRADE_SIGMA = 0.2
PLACE_SIGMA_M = 2.0
LAG_MEAN_S = (1.5, 1.0)
LAG_SIGMA_S = 2.0
REJECT_SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Slopes of whole segments, shape (n,), positive from from_node to to_node, and what they rest on."""

    slope_percent: Floats
    slope_sigma_percent: Floats
    driven_share: Floats
    observations: Ints
    passes: Ints
    rejected: Ints
    heard: dict[tuple[int, int], bool]
    """Whether each pass, by drive and sequence, agrees with the solution"""
    lag_s: dict[int, float]
    lag_mean_s: float
    solution: Solution
    unknowns: RoadUnknowns
    model: TerrainBlocks | None


class _Road:
    """What is believed of roads: nodes agree, grades go on, and walk at random in between."""

    def __init__(self, network: RoadTable, passes: Sequence[PassFactor]) -> None:
        self.unknowns = u = RoadUnknowns(network)
        rows = np.arange(len(network))
        ends = [np.column_stack([node, u.end(rows, np.full(len(rows), at))]) for node, at in ((u.start_node, False), (u.end_node, True))]
        self.ties = Blocks.of_rows(np.concatenate(ends), np.array([-1.0, 1.0]), 0.0, NODE_SIGMA_M**2)
        c = couplings(network)
        pair = np.column_stack([u.end(c.row_a, c.end_a) + 1, u.end(c.row_b, c.end_b) + 1])
        sign = np.column_stack([np.ones(len(pair)), np.where(c.end_a == c.end_b, 1.0, -1.0)])
        self.fixed = [Blocks.of_rows(pair, sign, 0.0, c.sigma**2)]
        self.roughness: list[Blocks] = []
        self.factor: list[Floats] = []
        for mine in u.by_intervals():
            variables, n = u.variables(mine), int(u.intervals[mine[0]])
            weak = np.diag(np.tile([1e-10, GRADE_SIGMA**-2], n + 1)) + 1e-12  # every pair of a segment shares an equation
            self.fixed.append(Blocks(variables, np.broadcast_to(weak, (len(mine), *weak.shape)), np.zeros(variables.shape), np.ones(len(mine))))
            unit = np.array([smoothness_block(d) for d in u.length_m[mine] / n])
            for j in range(n):
                self.roughness.append(Blocks(variables[:, 2 * j : 2 * j + 4], unit, np.zeros((len(mine), 4)), np.ones(len(mine))))
                self.factor.append(np.where(u.structure[mine], STRUCTURE_FACTOR, 1.0))
        learned = [DEFAULT_ROUGHNESS, *(p.roughness for p in passes)]
        self.usual = float(np.clip(np.exp(np.mean(np.log(learned[1:] or learned))), *ROUGHNESS_BOUNDS))
        self._begin = self.usual
        for one, factor in zip(self.roughness, self.factor, strict=True):
            one.weight = 1 / (2 * ROUGHNESS_START * self.usual * factor)

    def blocks(self) -> list[Blocks]:
        return [*self.fixed, self.ties, *self.roughness]

    def learn(self, solution: Solution) -> None:
        """Weigh ties and intervals by what the solution says that they do; and the usual roughness itself."""
        squares = self.ties.expected_squares(solution)
        self.ties.weight = (NODE_FREEDOM + 1) / (NODE_FREEDOM + squares)
        change = [np.maximum(b.expected_squares(solution), 0.0) / f for b, f in zip(self.roughness, self.factor, strict=True)]
        whole = np.concatenate(change)
        for _ in range(5):
            weight = (ROUGHNESS_FREEDOM + 2) / (ROUGHNESS_FREEDOM + whole / self.usual)
            self.usual = float((np.sum(weight * whole) + 20 * self._begin) / (2 * len(whole) + 20))
        for one, c, f in zip(self.roughness, change, self.factor, strict=True):
            one.weight = (ROUGHNESS_FREEDOM + 2) / (ROUGHNESS_FREEDOM * self.usual + c) / f


class _Drives:
    """What all drives say: their passes, and how the errors that they carry along hang together."""

    def __init__(self, drives: Mapping[int, Sequence[PassFactor]], road: RoadUnknowns) -> None:
        self.names = sorted(drives)
        self.passes = {d: sorted(drives[d], key=lambda p: p.sequence) for d in self.names}
        size = road.size
        self.unknowns: dict[int, DriveUnknowns] = {}
        for d in self.names:
            self.unknowns[d] = DriveUnknowns(self.passes[d], size)
            size = self.unknowns[d].end
        lags = [u.lag for u in self.unknowns.values() if u.lag is not None]
        self.lag_mean = size if lags else None
        self.size = size + bool(lags)
        self.fixed = self._beliefs(lags)
        self.walks = self._walks()
        self.groups = self._groups(road)

    def _beliefs(self, lags: list[int]) -> list[Blocks]:
        out = []
        for u in self.unknowns.values():
            kinds = np.array(list(u.constants.items()), np.int64).reshape(-1, 2)
            kinds = kinds[kinds[:, 1] != LAG]
            sigma = np.array(CONSTANT_SIGMA)[kinds[:, 1]]
            out.append(Blocks.of_rows(kinds[:, :1], np.ones((len(kinds), 1)), 0.0, sigma**2))
            for s in range(len(HEIGHT_SENSORS)):
                first = u.of_pass[u.of_pass[:, ENTRY.start + s] >= 0, ENTRY.start + s][:1]
                out.append(Blocks.of_rows(first[:, None], np.ones((len(first), 1)), 0.0, START_SIGMA_M[s] ** 2))
        if lags:
            out.append(Blocks.of_rows(np.array([[self.lag_mean]]), np.ones((1, 1)), LAG_MEAN_S[0], LAG_MEAN_S[1] ** 2))
            pairs = np.column_stack([lags, np.full(len(lags), self.lag_mean)])
            out.append(Blocks.of_rows(pairs, np.array([1.0, -1.0]), 0.0, LAG_SIGMA_S**2))
        return [b for b in out if len(b.variables)]

    def _walks(self) -> Blocks:
        """From one pass to the next an error walks on; over a second, where the passes meet."""
        pairs, variance, series = [np.empty((0, 2), np.int64)], [np.empty(0)], [np.empty(0, np.int64)]
        for d in self.names:
            u, passes = self.unknowns[d], self.passes[d]
            for s in range(len(HEIGHT_SENSORS)):
                before, after = u.joints(s)
                pairs.append(np.column_stack([u.of_pass[before, EXIT.start + s], u.of_pass[after, ENTRY.start + s]]))
                apart = [max(passes[b].first_time_s - passes[a].last_time_s, 0.0) + 1.0 for a, b in zip(before, after, strict=True)]
                rate = [passes[b].walk_m2_per_s[s] for b in after]
                variance.append(np.array(apart) * np.array(rate))
                series.append(np.full(len(before), len(series)))
        self.walk_series = np.concatenate(series)
        self.walk_scale = np.ones(len(series) + 1)
        return Blocks.of_rows(np.concatenate(pairs), np.array([-1.0, 1.0]), 0.0, np.concatenate(variance))

    def _groups(self, road: RoadUnknowns) -> list[tuple[list[tuple[int, int]], Blocks, Floats, Floats]]:
        """Passes with equal numbers of unknowns: which, their blocks, squares and numbers of measurements."""
        by_size: dict[tuple[int, bytes], list[tuple[int, int]]] = {}
        for d in self.names:
            for k, one in enumerate(self.passes[d]):
                by_size.setdefault((len(one.vector), one.used.tobytes()), []).append((d, k))
        out = []
        for members in by_size.values():
            factors = [self.passes[d][k] for d, k in members]
            knots = len(factors[0].vector) - factors[0].used.size
            kept = np.concatenate([np.ones(knots, bool), factors[0].used])
            own = np.array([self.unknowns[d].of_pass[k][factors[0].used] for d, k in members]).reshape(len(members), -1)
            rows = np.array([f.segment for f in factors])
            blocks = Blocks(
                np.concatenate([road.variables(rows), own], axis=1),
                np.array([f.information[np.ix_(kept, kept)] for f in factors]),
                np.array([f.vector[kept] for f in factors]),
                np.ones(len(members)),
            )
            out.append((members, blocks, np.array([f.square for f in factors]), np.array([max(f.rows, 1) for f in factors], float)))
        return out

    def blocks(self) -> list[Blocks]:
        return [*self.fixed, self.walks, *(b for _, b, _, _ in self.groups)]

    def learn(self, solution: Solution) -> None:
        if len(self.walks.variables):
            self._learn_walks(self.walks.expected_squares(solution))
        for (_, blocks, square, rows), misfit in zip(self.groups, self.misfits(solution), strict=True):
            del square, rows
            blocks.weight = _pass_weight(misfit)

    def _learn_walks(self, squares: Floats) -> None:
        """How much each drive's errors walk beyond what it knew of itself, and where they jump."""
        series = self.walk_series
        for _ in range(5):
            weight = (WALK_FREEDOM + 1) / (WALK_FREEDOM + squares / self.walk_scale[series])
            total = np.bincount(series, weight * squares, minlength=len(self.walk_scale))
            count = np.bincount(series, minlength=len(self.walk_scale))
            self.walk_scale = (total + WALK_PRIOR_COUNT) / (count + WALK_PRIOR_COUNT)
        self.walks.weight = (WALK_FREEDOM + 1) / (WALK_FREEDOM + squares / self.walk_scale[series]) / self.walk_scale[series]

    def misfits(self, solution: Solution) -> list[Floats]:
        """Chi-square of each pass for each of its measurements, group by group."""
        return [
            np.maximum(square - 2 * np.sum(b.vector * solution.x[b.variables], axis=1) + b.squares(solution.x), 0.0) / rows
            for _, b, square, rows in self.groups
        ]


def _pass_weight(misfit: Floats) -> Floats:
    weight = (PASS_FREEDOM + 1) / (PASS_FREEDOM + misfit)
    return np.asarray(weight * np.minimum(1.0, REJECT_SIGMAS**2 / np.maximum(misfit, 1e-9)))


def adjust(network: RoadTable, drives: Mapping[int, Sequence[PassFactor]], terrain: Terrain | None = None) -> Adjustment:
    """Solve a network; ``PassFactor.segment`` are its rows, the keys of ``drives`` any numbers that differ."""
    everything = [p for d in sorted(drives) for p in drives[d]]
    road = _Road(network, everything)
    said = _Drives(drives, road.unknowns)
    driven = np.zeros(len(network), bool)
    driven[[p.segment for p in everything]] = True
    model = None if terrain is None else TerrainBlocks(road.unknowns, terrain, driven)
    last = np.array([] if said.lag_mean is None else [said.lag_mean], np.int64)
    system = EquationSystem(said.size, [*road.blocks(), *said.blocks(), *(model.blocks() if model else [])], last)
    for number in range(ROUNDS):
        solution = system.solve()
        if number < ROUNDS - 1:
            road.learn(solution)
            said.learn(solution)
            if model:
                model.learn(solution, number == 0)
    return _published(network, road, said, model, solution)


def _published(network: RoadTable, road: _Road, said: _Drives, model: TerrainBlocks | None, solution: Solution) -> Adjustment:
    u = road.unknowns
    slope, sigma = np.full(len(network), np.nan), np.full(len(network), np.nan)
    for mine in u.by_intervals():
        variables, length = u.variables(mine), u.length_m[mine]
        covariance, x = solution.equations.covariance(variables), solution.x[variables]
        rows = slope_rows(np.zeros(len(mine)), length, length)
        variance = np.einsum("mi,mij,mj->m", rows, covariance, rows)
        for moved in place_rows(length):
            variance += PLACE_SIGMA_M**2 * (np.sum(moved * x, axis=1) ** 2 + np.einsum("mi,mij,mj->m", moved, covariance, moved))
        slope[mine], sigma[mine] = 100 * np.sum(rows * x, axis=1), 100 * np.sqrt(variance)
    heard: dict[tuple[int, int], bool] = {}
    counts = np.zeros((3, len(network)), np.int64)
    cover: list[list[tuple[float, float]]] = [[] for _ in range(len(network))]
    for (members, _, _, _), misfit in zip(said.groups, said.misfits(solution), strict=True):
        for (d, k), good in zip(members, (misfit <= REJECT_SIGMAS**2).tolist(), strict=True):
            factor = said.passes[d][k]
            heard[d, factor.sequence] = good
            counts[1 if good else 2, factor.segment] += 1
            if good:
                counts[0, factor.segment] += factor.observations
                cover[factor.segment].append((factor.start_m, factor.end_m))
    share = np.array([_covered(parts) for parts in cover]) / u.length_m
    lags = {d: float(solution.x[q.lag]) for d, q in said.unknowns.items() if q.lag is not None}
    mean = np.nan if said.lag_mean is None else float(solution.x[said.lag_mean])
    return Adjustment(slope, sigma, np.minimum(share, 1.0), *counts, heard, lags, mean, solution, u, model)


def _covered(parts: Sequence[tuple[float, float]]) -> float:
    """Length of the union of stretches, m."""
    total, reach = 0.0, -np.inf
    for start, end in sorted(parts):
        total += max(end - max(start, reach), 0.0)
        reach = max(reach, end)
    return total
