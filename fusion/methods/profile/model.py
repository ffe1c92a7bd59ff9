"""The linear model of a drive along its path: states, how they change, how the sensors see them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.filters.smoother import LinearModel
from fusion.methods.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, TERRAIN, Rows
from fusion.methods.profile.path import DrivenPath
from fusion.types import Floats, Ints

HEIGHT, GRADE, DRIFT, MOUNT, BIAS, SQUAT, BARO_DRIFT, DEM_ERROR = range(8)
STATES = 8

DRIFT_TAU_S = 120.0
"""Correlation time of GNSS height errors: minutes for every class of receiver. What is learned is the rate."""
DEM_LENGTH_M = 120.0
PLACE_M2 = 1.5**2
"""Variance of the place along the road, as far as it matters for the grade there: about a second's share, m^2."""
ASKEW_SIGMA = 0.2
"""Grade that a vehicle sees across the road: times 1 - cosine of the angle between its course and the road."""
SLOW_MPS = 2.0
"""At this speed springs double the variance of pitch and force."""
_START_SIGMA = (100.0, 0.1, 30.0, 0.3, 0.03, 0.005, 100.0, 30.0)
_NEW_RUN = (1e4, 0.1**2)
_MOUNT_WALK = 1e-10
JUMP_SIGMA = {MOUNT: 0.05, DRIFT: 30.0}
"""Size of sudden changes where the drive shows them: a phone slides in its holder, a receiver converges anew."""
_STEP_S = 1e-3


@dataclass(frozen=True)
class Noise:
    """Noise levels of a drive, one sigma unless said otherwise.

    ``roughness``: variance of the grade's change per metre of road (1/m). ``altitude_m``: white part of the GNSS
    height; ``drift``: variance per second by which its error changes (m^2/s). ``doppler``: factor on the stated one.
    ``pitch``, ``force``: grade seen by the sensor against the road's, springs included; ``shared``: the part of a
    pitch error that the force shows as well. ``baro_m``, ``baro_drift`` (m^2/s) as for the altitude. ``dem_m``: DEM.
    """

    roughness: float = 3e-5
    altitude_m: float = 0.5
    drift: float = 0.15
    doppler: float = 1.0
    pitch: float = 0.012
    force: float = 0.02
    shared: float = 0.0
    baro_m: float = 0.3
    baro_drift: float = 0.01
    dem_m: float = 5.0

    def with_(self, **changes: float) -> Noise:
        """A copy with other levels."""
        return replace(self, **changes)


def row_unit(rows: Rows) -> Floats:
    """What each row's variance is in units of its sensor's level squared, shape (m,).

    A crawling vehicle heaves on its springs, when it pulls away above all, and its attitude sensor has not settled.
    """
    springs = np.isin(rows.sensor, (PITCH, FORCE))
    slow = 1 + (SLOW_MPS / np.maximum(rows.speed_mps, 0.1)) ** 2
    return np.where(rows.sensor == DOPPLER, rows.hint**2, np.where(springs, slow, 1.0))


def row_variance(rows: Rows, noise: Noise) -> Floats:
    """Variance of each row's white error, shape (m,), before robust weights."""
    level = np.array([noise.altitude_m, noise.doppler, noise.pitch, noise.force, noise.baro_m, 1.0])
    slope = np.isin(rows.sensor, (DOPPLER, PITCH, FORCE))
    place = noise.roughness * np.sqrt(PLACE_M2) + (ASKEW_SIGMA * rows.turn) ** 2
    return level[rows.sensor] ** 2 * row_unit(rows) + np.where(slope, place, 0.0)


def decorrelated(rows: Rows, noise: Noise) -> tuple[Rows, Floats]:
    """Rows with each force row made independent of the pitch row beside it, and the share of pitch taken off.

    Springs move the body under both sensors alike: force - shared * pitch is what the force says beyond the pitch.
    """
    partner = pitch_partner(rows)
    share = np.where(partner >= 0, noise.shared, 0.0)
    value = rows.value - share * np.where(partner >= 0, rows.value[partner], 0.0)
    return replace(rows, value=value), share


def pitch_partner(rows: Rows) -> Ints:
    """For each force row the index of the pitch row at the same time (within 0.3 s), else -1; -1 for other rows."""
    out = np.full(len(rows), -1, np.int64)
    pitch, force = np.flatnonzero(rows.sensor == PITCH), np.flatnonzero(rows.sensor == FORCE)
    if not len(pitch) or not len(force):
        return out
    right = np.clip(np.searchsorted(rows.time_s[pitch], rows.time_s[force]), 0, len(pitch) - 1)
    left = np.maximum(right - 1, 0)
    wanted = rows.time_s[force]
    lag_left, lag_right = (np.abs(rows.time_s[pitch[i]] - wanted) for i in (left, right))
    nearest = pitch[np.where(lag_left < lag_right, left, right)]
    close = (np.minimum(lag_left, lag_right) < 0.3) & (
        np.abs(rows.along_m[nearest] - rows.along_m[force]) < 8
    )
    out[force[close]] = nearest[close]
    return out


