"""The particle filter of chapter 3 taken through a drive, epoch by epoch."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fusion.methods import particle_layout as k
from fusion.methods.epochs import Epochs
from fusion.methods.levelling import MountPitch
from fusion.methods.particle_filter import Estimate, ParticleCloud, PredictedMap
from fusion.methods.particle_options import ParticleOptions
from fusion.methods.particle_sensors import Sensors
from fusion.methods.track import TrackBuilder
from fusion.roads.matching import PointMatch, nearest_mahalanobis
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS, HeightModel
from fusion.types import Progress

_OUTLIER_SIGMAS = 6.0
_OUTLIERS_BEFORE_RESTART = 3


@dataclass
class DriveFilter:
    """One drive going through the filter: ``filter`` once, then ``rows`` and ``report``."""

    epochs: Epochs
    network: RoadNetwork
    dem: Dem | None
    options: ParticleOptions
    mount: MountPitch
    rows: TrackBuilder = field(init=False)
    counts: dict[str, int] = field(init=False)

    def __post_init__(self) -> None:
        self.rows = TrackBuilder(len(self.epochs))
        self.counts = dict.fromkeys(
            ("filtered", "matched", "resampled", "restarts", "gnss_outliers", "dem"), 0
        )
        self.n_eff_sum = 0.0
        self.sensors = Sensors(self.epochs, self.options, self.mount)
        self.dem_offset_m = _datum_offset(self.epochs, self.network, self.dem, self.options.antenna_height_m)
        self._window = WINDOWS[self.options.dem_window]
        self._grounds: dict[int, HeightModel | None] = {}
        self.cloud = ParticleCloud(self.options)
        self._last: Estimate | None = None
        self._rejected = 0

    def filter(self, progress: Progress) -> None:
        """Process every epoch in order."""
        for e in range(len(self.epochs)):
            progress("filter", e / len(self.epochs))
            if self.epochs.restart[e]:
                self._last = None
            if self._last is None and not self._start(e):
                continue
            self._step(e)

    def _start(self, e: int) -> bool:
        """Draw the cloud around the epoch's fix; without one the filter waits."""
        altitude = float(self.epochs.alt_m[e])
        if not math.isfinite(altitude):
            altitude = self._ground_below(e) + self.options.antenna_height_m
        if not (self.epochs.has_gnss[e] and math.isfinite(altitude)):
            return False
        self.cloud.restart(*self.sensors.start(e, altitude))
        self.rows.mark_start(e)
        self._rejected = 0
        self.counts["restarts"] += 1
        return True

    def _step(self, e: int) -> None:
        ep, last = self.epochs, self._last
        dt = None if last is None else float(ep.time_s[e] - ep.time_s[e - 1])
        if last is not None and dt is not None:
            self._refer(last, dt)
        speed = self._speed(e)
        moving = speed >= self.options.min_speed_mps
        measured = self.sensors.at(e, dt or 1.0, use_fix=self._plausible(e), moving=moving)
        predicted = self.cloud.weigh_sensors(dt, measured)
        match = self._match(predicted, moving)
        ground = self._ground(match, predicted) if match is not None else None
        road = None if match is None else (match.x_m, match.y_m, match.heading_rad)
        weight = self._dem_inv_var(speed, dt or 1.0)
        estimate = self.cloud.weigh_surroundings(road, moving, ground, weight)
        self._record(e, estimate, match, ground)
        self._last = None if self._rejected >= _OUTLIERS_BEFORE_RESTART else estimate

    def _speed(self, e: int) -> float:
        """Ground speed as logged; in an outage without a speed signal the filter's own."""
        logged = float(self.epochs.speed_mps[e])
        if math.isfinite(logged):
            return logged
        return 0.0 if self._last is None else math.hypot(self._last.state[k.VX], self._last.state[k.VY])

    def _refer(self, last: Estimate, dt: float) -> None:
        s = last.state
        self.cloud.refer_to(
            s[k.X] + s[k.VX] * dt, s[k.Y] + s[k.VY] * dt, s[k.Z] + s[k.VZ] * dt, last.heading_rad
        )

    def _plausible(self, e: int) -> bool:
        """Whether the fix can be where the vehicle is predicted to be; three misses in a row restart the filter."""
        ep, last = self.epochs, self._last
        if last is None or not ep.has_gnss[e]:
            return False  # a new cloud holds its fix already
        s, dt = last.state, ep.time_s[e] - ep.time_s[e - 1]
        h, v = self.sensors.gnss_sigmas(e)
        miss = math.hypot(ep.x_m[e] - s[k.X] - s[k.VX] * dt, ep.y_m[e] - s[k.Y] - s[k.VY] * dt)
        fits = miss <= _OUTLIER_SIGMAS * math.hypot(h, last.h_sigma_m) + 3.0 * dt * dt
        height_miss = abs(ep.alt_m[e] - s[k.Z] - s[k.VZ] * dt)
        if math.isfinite(height_miss):
            fits &= height_miss <= _OUTLIER_SIGMAS * math.hypot(v, last.z_sigma_m) + dt * dt
        if fits:
            self._rejected = 0
            return True
        self._rejected += 1
        self.counts["gnss_outliers"] += 1
        return False

    def _match(self, predicted: PredictedMap, moving: bool) -> PointMatch | None:
        """Map match of (2.27)-(2.31); while standing the heading says nothing."""
        o = self.options
        noise = np.diag([o.map_sigma_m**2, o.map_sigma_m**2, o.map_sigma_rad**2])
        return nearest_mahalanobis(
            self.network,
            predicted.x_m,
            predicted.y_m,
            predicted.heading_rad if moving else math.nan,
            predicted.covariance + noise,
            gate=o.match_gate,
        )

    def _ground(self, match: PointMatch, predicted: PredictedMap) -> float | None:
        """Terrain height at the predicted position by the matched segment's window (3.12); none on structures."""
        table = self.network.table
        if self.dem is None or table.bridge[match.segment] or table.tunnel[match.segment]:
            return None
        if match.segment not in self._grounds:
            self._grounds[match.segment] = self._window.model(self.dem, self.network, match.segment)
        model = self._grounds[match.segment]
        if model is None:
            return None
        height = float(model.height(np.array([predicted.x_m]), np.array([predicted.y_m]))[0])
        return height + self.dem_offset_m if math.isfinite(height) else None

    def _ground_below(self, e: int) -> float:
        if self.dem is None or not self.epochs.has_gnss[e]:
            return math.nan
        lon, lat = self.network.projection.to_lonlat(self.epochs.x_m[e : e + 1], self.epochs.y_m[e : e + 1])
        return float(self.dem.heights(lon, lat)[0])

    def _dem_inv_var(self, speed_mps: float, dt: float) -> float:
        """Terrain errors hang together, so an epoch brings only the information of the way it covers."""
        o = self.options
        way = max(speed_mps * dt, 0.1)
        return 1 / (o.dem_sigma_m**2 * (1 + 2 * o.dem_correlation_m / way))

    def _record(self, e: int, estimate: Estimate, match: PointMatch | None, ground: float | None) -> None:
        self._last = estimate
        self.counts["filtered"] += 1
        self.counts["matched"] += match is not None
        self.counts["resampled"] += estimate.resampled
        self.counts["dem"] += ground is not None
        self.n_eff_sum += estimate.n_eff
        distance = math.nan
        if match is not None:
            segment = np.array([match.segment])
            x, y = estimate.state[[k.X]], estimate.state[[k.Y]]
            distance = float(self.network.project_points(x, y, segment)[2][0])
        # While standing, vz / v is no pitch: roads are not steeper than this.
        lift = self.options.antenna_height_m / math.cos(min(abs(estimate.pitch_rad), k.STEEPEST_RAD))
        self.rows.put(e, self.epochs, estimate, match, distance, lift)

    def report(self) -> dict[str, object]:
        """What the filter says about itself, JSON-serialisable."""
        filtered = max(self.counts["filtered"], 1)
        return {
            "particles": self.options.particles,
            "epochs_filtered": self.counts["filtered"],
            "resampled_share": self.counts["resampled"] / filtered,
            "dem_share": self.counts["dem"] / filtered,
            "mean_n_eff": self.n_eff_sum / filtered,
            "filter_starts": self.counts["restarts"],
            "gnss_outliers": self.counts["gnss_outliers"],
            "mount_pitch_deg": math.degrees(self.mount.angle_rad) if self.mount.known else None,
            "mount_pitch_sigma_deg": math.degrees(self.mount.sigma) if self.mount.known else None,
            "mount_pitch_source": self.mount.source,
            "dem_offset_m": self.dem_offset_m,
        }


def _datum_offset(epochs: Epochs, network: RoadNetwork, dem: Dem | None, antenna_m: float) -> float:
    """What to add to the terrain so that it meets the log's heights: median over the drive, 0 below 10 m.

    Ellipsoidal heights lie tens of metres from a DEM above the geoid; a constant does no harm to slopes, but
    two sources that disagree by it would pull at the filter.
    """
    if dem is None:
        return 0.0
    lon, lat = network.projection.to_lonlat(epochs.x_m, epochs.y_m)
    difference = epochs.alt_m - antenna_m - dem.heights(lon, lat)
    known = np.isfinite(difference)
    offset = float(np.median(difference[known])) if known.any() else 0.0
    return offset if abs(offset) > 10.0 else 0.0
