"""A drive taken through the Kalman or the extended Kalman filter of the particle method: what leads the compiled loop.

It hands the drive to ``kalman_loop`` in plain arrays, and answers what the loop stops for: the terrain under a segment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fusion.published.epochs.table import Epochs
from fusion.published.nine_state.motion import half_rate, process_noise_rates
from fusion.published.nine_state.sensors import Sensors
from fusion.published.nine_state.surroundings import Terrain
from fusion.published.nine_state.track import EpochRows
from fusion.published.particle.kalman_loop import (
    GROUND,
    NOTHING,
    OTHER,
    PLANE,
    PREDICTED_X,
    PREDICTED_Y,
    SEGMENT,
    UNKNOWN,
    EpochInputs,
    Now,
    Planes,
    Rules,
    advance,
)
from fusion.published.particle.options import ParticleOptions
from fusion.roads.network import RoadNetwork
from fusion.terrain.plane import PlaneModel
from fusion.types import Floats, Progress, Track


@dataclass
class KalmanRun:
    """What ``DriveRun`` is to engines, for filters small enough to be compiled whole: ``linear`` or extended.

    ``run`` once, then ``track`` and ``report``.
    """

    epochs: Epochs
    network: RoadNetwork
    options: ParticleOptions
    sensors: Sensors
    terrain: Terrain | None
    linear: bool
    rows: EpochRows = field(init=False)

    def __post_init__(self) -> None:
        self.rows = EpochRows.blank(len(self.epochs))

    def run(self, progress: Progress) -> None:
        """Process every epoch in order."""
        drive, rules, planes, now = self._drive(), self._rules(), self._planes(), Now.begin()
        e = 0
        while e < len(self.epochs):
            progress("filter", e / len(self.epochs))
            e = advance(drive, self.sensors.columns, rules, self.network.grid, planes, self.rows, now, e)
            if e < len(self.epochs) and self.terrain is not None:
                _look(self.terrain, planes, now)

    def track(self) -> Track:
        """The filtered epochs; raises ``MissingSensorError`` where there is none."""
        return self.rows.track(self.epochs, self.network, self.options.antenna_height_m)

    def report(self) -> dict[str, object]:
        """What the run says about itself, JSON-serialisable."""
        terrain = {} if self.terrain is None else self.terrain.report()
        return {**self.rows.report(self.epochs), **terrain}

    def _drive(self) -> EpochInputs:
        ep = self.epochs
        fix = np.column_stack([ep.x_m, ep.y_m, ep.alt_m])
        return EpochInputs(ep.time_s, ep.after_outage, ep.has_gnss, fix, ep.speed_mps, self._start_altitude())

    def _start_altitude(self) -> Floats:
        """The fix's own, else that of the ground with the antenna above it."""
        ep, altitude = self.epochs, self.epochs.alt_m.copy()
        without = ep.has_gnss & ~np.isfinite(altitude)
        if self.terrain is not None and without.any():
            ground = self.terrain.below(ep.x_m[without], ep.y_m[without])
            altitude[without] = ground + self.options.antenna_height_m
        return altitude

    def _rules(self) -> Rules:
        o = self.options
        return Rules(
            linear=self.linear,
            half_rate=half_rate(o),
            process_noise=process_noise_rates(o),
            min_speed_mps=o.min_speed_mps,
            match_gate=o.match_gate,
            antenna_m=o.antenna_height_m,
            map_var_m2=o.map_sigma_m**2,
            map_var_rad2=o.map_sigma_rad**2,
            gnss_correlation_s=o.gnss_correlation_s,
            pitch_var_rad2=o.pitch_sigma_rad**2,
            pitch_correlation_s=o.pitch_correlation_s,
            dem_var_m2=o.dem_sigma_m**2,
            dem_correlation_m=o.dem_correlation_m,
        )

    def _planes(self) -> Planes:
        n = len(self.network)
        kind = np.full(n, NOTHING if self.terrain is None else UNKNOWN, np.int8)
        return Planes(kind, np.zeros((n, 5)))


def _look(terrain: Terrain, planes: Planes, now: Now) -> None:
    """Answer what the loop stopped for."""
    segment = int(now.flags[SEGMENT])
    if planes.kind[segment] == UNKNOWN:
        model = terrain.model(segment)
        if isinstance(model, PlaneModel):
            planes.kind[segment] = PLANE
            planes.plane[segment] = model.a, model.b, model.c + terrain.offset_m, model.x0, model.y0
        else:
            planes.kind[segment] = NOTHING if model is None else OTHER
    if planes.kind[segment] == OTHER:
        height = terrain.height(segment, float(now.place[PREDICTED_X]), float(now.place[PREDICTED_Y]))
        now.place[GROUND] = math.nan if height is None else height
