"""Methods ``gps-ins-kf``, ``gps-ins-ekf`` and ``gps-ins-ukf``: Saadaoui 2011, chapter 4.

GPS positions are fused with the speed and heading of an INS in the plane (``filter``, which knows neither options nor
roads). Heights (``height``), roads and slopes are ours: the thesis has none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from fusion.errors import MissingSensorError
from fusion.filters.unscented import Unscented
from fusion.frames import wrap_angle
from fusion.messages import say
from fusion.methods.base import DriveResult, Options
from fusion.published.epochs.levelling import MountPitch, estimate_mount, mount_report, unknown_mount
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.epochs.terrain import quality_warnings
from fusion.published.gps_ins.filter import DriveReadings, Filtered, Settings, chi_square_gate, run
from fusion.published.gps_ins.height import (
    Climb,
    HeightReadings,
    Heights,
    climb_rate,
    filter_heights,
    gnss_heights,
    terrain_heights,
)
from fusion.published.gps_ins.ins import NEED, Ins, build_drive, read_ins
from fusion.published.gps_ins.models import HEADING, ExtendedModel, KalmanModel, Model, UnscentedModel
from fusion.published.gps_ins.options import ExtendedOptions, GpsInsOptions, KalmanOptions, UnscentedOptions
from fusion.published.matchers.base import PointMatches
from fusion.published.matchers.mahalanobis import match_points
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Progress, Track

_LOST_M = 50.0  # a position as vague as this is on no road in particular

# Fitted once, by likelihood, to the errors on 25 kinds of drives: three receiver classes on three real roads and in the
# simulated town, with and without outages (3,000 slopes, 97 % of them within 1.96 sigma).
_SHARES = ErrorShares(
    grade=0.65,
    grade_correlation_s=1.0,
    height=0.3,
    height_correlation_s=60.0,
    white_m=0.05,
    floor_percent=0.1,
)


@dataclass(frozen=True)
class GpsInsMethod:
    """One of the three behind the ``Method`` protocol; the options say which filter it is."""

    name: str
    source: str
    description: str
    options_model: type[Options]
    needs: tuple[str, ...] = ("positions with altitude or, failing altitude, a DEM", NEED)
    cues: tuple[str, ...] = ("altitude", "doppler", "pitch", "specific force")

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: GpsInsOptions, progress: Progress
    ) -> DriveResult:
        """See ``Method.estimate``."""
        epochs = build_epochs(log, network.projection, options.period_s)
        terrain = self._terrain(epochs, dem, options)
        ins = read_ins(self.name, epochs, options)
        plane = locate(network, epochs, ins, options, lambda share: progress("filter", share))
        mount = estimate_mount(epochs) if options.level_pitch else unknown_mount("off")
        climb = climb_rate(epochs, plane.speed_mps, mount, options)
        if terrain is None:
            readings = gnss_heights(epochs, climb, options)
        else:
            readings = _ground(network, terrain, epochs, plane, climb, options)
        heights = filter_heights(epochs.time_s, epochs.after_outage, climb, readings, options.restart_after)
        track = _track(network, epochs, plane, climb, heights, options)
        mount_sigma = mount.sigma if mount.known and np.isfinite(epochs.pitch_rad).any() else 0.0
        slopes = line_slopes(track, _SHARES, mount_sigma, options.min_epochs)
        report = _report(epochs, ins, plane, heights, mount, options)
        warnings = [] if dem is None or terrain is None else quality_warnings(dem, options)
        return DriveResult(track, slopes, {**report, "warnings": warnings})

    def _terrain(self, epochs: Epochs, dem: Dem | None, options: GpsInsOptions) -> Dem | None:
        """The DEM, if heights are to come from it."""
        if options.height == "gnss" and np.isfinite(epochs.alt_m).any():
            return None
        if dem is None:
            raise MissingSensorError(say("method.needs_model", name=self.name))
        return dem.filtered(options.dem_min_quality)


GPS_INS_METHODS = (
    GpsInsMethod(
        "gps-ins-kf",
        "Saadaoui 2011, Algorithm 1",
        "Kalman filter over GPS positions with the INS's speed and heading as command; the height by a filter of ours.",
        KalmanOptions,
    ),
    GpsInsMethod(
        "gps-ins-ekf",
        "Saadaoui 2011, Algorithm 2",
        "Extended Kalman filter over GPS positions and the INS's heading; the height by a filter of ours.",
        ExtendedOptions,
    ),
    GpsInsMethod(
        "gps-ins-ukf",
        "Saadaoui 2011, Algorithm 3",
        "Unscented Kalman filter over GPS positions and the INS's heading; the height by a filter of ours.",
        UnscentedOptions,
    ),
)


@dataclass(frozen=True, eq=False)
class Plane:
    """The estimate in the plane, one row per epoch.

    ``heading_rad`` (n,) is the direction of travel at the epoch, from east, anticlockwise; ``speed_mps`` (n,) the
    ground speed, not negative, NaN where nothing says it.
    """

    filtered: Filtered
    heading_rad: Floats
    speed_mps: Floats
    match: PointMatches


def locate(
    network: RoadNetwork, epochs: Epochs, ins: Ins, options: GpsInsOptions, progress: Callable[[float], None]
) -> Plane:
    """Filter the drive as the options say, and match every epoch to the road."""
    drive = build_drive(epochs, ins, options)
    filtered = run(drive, model_of(options), settings_of(options), progress)
    heading = _direction(drive, filtered, options)
    # Where the INS is silent the fixes' own rate of change is better than nothing: for the map, not for the filter.
    speed = np.where(np.isfinite(ins.speed_mps), np.abs(ins.speed_mps), epochs.speed_mps)
    moving = np.nan_to_num(speed) >= options.min_speed_mps
    match = _match(network, filtered, np.where(moving, heading, np.nan), ins, options)
    return Plane(filtered, heading, speed, match)


def settings_of(options: GpsInsOptions) -> Settings:
    """The settings of the array-level filter that a method's options ask for."""
    named = {f.name: getattr(options, f.name) for f in fields(Settings) if hasattr(options, f.name)}
    return Settings(**named, gate=chi_square_gate(options.gate_probability))


