"""A drive's measurements summed, pass by pass, into likelihoods over the knots of the road and the drive's own errors.

What hangs together within a pass only (the wander of the mount on its springs, the way that a height sensor's error
takes) is integrated out here; what the drive carries on stays an unknown. Which passes count, and what a pass's place
in the drive is, is not known here (``factors``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fusion.compiled import compiled
from fusion.network.curve import variable_count
from fusion.network.pass_factor import NUISANCES
from fusion.profile.model import DRIFT, JUMP_SIGMA
from fusion.profile.path import DrivenPath
from fusion.profile.traversals import OnTraversals, segment_lengths
from fusion.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Likelihoods:
    """exp(-(square - 2 vector' x + x' information x) / 2) of n passes, of ``size`` (n,) unknowns each, in one row."""

    size: Ints
    information: Floats
    vector: Floats
    square: Floats

    @cached_property
    def _matrices(self) -> Ints:
        return np.cumsum(self.size**2) - self.size**2

    @cached_property
    def _vectors(self) -> Ints:
        return np.cumsum(self.size) - self.size

    def of(self, k: int) -> tuple[Floats, Floats]:
        """Information (size, size) and vector (size,) of pass ``k``."""
        n, at, row = int(self.size[k]), int(self._matrices[k]), int(self._vectors[k])
        return self.information[at : at + n * n].reshape(n, n), self.vector[row : row + n]


def likelihoods(
    data: OnTraversals, path: DrivenPath, walk_m2_per_s: tuple[float, float], drift_jumps_s: Floats
) -> Likelihoods:
    """Of every traversal; at ``drift_jumps_s`` the error of the GNSS height changes suddenly."""
    match = path.match
    size = variable_count(segment_lengths(path)[0]) + NUISANCES
    information, vector = np.zeros(int((size**2).sum())), np.zeros(int(size.sum()))
    square = np.zeros(len(size))
    sum_passes(
        data.first.astype(np.int64), size, data.variable, data.weights, data.constants, data.passing,
        data.height_sensor, data.value, data.variance, data.time_s, match.enter_time_s, match.leave_time_s,
        np.array(walk_m2_per_s), drift_jumps_s, JUMP_SIGMA[DRIFT] ** 2,
        information, vector, square,
    )  # fmt: skip
    return Likelihoods(size, information, vector, square)


@compiled
def sum_passes(  # noqa: C901, PLR0912, PLR0915 (one loop nest)
    first: Ints,
    size: Ints,
    variable: Ints,
    weights: Floats,
    constants: Floats,
    passing: Floats,
    height_sensor: Ints,
    value: Floats,
    variance: Floats,
    time_s: Floats,
    enter_s: Floats,
    leave_s: Floats,
    walk_m2_per_s: Floats,
    jumps_s: Floats,
    jump_m2: float,
    information: Floats,
    vector: Floats,
    square: Floats,
) -> None:
    """Fill ``information``, ``vector`` and ``square`` (see ``Likelihoods``) from the measurements of each pass.

    The unknowns of a pass are the knots, the constants, two height errors at entry and two now, which are those at
    exit when all is summed, and behind them the wander of the mount, which is integrated out.
    """
    present = np.zeros(2, np.bool_)
    for i in range(len(value)):
        if height_sensor[i] >= 0:
            present[height_sensor[i]] = True
    own, shared = passing.shape[1], NUISANCES - 4
    column, weight_of = np.empty(5 + shared + own, np.int64), np.empty(5 + shared + own)
    start = 0
    row = 0
    for k in range(len(size)):
        n = size[k]
        knots = n - NUISANCES
        matrix, right = np.zeros((n + own, n + own)), np.zeros(n + own)
        for a in range(own):
            matrix[n + a, n + a] = 1.0
        total = 0.0
        last = np.full(2, enter_s[k])
        for s in range(2):
            if present[s]:
                # Entry and now are one at first: a step that hardly moves joins them.
                entry, now = knots + shared + s, knots + shared + 2 + s
                joined = 1.0 / 1e-8
                matrix[entry, entry] = matrix[now, now] = joined
                matrix[entry, now] = matrix[now, entry] = -joined
        for i in range(first[k], first[k + 1] + 1):
            ending = i == first[k + 1]
            for s in range(2):
                if present[s] and (ending or height_sensor[i] == s):
                    until = leave_s[k] if ending else time_s[i]
                    moved = walk_m2_per_s[s] * max(until - last[s], 0.0)
                    if s == 0:
                        for jump in jumps_s:
                            if last[s] < jump <= until:
                                moved += jump_m2
                    total = step(matrix, right, total, knots + shared + 2 + s, moved)
                    last[s] = max(last[s], until)
            if ending:
                break
            count = 0
            for a in range(4):
                column[count], weight_of[count] = variable[i] + a, weights[i, a]
                count += 1
            for a in range(shared):
                if constants[i, a] != 0.0:
                    column[count], weight_of[count] = knots + a, constants[i, a]
                    count += 1
            if height_sensor[i] >= 0:
                column[count], weight_of[count] = knots + shared + 2 + height_sensor[i], 1.0
                count += 1
            for a in range(own):
                if passing[i, a] != 0.0:
                    column[count], weight_of[count] = n + a, passing[i, a]
                    count += 1
            precision = 1.0 / variance[i]
            total += value[i] * value[i] * precision
            for a in range(count):
                scaled = weight_of[a] * precision
                right[column[a]] += scaled * value[i]
                for b in range(count):
                    matrix[column[a], column[b]] += scaled * weight_of[b]
        for e in range(n + own - 1, n - 1, -1):
            pivot = matrix[e, e]
            total -= right[e] * right[e] / pivot
            for a in range(e):
                share = matrix[a, e] / pivot
                right[a] -= share * right[e]
                for b in range(e):
                    matrix[a, b] -= share * matrix[e, b]
        vector[row : row + n] = right[:n]
        for a in range(n):
            for b in range(n):
                information[start + a * n + b] = matrix[a, b]
        square[k] = total
        start += n * n
        row += n


@compiled
def step(matrix: Floats, right: Floats, total: float, e: int, variance: float) -> float:
    """Let unknown ``e`` take a random step: information about where it was before becomes weaker.

    Changes ``matrix`` and ``right`` in place; returns the new constant of the likelihood.
    """
    pivot = matrix[e, e]
    left = 1.0 / (1.0 + variance * pivot)
    share = variance * left
    here = right[e]
    for a in range(len(right)):
        if a != e and matrix[a, e] != 0.0:
            pull = share * matrix[a, e]
            right[a] -= pull * here
            for b in range(len(right)):
                if b != e:
                    matrix[a, b] -= pull * matrix[e, b]
    for a in range(len(right)):
        if a != e:
            matrix[a, e] *= left
            matrix[e, a] = matrix[a, e]
    right[e] *= left
    matrix[e, e] = pivot * left
    return float(total - share * here * here)
