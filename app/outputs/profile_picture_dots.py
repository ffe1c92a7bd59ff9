"""Where a drive's measurements lie behind its profile."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.outputs.profile import Profile
from fusion.types import Floats, Measurements

NEAR_S = 1.0
"""A measurement in an interruption belongs to an epoch that is no farther away."""
OTHER_DATUM_M = 10.0
"""Heights whose median lies farther from the estimate refer to something else, like the ellipsoid."""
MOST_DOTS = 4000

_LOOKS = {
    "altitude": ("GNSS altitude", "#3f97d0"),
    "barometer": ("barometer, drift taken off", "#c0699c"),
    "dem": ("elevation model", "#8a8f45"),
    "doppler": ("Doppler", "#2a9d7c"),
    "pitch": ("pitch less mount", "#8d6cc9"),
    "specific force": ("specific force less mount", "#d29a2e"),
}
_OTHER_LOOK = "#8a8f94"


@dataclass(frozen=True, eq=False)
class Dots:
    """One sensor's measurements on the profile's axes: ``value`` in m or in %, shape (n,) like ``distance_m``."""

    label: str
    colour: str
    is_height: bool
    distance_m: Floats
    value: Floats


def placed_m(profile: Profile, time_s: Floats) -> Floats:
    """Distance on the profile's axis at each time; NaN where the profile knows no position near that time."""
    if not len(profile):
        return np.full(len(time_s), np.nan)
    own = profile.time_s
    right = np.clip(np.searchsorted(own, time_s), 0, len(own) - 1)
    left = np.maximum(right - 1, 0)
    inside = (time_s >= own[0]) & (time_s <= own[-1]) & (~profile.gap[right] | (own[right] == time_s))
    nearest = np.where(np.abs(time_s - own[left]) <= np.abs(own[right] - time_s), left, right)
    near = np.abs(own[nearest] - time_s) <= NEAR_S
    outside = np.where(near, profile.distance_m[nearest], np.nan)
    return np.where(inside, np.interp(time_s, own, profile.distance_m), outside)


def dots_of(profile: Profile, measurements: Measurements) -> Iterator[Dots]:
    """Each sensor's dots, thinned evenly to ``MOST_DOTS``; heights on another datum moved, which the label says."""
    distance = placed_m(profile, measurements.time_s)
    usable = np.isfinite(distance) & np.isfinite(measurements.value)
    for code, name in enumerate(measurements.names):
        mine = np.flatnonzero(usable & (measurements.sensor == code))
        if not len(mine):
            continue
        label, colour = _LOOKS.get(name, (name, _OTHER_LOOK))
        where, value = distance[mine], measurements.value[mine]
        is_height = bool(measurements.is_height[mine[0]])
        if is_height:
            moved = datum_shift_m(profile, where, value)
            value, label = value + moved, label + (f", moved by {moved:+.0f} m" if moved else "")
        else:
            value = 100 * value
        kept = slice(None, None, -(-len(mine) // MOST_DOTS))
        yield Dots(label, colour, is_height, where[kept], value[kept])


def datum_shift_m(profile: Profile, distance_m: Floats, height_m: Floats) -> float:
    """What to add to heights that refer to something else than the estimate does; 0 where they agree roughly."""
    known = np.isfinite(profile.alt_m)
    if not known.any():
        return 0.0
    shift = float(
        np.median(np.interp(distance_m, profile.distance_m[known], profile.alt_m[known]) - height_m)
    )
    return shift if abs(shift) > OTHER_DATUM_M else 0.0
