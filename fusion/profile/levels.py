"""The noise levels under which a drive's measurements are most likely: white levels and rates of drifts at once.

The gradient of the likelihood comes from one pass of the smoother (Koopman and Shephard 1992). Outliers and sudden
changes of the drive are given; ``noise`` finds them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from fusion.filters.smoother import Entries, LinearModel, Scores
from fusion.network.curve import RANDOM_WALK_M
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, SENSORS, Measurements
from fusion.profile.model import (
    GRADE,
    RATES,
    Jumps,
    Noise,
    SmootherEpochs,
    grades_carried,
    linear_model,
    misalignment_variance,
    step_noise,
    steps_noise,
    variance_unit,
    white_level,
    white_variance,
)
from fusion.profile.prior import LOG_GRADE_LENGTH, WHITE, Prior
from fusion.types import Floats

STUDENT_T_FREEDOM = 5.0
"""Degrees of freedom of the Student-t errors: springs, kerbs and reflections have heavy tails."""
ROBUST_INFORMATION_LOSS = (STUDENT_T_FREEDOM + 3) / (STUDENT_T_FREEDOM + 1)
"""Variance of the Gaussian error that leaves as much information as an error of Student's t of scale 1. The latter's
Fisher information is (nu + 1) / (nu + 3) (Lange, Little and Taylor 1989)."""
_SIGMAS = {*WHITE.values(), "wander"}
"""Levels that are sigmas; the others are variances, for a metre or a second."""
LEAST_HEIGHT_M = 0.05
"""No receiver's height is surer than this, however smooth a filter makes it. It is stated in decimetres (NMEA 0183;
0.03 m), the body heaves on its springs (0.03 m), and the lane has a crossfall of 2.5 % (0.01 m)."""
LEAST_PRESSURE_HEIGHT_M = 0.1
"""No barometer's height is surer than this on the road, gusts apart (``model.GUST_MPS``)."""
_STEPS = 10
"""The optimisation ends after so many steps."""
_CLOSE = 0.05
"""It also ends where its gradient is so small, in sigmas of the levels."""
_FARTHEST = 3.0
"""How far a log moves in a round at most."""
_SHARE_TOLD = 0.3
"""Share of a white level's information that is left where states are unknown. It scales the first step."""
_BEND_STEP = 0.3
"""Upward step of a log over which the bend of the likelihood is taken. Errors of a level matter from about this size
on, and it is the upward ones that the expected variances come from."""
_LENGTH_STEP = 0.01
"""Step of the log of a grade's length over which the derivatives of the model are taken."""
MOST_UNCERTAIN = 1.0
"""The largest sigma of a log that is counted. Beyond it the prior's tail would speak almost alone."""


def _least() -> dict[str, float]:
    return {"altitude_m": LEAST_HEIGHT_M, "baro_m": LEAST_PRESSURE_HEIGHT_M}


def gaussian_variance(measured: Measurements, noise: Noise) -> Floats:
    """Variance (m,) of Gaussian errors that tell as much as those of the measurements, which are Student's t."""
    return np.asarray(ROBUST_INFORMATION_LOSS * white_variance(measured, noise))


def expected_levels(
    measured: Measurements, model: LinearModel, noise: Noise, weight: Floats
) -> tuple[Noise, Floats]:
    """One step of EM on the white levels alone, and new weights (m,): rough, but it gets away from any start."""
    variance = white_variance(measured, noise) / weight
    smoothed = model.at_levels({}, {}, variance).scores()
    second = _second_moment(smoothed, variance) * weight / variance_unit(measured)
    levels = {
        name: float(np.sqrt(np.mean(second[measured.sensor == sensor])))
        for sensor, name in WHITE.items()
        if (measured.sensor == sensor).any()
    }
    levels |= {name: max(levels[name], least) for name, least in _least().items() if name in levels}
    noise = noise.with_(**levels)
    square = normalised_square(smoothed, variance, white_variance(measured, noise))
    return noise, (STUDENT_T_FREEDOM + 1) / (STUDENT_T_FREEDOM + square)


def _second_moment(smoothed: Scores, variance: Floats) -> Floats:
    """Expected square of each measurement's error given everything."""
    error = variance * smoothed.residual / smoothed.residual_variance
    return np.asarray(error**2 + variance - variance**2 / smoothed.residual_variance)


