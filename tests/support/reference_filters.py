"""Filters over the nine states from the textbook's functions, written for clarity: what the fast ones must equal.

Derivatives are differences, so that nobody's Jacobian is taken for granted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.filters import kalman
from fusion.published.nine_state.measurements import SLOWEST_MPS
from fusion.published.nine_state.motion import STATES, STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.published.nine_state.options import NineStateOptions
from fusion.published.nine_state.protocol import Estimate, Measurement, PredictedMap, Road
from fusion.types import Floats

Function = Callable[[Floats], Floats]


def derivative(h: Function, state: Floats, step: float = 1e-4) -> Floats:
    """Central differences of h (m,) at a state (n,), shape (m, n), with one extrapolation."""

    def differences(size: float) -> Floats:
        columns = [(h(state + d) - h(state - d)) / (2 * size) for d in size * np.eye(len(state))]
        return np.column_stack(columns)

    return (4 * differences(step / 2) - differences(step)) / 3


def heading(state: Floats) -> Floats:
    return np.array([math.atan2(state[VY], state[VX])])


def pitch(state: Floats) -> Floats:
    return np.array([math.atan(state[VZ] / max(math.hypot(state[VX], state[VY]), SLOWEST_MPS))])


def lift(state: Floats, antenna_m: float) -> float:
    """What the antenna stands above the ground, by a pitch that roads have."""
    return antenna_m / math.cos(min(abs(pitch(state)[0]), STEEPEST_RAD))


@dataclass
class ReferenceFilter:
    """The extended Kalman filter, or the Kalman filter where ``linear``: an ``EpochFilter``."""

    options: NineStateOptions
    linear: bool = False

    def restart(self, mean: Floats, sigma: Floats) -> None:
        self.mean, self.covariance = mean.copy(), np.diag(sigma**2)

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        if dt_s is not None:
            o = self.options
            half = dt_s**2 / 2 if o.discretisation == "exact" else 0.0
            F = np.kron(np.eye(3), np.array([[1, 0, 0], [dt_s, 1, 0], [half, dt_s, 1]]))
            horizontal = [o.sigma_acc_mps2, o.sigma_vel_mps, o.sigma_pos_m]
            vertical = [o.sigma_acc_up_mps2, o.sigma_vel_up_mps, o.sigma_pos_up_m]
            Q = np.diag(np.array([*horizontal, *horizontal, *vertical]) ** 2 * dt_s)
            self.mean, self.covariance = kalman.predict(self.mean, self.covariance, F, Q)
        seen = np.flatnonzero(measured.inv_var)
        if len(seen):
            self._linear(seen, measured.z[seen], 1 / measured.inv_var[seen])
        if measured.inv_var_pitch and not self.linear:
            self._curved(measured.pitch_rad, pitch, 1 / measured.inv_var_pitch)
        rows = np.vstack([np.eye(STATES)[[X, Y]], derivative(self._unwound, self.mean)])
        at = (float(self.mean[X]), float(self.mean[Y]), float(heading(self.mean)[0]))
        return PredictedMap(*at, rows @ self.covariance @ rows.T)

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        o = self.options
        if road is not None:
            self._linear(np.array([X, Y]), np.array(road[:2]), np.full(2, o.map_sigma_m**2))
            if use_heading and not self.linear:
                # Headings are compared near the vehicle's own, where they do not jump.
                own = float(heading(self.mean)[0])
                near = own + math.remainder(road[2] - own, 2 * math.pi)
                self._curved(near, self._unwound, o.map_sigma_rad**2)
        if ground_m is not None and self.linear:
            height = np.array([ground_m + lift(self.mean, o.antenna_height_m)])
            self._linear(np.array([Z]), height, np.array([1 / inv_var_ground]))
        elif ground_m is not None:
            self._curved(
                ground_m,
                lambda s: np.array([s[Z] - lift(s, o.antenna_height_m)]),
                1 / inv_var_ground,
            )
        return self._estimate()

    def _linear(self, states: np.ndarray, z: Floats, variances: Floats) -> None:
        H = np.eye(STATES)[states]
        self.mean, self.covariance = kalman.correct(
            self.mean, self.covariance, z - H @ self.mean, H, np.diag(variances)
        )

    def _curved(self, z: float, h: Function, variance: float) -> None:
        self.mean, self.covariance = kalman.correct_extended(
            self.mean,
            self.covariance,
            np.array([z]),
            h,
            lambda state: derivative(h, state),
            np.array([[variance]]),
        )

    def _unwound(self, state: Floats) -> Floats:
        """The heading without a jump near the filter's own."""
        own = float(heading(self.mean)[0])
        return np.array([own + math.remainder(float(heading(state)[0]) - own, 2 * math.pi)])

    def _estimate(self) -> Estimate:
        P = self.covariance
        row = derivative(pitch, self.mean)[0]
        return Estimate(
            state=self.mean.copy(),
            heading_rad=float(heading(self.mean)[0]),
            pitch_rad=float(pitch(self.mean)[0]),
            pitch_sigma_rad=math.sqrt(row @ P @ row),
            h_sigma_m=math.sqrt(P[X, X] + P[Y, Y]),
            z_sigma_m=math.sqrt(P[Z, Z]),
        )
