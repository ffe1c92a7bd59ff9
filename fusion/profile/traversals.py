"""A drive's measurements brought to its traversals: what each sees of the road, of the drive and of the pass.

``factors`` sums them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.network.curve import grade_variance, grade_weights, height_variance, height_weights, knot_length
from fusion.profile.levels import ROBUST_INFORMATION_LOSS
from fusion.profile.measurements import ALTITUDE, BARO, FORCE, PITCH, TERRAIN, Measurements
from fusion.profile.model import (
    BIAS,
    GRADE,
    MOUNT,
    SPEED_PRESSURE,
    SQUAT,
    SmootherEpochs,
    decorrelated,
    design,
)
from fusion.profile.noise import Learned
from fusion.profile.path import DrivenPath
from fusion.types import Floats, Ints

PLACE_SIGMA_M = 5.0
"""Error of a pass's place along the road where the log states none: an ordinary receiver's (spec 7)."""
_BEND_OVER_M = 10.0
"""Changes of grade with place are taken over so far to either side: half of what knots are apart. Half or twice as far
changes slopes by less than 0.6 %."""


@dataclass(frozen=True)
class Altimeter:
    """The sensor of height that may be late: its code (-1: none is), and how late it was taken for, s."""

    sensor: int = -1
    lag_s: float = 0.0


@dataclass(frozen=True, eq=False)
class SmoothedDrive:
    """Everything known about a drive after smoothing."""

    path: DrivenPath
    measured: Measurements
    epochs: SmootherEpochs
    learned: Learned
    altimeter: Altimeter = Altimeter()


class OnTraversals(NamedTuple):
    """The m measurements on a drive's traversals in the order of driving, ready to be summed; columns of shape (m,).

    Each measurement sees four knot variables: ``variable`` is the first of them, ``weights`` (m, 4) are theirs.
    ``constants`` (m, 7) says what it sees of ``fusion.network.pass_factor.CONSTANTS``. ``passing`` (m, 3) says what
    it sees of three errors that belong to the pass alone, in units of one sigma: the mount's wander, the place along
    the road, and gusts, which come and go. ``height_sensor`` is 0 or 1 for those of ``HEIGHT_SENSORS``, else -1.
    ``variance`` holds robust weights, and the variance of the road between the knots. ``first`` (n + 1,): where each
    traversal's measurements begin.
    """

    variable: Ints
    weights: Floats
    constants: Floats
    passing: Floats
    height_sensor: Ints
    value: Floats
    variance: Floats
    time_s: Floats
    first: Ints


def on_traversals(drive: SmoothedDrive, place_sigma_m: Floats, common_place_m: Floats) -> OnTraversals:
    """Bring a drive's measurements to its traversals; terrain heights stay out, as the network has the DEM itself.

    ``place_sigma_m`` and ``common_place_m`` are those of ``factors.place_sigma``.
    """
    path, measured, learned, altimeter = drive.path, drive.measured, drive.learned, drive.altimeter
    clean, beyond = decorrelated(measured, learned.noise)
    traversal, distance = path.match.position_on(measured.along_m)
    keep = np.flatnonzero((measured.sensor != TERRAIN) & (traversal >= 0))
    keep = keep[np.lexsort((measured.time_s[keep], traversal[keep]))]
    sensor, traversal, share = measured.sensor[keep], traversal[keep], beyond[keep]
    length, scale = segment_lengths(path)
    length, distance = length[traversal], distance[keep] * scale[traversal]
    is_height = measured.of(ALTITUDE, BARO)[keep]
    forward = np.where(path.match.forward[traversal], 1.0, -1.0)
    variable, height = height_weights(distance, length)
    _, grade = grade_weights(distance, length)
    q = learned.expected.roughness
    seen = design(measured, beyond)[keep]
    # A height that is late by tau, taken for late by lag_s: y = H - climb (tau - lag_s). The unknown is tau.
    smoothed, along = learned.smoothed.mean[:, GRADE], measured.along_m[keep]
    grades = smoothed[drive.epochs.of_measurement[keep]]
    before, after = (
        np.interp(along + d, drive.epochs.along_m, smoothed) for d in (-_BEND_OVER_M, _BEND_OVER_M)
    )
    bend = (after - before) / (2 * _BEND_OVER_M)
    climb = grades * measured.speed_mps[keep]
    late = np.where(sensor == altimeter.sensor, -climb, 0.0)
    farther = np.where(is_height, grades, (1 - share) * bend)
    return OnTraversals(
        variable=variable,
        weights=np.where(is_height[:, None], height, (forward * (1 - share))[:, None] * grade),
        constants=np.column_stack(
            [
                seen[:, MOUNT],
                seen[:, BIAS],
                seen[:, SQUAT],
                late,
                farther[:, None] * common_place_m[traversal],
                seen[:, SPEED_PRESSURE],
            ]
        ),
        passing=np.column_stack(
            [
                learned.expected.wander
                * np.select([sensor == PITCH, sensor == FORCE], [1.0, 1 - share], 0.0),
                place_sigma_m[traversal] * farther,
                learned.expected.gust_m * (sensor == BARO),
            ]
        ),
        height_sensor=np.select([sensor == ALTITUDE, sensor == BARO], [0, 1], -1),
        value=clean.value[keep] + late * altimeter.lag_s,
        variance=ROBUST_INFORMATION_LOSS * learned.variance[keep]
        + np.where(
            is_height,
            height_variance(distance, length, q),
            (1 - share) ** 2 * grade_variance(distance, length, q),
        ),
        time_s=measured.time_s[keep],
        first=np.searchsorted(traversal, np.arange(len(path.match) + 1)),
    )


def segment_lengths(path: DrivenPath) -> tuple[Floats, Floats]:
    """For each traversal the length that the knots assume, m, and that length over the network's; shape (n,)."""
    segment = path.match.segment
    length = knot_length(path.network.table.length_m[segment])
    return length, length / np.maximum(path.network.length_m[segment], 1e-9)
