"""An elevation model beside the drives: how far it may be believed is learned from where roads were driven.

Its error is an Ornstein-Uhlenbeck process along the roads: as large as ``sigma_m``, alike over ``length_m``. What
counts for slopes is how fast two places' errors part, ``sigma_m^2 / length_m``; it is taken from differences over one
knot spacing and over ``LONG_LAG_M``, whichever are worse: a coarse model errs in proportion to distance within its
posts. Where a model comes from is not known here.

Where a model stands out from itself (a tile on another datum, a void that was filled badly) is judged by heights of
roads that do not know it. All of them may count from another level than the model, so the model's own usual difference
is the measure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.arrays import counted
from fusion.messages import say
from fusion.network.equations import Blocks, Solution
from fusion.network.subnetwork import joined_parts
from fusion.network.unknowns import RoadUnknowns
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats

DISPLACED_M = 15.0
"""Errors up to here are ordinary ones: SRTM was made to be within 16 m in nine of ten places, and is within 9 m
(Rodriguez, Morris and Belz 2006)."""
DISPLACED_SIGMAS = 4.0
"""... and so are those within so many of the model's own sigmas along these roads."""
SHORTEST_M = 100.0
"""Over a shorter way it is a cutting, an embankment or a clump of trees."""
_MEDIAN_TO_SIGMA = 1.4826


class Displaced(NamedTuple):
    """Which of n places stand out to the same side, by how much the model is too high there, and along how far."""

    where: Bools
    off_m: float
    length_m: float

    def said(self, lat_deg: float, lon_deg: float) -> str:
        """A sentence for a report; the place is one of those that stand out."""
        side = "high" if self.off_m > 0 else "low"
        return say(
            "terrain.stands_out",
            off_m=abs(self.off_m),
            side=side,
            length_m=self.length_m,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
        )


def displaced(above_m: Floats, length_m: Floats) -> Displaced | None:
    """Where the model stands out, most of it; ``above_m`` (n,) is by how much it is above the roads' heights.

    ``length_m`` (n,): of how much road each is. Half of the places at least must agree with each other.
    """
    if not len(above_m):
        return None
    off = above_m - np.median(above_m)
    sigma = _MEDIAN_TO_SIGMA * float(np.median(np.abs(off)))
    least = max(DISPLACED_M, DISPLACED_SIGMAS * sigma)
    sides = [off > least, off < -least]
    where = max(sides, key=lambda side: float(np.sum(length_m[side])))
    far = float(np.sum(length_m[where]))
    if far < SHORTEST_M:
        return None
    # Against the others: the middle of all leans to those that stand out.
    return Displaced(where, float(np.median(off[where]) - np.median(off[~where])), far)


