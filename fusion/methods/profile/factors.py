"""From a drive to its passes' factors: what each pass says about the heights of its segment.

Chooses which passes count and numbers them; the sums themselves are in ``likelihood``, and nothing here knows other
drives.
"""

from __future__ import annotations

import numpy as np

from fusion.methods.profile.likelihood import (
    PLACE_SIGMA_M,
    Altimeter,
    OnTraversals,
    likelihoods,
    on_traversals,
    segment_lengths,
)
from fusion.methods.profile.measurements import Measurements
from fusion.methods.profile.model import DRIFT, DRIFT_TAU_S, MOUNT, SmootherEpochs
from fusion.methods.profile.noise import Learned
from fusion.methods.profile.path import DrivenPath
from fusion.network.pass_factor import PassFactor
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
    data = on_traversals(measured, epochs, learned, path, altimeter, place_sigma(path, fix))
    walk = (learned.noise.drift, learned.noise.baro_drift)
    summed = likelihoods(data, path, walk, _times_of(epochs, learned, DRIFT))
    mount = _mount(path, _times_of(epochs, learned, MOUNT))
    length, scale = segment_lengths(path)
    match, found = path.match, []
    for k in np.flatnonzero(_usable(path)).tolist():
        information, vector = summed.of(k)
        weight = float(match.confidence[k])
        low, high = sorted((float(match.enter_m[k] * scale[k]), float(match.leave_m[k] * scale[k])))
        rows = slice(int(data.first[k]), int(data.first[k + 1]))
        found.append(
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
                roughness=learned.noise.roughness,
                observations=_instants(data, rows),
                first_time_s=float(match.enter_time_s[k]),
                last_time_s=float(match.leave_time_s[k]),
                lag_s=altimeter.lag_s,
            )
        )
    return found


def place_sigma(path: DrivenPath, fix: GnssFix) -> Floats:
    """One sigma of where each traversal lies along the road beside the ones before and after it, m.

    Positions are wrong for as long as heights (``DRIFT_TAU_S``): what they change by on the way is the traversal's
    own, by one axis of the accuracy that its fixes state; what all have in common moves all heights alike.
    """
    match = path.match
    stated = np.isfinite(fix.h_acc_m)
    radius = np.full(len(match), np.sqrt(2) * PLACE_SIGMA_M)
    if stated.any():
        middle = 0.5 * (match.enter_time_s + match.leave_time_s)
        radius = np.interp(middle, fix.time_s[stated], fix.h_acc_m[stated])
    changed = -np.expm1(-np.maximum(match.leave_time_s - match.enter_time_s, 0.0) / DRIFT_TAU_S)
    return np.asarray(np.clip(radius / np.sqrt(2), *PLACE_BOUNDS_M) * np.sqrt(changed))


def _usable(path: DrivenPath) -> Bools:
    match = path.match
    begin, end = (path.gaps_s[:, [side]] for side in (0, 1))
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
