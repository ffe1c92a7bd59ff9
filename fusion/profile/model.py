"""The linear model of a drive along its path: states, how they change, how the sensors see them.

Noise levels are given; where they come from it does not know (``noise``). The mount pitch is a state here, as the whole
drive is smoothed at once; filters that go forwards take it off before they start (``methods.epochs.levelling``).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fusion.arrays import nearest
from fusion.filters.smoother import Entries, LinearModel, go_on
from fusion.network.curve import RANDOM_WALK_M, grade_carried, grade_noise
from fusion.network.pass_factor import USUAL_SPEED_PRESSURE
from fusion.profile.barometer import speed_head
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, TERRAIN, Measurements
from fusion.profile.path import DrivenPath
from fusion.types import Bools, Floats, Ints

(
    HEIGHT, GRADE, DRIFT, MOUNT, BIAS, SQUAT, BARO_DRIFT, DEM_ERROR, WANDER, GUST, SPEED_PRESSURE,
) = range(11)  # fmt: skip
"""The states: height of the road (m) and its grade along the path, error of the GNSS height (m), mount pitch (as a
grade), bias of the accelerometer (over g), squat (grade per m/s^2), errors of the barometer and of the DEM (m), the
wander of the vehicle's attitude about its mount (as a grade), what gusts add to the barometer's error (m), and the
share of the dynamic pressure that it feels."""
STATES = 11

DRIFT_TAU_S = 120.0
"""Correlation time of GNSS height errors: minutes for every class of receiver. What is learned is the rate."""
DEM_LENGTH_M = 120.0
"""Correlation length of a DEM's height errors along the path."""
MISALIGNMENT_SIGMA = 0.2
"""Error of a grade where the vehicle is not in line with the road, over 1 - cosine of the angle between the two."""
SLOW_MPS = 2.0
"""At this speed springs double the variance of pitch and force."""
JUMP_SIGMA = {MOUNT: 0.05, DRIFT: 30.0}
"""Size of sudden changes where the drive shows them: a phone slides in its holder, a receiver converges anew."""
WANDER_SIGMA = 0.005
"""What a vehicle's attitude usually wanders by about its mount, as a grade: load, wind, fuel (spec 7: 0.3 to 0.5 %)."""
WANDER_TAU_S = 5.0
"""For so long a vehicle leans: between the swing of its springs, a second, and a change of its load."""
GUST_MPS, GUST_TAU_S = 1.5, 4.0
"""What the wind along a vehicle varies by, and for how long: near the ground gusts are a quarter to a third of a wind
of 5 m/s, in eddies of 50 to 100 m (Panofsky and Dutton 1984); so are the wakes of other vehicles. Roads and gusts look
alike to a barometer, so it can't learn them."""
_START_SIGMA = (100.0, 0.1, 30.0, 0.3, 0.03, 0.005, 100.0, 30.0, WANDER_SIGMA, 1.0, USUAL_SPEED_PRESSURE)
"""What is believed of each state at the beginning: nothing of levels, little of grade and mount pitch."""
_NEW_RUN = (1e4, 0.1**2)
"""Variance of height (m^2) and grade that is added where the path begins anew: as good as unknown."""
_MOUNT_WALK = 1e-10
"""Variance per second by which the mount pitch creeps (as a grade): 0.06 % in an hour."""
_SAME_EPOCH_S = 1e-3
_PARTNER_S, _PARTNER_M = 0.3, 8.0
"""How far apart in time and along the path a pitch and a force may be that the same springs moved."""


@dataclass(frozen=True)
class Noise:
    """Noise levels of a drive, one sigma unless said otherwise.

    ``roughness``: variance of the grade's change per metre of road (1/m); ``grade_length_m``: over so much of it grades
    go back to level. ``altitude_m``: white part of the GNSS height; ``drift``: variance per second by which its error
    changes (m^2/s). ``doppler``: factor on the stated one.
    ``pitch``, ``force``: grade seen by the sensor against the road's, springs included; ``shared``: the part of a
    pitch error that the force shows as well. ``wander``: slow part of both, a grade. ``baro_m``, ``baro_drift``
    (m^2/s) as for the altitude; ``gust_m``: what gusts add to it. ``dem_m``: DEM.
    """

    roughness: float = 3e-5
    grade_length_m: float = RANDOM_WALK_M
    altitude_m: float = 0.5
    drift: float = 0.15
    doppler: float = 1.0
    pitch: float = 0.012
    force: float = 0.02
    shared: float = 0.0
    wander: float = WANDER_SIGMA
    baro_m: float = 0.3
    baro_drift: float = 0.01
    gust_m: float = 0.1
    dem_m: float = 5.0

    def with_(self, **changes: float) -> Noise:
        """A copy with other levels."""
        return replace(self, **changes)


