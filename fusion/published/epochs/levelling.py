"""Take the misalignment of a pitch sensor out by the drive's own heights, before a filter takes its pitch.

Every real mount has a misalignment: one degree reads as 1.7 % of slope on each segment. Over a whole drive the
integral of the true grade along the road is the height gained, whatever the road does in between; what the
sensor's integral has beyond it is the mount pitch.

Filters that go forwards need it before they start, so it is one number here. ``methods.profile`` smooths a whole drive
at once and has the mount pitch as a state, which may also jump (``profile.model``, ``profile.noise``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.filters.kalman import correct_scalar, predict
from fusion.published.epochs.table import MAD_TO_SIGMA, UNKNOWN_ALTITUDE_SIGMA_M, Epochs
from fusion.types import Floats

_MIN_SPEED_MPS = 2.0  # slower, vertical over ground speed is noise
_ALTITUDE_TAU_S = 100.0  # correlation time of GNSS height errors, minutes for every receiver class
_ALTITUDE_WHITE_M = 0.5  # what is white of them
_DEFAULT_DOPPLER_SIGMA_MPS = 0.3  # accuracy of a vertical velocity that states none
_SUSPENSION_GRADE = 0.011  # sd of the body's motion on its springs (on the Karlsruhe drives 0.8 to 1.2 %)
_SUSPENSION_TAU_S = 1.0  # how long it hangs together (the same drives)
_MAX_POINTS = 400  # altitudes of a stretch that are used: more of them say the same again
_VAGUE_M, _VAGUE_GRADE = 1e4, 1e2  # spreads of offset and tilt at the start of the fit: nothing is known


@dataclass(frozen=True)
class MountPitch:
    """The estimated pitch of the sensor in the vehicle, as a grade that adds to the true one in its readings.

    ``source`` says what it was estimated from.
    """

    grade: float
    sigma: float
    source: str

    @property
    def angle_rad(self) -> float:
        """The mount pitch as an angle."""
        return float(np.arctan(self.grade))

    @property
    def known(self) -> bool:
        """Whether the drive told anything about the mount pitch."""
        return bool(np.isfinite(self.sigma))


def unknown_mount(why: str) -> MountPitch:
    """Grade 0 with infinite sigma; ``why`` stands for the source."""
    return MountPitch(0.0, np.inf, why)


def estimate_mount(epochs: Epochs) -> MountPitch:
    """Estimate the mount pitch from vertical Doppler velocity and from altitudes, by inverse variance.

    Returns grade 0 with infinite sigma where the drive holds neither or never moves.
    """
    return _weighed([e for e in (_from_doppler(epochs), _from_altitude(epochs)) if e.sigma > 0])


def _weighed(estimates: list[MountPitch]) -> MountPitch:
    """The estimates that say anything, combined by inverse variance."""
    known = [e for e in estimates if e.known]
    if not known:
        return unknown_mount("none")
    weight = np.array([1 / e.sigma**2 for e in known])
    grade = float(np.sum(weight * [e.grade for e in known]) / weight.sum())
    return MountPitch(
        grade, float(weight.sum() ** -0.5), " and ".join(dict.fromkeys(e.source for e in known))
    )


def mount_report(mount: MountPitch) -> dict[str, object]:
    """What a drive's report says of the tilt, JSON-serialisable; null where nothing is known of it."""
    return {
        "mount_pitch_deg": math.degrees(mount.angle_rad) if mount.known else None,
        "mount_pitch_sigma_deg": math.degrees(mount.sigma) if mount.known else None,
        "mount_pitch_source": mount.source,
    }


def _from_doppler(epochs: Epochs) -> MountPitch:
    """Weighted mean of tan(pitch) - v_up / v: white, so an hour of driving fixes it to a few 0.01 %."""
    use = np.isfinite(epochs.pitch_rad + epochs.vel_u_mps + epochs.speed_mps) & (
        epochs.speed_mps > _MIN_SPEED_MPS
    )
    if np.count_nonzero(use) < 10:
        return unknown_mount("none")
    speed = epochs.speed_mps[use]
    excess = np.tan(epochs.pitch_rad[use]) - epochs.vel_u_mps[use] / speed
    sigma = np.nan_to_num(epochs.s_acc_mps[use], nan=_DEFAULT_DOPPLER_SIGMA_MPS)
    weight = 1 / ((sigma / speed) ** 2 + _SUSPENSION_GRADE**2)
    grade = _robust_mean(excess, weight)
    spread = np.sqrt(np.sum(weight * (excess - grade) ** 2) / weight.sum())
    return MountPitch(grade, float(1.5 * spread / np.sqrt(len(excess))), "Doppler velocity")


