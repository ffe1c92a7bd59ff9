"""From a drive to its passes' factors: what each pass says about the heights of its segment.

Chooses which passes count and numbers them; the sums themselves are in ``likelihood``, and nothing here knows other
drives.
"""

from __future__ import annotations

import numpy as np

from fusion.network.pass_factor import PLACE_PART_S, PLACE_TAU_S, PassFactor
from fusion.profile.likelihood import likelihoods
from fusion.profile.measurements import Measurements
from fusion.profile.model import DRIFT, MOUNT, SmootherEpochs
from fusion.profile.noise import Learned
from fusion.profile.path import DrivenPath
from fusion.profile.traversals import (
    PLACE_SIGMA_M,
    Altimeter,
    OnTraversals,
    on_traversals,
    segment_lengths,
)
from fusion.types import Bools, Floats, GnssFix, Ints

MIN_CONFIDENCE = 0.5
"""A traversal that is less probably right than this says nothing."""
PLACE_BOUNDS_M = (0.3, 30.0)
"""Between a lane's width and a match that is hardly one: stated accuracies are no better than the map."""
_SAME_INSTANT_S = 0.2


def pass_factors(
    measured: Measurements,
    epochs: SmootherEpochs,
    learned: Learned,
    path: DrivenPath,
    altimeter: Altimeter,
    fix: GnssFix,
) -> list[PassFactor]:
    """The factors of all traversals that are probably right and were recorded whole, in driving order."""
    own, common = place_sigma(path, fix)
    data = on_traversals(measured, epochs, learned, path, altimeter, own, common)
    walk = (learned.expected.drift, learned.expected.baro_drift)
    summed = likelihoods(data, path, walk, _times_of(epochs, learned, DRIFT))
    mount = _mount(path, _times_of(epochs, learned, MOUNT))
    length, scale = segment_lengths(path)
    match, factors, place = path.match, [], _place(path)
    for k in np.flatnonzero(_usable(path)).tolist():
        information, vector = summed.of(k)
        weight = float(match.confidence[k])
        low, high = sorted((float(match.enter_m[k] * scale[k]), float(match.leave_m[k] * scale[k])))
        rows = slice(int(data.first[k]), int(data.first[k + 1]))
        factors.append(
            PassFactor(
                segment=int(match.segment[k]),
                sequence=k,
                mount=int(mount[k]),
                information=weight * information,
                vector=weight * vector,
                square=weight * float(summed.square[k]),
                rows=rows.stop - rows.start,
                walk_m2_per_s=walk,
                start_m=low,
                end_m=min(high, float(length[k])),
                roughness=learned.expected.roughness,
                observations=_instants(data, rows),
                first_time_s=float(match.enter_time_s[k]),
                last_time_s=float(match.leave_time_s[k]),
                place=int(place[k]),
                lag_s=altimeter.lag_s,
            )
        )
    return factors


def place_sigma(path: DrivenPath, fix: GnssFix) -> tuple[Floats, Floats]:
    """How far the n traversals lie from where they are thought, m: (n,) by itself each, and (n, 2) farther along the
    road for one sigma of what its part of the drive has in common, to the east and to the north.

    Positions are wrong for as long as heights (``PLACE_TAU_S``), by one axis of the accuracy that fixes state; what
    they change by on the way is the traversal's own.
    """
    match = path.match
    stated = np.isfinite(fix.h_acc_m)
    radius = np.full(len(match), np.sqrt(2) * PLACE_SIGMA_M)
    if stated.any():
        middle = 0.5 * (match.enter_time_s + match.leave_time_s)
        radius = np.interp(middle, fix.time_s[stated], fix.h_acc_m[stated])
    axis = np.clip(radius / np.sqrt(2), *PLACE_BOUNDS_M)
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
    begin, end = (path.outages_s[:, [side]] for side in (0, 1))
    unrecorded = np.any((match.enter_time_s < end) & (match.leave_time_s > begin), axis=0)
    return np.asarray((match.confidence >= MIN_CONFIDENCE) & (match.enter_m != match.leave_m) & ~unrecorded)


def _times_of(epochs: SmootherEpochs, learned: Learned, state: int) -> Floats:
    """When a state changed suddenly, s, ascending."""
    return np.sort([float(epochs.time_s[k]) for k, s in learned.jumps if s == state])


def _mount(path: DrivenPath, moved_s: Floats) -> Ints:
    """The number of each traversal's setting of the mount: one more after each change, and one for a pass in between.

    A pass on which the mount moved, within a second, has a setting of its own: of its two nobody knows which.
    """
    enter, leave = path.match.enter_time_s, path.match.leave_time_s
    number = 2 * np.searchsorted(moved_s, 0.5 * (enter + leave))
    during = np.zeros(len(enter), bool)
    for time in moved_s:
        during |= (enter - 1 <= time) & (time <= leave + 1)
    own = 2 * (len(moved_s) + 1) + np.arange(len(enter))
    return np.where(during, own, number).astype(np.int64)


def _instants(data: OnTraversals, rows: slice) -> int:
    """Instants at which anything was measured; at least 1, as the measurements around a short segment count as well."""
    time_s = np.sort(data.time_s[rows])
    return 1 + int(np.count_nonzero(np.diff(time_s) > _SAME_INSTANT_S)) if len(time_s) else 1
