"""Learning a drive's noise levels from the drive itself.

Receivers differ by ten times, and accuracy columns may be wrong. White levels come from smoothed residuals (EM with
Student-t weights), the rates of drifting states from the likelihood; priors by what the log states keep short drives
sane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.filters.smoother import Smoothed
from fusion.methods.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, TERRAIN, Measurements
from fusion.methods.profile.model import (
    DRIFT_TAU_S,
    JUMP_SIGMA,
    Jumps,
    Noise,
    SmootherEpochs,
    decorrelated,
    design,
    linear_model,
    pitch_partner,
    variance_unit,
    white_variance,
)
from fusion.types import Bools, Floats

ROUNDS = 6
"""Of smoothing and learning; nothing tests for convergence."""
FIRST_JUMP_ROUND = 1
MAX_JUMPS = 4
"""Sudden changes of one kind in a drive; each round adds one at most, from ``FIRST_JUMP_ROUND`` on."""
JUMP_SCORE = 6.0
"""Standard deviations by which a state must break with its model to have changed suddenly."""
JUMP_SPACING_S = 5.0
STUDENT_T_FREEDOM = 5.0
"""Degrees of freedom of the Student-t errors: springs, kerbs and reflections have heavy tails."""
OUTLIER_SIGMAS = 4.0
"""A measurement that is farther off counts less with the fourth power of how far, and is reported as an outlier."""
CORRELATED_WITHIN_S = 0.8
"""Springs swing for about a second: errors farther apart than this are taken for independent (what is left between
those of neighbouring seconds is mostly road that the knots have not followed)."""
_PRIOR_COUNT = 15.0
"""Imaginary measurements that hold a level to where it started."""
_PRIOR_REACH = 4.0
"""... and that are at most so many times (in variance) from what the drive shows."""
_RATE_STEP = np.log(2.5)
"""Log-rates apart at which the likelihood is looked at; ``_RATE_MOVE`` is how far a round moves one at most."""
_RATE_MOVE = 1.2
_ROUGHNESS_PRIOR = (np.log(3e-5), 1.5)
"""Mean and sigma of the log of the roughness (1/m): flat towns have 3e-7, hills 1e-4 (spec 7)."""
_RATE_SPREAD = 1.0
"""Sigma of the logs of the other rates about where they started."""


@dataclass(frozen=True, eq=False)
class Learned:
    """The levels, each measurement's variance with its robust weight (m,), which are outliers (m,), the sudden changes
    found, and the smoothed drive."""

    noise: Noise
    variance: Floats
    outlier: Bools
    jumps: Jumps
    smoothed: Smoothed


def prior_noise(measured: Measurements) -> Noise:
    """Where learning starts: what the log says about itself, in bounds, else an ordinary receiver's."""
    stated = measured.stated_sigma[(measured.sensor == ALTITUDE) & np.isfinite(measured.stated_sigma)]
    v_acc = float(np.clip(np.median(stated), 0.3, 12.0)) if len(stated) else 4.0
    return Noise(
        altitude_m=float(np.clip(v_acc / 6, 0.1, 1.5)),
        drift=2 * v_acc**2 / DRIFT_TAU_S,
        dem_m=_dem_sigma(measured),
    )


def _dem_sigma(measured: Measurements) -> float:
    """Robust scatter of DEM heights about the altitudes; unknown datums shift both alike."""
    terrain, altitude = measured.sensor == TERRAIN, measured.sensor == ALTITUDE
    if not terrain.any() or not altitude.any():
        return Noise.dem_m
    excess = measured.value[terrain] - np.interp(
        measured.time_s[terrain], measured.time_s[altitude], measured.value[altitude]
    )
    spread = 1.4826 * float(np.median(np.abs(excess - np.median(excess))))
    return float(np.clip(spread, 3.0, 100.0))


