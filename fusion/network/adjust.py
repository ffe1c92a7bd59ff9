"""The slopes of a road network from all drives together: one sparse least-squares solution for the heights.

Unknowns are the heights and grades at the knots of ``fusion.network.curve`` along each segment, and a height at every
node, at which the segments that meet there roughly agree. Every drive's passes enter as likelihoods
(``fusion.network.evidence``), the smoothness of roads enters once, the elevation model as a weak slope. The idea is
geodesy's network adjustment; what it buys over averaging slopes is in ``spec/7-slope-notes``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fusion.filters.sparse_inverse import NormalEquations
from fusion.network.curve import interval_count, knot_length, slope_rows, smoothness_block
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

STEEPEST = 0.2
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

FLOOR_PERCENT = 0.18
"""What the definition of a segment's slope leaves open, however often it is driven (spec 7: 0.12 to 0.18 %)."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Slopes of the rows of a window, shape (n,), positive from from_node to to_node.

    ``observations``, ``passes`` and ``rejected`` count what was heard and what was not; gaps have 0.
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
    layout = _Layout(network)
    row_of = {int(i): row for row, i in enumerate(np.arange(n) if ids is None else ids)}
    known = [None if e is None or not e.accepted.any() else e for e in evidence]
    system = _System(layout.size)
    _add_nodes(system, layout, network)
    _add_dem(system, layout, network, dem_slope_percent)
    _add_bounds(system, layout)
    for one in known:
        for history, (information, vector) in () if one is None else one.groups.items():
            _add_factor(system, layout, [row_of.get(s, -1) for s in history], information, vector)
    equations, solution = _solve(system, _Roughness(layout, known))
    slope, sigma = _slopes(equations, solution, layout, known)
    counts = [(0, 0, 0) if e is None else _counts(e) for e in evidence]
    observations, passes, rejected = np.array(counts, np.int64).reshape(n, 3).T
    return Adjustment(slope, sigma, observations, passes, rejected)


def _counts(evidence: SegmentEvidence) -> tuple[int, int, int]:
    heard = evidence.accepted
    return evidence.observations if heard.any() else 0, int(heard.sum()), int((~heard).sum())


class _Layout:
    """Where each segment's knot variables stand among the unknowns."""

    def __init__(self, network: RoadTable) -> None:
        self.length_m = knot_length(network.length_m)
        self.structure = network.bridge | network.tunnel
        self.intervals = interval_count(self.length_m)
        ends = np.concatenate([network.from_node, network.to_node])
        _, node = np.unique(ends, return_inverse=True)
        self.start_node, self.end_node = node[: len(network)], node[len(network) :]
        self.nodes = int(node.max()) + 1
        self.count = 2 * (self.intervals + 1)
        self.first = self.nodes + np.concatenate([[0], np.cumsum(self.count)[:-1]])
        self.size = self.nodes + int(self.count.sum())

    def rows_with(self, intervals: int) -> Ints:
        """Segments with so many intervals."""
        return np.flatnonzero(self.intervals == intervals)

    def variables(self, rows: Ints) -> Ints:
        """Unknowns (m, 2 * intervals + 2) of segments with equal numbers of intervals, in the order of the knots."""
        return np.asarray(self.first[rows][:, None] + np.arange(int(self.count[rows[0]])))

    def end(self, rows: Ints, at_end: NDArray[np.bool_]) -> Ints:
        """The unknown that is the height at the start or the end of each row; its grade is the next."""
        return np.where(at_end, self.first[rows] + self.count[rows] - 2, self.first[rows])


