"""The particle filter of Al Assaad 2020 at one epoch after another, on the compiled cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fusion.filters.resampling import RESAMPLERS
from fusion.methods import particle_layout as k
from fusion.methods.epoch_filter import Estimate, Measurement, PredictedMap, Road
from fusion.methods.kinematics import STATES, VX, VY, VZ, X, Y, Z, half_square, noise_rates
from fusion.methods.particle_estimate import merge_sums, normalise_blocks, weigh_and_estimate
from fusion.methods.particle_kernels import draw_cloud, predict_and_weigh
from fusion.methods.particle_options import ParticleOptions
from fusion.types import Floats, Ints


@dataclass
class ParticleCloud:
    """The cloud and its buffers: an ``EpochFilter``."""

    options: ParticleOptions
    _step: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        n = self.options.particles
        blocks = -(-n // k.BLOCK)
        self._cloud, self._spare = np.zeros((STATES, n)), np.zeros((STATES, n))
        self._logw, self._angles, self._weights = np.zeros(n), np.zeros((2, n)), np.zeros(n)
        self._sums_a, self._sums_b = np.zeros((blocks, k.A_COLUMNS)), np.zeros((blocks, k.B_COLUMNS))
        self._ref = np.zeros(4)  # x, y, heading, z: where second moments are taken
        self._last: Estimate | None = None
        self._q_per_s = noise_rates(self.options)
        self._resample = RESAMPLERS[self.options.resampling]
        self._ancestors = _NONE

    def restart(self, mean: Floats, sigma: Floats) -> None:
        """Draw a new cloud around ``mean`` (9,) with standard deviations ``sigma`` (9,)."""
        self._step += 1
        self._ancestors = _NONE
        draw_cloud(self._cloud, self._logw, self.options.seed, self._step, mean, sigma)
        self._ref[:] = mean[X], mean[Y], math.atan2(mean[VY], mean[VX]), mean[Z]
        self._last = None

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        """Predict over ``dt_s`` (None: no prediction) and correct by GNSS, acceleration and pitch."""
        self._step += 1
        dt = -1.0 if dt_s is None else dt_s
        half = half_square(self.options, dt)
        if self._last is not None and dt_s is not None:
            self._refer_near(self._last, dt_s)
        source = self._cloud
        if len(self._ancestors):
            self._cloud, self._spare = self._spare, self._cloud
        predict_and_weigh(
            source, self._ancestors, self._cloud, self._logw, self._angles, self._sums_a,
            self.options.seed, self._step, dt, half, self._q_per_s * max(dt, 0.0), measured.z, measured.inv_var,
            self.options.proposal == "optimal", measured.pitch_rad, measured.inv_var_pitch, self._ref,
        )  # fmt: skip
        self._ancestors = _NONE
        total = merge_sums(self._sums_a, -1, np.empty(k.A_COLUMNS))
        w = total[k.A_W]
        first = total[[k.A_X, k.A_Y, k.A_T]] / w
        xx, yy, tt, xy, xt, yt = total[[k.A_XX, k.A_YY, k.A_TT, k.A_XY, k.A_XT, k.A_YT]] / w
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) - np.outer(first, first)
        return PredictedMap(
            self._ref[0] + first[0], self._ref[1] + first[1], _wrapped(self._ref[2] + first[2]), covariance
        )

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        """Correct by the matched road point (x, y, heading) and the terrain's height, and estimate."""
        o = self.options
        inv = np.zeros(3)
        if road is not None:
            inv[:2] = o.map_sigma_m**-2
            inv[2] = o.map_sigma_rad**-2 if use_heading else 0.0
        ground = 0.0 if ground_m is None else ground_m
        inv_ground = 0.0 if ground_m is None else inv_var_ground
        weigh_and_estimate(
            self._cloud, self._logw, self._angles, self._weights, self._sums_b, self._ref,
            np.array(road or (0.0, 0.0, 0.0)), inv, ground, o.antenna_height_m, inv_ground,
        )  # fmt: skip
        self._last = self._estimate(merge_sums(self._sums_b, k.B_WW, np.empty(k.B_COLUMNS)))
        return self._last

    def _estimate(self, total: Floats) -> Estimate:
        w = total[k.B_W]
        mean = total[k.B_STATE :] / w
        spread = total[[k.B_XX, k.B_YY, k.B_ZZ]] / w - mean[[X, Y, Z]] ** 2
        state = mean.copy()
        state[[X, Y, Z]] += self._ref[[0, 1, 3]]
        pitch = total[k.B_PITCH] / w
        n_eff = w * w / total[k.B_WW]
        heading = math.atan2(total[k.B_SIN], total[k.B_COS])
        resampled = n_eff < (self.options.trigger_threshold or 2 / 3) * self.options.particles
        if resampled:
            self._draw_again(total[k.B_LOGMAX], w)
        else:
            self._logw -= total[k.B_LOGMAX]
        return Estimate(
            state=state,
            heading_rad=heading,
            pitch_rad=pitch,
            pitch_sigma_rad=math.sqrt(max(total[k.B_PITCH2] / w - pitch * pitch, 0.0)),
            h_sigma_m=math.sqrt(max(float(spread[0] + spread[1]), 0.0)),
            z_sigma_m=math.sqrt(max(float(spread[2]), 0.0)),
            n_eff=n_eff,
            resampled=resampled,
        )

    def _draw_again(self, top: float, total: float) -> None:
        normalise_blocks(self._weights, self._sums_b, top, total)
        # The copies are made when the next epoch moves them, block by block.
        self._ancestors = self._resample(self._weights, self.options.seed, self._step)
        self._logw[:] = 0.0

    def _refer_near(self, last: Estimate, dt: float) -> None:
        """Second moments are taken about a point near the cloud, for precision."""
        at = last.state
        moved = at[[X, Y, Z]] + at[[VX, VY, VZ]] * dt
        self._ref[:] = moved[0], moved[1], last.heading_rad, moved[2]


_NONE: Ints = np.empty(0, np.int64)


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2 * math.pi)
