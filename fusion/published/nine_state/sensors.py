"""What the sensors say to a filter over the nine states at one epoch: values with their inverse variances.

The epochs of a drive meet the options here: stated accuracies count before those of the options, errors that hang
together are thinned out. Roads and terrain are no sensors; they stand in ``run``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fusion.published.epochs.levelling import MountPitch
from fusion.published.epochs.table import Epochs, white_altitude_sigma
from fusion.published.nine_state.motion import AX, AY, AZ, STATES, VX, VY, VZ, X, Y, Z, whitened
from fusion.published.nine_state.options import InertialOptions, NineStateOptions
from fusion.published.nine_state.protocol import Measurement
from fusion.types import Floats

_SHARPEST_DOPPLER_MPS = 0.02  # a receiver that states less is not believed

# Spreads of a new state. A vehicle of unknown velocity may go anywhere on the plane, but hardly up.
_START_VELOCITY_SIGMA_MPS = np.array([8.0, 8.0, 0.5])  # east, north, up, where nothing measures it
_LEAST_START_VELOCITY_SIGMA_MPS = 0.3  # where something does
_START_ACCELERATION_SIGMA_MPS2 = np.array([0.5, 0.5, 0.1])

GNSS_STATES = (VX, X, VY, Y, VZ, Z)
"""The states that the receiver measures."""


class SensorColumns(NamedTuple):
    """All epochs at once, n of them, before errors that hang together are thinned out.

    ``z`` and ``var`` (n, 9) address the states, ``fix_sigma`` (n, 2) is the fix's horizontal sigma per axis and its
    vertical one, ``pitch`` and ``pitch_var`` (n,) are the sensor's, level; variances are inf where a sensor says
    nothing. A new state begins at ``start_mean`` (n, 9), but for its altitude, with ``start_sigma`` (n, 9).
    """

    z: Floats
    var: Floats
    fix_sigma: Floats
    pitch: Floats
    pitch_var: Floats
    start_mean: Floats
    start_sigma: Floats


@dataclass(frozen=True)
class Sensors:
    """A drive's epochs, read by the options' accuracies, the receiver's own where logged, and the mount's tilt.

    ``inertial`` None leaves acceleration out, and ``mount`` None the pitch.
    """

    epochs: Epochs
    options: NineStateOptions
    inertial: InertialOptions | None = None
    mount: MountPitch | None = None

    @property
    def measures_grade(self) -> bool:
        """Whether anything in the log says how steep the road is, other than the differences of its heights."""
        ep = self.epochs
        pitch = self.mount is not None and bool(np.isfinite(ep.pitch_rad).any())
        return pitch or (self.options.doppler and bool(np.isfinite(ep.vel_u_mps).any()))

    @cached_property
    def columns(self) -> SensorColumns:
        """Everything measured, by columns."""
        ep, o = self.epochs, self.options
        fix_sigma = self._fix_sigma()
        velocity, spread = self._velocity()
        z, sigma = np.full((len(ep), STATES), np.nan), np.full((len(ep), STATES), np.inf)
        z[:, [X, Y, Z]] = np.column_stack([ep.x_m, ep.y_m, ep.alt_m])
        sigma[:, [X, Y, Z]] = fix_sigma[:, [0, 0, 1]]
        if o.doppler:
            z[:, [VX, VY, VZ]], sigma[:, [VX, VY, VZ]] = velocity, spread
        if self.inertial is not None:
            z[:, [AX, AY, AZ]] = np.column_stack([ep.acc_e_mps2, ep.acc_n_mps2, ep.acc_u_mps2])
            sigma[:, [AX, AY, AZ]] = self.inertial.acc_sigma_mps2
        known = np.isfinite(z)
        mean, start_sigma = self._starts(fix_sigma[:, 0], velocity, spread)
        return SensorColumns(
            np.where(known, z, 0.0),
            np.where(known, sigma**2, np.inf),
            fix_sigma,
            *self._pitch(),
            mean,
            start_sigma,
        )

    def at(self, e: int, dt_s: float, *, use_fix: bool, moving: bool) -> Measurement:
        """Everything measured at epoch ``e``, ``dt_s`` after the one before.

        ``use_fix`` False leaves GNSS out; pitch counts only while ``moving``.
        """
        c, o = self.columns, self.options
        var = c.var[e].copy()
        if use_fix:
            var[Z] = whitened(var[Z], dt_s, o.gnss_correlation_s)
        else:
            var[list(GNSS_STATES)] = np.inf
        if self.inertial is None or not (moving and c.pitch_var[e] < np.inf):
            return Measurement(c.z[e], 1.0 / var)
        body = whitened(self.inertial.pitch_sigma_rad**2, dt_s, self.inertial.pitch_correlation_s)
        return Measurement(c.z[e], 1.0 / var, float(c.pitch[e]), 1.0 / (float(c.pitch_var[e]) + body))

    def start(self, e: int, altitude_m: float) -> tuple[Floats, Floats]:
        """Mean and sigmas (9,) of a new state at epoch ``e``, which has a fix."""
        mean = self.columns.start_mean[e].copy()
        mean[Z] = altitude_m
        return mean, self.columns.start_sigma[e]

    def _fix_sigma(self) -> Floats:
        """The receiver's own accuracies where it states any."""
        h, v = self.epochs.h_acc_m, self.epochs.v_acc_m
        horizontal = np.where(np.isfinite(h) & (h > 0), h, self.options.gnss_h_sigma_m)
        vertical = np.where(np.isfinite(v) & (v > 0), v, self.options.gnss_v_sigma_m)
        return np.column_stack([horizontal / math.sqrt(2), vertical])

    def _velocity(self) -> tuple[Floats, Floats]:
        """Velocity east, north, up and its sigmas, (n, 3), m/s: Doppler, else the fixes' own rate of change."""
        ep, o = self.epochs, self.options
        doppler = np.column_stack([ep.vel_e_mps, ep.vel_n_mps, ep.vel_u_mps])
        rates = np.column_stack([ep.rate_e_mps, ep.rate_n_mps, ep.rate_u_mps])
        stated = np.where(ep.s_acc_mps > 0, ep.s_acc_mps, o.doppler_sigma_mps)
        known = np.isfinite(doppler)
        sigma = np.where(known, np.maximum(stated, _SHARPEST_DOPPLER_MPS)[:, None], self._rate_sigma_mps())
        return np.where(known, doppler, rates), sigma

    def _rate_sigma_mps(self) -> float:
        """Noise of the fixes' rate of change, which is taken over two steps."""
        step_s = float(np.median(np.diff(self.epochs.time_s))) if len(self.epochs) > 1 else 1.0
        scatter = white_altitude_sigma(self.epochs) / (math.sqrt(2) * step_s)
        return max(self.options.rate_sigma_mps, scatter)

    def _pitch(self) -> tuple[Floats, Floats]:
        """The sensor's pitch, level, and its variance, (n,)."""
        ep = self.epochs
        if self.inertial is None or self.mount is None:
            return np.zeros(len(ep)), np.full(len(ep), np.inf)
        known = np.isfinite(ep.pitch_rad)
        level = np.where(known, ep.pitch_rad - self.mount.angle_rad, 0.0)
        return level, np.where(known, np.nan_to_num(ep.pitch_acc_rad) ** 2, np.inf)

    def _starts(self, h_sigma: Floats, velocity: Floats, spread: Floats) -> tuple[Floats, Floats]:
        """Mean and sigmas of new states, (n, 9) each; their altitudes are not known here."""
        mean, sigma = np.zeros((len(self.epochs), STATES)), np.zeros((len(self.epochs), STATES))
        mean[:, X], mean[:, Y] = self.epochs.x_m, self.epochs.y_m
        sigma[:, [X, Y]] = h_sigma[:, None]
        sigma[:, Z] = self.options.start_altitude_sigma_m
        known = np.isfinite(velocity)
        mean[:, [VX, VY, VZ]] = np.where(known, velocity, 0.0)
        sigma[:, [VX, VY, VZ]] = np.where(
            known, np.maximum(spread, _LEAST_START_VELOCITY_SIGMA_MPS), _START_VELOCITY_SIGMA_MPS
        )
        sigma[:, [AX, AY, AZ]] = _START_ACCELERATION_SIGMA_MPS2
        return mean, sigma
