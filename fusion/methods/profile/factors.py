"""From a drive to its passes' factors: what each pass says about the heights of its segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.methods.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, TERRAIN, Rows
from fusion.methods.profile.model import BIAS, DRIFT, JUMP_SIGMA, MOUNT, SQUAT, Steps, decorrelated, design
from fusion.methods.profile.noise import Learned
from fusion.methods.profile.path import DrivenPath
from fusion.network.curve import (
    grade_rows,
    grade_variance,
    height_rows,
    height_variance,
    knot_length,
    slope_row,
    smoothness,
    variable_count,
)
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats, Ints

CONSTANTS = (MOUNT, BIAS, SQUAT)
MIN_CONFIDENCE = 0.5
"""A traversal that is less probably right than this says nothing."""
LONE_ROUGHNESS = 1e-3
"""What a pass may assume by itself: that no road's grade changes faster."""
HISTORY_RATIO = 8.0
MAX_HISTORY = 12
SILENCE_S = 3.0
LONGEST_SILENCE_S = 120.0
_WEAKEST = 1e-7


@dataclass(frozen=True, eq=False)
class _Prepared:
    """Rows of a drive ready for the kernel: all (m, ...) in the order of time."""

    sensor: Ints
    traversal: Ints
    distance_m: Floats
    sign: Floats
    nuisance: Floats
    lead: Floats
    value: Floats
    variance: Floats
    time_s: Floats
    clock: Floats
    """(2, m) variance by which the two drifting errors, GNSS height and barometer, have moved since the beginning"""


def pass_factors(rows: Rows, steps: Steps, learned: Learned, path: DrivenPath) -> list[PassFactor]:
    """The factors of all traversals that are probably right, in driving order."""
    prepared = _prepare(rows, steps, learned, path)
    match = path.match
    first = np.searchsorted(prepared.traversal, np.arange(len(match) + 1))
    back_s = _history_s(rows, learned)
    silent_s = _silence(prepared, match.enter_time_s)
    begin, end = (path.gaps_s[:, [side]] for side in (0, 1))
    unrecorded = np.any((match.enter_time_s < end) & (match.leave_time_s > begin), axis=0)
    found = []
    for k in range(len(match)):
        if match.confidence[k] < MIN_CONFIDENCE or match.enter_m[k] == match.leave_m[k] or unrecorded[k]:
            continue
        start = _history_start(path, k, max(back_s, silent_s[k]))
        found.append(_factor(prepared, steps, learned, path, first, start, k))
    return found


def _prepare(rows: Rows, steps: Steps, learned: Learned, path: DrivenPath) -> _Prepared:
    clean, share = decorrelated(rows, learned.noise)
    traversal, distance = path.match.position_on(rows.along_m)
    seen = design(rows, share)
    keep = np.flatnonzero((rows.sensor != TERRAIN) & (traversal >= 0))
    keep = keep[np.lexsort((rows.time_s[keep], traversal[keep]))]
    heights = np.isin(rows.sensor, (ALTITUDE, BARO))
    lead = np.where(heights, 1.0, 1.0 - share)
    elapsed = rows.time_s - rows.time_s[0]
    clock = np.outer([learned.noise.drift, learned.noise.baro_drift], elapsed)
    for k, state in learned.jumps:
        if state == DRIFT:
            clock[0] += np.where(rows.time_s >= steps.time_s[k], JUMP_SIGMA[DRIFT] ** 2, 0.0)
    return _Prepared(
        rows.sensor[keep],
        traversal[keep],
        distance[keep],
        np.where(path.match.forward[traversal[keep]], 1.0, -1.0),
        seen[np.ix_(keep, np.array(CONSTANTS))],
        lead[keep],
        clean.value[keep],
        learned.variance[keep],
        rows.time_s[keep],
        clock[:, keep],
    )


def _history_s(rows: Rows, learned: Learned) -> float:
    """How long before a pass its heights still matter, s; 0 where velocities and pitch outweigh the heights."""
    slopes = np.isin(rows.sensor, (DOPPLER, PITCH, FORCE))
    heights = rows.sensor == ALTITUDE
    if not heights.any():
        return 0.0
    duration = max(float(np.ptp(rows.time_s)), 1.0)
    by_slopes = float(np.sum(1 / (learned.variance * rows.speed_mps**2)[slopes])) / duration
    if learned.noise.drift * by_slopes > HISTORY_RATIO:
        return 0.0
    return 4 * learned.noise.altitude_m / float(np.sqrt(learned.noise.drift))