def _robust_mean(values: Floats, weight: Floats) -> float:
    """Weighted mean with Huber weights about the median: one bump or one bad epoch must not tilt a drive."""
    centre = float(np.median(values))
    for _ in range(10):
        scale = max(MAD_TO_SIGMA * float(np.median(np.abs(values - centre))), 1e-6)
        huber = weight * np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(values - centre), 1e-12))
        centre = float(np.sum(huber * values) / huber.sum())
    return centre


def _from_altitude(epochs: Epochs) -> MountPitch:
    """Regress (altitude - integral of measured grade) on distance, stretch by stretch."""
    usable = np.isfinite(epochs.pitch_rad) & np.isfinite(epochs.speed_mps)
    breaks = np.flatnonzero(epochs.after_outage | ~usable)
    parts = np.split(np.arange(len(epochs)), breaks)
    return _weighed([_stretch(epochs, part) for part in parts if len(part) >= 10])


def _stretch(epochs: Epochs, part: NDArray[np.intp]) -> MountPitch:
    """Generalised least squares under a Gauss-Markov height error, for one uninterrupted stretch."""
    part = part[np.isfinite(epochs.pitch_rad[part]) & np.isfinite(epochs.speed_mps[part])]
    time_s = epochs.time_s[part]
    step = np.diff(time_s)
    speed = epochs.speed_mps[part]
    metres = 0.5 * (speed[1:] + speed[:-1]) * step
    grade = np.tan(epochs.pitch_rad[part])
    distance = np.concatenate([[0.0], np.cumsum(metres)])
    climb = np.concatenate([[0.0], np.cumsum(metres * 0.5 * (grade[1:] + grade[:-1]))])
    known = np.flatnonzero(np.isfinite(epochs.alt_m[part]))
    if len(known) < 10 or distance[known[-1]] - distance[known[0]] < 100.0:
        return unknown_mount("none")
    known = known[:: max(1, len(known) // _MAX_POINTS)]
    index, time_s, distance = part[known], time_s[known], distance[known]
    sigma = np.nan_to_num(epochs.v_acc_m[index], nan=UNKNOWN_ALTITUDE_SIGMA_M)
    # The sensor's integral wanders as well: white suspension noise adds up to a random walk along the road.
    squares_per_s = np.mean(np.diff(distance) ** 2 / np.diff(time_s))
    walk = _SUSPENSION_GRADE**2 * 2 * _SUSPENSION_TAU_S * squares_per_s / np.mean(np.diff(distance))
    misfit = epochs.alt_m[index] - climb[known]
    slope, variance = _mount_pitch_of_misfit(misfit, time_s, distance, sigma, float(walk))
    return MountPitch(slope, math.sqrt(variance), "altitude")


@compiled
def _mount_pitch_of_misfit(
    misfit: Floats, time_s: Floats, distance: Floats, sigma: Floats, walk: float
) -> tuple[float, float]:
    """Fit misfit = offset - grade * distance to n heights, (n,) each; returns the mount pitch (grade), its variance.

    Their errors are a Gauss-Markov process in time of ``sigma``, a random walk along the road of variance ``walk`` per
    metre, and white noise. Least squares under such errors is a Kalman filter over offset, grade and both errors.
    """
    level = misfit[0]
    mean = np.zeros(4)
    covariance = np.diag(np.array([_VAGUE_M**2, _VAGUE_GRADE**2, 1.0, walk * distance[0]]))
    for k in range(len(misfit)):
        if k:
            keep = math.exp((time_s[k - 1] - time_s[k]) / _ALTITUDE_TAU_S)
            noise = np.array([0.0, 0.0, 1.0 - keep * keep, walk * (distance[k] - distance[k - 1])])
            F = np.diag(np.array([1.0, 1.0, keep, 1.0]))
            mean, covariance = predict(mean, covariance, F, np.diag(noise))
        row = np.array([1.0, -distance[k], sigma[k], 1.0])
        correct_scalar(mean, covariance, misfit[k] - level - np.sum(row * mean), row, _ALTITUDE_WHITE_M**2)
    return mean[1], covariance[1, 1]
