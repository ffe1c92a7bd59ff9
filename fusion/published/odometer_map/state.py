"""What the filter of ``odometer-map`` knows between two epochs: its Gaussian state, and the heading it remembers.

The state is nine of motion, two for each wheel, and four more within a step. For each wheel stand the rounding of its
last reading and the lasting error of its radius. Over a step they are joined by the velocity before and the rounding of
the new reading, since a wheel's rotation, (4) and (5) of Lahrech et al., depends on both ends of the step. To take the
velocity before as known would leave (4) and (5) nothing of the way to correct: of v_{k+1} they hold the heading only.

The heading is remembered apart, for a vehicle that stands or creeps has a velocity that says nothing about it. What is
measured, and when, is not known here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fusion.filters import kalman
from fusion.published.nine_state.measurements import heading_measurement
from fusion.published.nine_state.motion import STATES, VX, VY, process_noise_rates, transition
from fusion.published.nine_state.options import NineStateOptions
from fusion.types import Floats

ROUNDING = slice(9, 11)
SCALE = slice(11, 13)
KEPT = 13
BEFORE = slice(13, 15)
NEW_ROUNDING = slice(15, 17)
WIDE = 17
AFTER = [VX, VY]

_LONGEST_STEP_S = 1.1  # the paper's second, and some jitter: a longer step is taken in several

_VAGUE_RAD = 0.5  # beyond this sigma a heading counts as unknown
# A direction of travel gives the nose no better than this, however sure the velocity is.
_LEAST_SIGMA_RAD = 0.02
_BEND_PER_M = 0.05  # one sigma of how far an unmeasured way may turn: bends of 20 m radius


class StepState:
    """Mean and covariance; ``widen`` predicts over a step, ``narrow`` ends it.

    ``rounding_rad`` (2,) is one sigma of the rounding of a wheel's reading, ``scale`` (2,) and ``scale_covariance``
    (2, 2) what is known in advance of the relative errors (left, right) of the radii.
    """

    def __init__(
        self, mean: Floats, sigma: Floats, rounding_rad: Floats, scale: Floats, scale_covariance: Floats
    ) -> None:
        self._rounding: Floats = np.diag(rounding_rad**2)
        self.mean: Floats = np.zeros(KEPT)
        self.covariance: Floats = np.zeros((KEPT, KEPT))
        self.mean[:STATES] = mean
        self.mean[SCALE] = scale
        self.covariance[:STATES, :STATES] = np.diag(sigma**2)
        self.covariance[ROUNDING, ROUNDING] = self._rounding
        self.covariance[SCALE, SCALE] = scale_covariance

    @property
    def motion(self) -> tuple[Floats, Floats]:
        """The nine states, mean (9,) and covariance (9, 9)."""
        return self.mean[:STATES], self.covariance[:STATES, :STATES]

    def widen(self, options: NineStateOptions, dt_s: float) -> None:
        """Predict the nine states over ``dt_s`` (8), and join what a reading at its end depends on."""
        step, noise = np.zeros((WIDE, KEPT)), np.zeros((WIDE, WIDE))
        step[:KEPT] = np.eye(KEPT)
        step[:STATES, :STATES], noise[:STATES, :STATES] = _over(options, dt_s)
        step[BEFORE, AFTER] = np.eye(2)
        noise[NEW_ROUNDING, NEW_ROUNDING] = self._rounding
        self.mean, self.covariance = kalman.predict(self.mean, self.covariance, step, noise)

    def correct(self, innovation: Floats, jacobian: Floats, noise: Floats) -> None:
        """A Kalman correction; ``jacobian`` (m, n) may leave out the last columns where they are zero."""
        full = np.zeros((len(innovation), len(self.mean)))
        full[:, : jacobian.shape[1]] = jacobian
        self.mean, self.covariance = kalman.correct(self.mean, self.covariance, innovation, full, noise)

    def narrow(self, *, wheels_read: bool) -> None:
        """Forget the velocity before; the new reading's rounding takes the old one's place if it was read."""
        if len(self.mean) == KEPT:
            return
        keep = np.arange(KEPT)
        if wheels_read:
            keep[ROUNDING] = np.arange(WIDE)[NEW_ROUNDING]
        self.mean, self.covariance = self.mean[keep], self.covariance[np.ix_(keep, keep)]
        if not wheels_read:
            self.mean[ROUNDING] = 0.0
            self.covariance[ROUNDING, :] = self.covariance[:, ROUNDING] = 0.0
            self.covariance[ROUNDING, ROUNDING] = self._rounding


@dataclass(frozen=True)
class RememberedHeading:
    """Where the nose points, radians from east, with its variance; infinite while that was never seen."""

    angle_rad: float = 0.0
    variance: float = math.inf

    @property
    def known(self) -> bool:
        """Whether it is good for anything."""
        return self.variance < _VAGUE_RAD**2

    def turned(self, turn_rad: float, variance: float) -> RememberedHeading:
        """After a turn to the left that wheels measured."""
        return RememberedHeading(self.angle_rad + turn_rad, self.variance + variance)

    def after_way(self, way_m: float) -> RememberedHeading:
        """After a way whose bends nobody measured."""
        return RememberedHeading(self.angle_rad, self.variance + (_BEND_PER_M * way_m) ** 2)

    def behind(self) -> RememberedHeading:
        """Turned about: what was taken for the nose is the tail."""
        return RememberedHeading(self.angle_rad + math.pi, self.variance)

    def renewed(
        self, state: Floats, covariance: Floats, slowest_mps: float, *, trust_reversal: bool = True
    ) -> RememberedHeading:
        """By the direction of a state (9,) that goes forwards and knows where to; else the old one.

        A velocity that swings through zero while a vehicle brakes points backwards. Without ``trust_reversal`` the
        nose does not follow it.
        """
        if math.hypot(state[VX], state[VY]) < slowest_mps:
            return self
        angle, row = heading_measurement(state)
        variance = float(row @ covariance @ row)
        reverse = self.known and math.cos(angle - self.angle_rad) < 0
        if variance > _VAGUE_RAD**2 or (reverse and not trust_reversal):
            return self
        return RememberedHeading(angle, max(variance, _LEAST_SIGMA_RAD**2))


def _over(options: NineStateOptions, dt_s: float) -> tuple[Floats, Floats]:
    """F and Q (9, 9) over ``dt_s``: of a step as printed, or of several where it is longer than the paper's."""
    steps = max(1, math.ceil(dt_s / _LONGEST_STEP_S))
    once = transition(options, dt_s / steps)
    fresh = np.diag(process_noise_rates(options) * dt_s / steps)
    moved, noise = once, fresh
    for _ in range(steps - 1):
        # Noise of an acceleration has to reach the position: within one step, as printed, it does not.
        moved, noise = once @ moved, once @ noise @ once.T + fresh
    return moved, noise