def variance_unit(measured: Measurements) -> Floats:
    """Each measurement's variance in units of its sensor's level squared, shape (m,).

    A crawling vehicle heaves on its springs, above all when it pulls away, and its attitude sensor has not settled.
    """
    springs = measured.of(PITCH, FORCE)
    slow = 1 + (SLOW_MPS / np.maximum(measured.speed_mps, 0.1)) ** 2
    return np.where(measured.sensor == DOPPLER, measured.stated_sigma**2, np.where(springs, slow, 1.0))


def white_level(sensor: Ints, noise: Noise) -> Floats:
    """The white level of each measurement's sensor, shape (m,)."""
    level = [noise.altitude_m, noise.doppler, noise.pitch, noise.force, noise.baro_m, 1.0]
    return np.array(level)[sensor]


def misalignment_variance(measured: Measurements) -> Floats:
    """Variance of grades while a vehicle is not in line with the road, shape (m,); 0 for heights."""
    slope = measured.of(DOPPLER, PITCH, FORCE)
    return np.where(slope, (MISALIGNMENT_SIGMA * measured.turn) ** 2, 0.0)


def white_variance(measured: Measurements, noise: Noise) -> Floats:
    """Variance of each measurement's white error, shape (m,), before robust weights."""
    white = white_level(measured.sensor, noise) ** 2 * variance_unit(measured)
    return np.asarray(white + misalignment_variance(measured))


def decorrelated(measured: Measurements, noise: Noise) -> tuple[Measurements, Floats]:
    """Measurements with each force made independent of the pitch beside it, and the share of pitch that was taken off.

    Springs move the body under both sensors alike: force - shared * pitch is what the force says beyond the pitch.
    """
    partner = pitch_partner(measured)
    share = np.where(partner >= 0, noise.shared, 0.0)
    value = measured.value - share * np.where(partner >= 0, measured.value[partner], 0.0)
    return replace(measured, value=value), share


def pitch_partner(measured: Measurements) -> Ints:
    """For each force the index of the pitch at its time and place, else -1; -1 for other sensors; shape (m,)."""
    out = np.full(len(measured), -1, np.int64)
    pitch, force = np.flatnonzero(measured.sensor == PITCH), np.flatnonzero(measured.sensor == FORCE)
    if not len(pitch) or not len(force):
        return out
    beside = pitch[nearest(measured.time_s[pitch], measured.time_s[force])]
    close = np.abs(measured.time_s[beside] - measured.time_s[force]) < _PARTNER_S
    close &= np.abs(measured.along_m[beside] - measured.along_m[force]) < _PARTNER_M
    out[force[close]] = beside[close]
    return out


def design(measured: Measurements, share: Floats) -> Floats:
    """Rows (m, STATES) of what each measurement sees; ``share`` (m,) is that of ``decorrelated``."""
    out = np.zeros((len(measured), STATES), order="F")  # a column that is not written takes no memory
    sensor = measured.sensor
    heights = measured.of(ALTITUDE, BARO, TERRAIN)
    out[heights, HEIGHT] = 1.0
    out[sensor == ALTITUDE, DRIFT] = 1.0
    out[np.ix_(sensor == BARO, (BARO_DRIFT, GUST))] = 1.0
    pressed = sensor == BARO
    out[pressed, SPEED_PRESSURE] = -speed_head(measured.speed_mps[pressed])
    out[sensor == TERRAIN, DEM_ERROR] = 1.0
    out[~heights, GRADE] = 1.0 - share[~heights]
    felt = measured.of(PITCH, FORCE)
    out[felt, MOUNT] = out[felt, WANDER] = 1.0 - share[felt]
    # The specific force has the same acceleration taken off, with the same error, and would teach a wrong squat. So it
    # sees only the squat of the pitch that is taken off it.
    squat = np.where(sensor == PITCH, 1.0, -share)
    out[felt, SQUAT] = (squat * measured.acceleration_mps2)[felt]
    out[sensor == FORCE, BIAS] = 1.0
    return out


Jumps = tuple[tuple[int, int], ...]
"""(epoch, state) of sudden changes."""


@dataclass(frozen=True, eq=False)
class SmootherEpochs:
    """The n instants of the smoother: all times at which anything is measured, on the path; arrays of shape (n,).

    ``grade_change_variance``: variance of the changes of grade at the road's nodes since the epoch before.
    ``of_measurement``, shape (m,): the epoch of each measurement. ``between``: see ``LinearModel``.
    """

    time_s: Floats
    along_m: Floats
    run: Ints
    grade_change_variance: Floats
    of_measurement: Ints
    between: Callable[[], None] = go_on

    @cached_property
    def steps(self) -> tuple[Floats, Floats]:
        """Seconds and metres since the epoch before, (n,)."""
        dt = np.diff(self.time_s, prepend=self.time_s[:1])
        return dt, np.maximum(np.diff(self.along_m, prepend=self.along_m[:1]), 0.0)

    @cached_property
    def fresh(self) -> Bools:
        """At which epochs the path begins anew, (n,)."""
        return np.asarray(np.diff(self.run, prepend=self.run[:1]) != 0)


