"""What surrounds a vehicle, as the filters over the nine states look at it: the nearest road, the ground under it."""

from __future__ import annotations

import math

import numpy as np

from fusion.published.epochs.table import Epochs
from fusion.published.epochs.terrain import TerrainOptions, quality_warnings
from fusion.published.matchers.base import PointMatch
from fusion.published.matchers.mahalanobis import nearest_mahalanobis
from fusion.published.nine_state.motion import SHORTEST_WAY_M, whitened
from fusion.published.nine_state.options import NineStateOptions
from fusion.published.nine_state.protocol import PredictedMap
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS, HeightModel
from fusion.types import Floats

_LEAST_OFFSET_M = (
    10.0  # a smaller difference is error, not another datum: geoids lie tens of metres off the ellipsoid
)


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
