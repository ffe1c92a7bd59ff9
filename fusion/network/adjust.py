"""The slopes of a road network from all drives together: one sparse least-squares solution for the heights.

Unknowns are the heights and grades at the knots of ``fusion.network.curve`` along each segment, and a height at every
node, at which the segments that meet there roughly agree. Every drive's passes enter as likelihoods
(``fusion.network.evidence``), the smoothness of roads enters once, the elevation model as a weak slope. The idea is
geodesy's network adjustment; ``benchmarks/adjustment.py`` measures how it grows. Drives and sensors are not known here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from fusion.filters.sparse_inverse import NormalEquations
from fusion.network.curve import slope_rows, smoothness_block
from fusion.network.equations import EquationSystem, Unknowns
from fusion.network.evidence import SegmentEvidence
from fusion.network.joints import couplings
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

DEFAULT_ROUGHNESS = 3e-5
"""Variance of the grade's change per metre where no drive has learned it: between flat towns and hills."""

ROUGHNESS_BOUNDS = (3e-7, 1e-3)
"""The flattest of towns and the roughest of tracks."""

ROUGHNESS_FACTOR = 2.0
"""Grades change more at a few places than elsewhere: a drive's likelihood finds the quiet stretches' strength."""
STRUCTURE_FACTOR = 0.1
"""Bridges and tunnels are built smoother than the roads to them."""
TAIL_FREEDOM = 2.0
TAIL_ROUNDS = 3
TAIL_START = 10.0
"""Changes of grade follow Student's t with so many degrees of freedom (kinks, kerbs), found in so many rounds, which
begin with a prior so many times weaker: what is smoothed away at first is never found again."""

GRADE_PRIOR_SIGMA = 0.2
"""One sigma of the weak belief that a road's grade is near 0; keeps unmeasured unknowns in bounds."""

RIDGE = 1e-10
"""Share of the diagonal that is added where rounding has left the equations not quite positive definite."""

DEM_SIGMA_PERCENT = 6.0
DEM_LENGTH_M = 90.0
"""A DEM's slope is this wrong over a stretch of the spacing of its posts; over longer ones less, in proportion."""

NODE_SIGMA_M = 2.0
"""How well the heights of segments agree where they meet. Camber and lanes are centimetres; the rest lets go of loops:
around a block small errors that all drives share sum up, and a drive would change slopes a mile away (measured: nothing
is lost but a little on logs that have nothing except heights)."""

SIGMA_FLOOR_PERCENT = 0.18
"""What the definition of a segment's slope leaves open, however often it is driven (spec 7: 0.12 to 0.18 %)."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Slopes of the rows of a window, shape (n,), positive from from_node to to_node.

    ``observations`` and ``passes`` count what was accepted, ``rejected`` the passes that were not; gaps have 0.
    """

    slope_percent: Floats
    slope_sigma_percent: Floats
    observations: Ints
    passes: Ints
    rejected: Ints


def adjust(
    network: RoadTable,
    evidence: Sequence[SegmentEvidence | None],
    dem_slope_percent: Floats,
    ids: Ints | None = None,
) -> Adjustment:
    """Solve a window of the network.

    ``evidence`` has one entry a row, None for a gap between driven ones, which gets a slope as well;
    ``dem_slope_percent`` has shape (n,), NaN unknown; ``ids`` says what the segments inside the evidence refer to (by
    default the rows' numbers). What a factor says conditional on segments outside the window is marginalised.
    """
    n = len(network)
    if not n:
        return Adjustment(np.empty(0), np.empty(0), *(np.empty(0, np.int64) for _ in range(3)))
    unknowns = Unknowns(network)
    row_of = {int(i): row for row, i in enumerate(np.arange(n) if ids is None else ids)}
    known = [None if e is None or not e.accepted.any() else e for e in evidence]
    system = EquationSystem(unknowns.size)
    _add_nodes(system, unknowns, network)
    _add_dem(system, unknowns, network, dem_slope_percent)
    _add_bounds(system, unknowns)
    for one in known:
        for history, (information, vector) in () if one is None else one.groups.items():
            _add_factor(system, unknowns, [row_of.get(s, -1) for s in history], information, vector)
    equations, solution = _solve(system, _RoughnessPrior(unknowns, known))
    slope, sigma = _slopes(equations, solution, unknowns, known)
    counts = [(0, 0, 0) if e is None else _pass_counts(e) for e in evidence]
    observations, passes, rejected = np.array(counts, np.int64).reshape(n, 3).T
    return Adjustment(slope, sigma, observations, passes, rejected)