def build_smoother_epochs(measured: Measurements, path: DrivenPath) -> SmootherEpochs:
    """The epochs of measurements; those within ``_SAME_EPOCH_S`` of each other share one."""
    new = np.concatenate([[True], np.diff(measured.time_s) > _SAME_EPOCH_S])
    time, along, run = measured.time_s[new], measured.along_m[new], measured.run[new]
    total = np.concatenate([[0.0], np.cumsum(path.grade_change_variance())])
    passed = total[np.searchsorted(path.match.start_m, along, side="right")]
    since = np.concatenate([[0.0], np.maximum(np.diff(passed), 0.0)])
    return SmootherEpochs(time, along, run, since, np.cumsum(new) - 1)


RATES = ("roughness", "drift", "baro_drift", "wander")
"""The levels that the steps' noise is proportional to (the wander's variance; fields of ``Noise``)."""


def step_noise(epochs: SmootherEpochs, noise: Noise, name: str) -> Entries:
    """What one of ``RATES`` adds to the steps' noise: also the derivative by the log of the variance."""
    dt, ds = epochs.steps
    if name == "roughness":
        q, (height, both, grade) = noise.roughness, grade_noise(ds, noise.grade_length_m)
        return {(HEIGHT, HEIGHT): q * height, (GRADE, HEIGHT): q * both, (GRADE, GRADE): q * grade}
    if name == "drift":
        return {(DRIFT, DRIFT): 0.5 * noise.drift * DRIFT_TAU_S * (1 - np.exp(-2 * dt / DRIFT_TAU_S))}
    if name == "wander":
        return {(WANDER, WANDER): noise.wander**2 * (1 - np.exp(-2 * dt / WANDER_TAU_S))}
    return {(BARO_DRIFT, BARO_DRIFT): noise.baro_drift * dt}


def steps_noise(
    epochs: SmootherEpochs, noise: Noise, jumps: Jumps = (), rates: Collection[str] = RATES
) -> dict[tuple[int, int], Floats]:
    """The noise of all steps, with sudden changes at ``jumps`` and of some ``rates``."""
    dt, ds = epochs.steps
    q = {
        (HEIGHT, HEIGHT): np.where(epochs.fresh, _NEW_RUN[0], 0.0),
        (GRADE, GRADE): epochs.grade_change_variance + np.where(epochs.fresh, _NEW_RUN[1], 0.0),
        (DRIFT, DRIFT): np.zeros(len(dt)),
        (MOUNT, MOUNT): _MOUNT_WALK * dt,
        (GUST, GUST): noise.gust_m**2 * (1 - np.exp(-2 * dt / GUST_TAU_S)),
        (DEM_ERROR, DEM_ERROR): noise.dem_m**2 * (1 - np.exp(-2 * ds / DEM_LENGTH_M)),
    }
    for name in rates:
        for pair, entry in step_noise(epochs, noise, name).items():
            q[pair] = q.get(pair, 0.0) + entry
    for k, state in jumps:
        q[state, state][k] += JUMP_SIGMA[state] ** 2
    return q


def linear_model(
    measured: Measurements, epochs: SmootherEpochs, noise: Noise, variance: Floats, jumps: Jumps = ()
) -> LinearModel:
    """The model for the filter, with the ``variance`` of each measurement (m,) and sudden changes at ``jumps``."""
    dt, ds = epochs.steps
    transition = {(state, state): np.broadcast_to(1.0, len(dt)) for state in range(STATES)}
    transition |= grades_carried(epochs, noise.grade_length_m)
    transition[DRIFT, DRIFT] = np.exp(-dt / DRIFT_TAU_S)
    transition[WANDER, WANDER] = np.exp(-dt / WANDER_TAU_S)
    transition[GUST, GUST] = np.exp(-dt / GUST_TAU_S)
    transition[DEM_ERROR, DEM_ERROR] = np.exp(-ds / DEM_LENGTH_M)
    clean, share = decorrelated(measured, noise)
    mean = np.zeros(STATES)
    heights = measured.value[(measured.sensor == ALTITUDE) | (measured.sensor == TERRAIN)]
    mean[HEIGHT] = float(np.median(heights[:50])) if len(heights) else 0.0
    pressed = measured.value[measured.sensor == BARO]
    if len(pressed):
        mean[BARO_DRIFT] = float(np.median(pressed[:50])) - mean[HEIGHT]
    return LinearModel(
        len(dt), transition, steps_noise(epochs, noise, jumps), mean, np.diag(np.square(_START_SIGMA)),
        epochs.of_measurement, design(measured, share), clean.value, variance, epochs.between,
    )  # fmt: skip


def grades_carried(epochs: SmootherEpochs, grade_length_m: float) -> dict[tuple[int, int], Floats]:
    """What lets heights follow the grades, and these go back to level, in transitions."""
    run, left = grade_carried(epochs.steps[1], grade_length_m)
    return {(HEIGHT, GRADE): np.where(epochs.fresh, 0.0, run), (GRADE, GRADE): left}