def learn(measured: Measurements, epochs: SmootherEpochs, start: Noise) -> Learned:
    """Noise levels, sudden changes and the smoothed drive."""
    jumps: Jumps = ()
    noise, weight = start, np.ones(len(measured))
    for number in range(ROUNDS):
        variance = white_variance(measured, noise) / weight
        smoothed = linear_model(measured, epochs, noise, variance, jumps).smooth()
        if number >= FIRST_JUMP_ROUND:
            jumps = _with_jump(epochs, smoothed, jumps)
        second = _second_moment(smoothed, variance)
        noise = _levels(measured, epochs, noise, start, second * weight, smoothed, variance)
        weight = (STUDENT_T_FREEDOM + 1) / (
            STUDENT_T_FREEDOM + _normalised_square(measured, noise, smoothed, variance)
        )
        noise = _rates(measured, epochs, noise, start, weight, jumps)
    # Once the levels are known, what lies far outside of them is not merely weakened but left out.
    normalised = _normalised_square(measured, noise, smoothed, variance)
    weight = weight * np.minimum(1.0, (OUTLIER_SIGMAS**2 / np.maximum(normalised, 1e-9)) ** 2)
    variance = white_variance(measured, noise) * _correlation_inflation(measured, smoothed, variance) / weight
    smoothed = linear_model(measured, epochs, noise, variance, jumps).smooth()
    outlier = _normalised_square(measured, noise, smoothed, variance) > OUTLIER_SIGMAS**2
    return Learned(noise, variance, outlier, jumps, smoothed)


def _with_jump(epochs: SmootherEpochs, smoothed: Smoothed, jumps: Jumps) -> Jumps:
    """The sudden changes known so far, and for each kind of state the clearest further one."""
    found = list(jumps)
    for state in JUMP_SIGMA:
        known = [k for k, s in jumps if s == state]
        if len(known) >= MAX_JUMPS:
            continue
        score = np.abs(smoothed.break_score[:, state])
        score[0] = 0.0
        for k in known:
            score[np.abs(epochs.time_s - epochs.time_s[k]) < JUMP_SPACING_S] = 0.0
        k = int(np.argmax(score))
        if score[k] > JUMP_SCORE:
            found.append((k, state))
    return tuple(found)


def _normalised_square(measured: Measurements, noise: Noise, smoothed: Smoothed, variance: Floats) -> Floats:
    """Square of each measurement's error against an estimate without it, over what it should be; shape (m,).

    That is by the level's variance, not by the present one, which has its robust weight in it: weights would come and
    go from round to round.
    """
    expected = smoothed.residual_variance - variance + white_variance(measured, noise)
    return np.asarray(smoothed.residual**2 / expected)


def _second_moment(smoothed: Smoothed, variance: Floats) -> Floats:
    """Expected square of each measurement's error given everything."""
    error = variance * smoothed.residual / smoothed.residual_variance
    return np.asarray(error**2 + variance - variance**2 / smoothed.residual_variance)


def _levels(
    measured: Measurements,
    epochs: SmootherEpochs,
    noise: Noise,
    start: Noise,
    second: Floats,
    smoothed: Smoothed,
    variance: Floats,
) -> Noise:
    """White levels from expected squares, drawn to where they started by ``_PRIOR_COUNT`` imaginary measurements."""
    changes: dict[str, float] = {}
    levels = {ALTITUDE: "altitude_m", DOPPLER: "doppler", PITCH: "pitch", FORCE: "force", BARO: "baro_m"}
    for sensor, name in levels.items():
        mine = measured.sensor == sensor
        if not mine.any():
            continue
        unit = variance_unit(measured)[mine]
        shown = float(np.mean(second[mine] / unit))
        # What the log states may be wrong by ten times: it counts as far as the drive does not contradict it.
        prior = float(np.clip(getattr(start, name) ** 2, shown / _PRIOR_REACH, shown * _PRIOR_REACH))
        total = mine.sum() * shown + _PRIOR_COUNT * prior
        changes[name] = float(np.sqrt(total / (mine.sum() + _PRIOR_COUNT)))
    changes |= _shared(measured, epochs, noise, smoothed, variance)
    return noise.with_(**changes)


