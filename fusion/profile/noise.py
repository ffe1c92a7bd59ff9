"""Learning a drive's noise levels from the drive itself, with its outliers and sudden changes.

Receivers differ by ten times, and accuracy columns may be wrong. Each round has three steps: find the most likely
levels (``levels``), give less weight to what lies far outside of them, and note a sudden change where the drive
breaks with the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from fusion.filters.smoother import Scores, Smoothed
from fusion.profile.blocks import spaced
from fusion.profile.levels import (
    LEAST_HEIGHT_M,
    ROBUST_INFORMATION_LOSS,
    STUDENT_T_FREEDOM,
    expected,
    expected_levels,
    gaussian_variance,
    log_sigmas,
    most_likely,
    normalised_square,
)
from fusion.profile.measurements import ALTITUDE, DOPPLER, FORCE, PITCH, TERRAIN, Measurements
from fusion.profile.model import (
    BARO_DRIFT,
    BIAS,
    GRADE,
    HEIGHT,
    JUMP_SIGMA,
    MOUNT,
    SPEED_PRESSURE,
    SQUAT,
    Jumps,
    Noise,
    SmootherEpochs,
    decorrelated,
    design,
    linear_model,
    pitch_partner,
    white_variance,
)
from fusion.profile.prior import Prior
from fusion.types import Bools, Floats, Ints, Progress, no_progress

FIRST_ROUNDS, ROUNDS = 3, 3
"""Rounds of rough steps from wherever the levels start, and rounds of likely levels, weights and sudden changes after
them. Nothing tests for convergence. One rough round makes slopes between high buildings 24 % worse; two of the others
make those of bad Doppler 2 %, of altitudes that jump 3 to 11 % worse."""
FILTERED = 1.3
"""Heights whose white level is found below so many times the least possible one come out of a filter."""
HEIGHTS_APART_S = 8.0
"""Heights that lie so far apart share no error of a receiver's filter, which remembers for one to three seconds."""
TAIL_SIGMAS = 2.5
"""Beyond this a measurement counts less while levels are learned: with the square of how far. Chosen on karlsruhe 00,
05, 08, 09 and 10; without it bursts of bad Doppler make slopes 5 % worse."""
JUMP_SCORE = 6.0
"""Standard deviations by which a state must break with its model to have changed suddenly (de Jong and Penzer 1998).
Chosen so that drives without any show none; without it a phone that slides makes slopes 18 to 46 % worse."""
JUMP_SPACING_S = 5.0
OUTLIER_SIGMAS = 4.0
"""A measurement that is farther off counts less with the fourth power of how far, and is reported as an outlier. Chosen
for bursts of bad Doppler, which cost 2 to 4 % without it; clean logs of the best receiver do better without (05)."""
CORRELATED_WITHIN_S = 0.8
"""Springs swing for about a second, so errors farther apart than this are taken for independent. What neighbouring
seconds still have in common is mostly road that the knots have not followed. It matters to logs of 2 Hz and more alone:
by M8 at 10 Hz slopes are 0.3 % worse without (road 08: 2 %)."""
FREEDOMS = (2.0, 3.0, 4.0, STUDENT_T_FREEDOM)
"""Degrees of freedom of Student's t that a sensor's tails may have in the end: heavier than usual in street canyons.
Lighter ones were tried: white noise gains nothing by them, and errors that hang together look like it."""
_MUTED_WEIGHT = 1e-9
"""Weight of what has no say in learning."""
SHARED_START = 0.8
"""The part of a pitch error in the force beside it, before anything is learned. If it began at 0, errors that both show
would be taken for road."""
_SHARED_PRIOR_COUNT = 15.0
"""Imaginary pairs of pitch and force whose errors have nothing in common."""


_SHOWN = (HEIGHT, GRADE, MOUNT, BIAS, SQUAT, BARO_DRIFT, SPEED_PRESSURE)
"""The states that factors, tracks, pictures and reports are made of. Of a long drive each takes tens of megabytes."""
USUAL_LOOKS = 60
"""About so often the smoother goes over a drive until its levels are known."""


