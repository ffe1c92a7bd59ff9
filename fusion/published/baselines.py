"""Methods ``raw`` and ``dem``, what every other method has to beat.

``raw`` draws a line through the altitudes as the receiver logged them; ``dem`` takes the terrain's heights at a
segment's two ends, which is what every tool without drives does. Both put the raw fixes on roads one by one, by the
rule of Al Assaad 2020, 2.3.3.3, and filter nothing.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from fusion.errors import MissingSensorError
from fusion.frames import wrap_angle
from fusion.messages import say
from fusion.methods.base import DriveResult, Options
from fusion.published.epochs.line import AltitudeErrors, segment_slopes
from fusion.published.epochs.table import UNKNOWN_ALTITUDE_SIGMA_M, Epochs, build_epochs, white_altitude_sigma
from fusion.published.matchers.mahalanobis import GATE, match_points
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import DriveLog, Floats, Progress, SegmentSlope, Track

_ALTITUDE_CORRELATION_S = 60.0  # GNSS altitude errors hang together for minutes

# How far a raw fix may lie from the road that it is put on; the gate is the thesis's.
_MIN_SPEED_MPS = 1.0  # slower, a course says nothing
_DEFAULT_H_ACC_M = 2.5  # horizontal accuracy (2-D) of a log that states none
_MAP_SIGMA_M = 4.0  # of the map's position, lane offset included
_HEADING_SIGMA_RAD = 0.3  # of the course and the map's direction together


class RawOptions(Options):
    """Options of the raw baseline."""

    period_s: float = Field(0.5, gt=0, le=10)
    """Shortest time between two epochs, s."""
    min_epochs: int = Field(4, ge=2, le=100)
    """Altitudes that a slope needs."""


class RawMethod:
    """The baseline behind the ``Method`` protocol."""

    name = "raw"
    source = "Baseline; matching and line of Al Assaad 2020, 2.3.3.3 and 3.4.3"
    description = "Line through the raw altitudes of the fixes nearest to a segment."
    needs = ("positions with altitude",)
    cues = ("altitude",)
    options_model = RawOptions

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: RawOptions, progress: Progress
    ) -> DriveResult:
        """See ``Method.estimate``."""
        if not (log.fix.has("alt_msl_m") or log.fix.has("height_ell_m")):
            raise MissingSensorError(say("method.raw_needs_altitudes"))
        progress("match", 0.0)
        epochs, track = match_fixes(log, network, options.period_s)
        slopes = segment_slopes(track, _altitude_errors(epochs, track).covariance, options.min_epochs)
        return DriveResult(track, slopes, {"white_altitude_sigma_m": white_altitude_sigma(epochs)})


def _altitude_errors(epochs: Epochs, track: Track) -> AltitudeErrors:
    white = white_altitude_sigma(epochs)
    stated: Floats = np.nan_to_num(epochs.v_acc_m, nan=UNKNOWN_ALTITUDE_SIGMA_M)
    nothing = np.zeros(len(epochs))
    return AltitudeErrors(
        time_s=track.time_s,
        speed_mps=np.nan_to_num(track.speed_mps),
        white_m=np.full(len(epochs), white),
        correlated_m=np.sqrt(np.maximum(stated**2 - white**2, 0.0)),
        correlation_s=_ALTITUDE_CORRELATION_S,
        grade=nothing,
        grade_correlation_s=1.0,
    )


class DemOptions(Options):
    """Options of the DEM baseline."""

    period_s: float = Field(0.5, gt=0, le=10)
    """Shortest time between two epochs, s."""
    height_sigma_m: float = Field(3.5, gt=0)
    """Error of a terrain height against its neighbourhood, m."""
    correlation_m: float = Field(90.0, gt=0)
    """Distance over which terrain errors hang together, m."""


class DemMethod:
    """The baseline behind the ``Method`` protocol."""

    name = "dem"
    source = "Baseline"
    description = "Difference of the DEM's heights at the ends of each driven segment."
    needs = ("positions", "a DEM")
    cues: tuple[str, ...] = ()
    options_model = DemOptions

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: DemOptions, progress: Progress
    ) -> DriveResult:
        """See ``Method.estimate``."""
        if dem is None:
            raise MissingSensorError(say("method.dem_needs_model"))
        progress("match", 0.0)
        _, track = match_fixes(log, network, options.period_s)
        driven = np.unique(track.segment[track.segment >= 0])
        slope = dem_slopes(dem, network.table.subset(driven))
        sigma = _end_sigma_percent(network.length_m[driven], options)
        slopes = [
            _end_slope(int(s), float(v), float(e), track.time_s[track.segment == s])
            for s, v, e in zip(driven, slope, sigma, strict=True)
            if np.isfinite(v)
        ]
        return DriveResult(track, tuple(slopes), {})


def _end_sigma_percent(length_m: Floats, options: DemOptions) -> Floats:
    """Two heights whose errors part with distance: sqrt(2 (1 - exp(-L / Lc))) sigma / L, linear below Lc."""
    apart = np.maximum(length_m, options.correlation_m)
    parted = np.sqrt(2 * (1 - np.exp(-apart / options.correlation_m)))
    sigma: Floats = 100.0 * options.height_sigma_m * parted / apart
    return sigma


def _end_slope(segment: int, slope: float, sigma: float, time_s: Floats) -> SegmentSlope:
    return SegmentSlope(segment, slope, sigma, len(time_s), 1, float(time_s[0]), float(time_s[-1]))


def match_fixes(log: DriveLog, network: RoadNetwork, period_s: float) -> tuple[Epochs, Track]:
    """Epochs with a position, and a track through the raw fixes: heights as logged, nearest segments."""
    epochs = build_epochs(log, network.projection, period_s)
    epochs = epochs.with_fix()
    heading = _course(epochs)
    sigma = np.hypot(np.nan_to_num(epochs.h_acc_m, nan=_DEFAULT_H_ACC_M) / np.sqrt(2), _MAP_SIGMA_M)
    covariance = np.zeros((len(epochs), 3, 3))
    covariance[:, 0, 0] = covariance[:, 1, 1] = sigma**2
    covariance[:, 2, 2] = _HEADING_SIGMA_RAD**2
    match = match_points(network, epochs.x_m, epochs.y_m, heading, covariance, GATE)
    lon, lat = network.projection.to_lonlat(epochs.x_m, epochs.y_m)
    unknown = np.full(len(epochs), np.nan)
    return epochs, Track(
        time_s=epochs.time_s,
        lat_deg=lat,
        lon_deg=lon,
        alt_m=epochs.alt_m,
        h_sigma_m=epochs.h_acc_m,
        alt_sigma_m=epochs.v_acc_m,
        speed_mps=epochs.speed_mps,
        heading_rad=np.mod(np.pi / 2 - heading, 2 * np.pi),
        pitch_rad=unknown,
        pitch_sigma_rad=unknown,
        segment=match.segment,
        distance_m=match.distance_m,
        has_gnss=np.ones(len(epochs), bool),
        after_outage=epochs.after_outage,
    )


def _course(epochs: Epochs) -> Floats:
    """Course from east, anticlockwise: Doppler, else the fixes on either side; NaN while standing."""
    heading = np.arctan2(epochs.vel_n_mps, epochs.vel_e_mps)
    if len(epochs) > 1:
        by_position = np.arctan2(np.gradient(epochs.y_m), np.gradient(epochs.x_m))
        heading = np.where(np.isfinite(heading), heading, by_position)
    moving = np.nan_to_num(epochs.speed_mps) >= _MIN_SPEED_MPS
    return np.where(moving, wrap_angle(heading), np.nan)