def _silence(p: _Prepared, enter_s: Floats) -> Floats:
    """How long before each pass the last height or climb was measured, s, where that is the end of an outage; else 0.

    The heights on both sides of a tunnel tell of all of it: the pass after it is conditional on those inside.
    """
    seen = np.sort(p.time_s[np.isin(p.sensor, (ALTITUDE, DOPPLER, BARO))])
    if not len(seen):
        return np.zeros(len(enter_s))
    after = np.searchsorted(seen, enter_s)
    before = np.clip(after - 1, 0, len(seen) - 1)
    pause = enter_s - seen[before]
    # Longer ones are no outage that heights bridge; and only the first pass that hears again needs to look back.
    leave = np.concatenate([enter_s[1:], [np.inf]])
    hears = (after < len(seen)) & (seen[np.minimum(after, len(seen) - 1)] <= leave)
    wanted = (after > 0) & hears & (pause > SILENCE_S) & (pause < LONGEST_SILENCE_S)
    return np.where(wanted, pause + 1.0, 0.0)


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
    p: _Prepared,
    steps: Steps,
    learned: Learned,
    path: DrivenPath,
    first: Ints,
    start: int,
    k: int,
) -> PassFactor:
    match = path.match
    middle = 0.5 * (match.enter_time_s[k] + match.leave_time_s[k])
    at = int(np.clip(np.searchsorted(steps.time_s, middle), 0, len(steps.time_s) - 1))
    mean = learned.smoothed.mean[at, list(CONSTANTS)]
    covariance = learned.smoothed.covariance[at][np.ix_(CONSTANTS, CONSTANTS)].copy()
    if _mount_moves(steps, learned, match.enter_time_s[k], match.leave_time_s[k]):
        covariance[0, 0] += JUMP_SIGMA[MOUNT] ** 2
    lengths = knot_length(path.network.table.length_m[match.segment[start : k + 1]])
    scale = lengths / np.maximum(path.network.length_m[match.segment[start : k + 1]], 1e-9)
    forward = match.forward[start : k + 1]
    information, vector = _likelihood(
        p, learned, first, start, k + 1, lengths, scale, forward, mean, covariance
    )
    if start < k:
        less, vector_less = _likelihood(
            p, learned, first, start, k, lengths[:-1], scale, forward, mean, covariance
        )
        size = len(vector_less)
        information[:size, :size] -= less
        vector[:size] -= vector_less
    weight = float(match.confidence[k])
    length = float(lengths[-1])
    part = np.sort([match.enter_m[k] * scale[-1], match.leave_m[k] * scale[-1]])
    slope, sigma = _lone_slope(weight * information, weight * vector, length, part)
    return PassFactor(
        segments=tuple(int(s) for s in match.segment[start : k + 1]),
        information=weight * information,
        vector=weight * vector,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        start_m=float(part[0]),
        end_m=float(part[1]),
        roughness=learned.noise.roughness,
        observations=_epochs(p.time_s[first[k] : first[k + 1]]),
        first_time_s=float(match.enter_time_s[k]),
        last_time_s=float(match.leave_time_s[k]),
    )


def _epochs(time_s: Floats) -> int:
    """Instants at which anything was measured; at least 1, as the measurements around a short segment count as well."""
    return 1 + int(np.count_nonzero(np.diff(np.sort(time_s)) > 0.2)) if len(time_s) else 1


def _mount_moves(steps: Steps, learned: Learned, begin_s: float, end_s: float) -> bool:
    """Whether the sensor's mount changed during (or within a second of) a stretch of time."""
    times = [steps.time_s[k] for k, state in learned.jumps if state == MOUNT]
    return any(begin_s - 1 <= t <= end_s + 1 for t in times)


