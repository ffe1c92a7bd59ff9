"""A drive taken through a filter over the nine states, epoch by epoch, in the order of Al Assaad 2020.

What surrounds the vehicle comes first, as filters look at it: the nearest road, the ground under it. Whatever follows
``EpochFilter`` is an engine. Which one, and what becomes of its track, is the method's business.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from fusion.published.epochs.table import Epochs
from fusion.published.epochs.terrain import TerrainOptions, quality_warnings
from fusion.published.matchers.base import PointMatch
from fusion.published.matchers.mahalanobis import nearest_mahalanobis
from fusion.published.nine_state.motion import (
    OUTLIERS_BEFORE_RESTART,
    SHORTEST_WAY_M,
    VX,
    VY,
    fix_fits,
    whitened,
)
from fusion.published.nine_state.options import NineStateOptions
from fusion.published.nine_state.protocol import EpochFilter, EpochRows, Estimate, PredictedMap
from fusion.published.nine_state.sensors import Sensors
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS, HeightModel
from fusion.types import Floats, Progress, Track

# A smaller difference is error, not another datum: geoids lie tens of metres off the ellipsoid.
_LEAST_OFFSET_M = 10.0


class Roads:
    """Map matching of (2.27)-(2.31): candidates by Mahalanobis distance, accepted within the gate."""

    def __init__(self, network: RoadNetwork, options: NineStateOptions) -> None:
        self._network = network
        self._gate = options.match_gate
        self._noise: Floats = np.diag(
            [options.map_sigma_m**2, options.map_sigma_m**2, options.map_sigma_rad**2]
        )

    def match(self, predicted: PredictedMap, use_heading: bool) -> PointMatch | None:
        """The road point that fits the prediction best, or None; while standing the heading says nothing."""
        return nearest_mahalanobis(
            self._network,
            predicted.x_m,
            predicted.y_m,
            predicted.heading_rad if use_heading else math.nan,
            predicted.covariance + self._noise,
            gate=self._gate,
        )


class Terrain:
    """The elevation model as a sensor along one drive.

    ``offset_m`` is what was added to it to meet the log's heights: ellipsoidal heights lie tens of metres from a
    DEM above the geoid. A constant does no harm to slopes, but two sources that disagree by it would pull at the
    filter. ``warnings`` are sentences for the drive's report.
    """

    def __init__(
        self,
        dem: Dem,
        window: str,
        network: RoadNetwork,
        epochs: Epochs,
        options: TerrainOptions,
        antenna_m: float,
    ) -> None:
        self._dem, self._network, self._options = dem.filtered(options.dem_min_quality), network, options
        self.warnings = quality_warnings(dem, options)
        self._window = WINDOWS[window]
        self._models: dict[int, HeightModel | None] = {}
        self.offset_m = _datum_offset(epochs, network, dem, antenna_m)

    def height(self, segment: int, x_m: float, y_m: float) -> float | None:
        """Height of the ground by the matched segment's window (3.12); None on structures and where unknown."""
        model = self.model(segment)
        if model is None:
            return None
        height = model.height_at(x_m, y_m)
        return height + self.offset_m if math.isfinite(height) else None

    def model(self, segment: int) -> HeightModel | None:
        """A segment's window, without the offset; None on structures and where the elevation model has no height."""
        table = self._network.table
        if table.bridge[segment] or table.tunnel[segment]:
            return None
        if segment not in self._models:
            self._models[segment] = self._window.model(self._dem, self._network, segment)
        return self._models[segment]

    def report(self) -> dict[str, object]:
        """What is to be said of the elevation model."""
        return {"dem_offset_m": self.offset_m, "warnings": self.warnings}

    def inv_var(self, way_m: float) -> float:
        """Terrain errors hang together, so an epoch brings only the information of the way it covers."""
        o = self._options
        return 1.0 / whitened(o.dem_sigma_m**2, max(way_m, SHORTEST_WAY_M), o.dem_correlation_m)

    def below(self, x_m: Floats, y_m: Floats) -> Floats:
        """Heights of the triangulated surface at places (n,), on the log's datum; NaN where unknown."""
        lon, lat = self._network.projection.to_lonlat(x_m, y_m)
        return self._dem.heights(lon, lat) + self.offset_m


def _datum_offset(epochs: Epochs, network: RoadNetwork, dem: Dem, antenna_m: float) -> float:
    """Median difference of the log's heights from the terrain over the drive; 0 below 10 m."""
    lon, lat = network.projection.to_lonlat(epochs.x_m, epochs.y_m)
    difference = epochs.alt_m - antenna_m - dem.heights(lon, lat)
    known = np.isfinite(difference)
    offset = float(np.median(difference[known])) if known.any() else 0.0
    return offset if abs(offset) > _LEAST_OFFSET_M else 0.0


@dataclass
class FilterRun(ABC):
    """One drive going through a filter over the nine states: ``run`` once, then ``track`` and ``report``.

    ``terrain`` None leaves the elevation model out.
    """

    epochs: Epochs
    network: RoadNetwork
    options: NineStateOptions
    sensors: Sensors
    terrain: Terrain | None
    rows: EpochRows = field(init=False)

    def __post_init__(self) -> None:
        self.rows = EpochRows.blank(len(self.epochs))

    @abstractmethod
    def run(self, progress: Progress) -> None:
        """Process every epoch in order."""

    def track(self) -> Track:
        """The filtered epochs; raises ``MissingSensorError`` where there is none."""
        return self.rows.track(self.epochs, self.network, self.options.antenna_height_m)

    def report(self) -> dict[str, object]:
        """What the run says about itself, JSON-serialisable."""
        terrain = {} if self.terrain is None else self.terrain.report()
        return {**self.rows.report(self.epochs), **terrain}


@dataclass
class DriveRun(FilterRun):
    """One drive going through ``engine``.

    With ``map_in_outages_only`` the road corrects the estimate only where there is no GNSS; it is matched at every
    epoch all the same, since slopes belong to segments. ``roads`` None matches by the options.
    """

    engine: EpochFilter
    map_in_outages_only: bool = False
    roads: Roads | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
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
        fix = np.array([ep.x_m[e], ep.y_m[e], ep.alt_m[e]])
        spread, dt = (last.h_sigma_m, last.z_sigma_m), float(ep.time_s[e] - ep.time_s[e - 1])
        fits = fix_fits(fix, self.sensors.columns.fix_sigma[e], last.state, spread, dt)
        self._rejected = 0 if fits else self._rejected + 1
        self.rows.outlier[e] = not fits
        return fits

    def _ground(self, match: PointMatch | None, predicted: PredictedMap) -> float | None:
        if self.terrain is None or match is None:
            return None
        return self.terrain.height(match.segment, predicted.x_m, predicted.y_m)

    def _ground_below(self, e: int) -> float:
        if self.terrain is None or not self.epochs.has_gnss[e]:
            return math.nan
        return float(self.terrain.below(self.epochs.x_m[[e]], self.epochs.y_m[[e]])[0])
