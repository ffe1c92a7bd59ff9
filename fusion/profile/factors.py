"""From a drive to its passes' factors: what each pass says about the heights of its segment.

Passes that count are chosen and numbered. The measurements of each are summed into a likelihood over the knots of the
road and the drive's own errors. Errors that belong to one pass alone are integrated out: the wander of the mount on its
springs, gusts at the barometer, and the way that a height sensor's error takes. Errors that the drive carries on stay
unknowns. No other drive is known here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.network.curve import variable_count
from fusion.network.pass_columns import PACKED_AT_ONCE, PackedPasses
from fusion.network.pass_factor import NUISANCES, PLACE_PART_S, PLACE_TAU_S, PassFactor
from fusion.profile.levels import knows_lengths
from fusion.profile.model import DRIFT, GUST_TAU_S, JUMP_SIGMA, MOUNT, Noise
from fusion.profile.path import DrivenPath
from fusion.profile.traversals import (
    PLACE_SIGMA_M,
    OnTraversals,
    SmoothedDrive,
    on_traversals,
    segment_lengths,
)
from fusion.types import Bools, Floats, GnssFix, Ints, Progress, no_progress


def likelihoods(
    data: OnTraversals,
    path: DrivenPath,
    walk_m2_per_s: tuple[float, float],
    drift_jumps_s: Floats,
    some: slice = slice(None),
) -> list[tuple[Floats, Floats, float]]:
    """Information (n, n), vector (n,) and square of every traversal, or ``some``, whose likelihood is
    exp(-(square - 2 vector' x + x' information x) / 2).

    At ``drift_jumps_s`` the error of the GNSS height changes suddenly.
    """
    match = path.match
    size = variable_count(segment_lengths(path)[0][some]) + NUISANCES
    information, vector = np.zeros(int((size**2).sum())), np.zeros(int(size.sum()))
    square = np.zeros(len(size))
    first = data.first[some.start : None if some.stop is None else some.stop + 1]
    sum_passes(
        data._replace(first=first), size, match.enter_time_s[some], match.leave_time_s[some],
        np.array(walk_m2_per_s), drift_jumps_s, JUMP_SIGMA[DRIFT] ** 2, information, vector, square,
    )  # fmt: skip
    matrices = np.split(information, np.cumsum(size**2))[:-1]
    vectors = np.split(vector, np.cumsum(size))[:-1]
    return [
        (matrix.reshape(n, n), right, total)
        for matrix, right, n, total in zip(matrices, vectors, size.tolist(), square.tolist(), strict=True)
    ]


@compiled
def sum_passes(  # noqa: C901, PLR0912, PLR0915 (one loop nest)
    data: OnTraversals,
    size: Ints,
    enter_s: Floats,
    leave_s: Floats,
    walk_m2_per_s: Floats,
    jumps_s: Floats,
    jump_m2: float,
    information: Floats,
    vector: Floats,
    square: Floats,
) -> None:
    """Fill ``information``, ``vector`` and ``square`` (see ``likelihoods``) from the measurements of each pass.

    The unknowns of a pass are, in this order: the knots, the constants, two height errors at entry, two height errors
    now (those at exit once all is summed), and the pass's own errors, which are integrated out; the last of these
    comes and goes (``GUST_TAU_S``).
    """
    variable, weights, constants, passing, height_sensor, value, variance, time_s, first = data
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
        gust_s = enter_s[k]
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
            if passing[i, own - 1] != 0.0:
                if time_s[i] > gust_s:
                    left = math.exp((gust_s - time_s[i]) / GUST_TAU_S)
                    total = calm(matrix, right, total, n + own - 1, max(left, 1e-3))
                gust_s = max(gust_s, time_s[i])
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


@compiled
def calm(matrix: Floats, right: Floats, total: float, e: int, left: float) -> float:
    """Let unknown ``e`` of variance 1 go on as a Gauss-Markov process of which a share ``left`` stays; in place."""
    for a in range(len(right)):
        matrix[a, e] /= left
        matrix[e, a] /= left
    right[e] /= left
    return float(step(matrix, right, total, e, 1.0 - left * left))


MIN_CONFIDENCE = 0.5
"""A traversal that is more probably wrong than right says nothing; with all of them slopes are up to 0.5 % worse."""
PLACE_BOUND_M = 30.0
"""Accuracies that fixes state count no more than this: a guard against absurd ones, as what was matched lies nearer."""
_SAME_INSTANT_S = 0.2


@dataclass(frozen=True, eq=False)
class DrivenPasses:
    """A drive's passes before they are summed: what their factors need of a drive, and no more.

    Of a long drive it is a third of it, so that the rest can be given back before factors are made.
    """

    path: DrivenPath
    data: OnTraversals
    expected: Noise
    grade_length_m: float
    lag_s: float
    drift_jumps_s: Floats
    mount_moved_s: Floats

    @classmethod
    def of(cls, drive: SmoothedDrive, fix: GnssFix) -> DrivenPasses:
        """Of a drive with these positions."""
        learned = drive.learned
        return cls(
            drive.path,
            on_traversals(drive, *place_sigma(drive.path, fix)),
            learned.expected,
            learned.noise.grade_length_m if knows_lengths(drive.measured) else 0.0,
            drive.altimeter.lag_s,
            _times_of(drive, DRIFT),
            _times_of(drive, MOUNT),
        )

    def factors(self, progress: Progress = no_progress) -> Sequence[PassFactor]:
        """The factors of all traversals that are probably right and were recorded whole, in driving order.

        Of a long drive they are packed; ``progress`` is told how far they are.
        """
        made = self._portions(progress)
        if len(self.path.match) > PACKED_AT_ONCE:
            return PackedPasses.of(made)
        return tuple(one for portion in made for one in portion)

    def _portions(self, progress: Progress) -> Iterator[list[PassFactor]]:
        path, data, match = self.path, self.data, self.path.match
        walk = (self.expected.drift, self.expected.baro_drift)
        mount, place, instants = _mount(path, self.mount_moved_s), _place(path), _instants(data)
        (length, scale), usable = segment_lengths(path), _usable(path)
        for first in range(0, len(match), PACKED_AT_ONCE):
            progress("factors", first / len(match))
            some, factors = slice(first, min(first + PACKED_AT_ONCE, len(match))), []
            summed = likelihoods(data, path, walk, self.drift_jumps_s, some)
            for k in (first + np.flatnonzero(usable[some])).tolist():
                information, vector, square = summed[k - first]
                weight = float(match.confidence[k])
                low, high = sorted((float(match.enter_m[k] * scale[k]), float(match.leave_m[k] * scale[k])))
                factors.append(
                    PassFactor(
                        segment=int(match.segment[k]),
                        sequence=k,
                        mount=int(mount[k]),
                        information=weight * information,
                        vector=weight * vector,
                        square=weight * square,
                        rows=int(data.first[k + 1] - data.first[k]),
                        walk_m2_per_s=walk,
                        start_m=low,
                        end_m=min(high, float(length[k])),
                        roughness=self.expected.roughness,
                        observations=int(instants[k]),
                        first_time_s=float(match.enter_time_s[k]),
                        last_time_s=float(match.leave_time_s[k]),
                        place=int(place[k]),
                        lag_s=self.lag_s,
                        grade_length_m=self.grade_length_m,
                    )
                )
            yield factors


def place_sigma(path: DrivenPath, fix: GnssFix) -> tuple[Floats, Floats]:
    """By how much the places of the n traversals along the road are wrong, one sigma, m.

    The first part (n,) is an error of each alone. The second (n, 2) is how far a traversal lies farther along the
    road for one sigma of a common error to the east and to the north.

    Positions err by one axis of the accuracy that fixes state, for as long as heights do (``PLACE_TAU_S``). This is the
    common error of a part of the drive. By how much it changes during a traversal is the traversal's own error.
    """
    match = path.match
    stated = np.isfinite(fix.h_acc_m)
    radius = np.full(len(match), np.sqrt(2) * PLACE_SIGMA_M)
    if stated.any():
        middle = 0.5 * (match.enter_time_s + match.leave_time_s)
        radius = np.interp(middle, fix.time_s[stated], fix.h_acc_m[stated])
    axis = np.minimum(radius / np.sqrt(2), PLACE_BOUND_M)
    correlation = np.exp(-np.maximum(match.leave_time_s - match.enter_time_s, 0.0) / PLACE_TAU_S)
    heading = path.network.heading_rad[match.segment] + np.where(match.forward, 0.0, np.pi)
    along = np.column_stack([np.cos(heading), np.sin(heading)])
    return np.asarray(axis * np.sqrt(1 - correlation)), np.asarray(
        (axis * np.sqrt(correlation))[:, None] * along
    )


def _place(path: DrivenPath) -> Ints:
    """The number of the part of the drive, ``PLACE_PART_S`` long, in which each traversal has its middle."""
    middle = 0.5 * (path.match.enter_time_s + path.match.leave_time_s)
    begin_s = path.match.enter_time_s.min(initial=np.inf)
    return np.asarray(np.floor((middle - begin_s) / PLACE_PART_S), np.int64)


def _usable(path: DrivenPath) -> Bools:
    match = path.match
    # Of outages that begin before it is left the last one to end: stated ones follow each other.
    begun = np.searchsorted(path.outages_s[:, 0], match.leave_time_s)
    until = np.concatenate([[-np.inf], np.maximum.accumulate(path.outages_s[:, 1])])
    unrecorded = match.enter_time_s < until[begun]
    return np.asarray((match.confidence >= MIN_CONFIDENCE) & (match.enter_m != match.leave_m) & ~unrecorded)


def _times_of(drive: SmoothedDrive, state: int) -> Floats:
    """When a state changed suddenly, s, ascending."""
    return np.sort([float(drive.epochs.time_s[k]) for k, s in drive.learned.jumps if s == state])


def _mount(path: DrivenPath, moved_s: Floats) -> Ints:
    """The number of each traversal's setting of the mount. Each change of the mount begins a new one.

    A pass during which the mount moved (or within a second of it) has a setting of its own: nobody knows which of the
    two it shows.
    """
    enter, leave = path.match.enter_time_s, path.match.leave_time_s
    number = 2 * np.searchsorted(moved_s, 0.5 * (enter + leave))
    during = np.zeros(len(enter), bool)
    for time in moved_s:
        during |= (enter - 1 <= time) & (time <= leave + 1)
    own = 2 * (len(moved_s) + 1) + np.arange(len(enter))
    return np.where(during, own, number).astype(np.int64)


def _instants(data: OnTraversals) -> Ints:
    """Instants of each traversal (n,) at which anything was measured; 1 where only around it, which counts as well."""
    passed = np.concatenate([[0], np.cumsum(np.diff(data.time_s) > _SAME_INSTANT_S)])
    begin, end = (np.clip(v, 0, len(passed) - 1) for v in (data.first[:-1], data.first[1:] - 1))
    return np.asarray(1 + np.maximum(passed[end] - passed[begin], 0))
