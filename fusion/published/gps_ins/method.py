"""Methods ``gps-ins-kf``, ``gps-ins-ekf`` and ``gps-ins-ukf``: Saadaoui 2011, chapter 4.

GPS positions are fused with the speed and heading of an INS in the plane. Heights (``height``), roads and slopes
are ours: the thesis has none of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.errors import MissingSensorError
from fusion.methods.base import DriveResult, Options
from fusion.published.epochs.levelling import MountPitch, estimate_mount, mount_report
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.epochs.terrain import quality_warnings
from fusion.published.gps_ins.height import (
    Climb,
    HeightReadings,
    Heights,
    climb_rate,
    filter_heights,
    gnss_heights,
    terrain_heights,
)
from fusion.published.gps_ins.ins import NEED, Ins, read_ins
from fusion.published.gps_ins.options import ExtendedOptions, GpsInsOptions, KalmanOptions, UnscentedOptions
from fusion.published.gps_ins.plane import Plane, locate, settings_of
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Progress, Track

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
        mount = estimate_mount(epochs) if options.level_pitch else MountPitch(0.0, np.inf, "off")
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
            raise MissingSensorError(
                f"Method {self.name!r} would take heights from a DEM, and none is there: import one that covers the "
                "drive, or give a log with altitudes (alt_msl_m or height_ell_m) and leave the option height at gnss."
            )
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


def _ground(
    network: RoadNetwork, dem: Dem, epochs: Epochs, plane: Plane, climb: Climb, options: GpsInsOptions
) -> HeightReadings:
    """Heights of the DEM at the filtered positions, none on bridges and in tunnels."""
    mean, segment, table = plane.filtered.mean, plane.match.segment, network.table
    structure = (segment >= 0) & (table.bridge[segment] | table.tunnel[segment])
    ground = np.where(structure, np.nan, dem.heights(*network.projection.to_lonlat(mean[:, 0], mean[:, 1])))
    if not np.isfinite(ground).any():
        raise MissingSensorError(
            "The DEM knows no height along the drive: import one that covers it, or record altitudes (alt_msl_m or "
            "height_ell_m)."
        )
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