def _likelihood(
    p: _Prepared,
    learned: Learned,
    first: Ints,
    start: int,
    stop: int,
    lengths: Floats,
    scale: Floats,
    forward: NDArray[np.bool_],
    mean: Floats,
    covariance: Floats,
) -> tuple[Floats, Floats]:
    """Information and vector of traversals start .. stop - 1 over their stacked knots."""
    counts = variable_count(lengths)
    size = int(counts.sum())
    blocks, offset, climbed = [], 0, np.zeros(size)
    for number, k in enumerate(range(start, stop)):
        mine = slice(first[k], first[k + 1])
        ends = (offset, offset + int(counts[number]) - 2)
        entry, leave = ends if forward[number] else ends[::-1]
        rows, extra = _knot_rows(p, mine, offset, size, float(lengths[number]), float(scale[number]), learned)
        # The road goes on from segment to segment: a height is the climb since the first entry. So the levels of the
        # segments, which the network leaves to each of them, don't matter.
        heights = (p.sensor[mine] == ALTITUDE) | (p.sensor[mine] == BARO)
        rows[heights] += climbed
        rows[heights, entry] -= 1.0
        climbed[leave] += 1.0
        climbed[entry] -= 1.0
        blocks.append((rows, extra))
        offset += int(counts[number])
    rows, extra = (np.concatenate(part) for part in zip(*blocks, strict=True))
    whole = slice(first[start], first[stop])
    kind = np.select([p.sensor[whole] == ALTITUDE, p.sensor[whole] == BARO], [1, 2], 0)
    full = np.zeros((len(rows), size + 5))
    full[:, :size] = rows
    full[:, size : size + 3] = p.nuisance[whole]
    full[kind == 1, size + 3] = 1.0
    full[kind == 2, size + 4] = 1.0
    information, vector = np.zeros((size + 5, size + 5)), np.zeros(size + 5)
    known = np.linalg.inv(covariance)
    information[size : size + 3, size : size + 3] = known
    vector[size : size + 3] = known @ mean
    accumulate(
        information, vector, full, kind.astype(np.int64), p.value[whole], p.variance[whole] + extra,
        np.ascontiguousarray(p.clock[:, whole]),
    )  # fmt: skip
    return information[:size, :size].copy(), vector[:size].copy()


def _knot_rows(
    p: _Prepared, mine: slice, offset: int, size: int, length: float, scale: float, learned: Learned
) -> tuple[Floats, Floats]:
    """Rows over the stacked knots for one traversal's measurements, and the variance that the knots leave open."""
    distance = p.distance_m[mine] * scale
    heights = (p.sensor[mine] == ALTITUDE) | (p.sensor[mine] == BARO)
    q = learned.noise.roughness
    out = np.zeros((len(distance), size))
    block = np.where(
        heights[:, None],
        height_rows(distance, length),
        (p.sign[mine] * p.lead[mine])[:, None] * grade_rows(distance, length),
    )
    out[:, offset : offset + block.shape[1]] = block
    extra = np.where(
        heights,
        height_variance(distance, length, q),
        p.lead[mine] ** 2 * grade_variance(distance, length, q),
    )
    return out, extra


def _lone_slope(information: Floats, vector: Floats, length: float, part: Floats) -> tuple[float, float]:
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


@compiled
def accumulate(  # noqa: C901 (one loop nest)
    information: Floats,
    vector: Floats,
    design: Floats,
    kind: Ints,
    value: Floats,
    variance: Floats,
    clock: Floats,
) -> None:
    """Add rows in the order of time, the last two unknowns drifting in between; then marginalise the last five.

    ``kind`` is 1 for rows that see the first drifting unknown, 2 for the second, 0 for neither; ``clock``
    (2, m) is the variance that each has moved by.
    """
    n = len(vector)
    last = np.full(2, np.nan)
    for i in range(len(value)):
        if kind[i] > 0:
            which = kind[i] - 1
            if np.isfinite(last[which]):
                _walk(information, vector, n - 2 + which, clock[which, i] - last[which])
            last[which] = clock[which, i]
        for a in range(n):
            if design[i, a] != 0.0:
                weight = design[i, a] / variance[i]
                vector[a] += weight * value[i]
                for b in range(n):
                    information[a, b] += weight * design[i, b]
    for gone in range(n - 1, n - 6, -1):
        pivot = information[gone, gone]
        if pivot > 0.0:
            for a in range(gone):
                share = information[a, gone] / pivot
                if share != 0.0:
                    vector[a] -= share * vector[gone]
                    for b in range(gone):
                        information[a, b] -= share * information[gone, b]


@compiled
def _walk(information: Floats, vector: Floats, e: int, variance: float) -> None:
    """Let unknown e take a random step: information about where it was before becomes weaker."""
    n = len(vector)
    pivot = information[e, e]
    left = 1.0 / (1.0 + variance * pivot)
    share = variance * left
    for a in range(n):
        if a != e and information[a, e] != 0.0:
            pull = share * information[a, e]
            vector[a] -= pull * vector[e]
            for b in range(n):
                if b != e:
                    information[a, b] -= pull * information[e, b]
    for a in range(n):
        if a != e:
            information[a, e] *= left
            information[e, a] = information[a, e]
    vector[e] *= left
    information[e, e] = pivot * left
