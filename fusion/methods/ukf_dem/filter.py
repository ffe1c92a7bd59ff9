"""The unscented Kalman filter over the nine states: an ``EpochFilter``.

Sigma points go through every function, the linear ones too, as in the filters that Al Assaad 2020 compares with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.filters.unscented import Unscented
from fusion.frames import wrap_angle
from fusion.methods.nine_state.measurements import SLOWEST_MPS, gaussian_estimate, predicted_map
from fusion.methods.nine_state.motion import (
    STEEPEST_RAD,
    VX,
    VY,
    VZ,
    X,
    Y,
    Z,
    process_noise_rates,
    transition,
)
from fusion.methods.nine_state.options import NineStateOptions
from fusion.methods.nine_state.protocol import Estimate, Measurement, PredictedMap, Road
from fusion.types import Floats


@dataclass
class UnscentedFilter:
    """A Gaussian of mean (9,) and covariance (9, 9), moved and corrected through ``unscented``'s sigma points.

    Corrections follow the order of the thesis; those that belong to one source enter together.
    """

    options: NineStateOptions
    unscented: Unscented

    def restart(self, mean: Floats, sigma: Floats) -> None:
        """See ``EpochFilter``."""
        self._mean, self._covariance = mean.copy(), np.diag(sigma**2)

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        """See ``EpochFilter``."""
        if dt_s is not None:
            F, Q = transition(self.options, dt_s), np.diag(process_noise_rates(self.options) * dt_s)
            self._mean, self._covariance = self.unscented.predict(
                self._mean, self._covariance, lambda points: points @ F.T, Q
            )
        seen = np.flatnonzero(measured.inv_var > 0.0)
        if len(seen):
            self._correct(measured.z[seen], 1.0 / measured.inv_var[seen], lambda points: points[:, seen])
        if measured.inv_var_pitch > 0.0:
            pitch, variance = np.array([measured.pitch_rad]), np.array([1.0 / measured.inv_var_pitch])
            self._correct(pitch, variance, lambda points: _pitch(points)[:, None])
        return predicted_map(self._mean, self._covariance)

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        """See ``EpochFilter``."""
        if road is not None:
            self._correct_by_road(road, 3 if use_heading else 2)
        if ground_m is not None:
            ground, variance = np.array([ground_m]), np.array([1.0 / inv_var_ground])
            self._correct(ground, variance, self._ground_under)
        return gaussian_estimate(self._mean, self._covariance)

    def _correct_by_road(self, road: Road, count: int) -> None:
        """The matched point, and with a ``count`` of 3 the direction of the road there."""
        o = self.options
        variances = np.array([o.map_sigma_m, o.map_sigma_m, o.map_sigma_rad]) ** 2

        def subtract(a: Floats, b: Floats) -> Floats:
            difference = a - b
            difference[..., 2:] = wrap_angle(difference[..., 2:])
            return difference

        self._correct(
            np.array(road)[:count], variances[:count], lambda points: _on_map(points)[:, :count], subtract
        )

    def _correct(
        self,
        measured: Floats,
        variances: Floats,
        h: Callable[[Floats], Floats],
        subtract: Callable[[Floats, Floats], Floats] = np.subtract,
    ) -> None:
        self._mean, self._covariance = self.unscented.correct(
            self._mean, self._covariance, measured, h, np.diag(variances), subtract
        )

    def _ground_under(self, points: Floats) -> Floats:
        """(2.17): z - H / cos(pitch), shape (k, 1)."""
        steep = np.clip(_pitch(points), -STEEPEST_RAD, STEEPEST_RAD)
        return (points[:, Z] - self.options.antenna_height_m / np.cos(steep))[:, None]


def _on_map(points: Floats) -> Floats:
    """(2.14): x, y and the direction of travel, shape (k, 3)."""
    return np.column_stack([points[:, X], points[:, Y], np.arctan2(points[:, VY], points[:, VX])])


def _pitch(points: Floats) -> Floats:
    """(3.14), shape (k,)."""
    along = np.maximum(np.hypot(points[:, VX], points[:, VY]), SLOWEST_MPS)
    pitch: Floats = np.arctan(points[:, VZ] / along)
    return pitch