def model_of(options: GpsInsOptions) -> Model:
    """The filter that a method's options ask for."""
    if isinstance(options, ExtendedOptions):
        return ExtendedModel(options.innovation == "printed", options.jacobian == "printed")
    if isinstance(options, UnscentedOptions):
        return UnscentedModel(Unscented(options.alpha, options.beta, options.kappa), not options.redraw)
    return KalmanModel(isinstance(options, KalmanOptions) and options.command_form == "printed")


def _direction(drive: DriveReadings, filtered: Filtered, options: GpsInsOptions) -> Floats:
    """Where the vehicle goes at each epoch, (n,): a filter of two states goes where its command says."""
    states = filtered.mean.shape[1]
    ahead = filtered.mean[:, HEADING] if states > HEADING else drive.heading_rad
    if options.command_at == "midpoint":
        # The heading is that of the step ahead; the vehicle's own lies between it and that of the step behind.
        before = np.concatenate([ahead[:1], ahead[:-1]])
        half = 0.5 * wrap_angle(before - ahead)
        ahead = ahead + np.where(np.isfinite(half) & ~filtered.starts, half, 0.0)
    return wrap_angle(np.where(drive.speed_mps < 0, ahead + np.pi, ahead))


def _match(
    network: RoadNetwork, filtered: Filtered, heading_rad: Floats, ins: Ins, options: GpsInsOptions
) -> PointMatches:
    """The nearest road point of each epoch by the filter's covariance and the map's."""
    n, states = filtered.mean.shape
    known = np.isfinite(filtered.mean[:, 0]) & (filtered.h_sigma_m < _LOST_M)
    covariance = np.zeros((n, 3, 3))
    covariance[:, :states, :states] = np.where(known[:, None, None], filtered.covariance, 0.0)
    if states == HEADING:
        covariance[:, HEADING, HEADING] = ins.heading_sigma_rad**2
    covariance += np.diag([options.map_sigma_m**2, options.map_sigma_m**2, options.map_sigma_rad**2])
    x, y = (np.where(known, filtered.mean[:, axis], np.nan) for axis in (0, 1))
    return match_points(network, x, y, heading_rad, covariance, options.match_gate)


def _ground(
    network: RoadNetwork, dem: Dem, epochs: Epochs, plane: Plane, climb: Climb, options: GpsInsOptions
) -> HeightReadings:
    """Heights of the DEM at the filtered positions, none on bridges and in tunnels."""
    mean, segment, table = plane.filtered.mean, plane.match.segment, network.table
    structure = (segment >= 0) & (table.bridge[segment] | table.tunnel[segment])
    ground = np.where(structure, np.nan, dem.heights(*network.projection.to_lonlat(mean[:, 0], mean[:, 1])))
    if not np.isfinite(ground).any():
        raise MissingSensorError(say("method.model_knows_none"))
    return terrain_heights(ground, climb, plane.speed_mps, epochs.time_s, options)


def _track(
    network: RoadNetwork, epochs: Epochs, plane: Plane, climb: Climb, heights: Heights, options: GpsInsOptions
) -> Track:
    """The epochs that have both a height and a position; a printed form may have left the Earth."""
    filtered, speed = plane.filtered, plane.speed_mps
    lon, lat = network.projection.to_lonlat(filtered.mean[:, 0], filtered.mean[:, 1])
    keep = np.isfinite(lat) & np.isfinite(heights.height_m)
    # While standing, a rate of climb is no pitch.
    pace = np.where(speed >= max(options.min_speed_mps, 0.1), speed, np.nan)
    columns = {
        "time_s": epochs.time_s,
        "lat_deg": lat,
        "lon_deg": lon,
        "alt_m": heights.height_m,
        "h_sigma_m": filtered.h_sigma_m,
        "alt_sigma_m": heights.sigma_m,
        "speed_mps": speed,
        "heading_rad": np.mod(np.pi / 2 - plane.heading_rad, 2 * np.pi),
        "pitch_rad": np.arctan(climb.rate_mps / pace),
        "pitch_sigma_rad": climb.sigma_mps / pace,
        "distance_m": plane.match.distance_m,
    }
    # A start that falls on a row left out counts at the next one that is kept.
    stretch = np.cumsum(filtered.starts | heights.starts)[keep]
    return Track(
        segment=plane.match.segment[keep],
        has_gnss=epochs.has_gnss[keep],
        after_outage=np.diff(stretch, prepend=-1) > 0,
        **{name: column[keep] for name, column in columns.items()},
    )


def _report(
    epochs: Epochs, ins: Ins, plane: Plane, heights: Heights, mount: MountPitch, options: GpsInsOptions
) -> dict[str, object]:
    """What the filter says about itself, JSON-serialisable."""
    filtered = plane.filtered
    nis = filtered.nis[np.isfinite(filtered.nis)]
    return {
        "heading_policy": settings_of(options).heading,
        "heading_sources": ins.heading_share,
        "heading_offset_deg": float(np.degrees(ins.heading_offset_rad)),
        "filter_starts": int(filtered.starts.sum()),
        "gated_fixes": int(filtered.gated.sum()),
        "gated_heights": int(heights.gated.sum()),
        "outage_share": float(np.mean(~epochs.has_gnss)),
        "mean_nis": float(nis.mean()) if len(nis) else None,
        **mount_report(mount),
    }
