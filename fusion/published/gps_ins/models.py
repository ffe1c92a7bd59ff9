"""The three filters of Saadaoui 2011 (Algorithms 1-3) as predict and correct on a common state.

The state is [x, y] while the heading is a command, else [x, y, heading]; metres in the local plane, the heading from
east, anticlockwise. The heading is kept as an unwrapped angle, so that plain differences and means of it are right.
Every measurement is linear in the state: rows of ``jacobian``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.filters import kalman
from fusion.filters.unscented import Unscented
from fusion.types import Floats

HEADING = 2

Moments = tuple[Floats, Floats]
"""Mean (n,) and covariance (n, n)."""


class Step(NamedTuple):
    """The INS over one step: its duration, speed (negative backwards) and heading."""

    dt_s: float
    speed_mps: float
    heading_rad: float


def displacement(step: Step, heading_rad: float) -> Floats:
    """Way (2,) of a step in a direction: dt (v cos, v sin) (section 4.2)."""
    way = step.dt_s * step.speed_mps
    return np.array([way * math.cos(heading_rad), way * math.sin(heading_rad)])


@dataclass(frozen=True)
class KalmanModel:
    """Algorithm 1: x + B u. ``printed`` takes u = [v, heading] where section 4.2 needs u = [v cos, v sin]."""

    printed: bool = False
    late_noise: bool = False

    def predict(self, mean: Floats, covariance: Floats, step: Step, noise: Floats) -> Moments:
        """The moments one step later; two states only."""
        mean, covariance = kalman.predict(mean, covariance, np.eye(2), noise)
        if self.printed:
            return mean + step.dt_s * np.array([step.speed_mps, step.heading_rad]), covariance
        return mean + displacement(step, step.heading_rad), covariance

    def correct(
        self, mean: Floats, covariance: Floats, measured: Floats, jacobian: Floats, noise: Floats
    ) -> Moments:
        """The moments after a measurement of ``jacobian @ state``."""
        return kalman.correct(mean, covariance, measured - jacobian @ mean, jacobian, noise)


@dataclass(frozen=True)
class ExtendedModel:
    """Algorithm 2. ``printed_innovation`` leaves "Z -" out; ``printed_jacobian`` has sine and cosine exchanged."""

    printed_innovation: bool = False
    printed_jacobian: bool = False
    late_noise: bool = False

    def predict(self, mean: Floats, covariance: Floats, step: Step, noise: Floats) -> Moments:
        """The moments one step later."""

        def jacobian(state: Floats) -> Floats:
            out = np.eye(len(state))
            if len(state) > HEADING:
                out[:HEADING, HEADING] = self._heading_column(step, float(state[HEADING]))
            return out

        return kalman.predict_extended(mean, covariance, lambda state: _moved(state, step), jacobian, noise)

    def correct(
        self, mean: Floats, covariance: Floats, measured: Floats, jacobian: Floats, noise: Floats
    ) -> Moments:
        """The moments after a measurement of ``jacobian @ state``."""

        def innovation(z: Floats, expected: Floats) -> Floats:
            return expected if self.printed_innovation else z - expected

        return kalman.correct_extended(
            mean, covariance, measured, lambda x: jacobian @ x, lambda _: jacobian, noise, subtract=innovation
        )

    def _heading_column(self, step: Step, heading_rad: float) -> Floats:
        if self.printed_jacobian:
            v = step.speed_mps
            return np.array([-v * math.cos(heading_rad), v * math.sin(heading_rad)])
        x, y = displacement(step, heading_rad)
        return np.array([-y, x])


@dataclass(frozen=True)
class UnscentedModel:
    """Algorithm 3. Without ``late_noise`` new sigma points are drawn after the process noise is added.

    As printed the predicted points serve the correction as well. All measurements being linear, that is the same as
    correcting by the points' own spread and adding the noise afterwards, which ``late_noise`` asks the caller for.
    """

    transform: Unscented
    late_noise: bool = False

    def predict(self, mean: Floats, covariance: Floats, step: Step, noise: Floats) -> Moments:
        """The moments one step later."""
        return self.transform.predict(mean, covariance, lambda points: _moved(points.T, step).T, noise)

    def correct(
        self, mean: Floats, covariance: Floats, measured: Floats, jacobian: Floats, noise: Floats
    ) -> Moments:
        """The moments after a measurement of ``jacobian @ state``."""
        return self.transform.correct(mean, covariance, measured, lambda points: points @ jacobian.T, noise)


Model = KalmanModel | ExtendedModel | UnscentedModel
"""A filter over two or three states. ``late_noise``: the process noise is added after the corrections, and not with
the prediction."""


def _moved(state: Floats, step: Step) -> Floats:
    """The dynamics f of section 4.3.1 on states in columns, shape (n,) or (n, k); the heading stays as it is."""
    heading = state[HEADING] if len(state) > HEADING else np.full(state.shape[1:], step.heading_rad)
    moved: Floats = state.copy()
    moved[0] += step.dt_s * step.speed_mps * np.cos(heading)
    moved[1] += step.dt_s * step.speed_mps * np.sin(heading)
    return moved