def normalised_square(smoothed: Scores, variance: Floats, usual: Floats) -> Floats:
    """Square of each measurement's error against an estimate without it, over the expected square; shape (m,).

    The expected square comes from the ``usual`` variance. The present variance holds the robust weight: with it,
    weights would come and go from round to round.
    """
    # Of tiny weights rounding leaves anything.
    without = np.maximum(smoothed.residual_variance - variance, 0.0)
    return np.asarray(smoothed.residual**2 / (without + usual))


def most_likely(
    measured: Measurements,
    epochs: SmootherEpochs,
    noise: Noise,
    prior: Prior,
    weight: Floats,
    jumps: Jumps,
    look: Callable[[], None] = lambda: None,
) -> Noise:
    """Levels near the most likely ones, from ``noise`` on, held by weak priors; ``look``: before each step."""
    if noise.grade_length_m == RANDOM_WALK_M and knows_lengths(measured):
        noise = noise.with_(grade_length_m=float(np.exp(LOG_GRADE_LENGTH[0])))
    likelihood = _Likelihood.about(measured, epochs, noise, weight, jumps)
    names = likelihood.names
    mean, sigma = np.array([prior.of(n) for n in names]).T
    begin = np.log([getattr(noise, n) for n in names])
    counts: list[float] = [2 * int(np.sum(measured.sensor == sensor)) for sensor in likelihood.white]
    counts += [len(epochs.time_s) / 8] * (len(names) - len(counts))
    scale = np.sqrt(_SHARE_TOLD * np.array(counts) + sigma**-2)

    def at(step: Floats) -> Noise:
        return noise.with_(**dict(zip(names, np.exp(begin + step / scale).tolist(), strict=True)))

    def loss(step: Floats) -> tuple[float, Floats]:
        look()
        value, gradient = likelihood.at(at(step))
        off = (begin + step / scale - mean) / sigma
        return 0.5 * float(off @ off) - value, (off / sigma - gradient) / scale

    bound = np.column_stack([-_FARTHEST * scale, _FARTHEST * scale])
    for k, name in enumerate(names):
        if name in _least():
            bound[k, 0] = max(bound[k, 0], scale[k] * (np.log(_least()[name]) - begin[k]))
    best = optimize.minimize(
        loss,
        np.zeros(len(names)),
        jac=True,
        method="L-BFGS-B",
        bounds=bound,
        options={"maxiter": _STEPS, "maxfun": 2 * _STEPS, "gtol": _CLOSE},
    )
    return at(best.x)


def log_sigmas(
    measured: Measurements,
    epochs: SmootherEpochs,
    noise: Noise,
    prior: Prior,
    weight: Floats,
    jumps: Jumps,
    look: Callable[[], None] = lambda: None,
) -> dict[str, float]:
    """How uncertain the logs of the levels are near the most likely ones, ``noise``; 0 where a level is the least.

    The sigmas come from the likelihood's bend and the priors' precision, and are never above the priors' own. The bend
    takes one more gradient for each level.
    """
    likelihood = _Likelihood.about(measured, epochs, noise, weight, jumps)
    names = likelihood.names
    sigma = np.array([prior.of(n)[1] for n in names])
    here = likelihood.at(noise)[1]
    free = [k for k, n in enumerate(names) if getattr(noise, n) > 1.01 * _least().get(n, 0.0)]
    bend = np.zeros((len(free), len(free)))
    for row, k in enumerate(free):
        look()
        there = likelihood.at(noise.with_(**{names[k]: getattr(noise, names[k]) * np.exp(_BEND_STEP)}))[1]
        bend[row] = ((here - there) / _BEND_STEP)[free]
    sigma = sigma[free]
    curvature, axes = np.linalg.eigh(0.5 * (bend + bend.T) * np.outer(sigma, sigma))
    share = (axes**2) @ (1 / (1 + np.maximum(curvature, 0.0)))
    sigmas = dict(zip([names[k] for k in free], (sigma * np.sqrt(share)).tolist(), strict=True))
    return {name: min(sigmas.get(name, 0.0), MOST_UNCERTAIN) for name in names}


def expected(noise: Noise, log_sigma: Mapping[str, float]) -> Noise:
    """The levels of the variances that are to be expected where logs err normally: E[exp(x)] = exp(mean + sigma^2 / 2).

    Of a level that is a sigma itself, twice its log is meant.
    """
    power = {name: 1.0 if name in _SIGMAS else 0.5 for name in log_sigma if name != "grade_length_m"}
    return noise.with_(
        **{n: getattr(noise, n) * float(np.exp(p * log_sigma[n] ** 2)) for n, p in power.items()}
    )


