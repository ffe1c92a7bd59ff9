"""What the sensors say to the particle filter at one epoch: values with their inverse variances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fusion.methods import particle_layout as k
from fusion.methods.epochs import Epochs, white_altitude_sigma
from fusion.methods.levelling import MountPitch
from fusion.methods.particle_filter import Measurement
from fusion.methods.particle_options import ParticleOptions
from fusion.types import Floats

_SHARPEST_DOPPLER_MPS = 0.02


@dataclass(frozen=True)
class Sensors:
    """A drive's epochs, read by the options' accuracies, the receiver's own where logged, and the mount's tilt."""

    epochs: Epochs
    options: ParticleOptions
    mount: MountPitch

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
        return bool(np.isfinite(ep.pitch_rad).any() or np.isfinite(ep.vel_u_mps).any())

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
        z, sigma = np.full(k.STATES, np.nan), np.full(k.STATES, np.inf)
        if use_fix:
            h, v = self.gnss_sigmas(e)
            z[[k.X, k.Y, k.Z]] = ep.x_m[e], ep.y_m[e], ep.alt_m[e]
            sigma[[k.X, k.Y, k.Z]] = h, h, v * math.sqrt(1 + 2 * o.gnss_correlation_s / dt_s)
            if o.doppler:
                z[[k.VX, k.VY, k.VZ]], sigma[[k.VX, k.VY, k.VZ]] = self.velocity(e)
        z[[k.AX, k.AY, k.AZ]] = ep.acc_e_mps2[e], ep.acc_n_mps2[e], ep.acc_u_mps2[e]
        sigma[[k.AX, k.AY, k.AZ]] = o.acc_sigma_mps2
        known = np.isfinite(z)
        pitch, inv_pitch = self._pitch(e, dt_s) if moving else (0.0, 0.0)
        return Measurement(np.where(known, z, 0.0), np.where(known, sigma**-2.0, 0.0), pitch, inv_pitch)

    def _pitch(self, e: int, dt_s: float) -> tuple[float, float]:
        ep, o = self.epochs, self.options
        if not np.isfinite(ep.pitch_rad[e]):
            return 0.0, 0.0
        sensor = float(np.nan_to_num(ep.pitch_acc_rad[e]))
        body = o.pitch_sigma_rad**2 * (1 + 2 * o.pitch_correlation_s / dt_s)
        return float(ep.pitch_rad[e] - self.mount.angle_rad), 1 / (sensor**2 + body)

    def start(self, e: int, altitude_m: float) -> tuple[Floats, Floats]:
        """Mean and sigmas (9,) of a new cloud at epoch ``e``, which has a fix."""
        mean, sigma = np.zeros(k.STATES), np.zeros(k.STATES)
        h, _ = self.gnss_sigmas(e)
        mean[[k.X, k.Y, k.Z]] = self.epochs.x_m[e], self.epochs.y_m[e], altitude_m
        sigma[[k.X, k.Y, k.Z]] = h, h, self.options.start_altitude_sigma_m
        velocity, spread = self.velocity(e)
        known = np.isfinite(velocity)
        # A vehicle of unknown velocity may go anywhere on the plane, but hardly up.
        unknown = np.array([8.0, 8.0, 0.5])
        mean[[k.VX, k.VY, k.VZ]] = np.where(known, velocity, 0.0)
        sigma[[k.VX, k.VY, k.VZ]] = np.where(known, np.maximum(spread, 0.3), unknown)
        sigma[[k.AX, k.AY, k.AZ]] = 0.5, 0.5, 0.1
        return mean, sigma