class _System:
    """Normal equations under construction."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.vector = np.zeros(size)
        self._parts: list[tuple[Ints, Ints, Floats]] = []

    def add(self, variables: Ints, blocks: Floats, vectors: Floats | None = None) -> None:
        """Add blocks (m, k, k) over unknowns (m, k), and right-hand sides (m, k)."""
        k = variables.shape[1]
        self._parts.append(
            (np.repeat(variables, k, axis=1).ravel(), np.tile(variables, (1, k)).ravel(), blocks.ravel())
        )
        if vectors is not None:
            np.add.at(self.vector, variables, vectors)

    def copy(self) -> _System:
        """Another system that begins with the same equations."""
        other = _System(self.size)
        other.vector, other._parts = self.vector.copy(), list(self._parts)
        return other

    def matrix(self) -> scipy.sparse.csc_matrix:
        """The sum, with a weak hold on the level of each connected part, which no difference of heights fixes."""
        rows, columns, values = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        matrix = scipy.sparse.csc_matrix((values, (rows, columns)), shape=(self.size, self.size))
        _, part = scipy.sparse.csgraph.connected_components(matrix, directed=False)
        _, first = np.unique(part, return_index=True)
        # In place: a sum of sparse matrices would drop entries that happen to be 0, and their covariances with them.
        diagonal = matrix.diagonal()
        diagonal[first] += 1.0
        matrix.setdiag(diagonal)
        return matrix


class _Roughness:
    """The one smoothness prior: grades are random walks whose strength the drives have learned, with heavy tails."""

    def __init__(self, layout: _Layout, evidence: Sequence[SegmentEvidence | None]) -> None:
        learned = [DEFAULT_ROUGHNESS if e is None else e.roughness for e in evidence]
        usual = ROUGHNESS_FACTOR * np.clip(learned, *ROUGHNESS_BOUNDS)
        usual = np.where(layout.structure, STRUCTURE_FACTOR * usual, usual)
        self._parts = []
        for intervals in np.unique(layout.intervals).tolist():
            rows = layout.rows_with(intervals)
            variables = layout.variables(rows)
            unit = np.array([smoothness_block(d) for d in layout.length_m[rows] / intervals])
            for j in range(intervals):
                self._parts.append((variables[:, 2 * j : 2 * j + 4], unit, usual[rows]))
        self._strength = [TAIL_START * usual for _, _, usual in self._parts]

    def add_to(self, system: _System) -> None:
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


def _solve(system: _System, roughness: _Roughness) -> tuple[NormalEquations, Floats]:
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


def _add_bounds(system: _System, layout: _Layout) -> None:
    """Weakly believe that roads are not steep; all of a segment's unknowns meet here, so that covariances are found."""
    for intervals in np.unique(layout.intervals).tolist():
        variables = layout.variables(layout.rows_with(intervals))
        block = np.diag(np.tile([0.0, STEEPEST**-2], intervals + 1))
        system.add(variables, np.broadcast_to(block, (len(variables), *block.shape)))


def _add_nodes(system: _System, layout: _Layout, network: RoadTable) -> None:
    """At a node heights meet and the grade goes on, the less surely the sharper the turn."""
    rows = np.arange(len(network))
    for node, at_end in ((layout.start_node, False), (layout.end_node, True)):
        heights = layout.end(rows, np.full(len(rows), at_end))
        _add_differences(system, node, heights, -np.ones(len(rows)), np.full(len(rows), NODE_SIGMA_M))
    c = couplings(network)
    sign = np.where(c.end_a == c.end_b, 1.0, -1.0)
    _add_differences(
        system, layout.end(c.row_a, c.end_a) + 1, layout.end(c.row_b, c.end_b) + 1, sign, c.sigma
    )


def _add_differences(system: _System, a: Ints, b: Ints, sign: Floats, sigma: Floats) -> None:
    """Observations x_a + sign * x_b = 0."""
    blocks = np.empty((len(a), 2, 2))
    blocks[:, 0, 0] = blocks[:, 1, 1] = sigma**-2
    blocks[:, 0, 1] = blocks[:, 1, 0] = sign * sigma**-2
    system.add(np.column_stack([a, b]), blocks)