def knows_lengths(measured: Measurements) -> bool:
    """Whether a drive may learn over which length grades go back to level.

    The error of a height that walks in time looks like a road whose grade has a short length; so do bursts of bad
    Doppler, and so do springs. It takes both kinds of grades to tell them apart.
    """
    return bool((measured.sensor == DOPPLER).any() and measured.of(PITCH, FORCE).any())


def _learned(measured: Measurements) -> tuple[dict[int, str], list[str]]:
    """The white levels, by sensor, and the rates that a drive's measurements tell."""
    white = {sensor: name for sensor, name in WHITE.items() if (measured.sensor == sensor).any()}
    rates = ["roughness"]
    rates += ["drift"] if ALTITUDE in white else []
    rates += ["baro_drift"] if BARO in white else []
    rates += ["wander"] if PITCH in white or FORCE in white else []
    return white, rates


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """The likelihood of a drive's levels, with all that stays as it is while they are sought.

    ``white`` are the white levels, by sensor. ``unit`` and ``misalignment`` (m,): parts of the variances, with weights;
    ``fixed``: of the steps' noise what is not learned, at the entries that the ``rates`` change.
    """

    measured: Measurements
    white: dict[int, str]
    unit: Floats
    misalignment: Floats
    epochs: SmootherEpochs
    model: LinearModel
    fixed: Entries
    rates: list[str]

    @classmethod
    def about(
        cls, measured: Measurements, epochs: SmootherEpochs, noise: Noise, weight: Floats, jumps: Jumps
    ) -> _Likelihood:
        """Near the levels ``noise``."""
        white, rates = _learned(measured)
        lost = ROBUST_INFORMATION_LOSS / weight
        unit, misalignment = lost * variance_unit(measured), lost * misalignment_variance(measured)
        model = linear_model(measured, epochs, noise, unit, jumps)
        others = steps_noise(epochs, noise, jumps, [name for name in RATES if name not in rates])
        fixed = {p: others.get(p, np.zeros(1)) for name in rates for p in step_noise(epochs, noise, name)}
        return cls(measured, white, unit, misalignment, epochs, model, fixed, rates)

    @property
    def names(self) -> list[str]:
        """The levels: white ones, then rates, and last the grade's length where the drive may learn it."""
        return [*self.white.values(), *self.rates, *["grade_length_m"][: knows_lengths(self.measured)]]

    def at(self, noise: Noise) -> tuple[float, Floats]:
        """The log-likelihood, and its derivatives by the logs of the levels, in the order of ``names``."""
        sensor, length = self.measured.sensor, noise.grade_length_m
        variance = white_level(sensor, noise) ** 2 * self.unit + self.misalignment
        parts = {name: step_noise(self.epochs, noise, name) for name in self.rates}
        total = {entry: self.fixed[entry] + value for part in parts.values() for entry, value in part.items()}
        learns_length = knows_lengths(self.measured)
        carried = grades_carried(self.epochs, length) if learns_length else {}
        scores = self.model.at_levels(total, carried, variance).scores(GRADE if learns_length else -1)
        white = scores.level_score(variance) * (1 - self.misalignment / variance)
        by_sensor = np.bincount(sensor, white, len(SENSORS))
        slopes = [2 * float(by_sensor[code]) for code in self.white]
        slopes += [_power(name) * scores.noise_score(part) for name, part in parts.items()]
        if learns_length:
            longer = noise.with_(grade_length_m=length * float(np.exp(_LENGTH_STEP)))
            noisier = _change(parts["roughness"], step_noise(self.epochs, longer, "roughness"))
            farther = _change(carried, grades_carried(self.epochs, longer.grade_length_m))
            slopes.append(scores.noise_score(noisier) + scores.carry_score(farther))
        return scores.log_likelihood, np.array(slopes)


def _change(here: Entries, longer: Entries) -> Entries:
    """Derivatives of entries by the log of the grade's length."""
    return {entry: (longer[entry] - value) / _LENGTH_STEP for entry, value in here.items()}


def _power(rate: str) -> int:
    """The power of a level that its variance is proportional to."""
    return 2 if rate == "wander" else 1