def _pass_counts(evidence: SegmentEvidence) -> tuple[int, int, int]:
    """Observations, accepted passes and rejected passes of a segment."""
    accepted = evidence.accepted
    return evidence.observations if accepted.any() else 0, int(accepted.sum()), int((~accepted).sum())


class _RoughnessPrior:
    """The one smoothness prior: grades are random walks whose strength the drives have learned, with heavy tails."""

    def __init__(self, unknowns: Unknowns, evidence: Sequence[SegmentEvidence | None]) -> None:
        learned = [DEFAULT_ROUGHNESS if e is None else e.roughness for e in evidence]
        usual = ROUGHNESS_FACTOR * np.clip(learned, *ROUGHNESS_BOUNDS)
        usual = np.where(unknowns.structure, STRUCTURE_FACTOR * usual, usual)
        self._parts = []
        for intervals in np.unique(unknowns.intervals).tolist():
            rows = unknowns.rows_with(intervals)
            variables = unknowns.variables(rows)
            unit = np.array([smoothness_block(d) for d in unknowns.length_m[rows] / intervals])
            for j in range(intervals):
                self._parts.append((variables[:, 2 * j : 2 * j + 4], unit, usual[rows]))
        self._strength = [TAIL_START * usual for _, _, usual in self._parts]

    def add_to(self, system: EquationSystem) -> None:
        """Add the prior at its present strength."""
        for (variables, unit, _), strength in zip(self._parts, self._strength, strict=True):
            system.add(variables, unit / strength[:, None, None])

    def learn(self, equations: NormalEquations, solution: Floats) -> None:
        """Strengthen or weaken each interval by what the solution says that its grade does there (EM)."""
        for k, (variables, unit, usual) in enumerate(self._parts):
            x = solution[variables]
            change = np.einsum("mi,mij,mj->m", x, unit, x)
            change += np.einsum("mij,mji->m", unit, equations.covariance(variables))
            self._strength[k] = (TAIL_FREEDOM * usual + np.maximum(change, 0.0)) / (TAIL_FREEDOM + 2)


def _solve(system: EquationSystem, roughness: _RoughnessPrior) -> tuple[NormalEquations, Floats]:
    """The solution with the strength of the prior found on the way."""
    order: Ints | None = None
    for last in [False] * TAIL_ROUNDS + [True]:
        whole = system.copy()
        roughness.add_to(whole)
        equations = _factorised(whole.matrix(), order)
        order = equations.order
        solution = equations.solve(whole.vector)
        if not last:
            roughness.learn(equations, solution)
    return equations, solution


def _factorised(matrix: scipy.sparse.csc_matrix, order: Ints | None) -> NormalEquations:
    """The factorised equations; rounding in long sums of factors may ask for a hair more."""
    try:
        return NormalEquations(matrix, order)
    except ValueError:
        matrix.setdiag((1 + RIDGE) * matrix.diagonal())
        return NormalEquations(matrix, order)


def _add_bounds(system: EquationSystem, unknowns: Unknowns) -> None:
    """Weakly believe that roads are not steep; all of a segment's unknowns meet here, so that covariances are found."""
    for intervals in np.unique(unknowns.intervals).tolist():
        variables = unknowns.variables(unknowns.rows_with(intervals))
        block = np.diag(np.tile([0.0, GRADE_PRIOR_SIGMA**-2], intervals + 1))
        system.add(variables, np.broadcast_to(block, (len(variables), *block.shape)))


def _add_nodes(system: EquationSystem, unknowns: Unknowns, network: RoadTable) -> None:
    """At a node heights meet and the grade goes on, the less surely the sharper the turn."""
    rows = np.arange(len(network))
    for node, at_end in ((unknowns.start_node, False), (unknowns.end_node, True)):
        heights = unknowns.end(rows, np.full(len(rows), at_end))
        _add_differences(system, node, heights, -np.ones(len(rows)), np.full(len(rows), NODE_SIGMA_M))
    c = couplings(network)
    sign = np.where(c.end_a == c.end_b, 1.0, -1.0)
    _add_differences(
        system, unknowns.end(c.row_a, c.end_a) + 1, unknowns.end(c.row_b, c.end_b) + 1, sign, c.sigma
    )