def design(rows: Rows, share: Floats) -> Floats:
    """Rows (m, STATES) of what each measurement sees."""
    out = np.zeros((len(rows), STATES))
    sensor = rows.sensor
    heights = np.isin(sensor, (ALTITUDE, BARO, TERRAIN))
    out[heights, HEIGHT] = 1.0
    out[sensor == ALTITUDE, DRIFT] = 1.0
    out[sensor == BARO, BARO_DRIFT] = 1.0
    out[sensor == TERRAIN, DEM_ERROR] = 1.0
    out[~heights, GRADE] = 1.0 - share[~heights]
    felt = np.isin(sensor, (PITCH, FORCE))
    out[felt, MOUNT] = 1.0 - share[felt]
    out[felt, SQUAT] = ((1.0 - share) * rows.acceleration_mps2)[felt]
    out[sensor == FORCE, BIAS] = 1.0
    return out


Jumps = tuple[tuple[int, int], ...]
"""(step, state) of sudden changes."""


@dataclass(frozen=True, eq=False)
class Steps:
    """The times at which anything is measured, shape (n,), and the row-to-step table (m,)."""

    time_s: Floats
    along_m: Floats
    run: Ints
    kink: Floats
    step: Ints


def build_steps(rows: Rows, path: DrivenPath) -> Steps:
    """Rows closer than a millisecond share a step; ``kink``: variance of grade changes at nodes since the last."""
    new = np.concatenate([[True], np.diff(rows.time_s) > _STEP_S])
    time, along, run = rows.time_s[new], rows.along_m[new], rows.run[new]
    total = np.concatenate([[0.0], np.cumsum(path.kinks())])
    passed = total[np.searchsorted(path.match.start_m, along, side="right")]
    kink = np.concatenate([[0.0], np.maximum(np.diff(passed), 0.0)])
    return Steps(time, along, run, kink, np.cumsum(new) - 1)


def linear_model(rows: Rows, steps: Steps, noise: Noise, variance: Floats, jumps: Jumps = ()) -> LinearModel:
    """The model for the filter; ``variance`` is that of each row, ``jumps`` are sudden changes of states at steps."""
    n = len(steps.time_s)
    dt = np.diff(steps.time_s, prepend=steps.time_s[:1])
    ds = np.maximum(np.diff(steps.along_m, prepend=steps.along_m[:1]), 0.0)
    fresh = np.diff(steps.run, prepend=steps.run[:1]) != 0
    transition = np.broadcast_to(np.eye(STATES), (n, STATES, STATES)).copy()
    transition[:, HEIGHT, GRADE] = np.where(fresh, 0.0, ds)
    transition[:, DRIFT, DRIFT] = np.exp(-dt / DRIFT_TAU_S)
    transition[:, DEM_ERROR, DEM_ERROR] = np.exp(-ds / DEM_LENGTH_M)
    q = np.zeros((n, STATES, STATES))
    q[:, HEIGHT, HEIGHT] = noise.roughness * ds**3 / 3 + np.where(fresh, _NEW_RUN[0], 0.0)
    q[:, HEIGHT, GRADE] = q[:, GRADE, HEIGHT] = noise.roughness * ds**2 / 2
    q[:, GRADE, GRADE] = noise.roughness * ds + steps.kink + np.where(fresh, _NEW_RUN[1], 0.0)
    q[:, DRIFT, DRIFT] = 0.5 * noise.drift * DRIFT_TAU_S * (1 - np.exp(-2 * dt / DRIFT_TAU_S))
    q[:, MOUNT, MOUNT] = _MOUNT_WALK * dt
    for k, state in jumps:
        q[k, state, state] += JUMP_SIGMA[state] ** 2
    q[:, BARO_DRIFT, BARO_DRIFT] = noise.baro_drift * dt
    q[:, DEM_ERROR, DEM_ERROR] = noise.dem_m**2 * (1 - np.exp(-2 * ds / DEM_LENGTH_M))
    clean, share = decorrelated(rows, noise)
    mean = np.zeros(STATES)
    heights = rows.value[np.isin(rows.sensor, (ALTITUDE, TERRAIN))]
    mean[HEIGHT] = float(np.median(heights[:50])) if len(heights) else 0.0
    pressed = rows.value[rows.sensor == BARO]
    if len(pressed):
        mean[BARO_DRIFT] = float(np.median(pressed[:50])) - mean[HEIGHT]
    return LinearModel(
        transition, q, mean, np.diag(np.square(_START_SIGMA)), steps.step, design(rows, share),
        clean.value, variance,
    )  # fmt: skip
