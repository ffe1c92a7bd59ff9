"""From a drive to its passes' factors: what each pass says about the heights of its segment.

Chooses what a factor is conditional on; the sums themselves are in ``likelihood``, and nothing here knows other drives.
"""

from __future__ import annotations

import numpy as np

from fusion.methods.profile.likelihood import CONSTANTS, Chain, OnTraversals, likelihood, on_traversals
from fusion.methods.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, Measurements
from fusion.methods.profile.model import JUMP_SIGMA, MOUNT, SmootherEpochs
from fusion.methods.profile.noise import Learned
from fusion.methods.profile.path import DrivenPath
from fusion.network.curve import slope_row, smoothness, variable_count
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats

MIN_CONFIDENCE = 0.5
"""A traversal that is less probably right than this says nothing."""
LONE_ROUGHNESS = 1e-3
"""What a pass may assume by itself, 1/m: that no road's grade changes faster."""
HISTORY_RATIO = 8.0
"""Where slopes give a second's climb with a variance this many times below the GNSS height's drift in it, a pass needs
no heights from before it."""
HISTORY_TIMES = 4.0
"""History in memories of a filter that sees a drifting height once a second: altitude_m / sqrt(drift) seconds each."""
MAX_HISTORY = 12
"""Segments before its own that a factor may be conditional on: a bound on its size."""
SHORTEST_OUTAGE_S = 3.0
LONGEST_OUTAGE_S = 120.0
"""What counts as an outage that heights on both sides bridge: not the spacing of sparse logs, not the night."""
_SAME_INSTANT_S = 0.2
_WEAKEST = 1e-7
"""Information on the diagonal that keeps a lone pass's equations solvable where it measured nothing."""


def pass_factors(
    measured: Measurements, epochs: SmootherEpochs, learned: Learned, path: DrivenPath
) -> list[PassFactor]:
    """The factors of all traversals that are probably right and were recorded whole, in driving order."""
    data = on_traversals(measured, epochs, learned, path)
    match = path.match
    back_s = _history_s(measured, learned)
    outage_s = _outage_before(data, match.enter_time_s)
    begin, end = (path.gaps_s[:, [side]] for side in (0, 1))
    unrecorded = np.any((match.enter_time_s < end) & (match.leave_time_s > begin), axis=0)
    found = []
    for k in range(len(match)):
        if match.confidence[k] < MIN_CONFIDENCE or match.enter_m[k] == match.leave_m[k] or unrecorded[k]:
            continue
        start = _history_start(path, k, max(back_s, outage_s[k]))
        found.append(_factor(data, epochs, learned, path, start, k))
    return found


def _history_s(measured: Measurements, learned: Learned) -> float:
    """How long before a pass its heights still matter, s; 0 where velocities and pitch outweigh the heights."""
    slopes = np.isin(measured.sensor, (DOPPLER, PITCH, FORCE))
    heights = measured.sensor == ALTITUDE
    if not heights.any():
        return 0.0
    duration = max(float(np.ptp(measured.time_s)), 1.0)
    by_slopes = float(np.sum(1 / (learned.variance * measured.speed_mps**2)[slopes])) / duration
    if learned.noise.drift * by_slopes > HISTORY_RATIO:
        return 0.0
    return HISTORY_TIMES * learned.noise.altitude_m / float(np.sqrt(learned.noise.drift))


def _outage_before(data: OnTraversals, enter_s: Floats) -> Floats:
    """How long before each pass the last height or climb was measured, s, where that is the end of an outage; else 0.

    The heights on both sides of a tunnel tell of all of it: the pass after it is conditional on those inside.
    """
    seen = np.sort(data.time_s[np.isin(data.sensor, (ALTITUDE, DOPPLER, BARO))])
    if not len(seen):
        return np.zeros(len(enter_s))
    after = np.searchsorted(seen, enter_s)
    before = np.clip(after - 1, 0, len(seen) - 1)
    outage = enter_s - seen[before]
    # Only the first pass on which anything is measured again needs to look back.
    leave = np.concatenate([enter_s[1:], [np.inf]])
    measures = (after < len(seen)) & (seen[np.minimum(after, len(seen) - 1)] <= leave)
    wanted = (after > 0) & measures & (outage > SHORTEST_OUTAGE_S) & (outage < LONGEST_OUTAGE_S)
    return np.where(wanted, outage + 1.0, 0.0)