class Looks:
    """Tells ``progress`` how far learning is: called whenever the smoother is about to go over the drive."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._done = progress, 0

    def __call__(self) -> None:
        """Before it does."""
        self.between()
        self._done += 1

    def between(self) -> None:
        """While it does: whoever asked may want an end."""
        self._progress("smooth", min(self._done / USUAL_LOOKS, 1.0))


@dataclass(frozen=True, eq=False)
class Learned:
    """What a drive says of itself.

    ``noise`` are the most likely levels. ``expected`` are the levels of the expected variances; everything else here
    rests on these. ``variance`` (m,) is each measurement's with its robust weight, ``outlier`` (m,) says which are far
    off, ``jumps`` are the sudden changes found, and ``smoothed`` is the drive by the model of all this.
    """

    noise: Noise
    expected: Noise
    variance: Floats
    outlier: Bools
    jumps: Jumps
    smoothed: Smoothed


def learn(
    measured: Measurements,
    epochs: SmootherEpochs,
    prior: Prior,
    *,
    by_satellites: bool = True,
    progress: Progress = no_progress,
) -> Learned:
    """Noise levels, sudden changes and the smoothed drive; ``by_satellites``: altitudes are a receiver's."""
    look = Looks(progress)
    epochs = replace(epochs, between=look.between)
    noise, jumps, variance, smoothed, robust = _levels(measured, epochs, prior, look)
    filtered = by_satellites and noise.altitude_m < FILTERED * LEAST_HEIGHT_M
    every = np.ones(len(measured), bool), np.ones(len(measured))
    used, repeated = _apart(measured) if filtered else every
    chosen = measured.take(used), replace(epochs, of_measurement=epochs.of_measurement[used])
    if filtered:
        noise = most_likely(*chosen, noise, prior, robust[used], jumps, look)
        variance = gaussian_variance(measured, noise) * repeated / robust
        smoothed = linear_model(measured, epochs, noise, variance, jumps).scores()
    likely = expected(noise, log_sigmas(*chosen, noise, prior, robust[used], jumps, look))
    del chosen  # of a long drive it is large
    # Once the levels are known, what lies far outside of them is not merely weakened but left out.
    usual = white_variance(measured, likely) * repeated
    square = normalised_square(smoothed, variance, usual)
    weight = np.where(_muted(measured), 1.0, _tail_weights(measured, square) * _outlier_factor(square))
    variance = usual * _correlation_inflation(measured, smoothed, variance) / weight
    model = linear_model(measured, epochs, likely, variance, jumps)
    smoothed = replace(model.smooth(states=_SHOWN), pull={}, pull_precision={}, carry_pull={})
    outlier = normalised_square(smoothed, variance, usual) > OUTLIER_SIGMAS**2
    return Learned(noise, likely, variance, outlier, jumps, smoothed)


def _levels(
    measured: Measurements, epochs: SmootherEpochs, prior: Prior, look: Callable[[], None]
) -> tuple[Noise, Jumps, Floats, Scores, Floats]:
    """Levels, sudden changes, variances, what the smoother says by them, and new weights, found in rounds.

    The variances are those of the last levels but one. The elevation model has no say where anything else is known: its
    errors would pass for the road's shape.
    """
    jumps: Jumps = ()
    paired = bool(np.any(pitch_partner(measured) >= 0))
    counts = np.where(_muted(measured), _MUTED_WEIGHT, 1.0)
    noise, weight = prior.noise.with_(shared=SHARED_START if paired else 0.0), counts
    model = linear_model(measured, epochs, noise, weight)
    for _ in range(FIRST_ROUNDS):
        look()
        noise, weight = expected_levels(measured, model, noise, weight)
        weight = weight * counts
    for _ in range(ROUNDS):
        del model  # before the next one is made: both are large
        noise = most_likely(measured, epochs, noise, prior, weight, jumps, look)
        usual = gaussian_variance(measured, noise)
        variance = usual / weight
        model = linear_model(measured, epochs, noise, variance, jumps)
        springs = _Springs.of(measured, epochs, noise) if paired else None
        smoothed = model.smooth(springs.look, states=()) if springs else model.scores()
        jumps = _with_jump(epochs, smoothed, jumps)
        if springs:
            noise = noise.with_(**springs.shared(smoothed, variance))
        smoothed = smoothed.of_measurements()
        square = np.maximum(normalised_square(smoothed, variance, usual), 1e-9)
        weight = np.minimum(1.0, TAIL_SIGMAS**2 / square) * _outlier_factor(square) * counts
    return noise, jumps, variance, smoothed, weight


def _muted(measured: Measurements) -> Bools:
    """What has no say in learning, (m,): an elevation model beside anything else."""
    terrain = measured.sensor == TERRAIN
    return np.asarray(terrain & ~terrain.all())


def _tail_weights(measured: Measurements, square: Floats) -> Floats:
    """Student's t weights (m,) with tails as heavy as each sensor shows, by squares over those of the white levels.

    Whatever the tails, errors tell as much as Gaussian ones of ``gaussian_variance``.
    """
    weight = np.ones(len(square))
    for sensor in np.unique(measured.sensor):
        mine = measured.sensor == sensor
        likelihood = np.array([_tail_likelihood(one, square[mine]) for one in FREEDOMS])
        # Their mean by probability, so that a little more or less of a log changes weights little.
        freedom = float(np.exp(np.average(np.log(FREEDOMS), weights=np.exp(likelihood - likelihood.max()))))
        scaled = square[mine] * (freedom + 3) / (freedom + 1) / ROBUST_INFORMATION_LOSS
        weight[mine] = (freedom + 1) / (freedom + scaled)
    return weight


