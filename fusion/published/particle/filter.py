"""The particle filter of Al Assaad 2020 at one epoch after another, on the compiled cloud.

Two passes over all particles make an epoch: ``sense_pass``, and after the map match ``locate_pass``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS
from fusion.published.nine_state.motion import STATES, VX, VY, X, Y, Z, half_square, process_noise_rates
from fusion.published.nine_state.protocol import Estimate, Measurement, PredictedMap, Road
from fusion.published.particle import layout as k
from fusion.published.particle.layout import predicted_map, state_summary, weights_summary
from fusion.published.particle.locate_pass import fill_weights, weigh_and_estimate
from fusion.published.particle.options import ParticleOptions
from fusion.published.particle.sense_pass import draw_cloud, follow, predict_and_weigh
from fusion.types import Floats, Ints


@dataclass
class ParticleCloud:
    """The cloud and its buffers: an ``EpochFilter``."""

    options: ParticleOptions
    _step: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        o, blocks = self.options, k.blocks_of(self.options.particles)
        self._cloud = np.zeros((blocks, k.CHUNK), np.float32)
        self._spare, self._weights = np.zeros_like(self._cloud), np.zeros(o.particles)
        self._sums_a, self._sums_b = np.zeros((blocks, k.A_COLUMNS)), np.zeros((blocks, k.B_COLUMNS))
        # Positions in the cloud are relative to the origin, which keeps up with the vehicle.
        self._origin, self._moved = np.zeros(STATES), np.zeros(STATES)
        self._heading_rad, self._road = 0.0, np.zeros(3)
        self._last: Estimate | None = None
        self._settle = 0.0
        self._ancestors = _NONE
        self._q_per_s = process_noise_rates(o)
        self._resample, self._trigger = RESAMPLERS[o.resampling], TRIGGERS[o.resampling_trigger]
        chosen = o.trigger_threshold
        self._threshold = self._trigger.default_threshold if chosen is None else chosen

    def restart(self, mean: Floats, sigma: Floats) -> None:
        """Draw a new cloud around ``mean`` (9,) with standard deviations ``sigma`` (9,)."""
        self._step += 1
        self._ancestors, self._settle, self._last = _NONE, 0.0, None
        follow(mean, 0.0, self._origin, self._moved)
        self._heading_rad = math.atan2(mean[VY], mean[VX])
        draw_cloud(self._cloud, self.options.seed, self._step, mean - self._origin, sigma)

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        """Predict over ``dt_s`` (None: no prediction) and correct by GNSS, acceleration and pitch."""
        o, dt = self.options, dt_s or 0.0
        self._step += 1
        self._moved[:] = 0.0
        if self._last is not None:
            # Only a prediction moves the cloud away from where it was.
            follow(self._last.state, dt, self._origin, self._moved)
            self._heading_rad = self._last.heading_rad
        source = self._cloud
        if len(self._ancestors):
            self._cloud, self._spare = self._spare, self._cloud
        predict_and_weigh(
            source, self._ancestors, self._cloud, o.particles, self._sums_a,
            o.seed, self._step, dt, half_square(o, dt), self._moved, self._origin,
            self._q_per_s * dt, measured.z, measured.inv_var, o.proposal == "optimal",
            self._heading_rad, measured.pitch_rad, measured.inv_var_pitch, self._settle,
        )  # fmt: skip
        self._ancestors, self._settle = _NONE, 0.0
        return PredictedMap(*predicted_map(self._sums_a, self._origin, self._heading_rad))

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        """Correct by the matched road point (x, y, heading) and the terrain's height, and estimate."""
        o, inv_var = self.options, np.zeros(3)
        if road is not None:
            self._road[:2] = road[0] - self._origin[X], road[1] - self._origin[Y]
            self._road[2] = math.remainder(road[2] - self._heading_rad, 2 * math.pi)
            inv_var[:2] = o.map_sigma_m**-2
            inv_var[2] = o.map_sigma_rad**-2 if use_heading else 0.0
        ground = 0.0 if ground_m is None else ground_m - self._origin[Z]
        weigh_and_estimate(
            self._cloud, o.particles, self._sums_b, self._road, inv_var,
            ground, 0.0 if ground_m is None else inv_var_ground, o.antenna_height_m,
        )  # fmt: skip
        top, total, n_eff, entropy = weights_summary(self._sums_b, o.particles)
        resampled = self._trigger.due(n_eff, entropy, o.particles, self._threshold)
        if resampled:
            fill_weights(self._cloud, top, total, self._weights)
            # The copies are made when the next epoch moves them, block by block.
            self._ancestors = self._resample(self._weights, o.seed, self._step)
        self._settle = 0.0 if resampled else top
        self._last = Estimate(*state_summary(self._sums_b, self._origin), n_eff, resampled)
        return self._last


_NONE: Ints = np.empty(0, np.int64)