DEFAULT_SIGMA_M, DEFAULT_LENGTH_M = 7.5, 300.0
"""An SRTM's, where nothing was driven: its rises are wrong by 5.4 m over 90 m (spec 7: 6 %)."""
SIGMA_BOUNDS_M = (0.3, 100.0)
LONG_LAG_M = 100.0
PRIOR_PAIRS = 8.0
"""Imaginary pairs of places that hold what is learned to the default."""
SOUND_GRADE = 0.015
"""Rises that the drives alone know better than this over their length may judge a model."""
STEP_FREEDOM = 2.0
"""A model has edges: differences from knot to knot have heavy tails."""
_MEDIAN_OF_SQUARE = 0.455


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights of an elevation model at the knots of all segments, one segment after another, m (NaN unknown)."""

    height_m: Floats
    sigma_m: float = DEFAULT_SIGMA_M
    length_m: float = DEFAULT_LENGTH_M


class TerrainBlocks:
    """The model's part in the equations: without weight until ``learn`` has seen what the drives say alone."""

    def __init__(self, unknowns: RoadUnknowns, terrain: Terrain, driven: Bools) -> None:
        self.terrain = terrain
        touched = np.zeros(unknowns.nodes, bool)
        structure = unknowns.structure
        touched[unknowns.start_node[structure]] = touched[unknowns.end_node[structure]] = True
        clear = ~(structure | touched[unknowns.start_node] | touched[unknowns.end_node])
        first = np.concatenate([[0], np.cumsum(unknowns.intervals + 1)])
        self._unknowns, self._first, self._clear, self._driven = unknowns, first, clear, driven
        rows, step = counted(unknowns.intervals)
        self._knot = first[rows] + step
        known = clear[rows] & np.isfinite(terrain.height_m[self._knot] + terrain.height_m[self._knot + 1])
        rows, step, self._knot = rows[known], step[known], self._knot[known]
        self._row = rows
        self.spacing_m = unknowns.length_m[rows] / unknowns.intervals[rows]
        start = unknowns.first[rows] + 2 * step
        pair = np.column_stack([start, start + 2])
        zero = np.zeros(len(rows))
        ends = np.column_stack([terrain.height_m[self._knot], terrain.height_m[self._knot + 1]])
        self._height_m, self._rise_m = ends.ravel(), ends[:, 1] - ends[:, 0]
        self.steps = Blocks.of_rows(pair, np.array([-1.0, 1.0]), self._rise_m, 1.0)
        self.level = Blocks.of_rows(pair.reshape(-1, 1), np.ones((2 * len(rows), 1)), self._height_m, 1.0)
        self.steps.weight, self.level.weight = zero.copy(), np.zeros(2 * len(rows))
        self.sigma_m, self.length_m = terrain.sigma_m, terrain.length_m
        self.tail = np.ones(len(rows))
        self.displaced: tuple[int, Displaced] | None = None
        """A driven segment on which the model stands out from itself, and how"""

    def blocks(self) -> list[Blocks]:
        """Differences from knot to knot, and heights."""
        return [self.steps, self.level]

    def learn(self, solution: Solution, first: bool) -> None:
        """Set the weights: after the ``first`` solution by what it says of the model, then only those of steps."""
        if not len(self._row):
            return
        if first:
            self._measure(solution)
            self.displaced = self._displaced(solution)
        error, own = self._step_errors(solution)
        usual = self._step_variance()
        # The first solution is without the model: both are uncertain of each other.
        misfit = error**2 / (usual + own) if first else (error**2 + own) / usual
        self.tail = (STEP_FREEDOM + 1) / (STEP_FREEDOM + misfit)
        spacing = self.spacing_m / self.length_m
        self.steps.weight = self.tail / (self._step_variance() * (STEP_FREEDOM + 3) / (STEP_FREEDOM + 1))
        ends = np.repeat((1 / np.tanh(spacing) - 1 / np.sinh(spacing)) / (2 * self.sigma_m**2), 2)
        self.level.weight = ends * self._level_tail(solution, first)

    def _level_tail(self, solution: Solution, first: bool) -> Floats:
        """Where the model is far from the roads, its height counts less than its differences may.

        The ``first`` solution, which is without the model, does not know how high roads are that nobody drove.
        """
        driven = np.repeat(self._driven[self._row], 2)
        error = self._height_m - solution.x[self.level.variables[:, 0]]
        if not driven.any():
            return np.ones(len(error))
        error -= np.median(error[driven])
        misfit = np.where(driven | (not first), np.square(error / self.sigma_m), 0.0)
        return np.asarray((STEP_FREEDOM + 1) / (STEP_FREEDOM + np.maximum(misfit, 1.0)))

    def remarks(self, network: RoadTable) -> list[str]:
        """A sentence where the model stands out from itself."""
        if self.displaced is None:
            return []
        row, outlier = self.displaced
        return [outlier.said(float(network.lat0_deg[row]), float(network.lon0_deg[row]))]

    def _displaced(self, solution: Solution) -> tuple[int, Displaced] | None:
        """The worst of all networks of driven roads that hang together: heights do not carry from one to another."""
        u, above = self._unknowns, self._height_m[::2] - solution.x[self.level.variables[::2, 0]]
        part = joined_parts(u.nodes, u.start_node[self._driven], u.end_node[self._driven])
        driven = np.flatnonzero(self._driven[self._row])
        part = part[u.start_node[self._row[driven]]]
        sentences = []
        for number in np.unique(part).tolist():
            mine = driven[part == number]
            one = displaced(above[mine], self.spacing_m[mine])
            if one is not None:
                sentences.append((int(self._row[mine[one.where][0]]), one))
        return max(sentences, key=lambda one: one[1].length_m, default=None)

    def _step_variance(self) -> Floats:
        return np.asarray(2 * self.sigma_m**2 * np.sinh(self.spacing_m / self.length_m))

    def _step_errors(self, solution: Solution) -> tuple[Floats, Floats]:
        """The differences' errors, m, and their variances under the solution, m^2."""
        pair = self.steps.variables
        error = np.diff(solution.x[pair], axis=1)[:, 0] - self._rise_m
        c = solution.equations.covariance(pair)
        return error, np.maximum(c[:, 0, 0] + c[:, 1, 1] - 2 * c[:, 0, 1], 0.0)

    def _measure(self, solution: Solution) -> None:
        driven = self._driven[self._row]
        pair = self.steps.variables
        height = self.terrain.height_m
        error, own = self._step_errors(solution)
        sound = driven & (own < np.square(SOUND_GRADE * self.spacing_m))
        if sound.sum() < PRIOR_PAIRS:
            return
        short = (error**2 - own)[sound] / (2 * self.spacing_m[sound])
        long = self._long(solution)
        default = DEFAULT_SIGMA_M**2 / DEFAULT_LENGTH_M
        rate = max(_shrunk(short, default), _shrunk(long, default))
        level = height[self._knot[driven]] - solution.x[pair[driven, 0]]
        if len(level):
            spread = 1.4826 * float(np.median(np.abs(level - np.median(level))))
            weight = len(level) / (len(level) + PRIOR_PAIRS)
            spread = spread**weight * DEFAULT_SIGMA_M ** (1 - weight)
            self.sigma_m = float(np.clip(spread, *SIGMA_BOUNDS_M))
        self.length_m = float(np.clip(self.sigma_m**2 / rate, 5.0, 1e5))

    def _long(self, solution: Solution) -> Floats:
        """Half the squared differences of the model's errors over about ``LONG_LAG_M``, for each metre."""
        u = self._unknowns
        good = self._clear & self._driven & self._sound_rows(solution)
        ends_m = [self._first[:-1], self._first[1:] - 1]
        rise = solution.x[u.end(np.arange(len(good)), np.ones(len(good), bool))] - solution.x[u.first]
        error = rise - (self.terrain.height_m[ends_m[1]] - self.terrain.height_m[ends_m[0]])
        good &= np.isfinite(error)
        at_node: dict[int, list[int]] = {}
        for row in np.flatnonzero(good).tolist():
            at_node.setdefault(int(u.start_node[row]), []).append(row)
            at_node.setdefault(int(u.end_node[row]), []).append(row)
        out = []
        for row in np.flatnonzero(good).tolist():
            out.append(_walk(row, u, error, at_node))
        return np.array([v for v in out if v is not None], float)

    def _sound_rows(self, solution: Solution) -> Bools:
        """Segments whose rise the drives know well enough to judge a model by."""
        u = self._unknowns
        ends = np.column_stack([u.first, u.end(np.arange(len(u.first)), np.ones(len(u.first), bool))])
        c = solution.equations.covariance(ends)
        own = c[:, 0, 0] + c[:, 1, 1] - 2 * c[:, 0, 1]
        return np.asarray(own < np.square(SOUND_GRADE * u.length_m), np.bool_)


def _walk(row: int, u: RoadUnknowns, error: Floats, at_node: dict[int, list[int]]) -> float | None:
    """Follow the road from a segment on until the lag is reached."""
    length, total, node, before = 0.0, 0.0, int(u.start_node[row]), -1
    here: int | None = row
    for _ in range(60):
        if here is None:
            return None
        forward = int(u.start_node[here]) == node
        total += float(error[here]) if forward else -float(error[here])
        length += float(u.length_m[here])
        node = int(u.end_node[here]) if forward else int(u.start_node[here])
        if length >= LONG_LAG_M:
            return total**2 / (2 * length)
        before = here
        here = next((r for r in at_node[node] if r != before), None)
    return None


def _shrunk(rates: Floats, default: float) -> float:
    """A robust mean of squares, drawn to the default by ``PRIOR_PAIRS`` imaginary ones (on a logarithmic scale)."""
    if not len(rates):
        return default
    seen = max(float(np.median(rates)) / _MEDIAN_OF_SQUARE, 1e-5)
    weight = len(rates) / (len(rates) + PRIOR_PAIRS)
    return float(np.exp(weight * np.log(seen) + (1 - weight) * np.log(default)))
