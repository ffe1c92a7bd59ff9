"""Baseline ``dem``: the terrain's heights at a segment's two ends, what every DEM tool does."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from fusion.errors import MissingSensorError
from fusion.methods.base import DriveResult, Options
from fusion.methods.baselines.matched_fixes import match_fixes
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import DriveLog, Floats, Progress, SegmentSlope


class DemOptions(Options):
    """Options of the DEM baseline."""

    period_s: float = Field(0.5, gt=0, le=10, description="Shortest time between two epochs, s.")
    height_sigma_m: float = Field(
        3.5, gt=0, description="Error of a terrain height against its neighbourhood, m."
    )
    correlation_m: float = Field(
        90.0, gt=0, description="Distance over which terrain errors hang together, m."
    )


class DemMethod:
    """The baseline behind the ``Method`` protocol."""

    name = "dem"
    source = "Baseline"
    description = "Difference of the DEM's heights at the ends of each driven segment."
    needs = ("positions", "a DEM")
    options_model = DemOptions

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: DemOptions, progress: Progress
    ) -> DriveResult:
        """See ``Method.estimate``."""
        if dem is None:
            raise MissingSensorError(
                "Method 'dem' takes slopes from a DEM, and none is there. Import one that covers the drive, or "
                "choose another method."
            )
        progress("match", 0.0)
        _, track = match_fixes(log, network, options.period_s)
        driven = np.unique(track.segment[track.segment >= 0])
        slope = dem_slopes(dem, network.table.subset(driven))
        sigma = _sigma_percent(network.length_m[driven], options)
        found = [
            _slope(int(s), float(v), float(e), track.time_s[track.segment == s])
            for s, v, e in zip(driven, slope, sigma, strict=True)
            if np.isfinite(v)
        ]
        return DriveResult(track, tuple(found), {})


def _sigma_percent(length_m: Floats, options: DemOptions) -> Floats:
    """Two heights whose errors part with distance: sqrt(2 (1 - exp(-L / Lc))) sigma / L, linear below Lc."""
    apart = np.maximum(length_m, options.correlation_m)
    parted = np.sqrt(2 * (1 - np.exp(-apart / options.correlation_m)))
    sigma: Floats = 100.0 * options.height_sigma_m * parted / apart
    return sigma


def _slope(segment: int, slope: float, sigma: float, time_s: Floats) -> SegmentSlope:
    return SegmentSlope(segment, slope, sigma, len(time_s), 1, float(time_s[0]), float(time_s[-1]))