def _add_differences(system: EquationSystem, a: Ints, b: Ints, sign: Floats, sigma: Floats) -> None:
    """Observations x_a + sign * x_b = 0."""
    blocks = np.empty((len(a), 2, 2))
    blocks[:, 0, 0] = blocks[:, 1, 1] = sigma**-2
    blocks[:, 0, 1] = blocks[:, 1, 0] = sign * sigma**-2
    system.add(np.column_stack([a, b]), blocks)


def _add_dem(
    system: EquationSystem, unknowns: Unknowns, network: RoadTable, dem_slope_percent: Floats
) -> None:
    """The DEM's slope as a weak observation, not on structures nor beside them."""
    structure = network.bridge | network.tunnel
    touched = np.zeros(unknowns.nodes, bool)
    touched[unknowns.start_node[structure]] = touched[unknowns.end_node[structure]] = True
    beside = touched[unknowns.start_node] | touched[unknowns.end_node]
    use = np.isfinite(dem_slope_percent) & ~structure & ~beside
    rows = np.flatnonzero(use)
    length = unknowns.length_m[rows]
    share = DEM_LENGTH_M / length
    sigma = DEM_SIGMA_PERCENT / 100 * np.where(share > 1, np.sqrt(share), share)
    design = np.column_stack([-1 / length, 1 / length])
    weight = sigma**-2
    system.add(
        np.column_stack([unknowns.end(rows, np.full(len(rows), at_end)) for at_end in (False, True)]),
        weight[:, None, None] * design[:, :, None] * design[:, None, :],
        (weight * dem_slope_percent[rows] / 100)[:, None] * design,
    )


def _add_factor(
    system: EquationSystem, unknowns: Unknowns, rows: list[int], information: Floats, vector: Floats
) -> None:
    inside = [row >= 0 for row in rows]
    if not all(inside):
        information, vector, rows = _without_history(unknowns, rows, information, vector)
    if rows:
        variables = np.concatenate([unknowns.variables(np.array([row]))[0] for row in rows])
        system.add(variables[None, :], information[None], vector[None])


def _without_history(
    unknowns: Unknowns, rows: list[int], information: Floats, vector: Floats
) -> tuple[Floats, Floats, list[int]]:
    """Marginalise the history of a factor; its own segment stays, if it is in the window."""
    if rows[-1] < 0:
        return information, vector, []
    own = 2 * int(unknowns.intervals[rows[-1]]) + 2
    a, b, d = information[-own:, -own:], information[-own:, :-own], information[:-own, :-own]
    # The history's heights are known up to their level only: the ridge is far below any information.
    ridge = (1e-9 * np.trace(information) + 1e-30) * np.eye(len(d))
    solved = np.linalg.solve(d + ridge, np.column_stack([b.T, vector[:-own]]))
    return a - b @ solved[:, :-1], vector[-own:] - b @ solved[:, -1], [rows[-1]]


def _slopes(
    equations: NormalEquations,
    solution: Floats,
    unknowns: Unknowns,
    evidence: Sequence[SegmentEvidence | None],
) -> tuple[Floats, Floats]:
    """Slope and sigma of every row, over its driven part where it was driven."""
    slope, sigma = np.full(len(evidence), np.nan), np.full(len(evidence), np.nan)
    for intervals in np.unique(unknowns.intervals).tolist():
        rows = unknowns.rows_with(intervals)
        variables = unknowns.variables(rows)
        weights = _slope_weights([evidence[r] for r in rows], unknowns.length_m[rows])
        covariance = equations.covariance(variables)
        slope[rows] = 100 * np.sum(weights * solution[variables], axis=1)
        variance = np.einsum("mi,mij,mj->m", weights, covariance, weights)
        birge = np.array([1.0 if e is None else e.birge_ratio for e in (evidence[r] for r in rows)])
        sigma[rows] = np.hypot(100 * birge * np.sqrt(np.maximum(variance, 0.0)), SIGMA_FLOOR_PERCENT)
    return slope, sigma


def _slope_weights(evidence: Sequence[SegmentEvidence | None], length_m: Floats) -> Floats:
    """Rows that yield the slopes over the driven parts; over the whole where there is none worth the name."""
    part = np.array([(0.0, np.inf) if e is None else e.driven for e in evidence])
    start, end = np.clip(part[:, 0], 0.0, length_m), np.clip(part[:, 1], 0.0, length_m)
    short = end - start < np.minimum(1.0, 0.5 * length_m)
    return slope_rows(np.where(short, 0.0, start), np.where(short, length_m, end), length_m)
