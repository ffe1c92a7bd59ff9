"""What is believed of roads before any drive: nodes agree, grades go on where segments meet, and walk in between.

Heavy tails are Student's t, found in rounds of reweighting. Drives and elevation models are not known here.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fusion.arrays import counted
from fusion.frames import METRES_PER_DEGREE
from fusion.network.curve import RANDOM_WALK_M, smoothness_block
from fusion.network.equations import Asked, Blocks, Solution
from fusion.network.joints import couplings
from fusion.network.pass_columns import PassColumns
from fusion.network.subnetwork import joined_parts
from fusion.network.unknowns import RoadUnknowns
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

DEFAULT_ROUGHNESS = 3e-5
"""Variance of the grade's change per metre (1/m) of roads that no drive has learned it of (spec 7)."""
ROUGHNESS_BOUNDS = (3e-7, 1e-3)
"""Flat towns and serpentines (spec 7)."""
ROUGHNESS_FREEDOM = 3.0
"""Degrees of freedom of the Student's t that an interval's change of grade follows. Chosen on karlsruhe 00 and 09: with
Gaussian ones single drives are 0.4 to 1.3 % worse, ten of the best receiver 10 % better (road 05)."""
ROUGHNESS_PRIOR_COUNT = 20.0
"""Imaginary changes of grade about each place that are as large as the drives learned of themselves; and as many for
each class of roads there that are as large as the others'."""
UNSEEN_VARIANCE = ROUGHNESS_FREEDOM / (ROUGHNESS_FREEDOM - 2)
"""Variance of that Student's t over its scale squared: where nobody drove, nothing says which are even."""
FAR_SHARE = 0.01
"""All passes together say so much of what is usual about a place as this share of one that is there."""
NODE_SIGMA_M = 0.2
"""Segments end at their node's height: lanes and camber."""
NODE_FREEDOM = 2.0
"""Degrees of freedom of that agreement. It guards against maps that join what does not meet, and where they are right
it changes nothing: a node that joins roads 4 to 8 m apart makes slopes by one drive 3 % worse without it."""
GRADE_SIGMA = 0.2
"""Grades of roads, before anything is measured (1 = 100 %)."""
LEVEL_SIGMA_M = 1000.0
"""The mean height of all roads that hang together, before anything is measured: it keeps the equations solvable where
nothing speaks of heights, and weighs nothing where anything does."""
PLACE_M = 250.0
"""Spacing of the places over which roughness is averaged. It is less than what a subnetwork is wider than its published
part, so that subnetworks agree; with 500 m they do as well (``benchmarks/adjustment.py``)."""

_CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))


class RoadBeliefs:
    """What is believed of roads: nodes agree, grades go on, and walk at random in between."""

    def __init__(self, network: RoadTable, passes: PassColumns) -> None:
        self.unknowns = u = RoadUnknowns(network)
        rows = np.arange(len(network))
        ends = [
            np.column_stack([node, u.end(rows, np.full(len(rows), at))])
            for node, at in ((u.start_node, False), (u.end_node, True))
        ]
        self.ties = Blocks.of_rows(np.concatenate(ends), np.array([-1.0, 1.0]), 0.0, NODE_SIGMA_M**2)
        self.ties.asked = Asked.EXPECTED
        c = couplings(network)
        pair = np.column_stack([u.end(c.row_a, c.end_a) + 1, u.end(c.row_b, c.end_b) + 1])
        sign = np.column_stack([np.ones(len(pair)), np.where(c.end_a == c.end_b, 1.0, -1.0)])
        self.fixed = [Blocks.of_rows(pair, sign, 0.0, c.sigma**2)]
        for mine in u.by_intervals():
            variables, n = u.variables(mine), int(u.intervals[mine[0]])
            weak = np.diag(np.tile([0.0, GRADE_SIGMA**-2], n + 1)) + 1e-12  # every pair shares an equation
            every = np.broadcast_to(weak, (len(mine), *weak.shape))
            self.fixed.append(Blocks(variables, every, np.zeros(variables.shape), np.ones(len(mine))))
        row, knot = counted(u.intervals + 1)
        self.levels = Blocks.of_rows((u.first[row] + 2 * knot)[:, None], np.ones(1), 0.0, 1.0)
        self.levels.weight = _level_information(u)[row]
        self._row, self._step = row, step = counted(u.intervals)
        first = u.first[row] + 2 * step
        self._places = Places(network)
        measured = passes.take(passes.rows > 0)  # the others know nothing of roads
        told = measured.take(measured.grade_length_m > 0)
        lengths = _as_drives_learned(self._places, told, told.grade_length_m, RANDOM_WALK_M)
        unit = smoothness_block((u.length_m / u.intervals)[row], self._places.at_rows(lengths)[row])
        none = np.zeros((len(row), 4))
        self.roughness = Blocks(first[:, None] + np.arange(4), unit, none, np.ones(len(row)), Asked.EXPECTED)
        _, kind = np.unique(network.highway.astype(str), return_inverse=True)
        self._places_of_class = Places(network, kind)
        learned = _as_drives_learned(self._places, measured, measured.roughness, DEFAULT_ROUGHNESS)
        self._begin = np.clip(learned, *ROUGHNESS_BOUNDS)
        self.usual = self._places.at_rows(self._begin)
        """The usual roughness about each segment (n,), 1/m"""
        self._open = _open_intervals(u, row, step, measured)
        self.roughness.weight = 1 / self.usual[row]

    def blocks(self) -> list[Blocks]:
        """All equations."""
        return [*self.fixed, self.levels, self.ties, self.roughness]

    def learn(self, solution: Solution) -> None:
        """Weigh ties and intervals by what the solution says that they do; and the usual roughness itself."""
        # About where heights were found to be, so that they are not drawn to 0.
        self.levels.vector = solution.x[self.levels.variables]
        squares = solution.expected_squares(self.ties)
        self.ties.weight = (NODE_FREEDOM + 1) / (NODE_FREEDOM + squares)
        change = np.maximum(solution.expected_squares(self.roughness), 0.0)
        self._learn_usual(change)
        usual = self.usual[self._row]
        seen = (ROUGHNESS_FREEDOM + 2) / (ROUGHNESS_FREEDOM * usual + change)
        self.roughness.weight = np.where(self._open, 1 / (UNSEEN_VARIANCE * usual), seen)

    def _learn_usual(self, change: Floats) -> None:
        """From the squares of driven intervals, two changes each, over what one of roughness 1 has.

        First of all roads of a place, then how much rougher those of each class are there than the others.
        """
        row, change = self._row[~self._open], change[~self._open]
        of_class, prior = self._places_of_class, ROUGHNESS_PRIOR_COUNT
        count, count_of_class = (2 * c.sums(row) + prior for c in (self._places, of_class))
        for _ in range(5):
            square = (ROUGHNESS_FREEDOM + 2) / (ROUGHNESS_FREEDOM + change / self.usual[row]) * change
            place = self._places.at_rows((self._places.sums(row, square) + prior * self._begin) / count)
            more = (of_class.sums(row, square / place[row]) + prior) / count_of_class
            self.usual = place * of_class.at_rows(more)