def _tail_likelihood(freedom: float, square: Floats) -> float:
    """Log-likelihood of degrees of freedom, of whatever scale."""
    scale = 1.0
    for _ in range(5):
        scale = float(np.mean((freedom + 1) / (freedom + square / scale) * square))
    density = gammaln((freedom + 1) / 2) - gammaln(freedom / 2) - 0.5 * np.log(freedom * scale)
    tails = 0.5 * (freedom + 1) * np.sum(np.log1p(square / scale / freedom))
    return float(len(square) * density - tails)


def _apart(measured: Measurements) -> tuple[Bools, Floats]:
    """Where altitudes come out of a filter: which measurements tell levels (m,), and how many share one error (m,).

    Altitudes tell levels only if they are ``HEIGHTS_APART_S`` apart. Those that a receiver's filter has smoothed err
    together from epoch to epoch. This looks as if they had neither error nor drift, and their error looks like road.
    """
    altitude = measured.sensor == ALTITUDE
    mine = np.flatnonzero(altitude)
    apart = mine[spaced(measured.time_s[mine], 0.95 * HEIGHTS_APART_S)]
    used = ~altitude
    used[apart] = True
    return used, np.where(altitude, len(mine) / max(len(apart), 1), 1.0)


def _outlier_factor(square: Floats) -> Floats:
    """Factor on the weight of measurements whose squared errors are so large, (m,)."""
    return np.asarray(np.minimum(1.0, (OUTLIER_SIGMAS**2 / np.maximum(square, 1e-9)) ** 2))


def _with_jump(epochs: SmootherEpochs, smoothed: Scores, jumps: Jumps) -> Jumps:
    """The sudden changes known so far, and for each kind of state the clearest further one: one a round at most."""
    extended = list(jumps)
    for state in JUMP_SIGMA:
        known = [k for k, s in jumps if s == state]
        score = np.abs(smoothed.break_score(state))
        score[0] = 0.0
        for k in known:
            score[np.abs(epochs.time_s - epochs.time_s[k]) < JUMP_SPACING_S] = 0.0
        k = int(np.argmax(score))
        if score[k] > JUMP_SCORE:
            extended.append((k, state))
    return tuple(extended)


@dataclass(frozen=True, eq=False)
class _Springs:
    """The share of the pitch's error in the force beside it, by regression of the errors expected given everything.

    ``force`` and ``pitch`` (p,) are the measurements, ``seen`` (m, states) what each measurement sees; ``together`` (2,
    p) are, once the smoother has shown covariances, what these make of both errors and of that of the pitch alone.
    """

    noise: Noise
    force: Ints
    pitch: Ints
    seen: Floats
    epoch: Ints
    together: Floats

    @classmethod
    def of(cls, measured: Measurements, epochs: SmootherEpochs, noise: Noise) -> _Springs:
        """Before the smoother has run."""
        partner = pitch_partner(measured)
        force = np.flatnonzero(partner >= 0)
        seen = design(measured, decorrelated(measured, noise)[1])
        epoch, together = epochs.of_measurement[force], np.zeros((2, len(force)))
        return cls(noise, force, partner[force], seen, epoch, together)

    def look(self, piece: slice, covariance: Floats) -> None:
        """See ``smoother.Look``."""
        mine = slice(*np.searchsorted(self.epoch, [piece.start, piece.stop]))
        at = covariance[self.epoch[mine] - piece.start]
        pitch = self.seen[self.pitch[mine]]
        for out, one in zip(self.together, (self.seen[self.force[mine]], pitch), strict=True):
            out[mine] = np.einsum("mi,mij,mj->m", one, at, pitch)

    def shared(self, smoothed: Scores, variance: Floats) -> dict[str, float]:
        """The level, from what it was in ``noise`` on."""
        if len(self.force) <= 20:
            return {}
        error = variance * smoothed.residual / smoothed.residual_variance
        both = error[self.force] * error[self.pitch] + self.together[0]
        alone = error[self.pitch] ** 2 + self.together[1]
        # The force holds what is left after ``shared`` of the pitch was taken off.
        left = float(np.sum(both) / (np.sum(alone) + _SHARED_PRIOR_COUNT * self.noise.pitch**2))
        return {"shared": float(np.clip(self.noise.shared + left, 0.0, 0.9))}


def _correlation_inflation(measured: Measurements, smoothed: Scores, variance: Floats) -> Floats:
    """Factor on the variance of sensors whose neighbouring errors repeat: (1 + r) / (1 - r) of lag one, at least 1."""
    out = np.ones(len(measured))
    error = smoothed.residual / smoothed.residual_variance * np.sqrt(variance)
    for sensor in (DOPPLER, PITCH, FORCE):
        mine = np.flatnonzero(measured.sensor == sensor)
        near = np.diff(measured.time_s[mine]) < CORRELATED_WITHIN_S
        first, second = np.clip(error[mine[:-1][near]], -3, 3), np.clip(error[mine[1:][near]], -3, 3)
        if len(first) < 20:
            continue
        r = float(np.sum(first * second) / max(np.sqrt(np.sum(first**2) * np.sum(second**2)), 1e-12))
        r = float(np.clip(r, 0.0, 0.8))
        out[mine] = (1 + r) / (1 - r)
    return out