def _shared(
    measured: Measurements, epochs: SmootherEpochs, noise: Noise, smoothed: Smoothed, variance: Floats
) -> dict[str, float]:
    """The share of the pitch's error in the force beside it, by regression of the errors expected given everything."""
    partner = pitch_partner(measured)
    force = np.flatnonzero(partner >= 0)
    if len(force) <= 20:
        return {}
    pitch = partner[force]
    error = variance * smoothed.residual / smoothed.residual_variance
    seen = design(measured, decorrelated(measured, noise)[1])
    covariance = smoothed.covariance[epochs.of_measurement[force]]
    both = error[force] * error[pitch] + np.einsum("mi,mij,mj->m", seen[force], covariance, seen[pitch])
    alone = error[pitch] ** 2 + np.einsum("mi,mij,mj->m", seen[pitch], covariance, seen[pitch])
    # The force holds what is left after ``shared`` of the pitch was taken off.
    left = float(np.sum(both) / (np.sum(alone) + _PRIOR_COUNT * noise.pitch**2))
    return {"shared": float(np.clip(noise.shared + left, 0.0, 0.9))}


def _rates(
    measured: Measurements, epochs: SmootherEpochs, noise: Noise, start: Noise, weight: Floats, jumps: Jumps
) -> Noise:
    """One step of a parabola through three log-likelihoods, for each rate in turn."""
    wanted = {"roughness": _ROUGHNESS_PRIOR}
    if (measured.sensor == ALTITUDE).any():
        wanted["drift"] = (np.log(start.drift), _RATE_SPREAD)
    if (measured.sensor == BARO).any():
        wanted["baro_drift"] = (np.log(start.baro_drift), _RATE_SPREAD)

    def score(candidate: Noise, name: str, prior: tuple[float, float]) -> float:
        variance = white_variance(measured, candidate) / weight
        distance = (np.log(getattr(candidate, name)) - prior[0]) / prior[1]
        likelihood = linear_model(measured, epochs, candidate, variance, jumps).log_likelihood()
        return likelihood - 0.5 * float(distance) ** 2

    for name, prior in wanted.items():
        here = float(np.log(getattr(noise, name)))
        low, middle, high = (
            score(noise.with_(**{name: float(np.exp(here + d))}), name, prior)
            for d in (-_RATE_STEP, 0.0, _RATE_STEP)
        )
        curvature = low - 2 * middle + high
        move = 0.5 * _RATE_STEP * (low - high) / curvature if curvature < -1e-9 else np.sign(high - low)
        noise = noise.with_(**{name: float(np.exp(here + np.clip(move, -_RATE_MOVE, _RATE_MOVE)))})
    return noise


def _correlation_inflation(measured: Measurements, smoothed: Smoothed, variance: Floats) -> Floats:
    """Factor on the variance of sensors whose neighbouring errors repeat: (1 + r) / (1 - r) of lag one, at least 1."""
    out = np.ones(len(measured))
    error = smoothed.residual / smoothed.residual_variance * np.sqrt(variance)
    for sensor in (DOPPLER, PITCH, FORCE, BARO):
        mine = np.flatnonzero(measured.sensor == sensor)
        if len(mine) < 30:
            continue
        near = np.diff(measured.time_s[mine]) < CORRELATED_WITHIN_S
        first, second = np.clip(error[mine[:-1][near]], -3, 3), np.clip(error[mine[1:][near]], -3, 3)
        if len(first) < 20:
            continue
        r = float(np.sum(first * second) / max(np.sqrt(np.sum(first**2) * np.sum(second**2)), 1e-12))
        r = float(np.clip(r, 0.0, 0.8))
        out[mine] = (1 + r) / (1 - r)
    return out