def _as_drives_learned(places: Places, passes: PassColumns, learned: Floats, default: float) -> Floats:
    """The mean (of logs) of what drives learned of themselves about each place (c,); far from all, that of all."""
    row, count = passes.segment, np.maximum(passes.condensed, 1).astype(float)
    weighed = count * np.log(learned)
    far = FAR_SHARE * weighed.sum() / count.sum() if len(row) else FAR_SHARE * np.log(default)
    total = places.sums(row, weighed) + far
    return np.asarray(np.exp(total / (places.sums(row, count) + FAR_SHARE)))


def _level_information(u: RoadUnknowns) -> Floats:
    """What is known of the height of each knot of a segment, (n,): its share of ``LEVEL_SIGMA_M``."""
    part = joined_parts(u.nodes, u.start_node, u.end_node)
    knots = np.bincount(part[u.start_node], u.intervals + 1.0)
    return np.asarray(LEVEL_SIGMA_M**-2.0 / knots[part[u.start_node]])


def _open_intervals(u: RoadUnknowns, row: Ints, step: Ints, passes: PassColumns) -> Bools:
    """Which intervals (m,), by row and number there, no pass goes over: between the first and last place on a segment
    that any pass reaches, all count as driven."""
    low, high = np.full(len(u.length_m), np.inf), np.full(len(u.length_m), -np.inf)
    np.minimum.at(low, passes.segment, passes.start_m)
    np.maximum.at(high, passes.segment, passes.end_m)
    middle = (step + 0.5) / u.intervals[row] * u.length_m[row]
    return np.asarray((middle < low[row]) | (middle > high[row]), np.bool_)


class Places:
    """c places of a square grid over the n segments of a network; each segment has a share in its four nearest ones.

    ``share`` (n, c), rows adding up to 1, falls linearly with the distance to the north and to the east. The grid is
    fixed on earth, so a part of a network learns what the whole does, but for its edge. Segments of another ``kind``
    (n,) have places of their own.
    """

    def __init__(self, network: RoadTable, kind: Ints | None = None) -> None:
        lat = 0.5 * (network.lat0_deg + network.lat1_deg)
        lon = 0.5 * (network.lon0_deg + network.lon1_deg)
        band = np.rint(lat)  # columns are as wide as in the middle of their degree
        place = np.array([lat, lon * np.cos(np.radians(band))]) * (METRES_PER_DEGREE / PLACE_M)
        low = np.floor(place)
        part = place - low
        corners = [(band, *(low + np.array(corner)[:, None])) for corner in _CORNERS]
        share = [np.prod(np.where(np.array(corner)[:, None], part, 1 - part), axis=0) for corner in _CORNERS]
        names = np.concatenate([np.array(c, float).reshape(3, -1).T for c in corners])
        _, number = np.unique(names @ [1e14, 1e7, 1.0], return_inverse=True)
        row = np.tile(np.arange(len(network)), len(_CORNERS))
        if kind is not None:
            _, number = np.unique(number * (kind.max(initial=0) + 1) + kind[row], return_inverse=True)
        self.share = sparse.csr_matrix(
            (np.concatenate(share), (row, number)), (len(network), number.max() + 1)
        )
        self._turned = self.share.T

    def sums(self, rows: Ints, values: Floats | float = 1.0) -> Floats:
        """Values (m,) at ``rows`` (m,) added up in each place (c,), by share."""
        weights = np.broadcast_to(np.asarray(values, float), rows.shape)
        return np.asarray(self._turned @ np.bincount(rows, weights, minlength=self.share.shape[0]))

    def at_rows(self, values: Floats) -> Floats:
        """What places (c,) have, at each segment (n,)."""
        return np.asarray(self.share @ values)
