"""The road map as Lahrech et al. 2005 look at it: near by, and maybe made of points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fusion.matching.points.base import PointMatch
from fusion.methods.nine_state.filter import PredictedMap
from fusion.methods.nine_state.surroundings import Roads
from fusion.methods.odometer_map.options import OdometerMapOptions
from fusion.roads.network import RoadNetwork
from fusion.types import Floats


class NearRoads(Roads):
    """``Roads`` that answer while the position is known to ``match_within_m``: beyond it any road would do.

    With ``map_step_m`` a match is one of the matched segment's points, so far apart, and its end (11).
    """

    def __init__(self, network: RoadNetwork, options: OdometerMapOptions) -> None:
        super().__init__(network, options)
        self._table, self._options = network, options

    def match(self, predicted: PredictedMap, use_heading: bool) -> PointMatch | None:
        """The road point of least Mahalanobis distance, or None where that is outside the gate."""
        widest = float(np.linalg.eigvalsh(predicted.covariance[:2, :2])[-1])
        if widest > self._options.match_within_m**2:
            return None
        exact = super().match(predicted, use_heading)
        if exact is None or self._options.map_step_m is None:
            return exact
        return self._nearest_point(exact, predicted, use_heading)

    def _nearest_point(
        self, exact: PointMatch, predicted: PredictedMap, use_heading: bool
    ) -> PointMatch | None:
        along, x, y = self._points(exact.segment)
        turn = math.remainder(exact.heading_rad - predicted.heading_rad, 2 * math.pi)
        used = slice(0, 3 if use_heading else 2)
        away = np.column_stack([x - predicted.x_m, y - predicted.y_m, np.full(len(x), turn)])[:, used]
        o = self._options
        noise = np.diag([o.map_sigma_m, o.map_sigma_m, o.map_sigma_rad]) ** 2
        spread = (predicted.covariance + noise)[used, used]
        square = np.sum(away * np.linalg.solve(spread, away.T).T, axis=1)
        best = int(np.argmin(square))
        d = math.sqrt(float(square[best]))
        if d > o.match_gate:
            return None
        return replace(
            exact, x_m=float(x[best]), y_m=float(y[best]), distance_m=float(along[best]), mahalanobis=d
        )

    def _points(self, segment: int) -> tuple[Floats, Floats, Floats]:
        """Distances from from_node, x and y of a segment's points, metres."""
        t, length = self._table, float(self._table.length_m[segment])
        along = np.append(np.arange(0.0, length, self._options.map_step_m), length)
        share = along / length if length > 0 else np.zeros(len(along))
        x = t.x0[segment] + share * (t.x1[segment] - t.x0[segment])
        y = t.y0[segment] + share * (t.y1[segment] - t.y0[segment])
        return along, x, y