def _history_start(path: DrivenPath, k: int, back_s: float) -> int:
    """The first traversal on which traversal k's factor is conditional (k: none)."""
    match, start = path.match, k
    seen = {int(match.segment[k])}
    while back_s > 0 and start > 0 and k - start < MAX_HISTORY:
        if match.enter_time_s[k] - match.enter_time_s[start] >= back_s:
            break
        before = start - 1
        if match.run[before] != match.run[k] or int(match.segment[before]) in seen:
            break
        seen.add(int(match.segment[before]))
        start = before
    return start


def _factor(
    data: OnTraversals, epochs: SmootherEpochs, learned: Learned, path: DrivenPath, start: int, k: int
) -> PassFactor:
    """Traversal k's factor, conditional on those from ``start`` on: what both say less what the history says alone."""
    match = path.match
    mean, covariance = _constants(epochs, learned, match.enter_time_s[k], match.leave_time_s[k])
    chain = Chain.between(path, start, k + 1)
    information, vector = likelihood(data, chain, mean, covariance)
    if start < k:
        less, vector_less = likelihood(data, chain.without_last(), mean, covariance)
        size = len(vector_less)
        information[:size, :size] -= less
        vector[:size] -= vector_less
    weight = float(match.confidence[k])
    length = float(chain.length_m[-1])
    part = np.sort([match.enter_m[k] * chain.scale[-1], match.leave_m[k] * chain.scale[-1]])
    slope, sigma = _slope_alone(weight * information, weight * vector, length, part)
    return PassFactor(
        segments=tuple(int(s) for s in match.segment[start : k + 1]),
        information=weight * information,
        vector=weight * vector,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        start_m=float(part[0]),
        end_m=float(part[1]),
        roughness=learned.noise.roughness,
        observations=_instants(data.time_s[data.first[k] : data.first[k + 1]]),
        first_time_s=float(match.enter_time_s[k]),
        last_time_s=float(match.leave_time_s[k]),
    )


def _constants(
    epochs: SmootherEpochs, learned: Learned, enter_s: float, leave_s: float
) -> tuple[Floats, Floats]:
    """Mean (3,) and covariance (3, 3) of ``CONSTANTS`` in the middle of a pass, by the whole drive.

    Where the sensor's mount changed during the pass or within a second of it, its pitch is hardly known.
    """
    middle = 0.5 * (enter_s + leave_s)
    at = int(np.clip(np.searchsorted(epochs.time_s, middle), 0, len(epochs.time_s) - 1))
    mean = learned.smoothed.mean[at, list(CONSTANTS)]
    covariance = learned.smoothed.covariance[at][np.ix_(CONSTANTS, CONSTANTS)].copy()
    moves = [epochs.time_s[k] for k, state in learned.jumps if state == MOUNT]
    if any(enter_s - 1 <= t <= leave_s + 1 for t in moves):
        covariance[0, 0] += JUMP_SIGMA[MOUNT] ** 2
    return mean, covariance


def _instants(time_s: Floats) -> int:
    """Instants at which anything was measured; at least 1, as the measurements around a short segment count as well."""
    return 1 + int(np.count_nonzero(np.diff(np.sort(time_s)) > _SAME_INSTANT_S)) if len(time_s) else 1


def _slope_alone(information: Floats, vector: Floats, length: float, part: Floats) -> tuple[float, float]:
    """Slope (%) and sigma by this factor alone, history marginalised, with the roughest of roads assumed."""
    own = int(variable_count(length))
    total = information + _WEAKEST * np.eye(len(vector))
    total[-own:, -own:] += smoothness(length, LONE_ROUGHNESS)
    grades = np.arange(len(vector) - own + 1, len(vector), 2)
    total[grades, grades] += 1.0  # a grade of 100 %: only to keep what nobody measured in bounds
    low, high = (float(v) for v in part)
    if high - low < min(1.0, 0.5 * length):
        low, high = 0.0, length
    row = np.zeros(len(vector))
    row[-own:] = slope_row(low, high, length)
    solved = np.linalg.solve(total, np.column_stack([row, vector]))
    return 100 * float(row @ solved[:, 1]), 100 * float(np.sqrt(max(float(row @ solved[:, 0]), 0.0)))
