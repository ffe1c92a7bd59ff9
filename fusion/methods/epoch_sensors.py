"""What the sensors say to a filter over the nine states at one epoch: values with their inverse variances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fusion.methods.epoch_filter import Measurement
from fusion.methods.epoch_options import EpochOptions, InertialOptions
from fusion.methods.epochs import Epochs, white_altitude_sigma
from fusion.methods.kinematics import AX, AY, AZ, STATES, VX, VY, VZ, X, Y, Z
from fusion.methods.levelling import MountPitch
from fusion.types import Floats

_SHARPEST_DOPPLER_MPS = 0.02


@dataclass(frozen=True)
class Sensors:
    """A drive's epochs, read by the options' accuracies, the receiver's own where logged, and the mount's tilt.

    ``inertial`` None leaves acceleration out, and ``mount`` None the pitch.
    """

    epochs: Epochs
    options: EpochOptions
    inertial: InertialOptions | None = None
    mount: MountPitch | None = None

    @cached_property
    def _rate_sigma_mps(self) -> float:
        """Noise of the fixes' rate of change, which is taken over two steps."""
        step_s = float(np.median(np.diff(self.epochs.time_s))) if len(self.epochs) > 1 else 1.0
        scatter = white_altitude_sigma(self.epochs) / (math.sqrt(2) * step_s)
        return max(self.options.rate_sigma_mps, scatter)

    @property
    def measures_grade(self) -> bool:
        """Whether anything in the log says how steep the road is, other than the differences of its heights."""
        ep = self.epochs
        pitch = self.mount is not None and bool(np.isfinite(ep.pitch_rad).any())
        return pitch or (self.options.doppler and bool(np.isfinite(ep.vel_u_mps).any()))

    def gnss_sigmas(self, e: int) -> tuple[float, float]:
        """Per-axis horizontal and vertical sigma of the fix at epoch ``e``, m."""
        h, v = self.epochs.h_acc_m[e], self.epochs.v_acc_m[e]
        h = h if np.isfinite(h) and h > 0 else self.options.gnss_h_sigma_m
        v = v if np.isfinite(v) and v > 0 else self.options.gnss_v_sigma_m
        return float(h) / math.sqrt(2), float(v)

    def velocity(self, e: int) -> tuple[Floats, Floats]:
        """Velocity east, north, up and its sigmas, m/s: Doppler where logged, else the fixes' own rate of change."""
        ep, o = self.epochs, self.options
        doppler = np.array([ep.vel_e_mps[e], ep.vel_n_mps[e], ep.vel_u_mps[e]])
        rates = np.array([ep.rate_e_mps[e], ep.rate_n_mps[e], ep.rate_u_mps[e]])
        stated = ep.s_acc_mps[e] if ep.s_acc_mps[e] > 0 else o.doppler_sigma_mps
        known = np.isfinite(doppler)
        sigma = np.where(known, max(float(stated), _SHARPEST_DOPPLER_MPS), self._rate_sigma_mps)
        return np.where(known, doppler, rates), sigma

    def at(self, e: int, dt_s: float, *, use_fix: bool, moving: bool) -> Measurement:
        """Everything measured at epoch ``e``, ``dt_s`` after the one before.

        ``use_fix`` False leaves GNSS out; pitch counts only while ``moving``.
        """
        ep, o = self.epochs, self.options
        z, sigma = np.full(STATES, np.nan), np.full(STATES, np.inf)
        if use_fix:
            h, v = self.gnss_sigmas(e)
            z[[X, Y, Z]] = ep.x_m[e], ep.y_m[e], ep.alt_m[e]
            sigma[[X, Y, Z]] = h, h, v * math.sqrt(1 + 2 * o.gnss_correlation_s / dt_s)
            if o.doppler:
                z[[VX, VY, VZ]], sigma[[VX, VY, VZ]] = self.velocity(e)
        if self.inertial is not None:
            z[[AX, AY, AZ]] = ep.acc_e_mps2[e], ep.acc_n_mps2[e], ep.acc_u_mps2[e]
            sigma[[AX, AY, AZ]] = self.inertial.acc_sigma_mps2
        known = np.isfinite(z)
        pitch, inv_pitch = self._pitch(e, dt_s) if moving else (0.0, 0.0)
        return Measurement(np.where(known, z, 0.0), np.where(known, sigma**-2.0, 0.0), pitch, inv_pitch)

    def _pitch(self, e: int, dt_s: float) -> tuple[float, float]:
        ep, o = self.epochs, self.inertial
        if o is None or self.mount is None or not np.isfinite(ep.pitch_rad[e]):
            return 0.0, 0.0
        sensor = float(np.nan_to_num(ep.pitch_acc_rad[e]))
        body = o.pitch_sigma_rad**2 * (1 + 2 * o.pitch_correlation_s / dt_s)
        return float(ep.pitch_rad[e] - self.mount.angle_rad), 1 / (sensor**2 + body)

    def start(self, e: int, altitude_m: float) -> tuple[Floats, Floats]:
        """Mean and sigmas (9,) of a new state at epoch ``e``, which has a fix."""
        mean, sigma = np.zeros(STATES), np.zeros(STATES)
        h, _ = self.gnss_sigmas(e)
        mean[[X, Y, Z]] = self.epochs.x_m[e], self.epochs.y_m[e], altitude_m
        sigma[[X, Y, Z]] = h, h, self.options.start_altitude_sigma_m
        velocity, spread = self.velocity(e)
        known = np.isfinite(velocity)
        # A vehicle of unknown velocity may go anywhere on the plane, but hardly up.
        unknown = np.array([8.0, 8.0, 0.5])
        mean[[VX, VY, VZ]] = np.where(known, velocity, 0.0)
        sigma[[VX, VY, VZ]] = np.where(known, np.maximum(spread, 0.3), unknown)
        sigma[[AX, AY, AZ]] = 0.5, 0.5, 0.1
        return mean, sigma
