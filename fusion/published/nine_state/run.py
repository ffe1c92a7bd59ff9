"""A drive taken through a filter over the nine states, epoch by epoch, in the order of Al Assaad 2020.

Whatever follows ``EpochFilter`` is an engine. Which one, and what becomes of its track, is the method's business.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from fusion.published.epochs.table import Epochs
from fusion.published.matchers.base import PointMatch
from fusion.published.nine_state.motion import OUTLIERS_BEFORE_RESTART, VX, VY, fix_fits
from fusion.published.nine_state.options import NineStateOptions
from fusion.published.nine_state.protocol import EpochFilter, Estimate, PredictedMap
from fusion.published.nine_state.sensors import Sensors
from fusion.published.nine_state.surroundings import Roads, Terrain
from fusion.published.nine_state.track import EpochRows
from fusion.roads.network import RoadNetwork
from fusion.types import Progress, Track


@dataclass
class DriveRun:
    """One drive going through ``engine``: ``run`` once, then ``track`` and ``report``.

    ``terrain`` None leaves the elevation model out. With ``map_in_outages_only`` the road corrects the estimate only
    where there is no GNSS; it is matched at every epoch all the same, since slopes belong to segments. ``roads`` None
    matches by the options.
    """

    epochs: Epochs
    network: RoadNetwork
    engine: EpochFilter
    options: NineStateOptions
    sensors: Sensors
    terrain: Terrain | None = None
    map_in_outages_only: bool = False
    roads: Roads | None = None
    rows: EpochRows = field(init=False)

    def __post_init__(self) -> None:
        self.rows = EpochRows.blank(len(self.epochs))
        self._roads = self.roads or Roads(self.network, self.options)
        self._last: Estimate | None = None
        self._rejected = 0

    def run(self, progress: Progress) -> None:
        """Process every epoch in order."""
        for e in range(len(self.epochs)):
            progress("filter", e / len(self.epochs))
            if self.epochs.after_outage[e]:
                self._last = None
            if self._last is None and not self._start(e):
                continue
            self._step(e)

    def _start(self, e: int) -> bool:
        """Begin around the epoch's fix; without one the filter waits."""
        altitude = float(self.epochs.alt_m[e])
        if not math.isfinite(altitude):
            altitude = self._ground_below(e) + self.options.antenna_height_m
        if not (self.epochs.has_gnss[e] and math.isfinite(altitude)):
            return False
        self.engine.restart(*self.sensors.start(e, altitude))
        self.rows.start[e] = True
        self._rejected = 0
        return True

    def _step(self, e: int) -> None:
        ep, last = self.epochs, self._last
        dt = None if last is None else float(ep.time_s[e] - ep.time_s[e - 1])
        speed = self._speed(e)
        moving = speed >= self.options.min_speed_mps
        use_fix = self._plausible(e)
        measured = self.sensors.at(e, dt or 1.0, use_fix=use_fix, moving=moving)
        predicted = self.engine.sense(dt, measured)
        match = self._roads.match(predicted, moving)
        ground = self._ground(match, predicted)
        road = None if match is None else (match.x_m, match.y_m, match.heading_rad)
        if self.map_in_outages_only and (use_fix or last is None):
            road = None
        weight = 0.0 if self.terrain is None else self.terrain.inv_var(speed * (dt or 1.0))
        estimate = self.engine.locate(road, moving, ground, weight)
        self.rows.put(e, estimate, -1 if match is None else match.segment)
        self.rows.ground[e] = ground is not None
        lost = self._rejected >= OUTLIERS_BEFORE_RESTART or estimate.collapsed
        self._last = None if lost else estimate

    def _speed(self, e: int) -> float:
        """Ground speed as logged; in an outage without a speed signal the filter's own."""
        logged = float(self.epochs.speed_mps[e])
        if math.isfinite(logged):
            return logged
        return 0.0 if self._last is None else math.hypot(self._last.state[VX], self._last.state[VY])

    def _plausible(self, e: int) -> bool:
        """Whether the fix can be where the vehicle is predicted to be; three misses in a row restart the filter."""
        ep, last = self.epochs, self._last
        if last is None or not ep.has_gnss[e]:
            return False  # a new state holds its fix already
        fix = float(ep.x_m[e]), float(ep.y_m[e]), float(ep.alt_m[e])
        spread, dt = (last.h_sigma_m, last.z_sigma_m), float(ep.time_s[e] - ep.time_s[e - 1])
        fits = fix_fits(fix, self.sensors.gnss_sigmas(e), last.state, spread, dt)
        if fits:
            self._rejected = 0
            return True
        self._rejected += 1
        self.rows.outlier[e] = True
        return False

    def _ground(self, match: PointMatch | None, predicted: PredictedMap) -> float | None:
        if self.terrain is None or match is None:
            return None
        return self.terrain.height(match.segment, predicted.x_m, predicted.y_m)

    def _ground_below(self, e: int) -> float:
        if self.terrain is None or not self.epochs.has_gnss[e]:
            return math.nan
        return float(self.terrain.below(self.epochs.x_m[[e]], self.epochs.y_m[[e]])[0])

    def track(self) -> Track:
        """The filtered epochs; raises ``MissingSensorError`` where there is none."""
        return self.rows.track(self.epochs, self.network, self.options.antenna_height_m)

    def report(self) -> dict[str, object]:
        """What the run says about itself, JSON-serialisable."""
        terrain = {} if self.terrain is None else self.terrain.report()
        return {**self.rows.report(self.epochs), **terrain}

    def cloud_report(self) -> dict[str, object]:
        """What a cloud of particles says besides."""
        return self.rows.cloud_report()
