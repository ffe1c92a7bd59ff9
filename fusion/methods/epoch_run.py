"""A drive taken through a filter over the nine states, epoch by epoch, in the order of Al Assaad 2020."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fusion.errors import MissingSensorError
from fusion.methods.epoch_filter import EpochFilter, Estimate, PredictedMap
from fusion.methods.epoch_options import EpochOptions
from fusion.methods.epoch_sensors import Sensors
from fusion.methods.epochs import Epochs
from fusion.methods.kinematics import STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.methods.levelling import MountPitch
from fusion.methods.surroundings import Roads, Terrain
from fusion.methods.track import TrackBuilder
from fusion.roads.matching import PointMatch
from fusion.roads.network import RoadNetwork
from fusion.types import Progress, Track

_OUTLIER_SIGMAS = 6.0
_OUTLIERS_BEFORE_RESTART = 3


@dataclass
class DriveRun:
    """One drive going through ``engine``: ``run`` once, then ``track`` and ``report``.

    ``terrain`` None leaves the elevation model out. With ``map_in_outages_only`` the road corrects the estimate only
    where there is no GNSS; it is matched at every epoch all the same, since slopes belong to segments.
    """

    epochs: Epochs
    network: RoadNetwork
    engine: EpochFilter
    options: EpochOptions
    sensors: Sensors
    terrain: Terrain | None = None
    map_in_outages_only: bool = False
    counts: dict[str, int] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = dict.fromkeys(
            ("filtered", "matched", "resampled", "starts", "gnss_outliers", "dem", "outage"), 0
        )
        self._n_eff_sum = 0.0
        self._rows = TrackBuilder(len(self.epochs))
        self._roads = Roads(self.network, self.options)
        self._last: Estimate | None = None
        self._rejected = 0

    def run(self, progress: Progress) -> None:
        """Process every epoch in order."""
        for e in range(len(self.epochs)):
            progress("filter", e / len(self.epochs))
            if self.epochs.restart[e]:
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
        self._rows.mark_start(e)
        self._rejected = 0
        self.counts["starts"] += 1
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
        self._record(e, estimate, match, ground)
        self._last = None if self._rejected >= _OUTLIERS_BEFORE_RESTART else estimate

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
        s, dt = last.state, ep.time_s[e] - ep.time_s[e - 1]
        h, v = self.sensors.gnss_sigmas(e)
        miss = math.hypot(ep.x_m[e] - s[X] - s[VX] * dt, ep.y_m[e] - s[Y] - s[VY] * dt)
        fits = miss <= _OUTLIER_SIGMAS * math.hypot(h, last.h_sigma_m) + 3.0 * dt * dt
        height_miss = abs(ep.alt_m[e] - s[Z] - s[VZ] * dt)
        if math.isfinite(height_miss):
            fits &= height_miss <= _OUTLIER_SIGMAS * math.hypot(v, last.z_sigma_m) + dt * dt
        if fits:
            self._rejected = 0
            return True
        self._rejected += 1
        self.counts["gnss_outliers"] += 1
        return False

    def _ground(self, match: PointMatch | None, predicted: PredictedMap) -> float | None:
        if self.terrain is None or match is None:
            return None
        return self.terrain.height(match.segment, predicted.x_m, predicted.y_m)

    def _ground_below(self, e: int) -> float:
        if self.terrain is None or not self.epochs.has_gnss[e]:
            return math.nan
        return self.terrain.below(float(self.epochs.x_m[e]), float(self.epochs.y_m[e]))

    def _record(self, e: int, estimate: Estimate, match: PointMatch | None, ground: float | None) -> None:
        self.counts["filtered"] += 1
        self.counts["matched"] += match is not None
        self.counts["resampled"] += estimate.resampled
        self.counts["dem"] += ground is not None
        self.counts["outage"] += not self.epochs.has_gnss[e]
        self._n_eff_sum += estimate.n_eff
        distance = math.nan
        if match is not None:
            segment = np.array([match.segment])
            x, y = estimate.state[[X]], estimate.state[[Y]]
            distance = float(self.network.project_points(x, y, segment)[2][0])
        # While standing, vz / v is no pitch: roads are not steeper than this.
        lift = self.options.antenna_height_m / math.cos(min(abs(estimate.pitch_rad), STEEPEST_RAD))
        self._rows.put(e, self.epochs, estimate, match, distance, lift)

    def track(self) -> Track:
        """The filtered epochs; raises ``MissingSensorError`` where there is none."""
        track = self._rows.build(self.network.projection)
        if not len(track):
            raise MissingSensorError(
                "No epoch of the log has both a position and a height: it has no altitude (alt_msl_m or height_ell_m), "
                "and no elevation model that this method uses knows one along it. Record altitudes, or import a DEM "
                "that covers the drive."
            )
        return track

    def report(self) -> dict[str, object]:
        """What the run says about itself, JSON-serialisable."""
        filtered = max(self.counts["filtered"], 1)
        return {
            "epochs_filtered": self.counts["filtered"],
            "outage_share": self.counts["outage"] / filtered,
            "dem_share": self.counts["dem"] / filtered,
            "filter_starts": self.counts["starts"],
            "gnss_outliers": self.counts["gnss_outliers"],
            "dem_offset_m": 0.0 if self.terrain is None else self.terrain.offset_m,
        }

    def cloud_report(self) -> dict[str, object]:
        """What a cloud of particles says besides: share of epochs resampled (57 % in the thesis), mean N_eff."""
        filtered = max(self.counts["filtered"], 1)
        return {
            "resampled_share": self.counts["resampled"] / filtered,
            "mean_n_eff": self._n_eff_sum / filtered,
        }


def mount_report(mount: MountPitch) -> dict[str, object]:
    """What is known of the tilt of the pitch sensor's mount."""
    return {
        "mount_pitch_deg": math.degrees(mount.angle_rad) if mount.known else None,
        "mount_pitch_sigma_deg": math.degrees(mount.sigma) if mount.known else None,
        "mount_pitch_source": mount.source,
    }