def _add_dem(system: _System, layout: _Layout, network: RoadTable, dem_slope_percent: Floats) -> None:
    """The DEM's slope as a weak observation, not on structures nor beside them."""
    structure = network.bridge | network.tunnel
    touched = np.zeros(layout.nodes, bool)
    touched[layout.start_node[structure]] = touched[layout.end_node[structure]] = True
    beside = touched[layout.start_node] | touched[layout.end_node]
    use = np.isfinite(dem_slope_percent) & ~structure & ~beside
    rows = np.flatnonzero(use)
    length = layout.length_m[rows]
    share = DEM_LENGTH_M / length
    sigma = DEM_SIGMA_PERCENT / 100 * np.where(share > 1, np.sqrt(share), share)
    design = np.column_stack([-1 / length, 1 / length])
    weight = sigma**-2
    system.add(
        np.column_stack([layout.end(rows, np.full(len(rows), at_end)) for at_end in (False, True)]),
        weight[:, None, None] * design[:, :, None] * design[:, None, :],
        (weight * dem_slope_percent[rows] / 100)[:, None] * design,
    )


def _add_factor(
    system: _System, layout: _Layout, rows: list[int], information: Floats, vector: Floats
) -> None:
    inside = [row >= 0 for row in rows]
    if not all(inside):
        information, vector, rows = _without(layout, rows, information, vector)
    if rows:
        variables = np.concatenate([layout.variables(np.array([row]))[0] for row in rows])
        system.add(variables[None, :], information[None], vector[None])


def _without(
    layout: _Layout, rows: list[int], information: Floats, vector: Floats
) -> tuple[Floats, Floats, list[int]]:
    """Marginalise the history of a factor; its own segment stays, if it is in the window."""
    if rows[-1] < 0:
        return information, vector, []
    own = 2 * int(layout.intervals[rows[-1]]) + 2
    a, b, d = information[-own:, -own:], information[-own:, :-own], information[:-own, :-own]
    # The history's heights are known up to their level only: the ridge is far below any information.
    ridge = (1e-9 * np.trace(information) + 1e-30) * np.eye(len(d))
    solved = np.linalg.solve(d + ridge, np.column_stack([b.T, vector[:-own]]))
    return a - b @ solved[:, :-1], vector[-own:] - b @ solved[:, -1], [rows[-1]]


def _slopes(
    equations: NormalEquations, solution: Floats, layout: _Layout, evidence: Sequence[SegmentEvidence | None]
) -> tuple[Floats, Floats]:
    """Slope and sigma of every row, over its driven part where it was driven."""
    slope, sigma = np.full(len(evidence), np.nan), np.full(len(evidence), np.nan)
    for intervals in np.unique(layout.intervals).tolist():
        rows = layout.rows_with(intervals)
        variables = layout.variables(rows)
        weights = _weights([evidence[r] for r in rows], layout.length_m[rows])
        covariance = equations.covariance(variables)
        slope[rows] = 100 * np.sum(weights * solution[variables], axis=1)
        variance = np.einsum("mi,mij,mj->m", weights, covariance, weights)
        scatter = np.array([1.0 if e is None else e.scatter for e in (evidence[r] for r in rows)])
        sigma[rows] = np.hypot(100 * scatter * np.sqrt(np.maximum(variance, 0.0)), FLOOR_PERCENT)
    return slope, sigma


def _weights(evidence: Sequence[SegmentEvidence | None], length_m: Floats) -> Floats:
    """Rows that yield the slopes over the driven parts; over the whole where there is none worth the name."""
    part = np.array([(0.0, np.inf) if e is None else e.driven for e in evidence])
    start, end = np.clip(part[:, 0], 0.0, length_m), np.clip(part[:, 1], 0.0, length_m)
    short = end - start < np.minimum(1.0, 0.5 * length_m)
    return slope_rows(np.where(short, 0.0, start), np.where(short, length_m, end), length_m)
