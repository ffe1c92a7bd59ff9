"""The particle filter by whole-array numpy: what one writes first, done with care. What ``particle_speed.py`` compares.

The same model, importance density and corrections as the compiled cloud in double precision, ``numpy.random.Generator``
for the normals, and multinomial resampling by sorted uniforms. Nothing is computed twice, angles need no remainders
over the cloud, and large temporaries are few.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.published.nine_state import motion as k
from fusion.published.nine_state.protocol import Estimate, Measurement, PredictedMap, Road
from fusion.published.particle.options import ParticleOptions
from fusion.types import Floats

_SMALLEST_SPEED_MPS = 1e-6


class NumpyCloud:
    """An ``EpochFilter`` with the optimal importance density, resampled by N_eff."""

    def __init__(self, options: ParticleOptions) -> None:
        self.options = options
        self._rng = np.random.default_rng(options.seed)
        self._q_per_s = k.process_noise_rates(options)

    def restart(self, mean: Floats, sigma: Floats) -> None:
        n = self.options.particles
        self._cloud = mean[:, None] + sigma[:, None] * self._rng.standard_normal((k.STATES, n))
        self._logw = np.zeros(n)
        self._refer(mean, math.atan2(mean[k.VY], mean[k.VX]))

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        if dt_s is not None:
            self._move(dt_s, measured)
        c, cos, sin = self._cloud, math.cos(self._heading), math.sin(self._heading)
        vx, vy = c[k.VX], c[k.VY]
        self._speed = np.sqrt(vx * vx + vy * vy + _SMALLEST_SPEED_MPS**2)
        self._pitch = np.arctan(c[k.VZ] / self._speed)
        self._logw -= (0.5 * measured.inv_var_pitch) * (measured.pitch_rad - self._pitch) ** 2
        self._turn = np.arctan2(cos * vy - sin * vx, cos * vx + sin * vy)
        w = self._weights()
        z = np.stack([c[k.X] - self._x, c[k.Y] - self._y, self._turn])
        mean = z @ w
        covariance = (z * w) @ z.T - np.outer(mean, mean)
        heading = math.remainder(self._heading + mean[2], 2 * math.pi)
        return PredictedMap(self._x + mean[0], self._y + mean[1], heading, covariance)

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        o, c = self.options, self._cloud
        if road is not None:
            off = (c[k.X] - road[0]) ** 2 + (c[k.Y] - road[1]) ** 2
            self._logw -= (0.5 / o.map_sigma_m**2) * off
            if use_heading:
                turn = self._turn - math.remainder(road[2] - self._heading, 2 * math.pi)
                turn -= 2 * math.pi * np.rint(turn / (2 * math.pi))
                self._logw -= (0.5 / o.map_sigma_rad**2) * turn**2
        if ground_m is not None:
            miss = ground_m - c[k.Z] + o.antenna_height_m / np.cos(self._pitch)
            self._logw -= (0.5 * inv_var_ground) * miss**2
        w = self._weights()
        state = c @ w
        pitch = float(self._pitch @ w)
        x, y, z = (c[row] - state[row] for row in (k.X, k.Y, k.Z))
        over = w / self._speed
        heading = math.atan2(c[k.VY] @ over, c[k.VX] @ over)
        n_eff = float(1 / (w @ w))
        resampled = n_eff < 2 / 3 * o.particles
        if resampled:
            self._draw_again(w)
        self._refer(state, heading)
        return Estimate(
            state=state,
            heading_rad=heading,
            pitch_rad=pitch,
            pitch_sigma_rad=math.sqrt((self._pitch - pitch) ** 2 @ w),
            h_sigma_m=math.sqrt((x * x + y * y) @ w),
            z_sigma_m=math.sqrt((z * z) @ w),
            n_eff=n_eff,
            resampled=resampled,
        )

    def _refer(self, state: Floats, heading_rad: float) -> None:
        """Second moments are taken about a point near the cloud, for precision."""
        self._x, self._y, self._heading = float(state[k.X]), float(state[k.Y]), heading_rad

    def _move(self, dt: float, measured: Measurement) -> None:
        c, q = self._cloud, self._q_per_s * dt
        half = k.half_square(self.options, dt)
        for a in (k.AX, k.AY, k.AZ):
            v, u = a + 1, a + 2
            c[u] += c[v] * dt + c[a] * half if half else c[v] * dt
            c[v] += c[a] * dt
        for row in range(k.STATES):
            inv = measured.inv_var[row]
            gain = q[row] * inv / (1 + q[row] * inv)
            noise = self._rng.standard_normal(c.shape[1])
            noise *= math.sqrt(q[row] * (1 - gain))
            if inv:
                miss = measured.z[row] - c[row]
                self._logw -= (0.5 * inv / (1 + q[row] * inv)) * miss**2
                noise += gain * miss
            c[row] += noise

    def _weights(self) -> Floats:
        w: Floats = np.exp(self._logw - self._logw.max())
        w /= w.sum()
        return w

    def _draw_again(self, w: Floats) -> None:
        n = self.options.particles
        # Side "right" of the cumulative weights inverts them; the last may round below 1.
        ancestors = np.searchsorted(np.cumsum(w), np.sort(self._rng.random(n)), side="right")
        self._cloud = np.take(self._cloud, np.minimum(ancestors, n - 1), axis=1)
        self._logw = np.zeros(n)
