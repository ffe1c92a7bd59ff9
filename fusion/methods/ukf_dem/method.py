"""Method ``ukf-dem``: GPS, OSM and a triangulated DEM in an unscented Kalman filter.

The system of Boucher and Noyer that Al Assaad 2020 compares with (its reference [29], chapters 1 and 3): no inertial
sensor, the terrain's height by triangles between its posts. The thesis describes it in a few sentences; states,
measurements and matching are those that it took over from there (2.1)-(2.18).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from fusion.errors import MissingSensorError
from fusion.filters.unscented import Unscented
from fusion.methods.base import DriveResult, Registered
from fusion.methods.epochs.line import ErrorShares, line_slopes
from fusion.methods.epochs.table import Epochs, build_epochs
from fusion.methods.epochs.terrain import TerrainOptions
from fusion.methods.nine_state.motion import whitened
from fusion.methods.nine_state.options import NineStateOptions
from fusion.methods.nine_state.run import DriveRun
from fusion.methods.nine_state.sensors import Sensors
from fusion.methods.nine_state.surroundings import Terrain
from fusion.methods.ukf_dem.filter import UnscentedFilter
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS
from fusion.types import DriveLog, Floats, Progress, Track

# How a slope's sigma follows from the filter's spread in height and from the receiver's own accuracy, fitted to the
# errors on twelve kinds of drives: three receiver classes on three real roads and the simulated town (1,800 slopes,
# 97 % of them within 1.96 sigma, by kind 93 to 100 %; the same on 3,000 slopes of drives kept apart). How far terrain
# errors tilt heights was fitted on two more, motorways over ASTER-like and World-30-like rasters, which had 64 and 93 %
# without; on other scenes 97 and 99 % have it with.
_SHARES = ErrorShares(
    grade=0.0,
    grade_correlation_s=5.0,
    height=0.3,
    height_correlation_s=120.0,
    white_m=0.05,
    floor_percent=0.35,
    receiver=0.67,
)

_TERRAIN = 0.6
"""Of the terrain's accuracy, what counts like a receiver's where heights follow the terrain alone; fitted likewise."""


_TERRAIN_GRADE_PER_M = 0.012
"""Grade error for each metre by which the terrain's errors pull at the height; fitted likewise."""

_MAD_TO_SIGMA = 1.4826


class UkfDemOptions(TerrainOptions, NineStateOptions):
    """Options of the filter. Process noises were chosen for positions alone, on four roads with three receivers."""

    sigma_acc_mps2: float = Field(
        3.0, gt=0, description="Process noise of horizontal acceleration, m/s2 per root second."
    )
    sigma_vel_mps: float = Field(
        0.2, gt=0, description="Process noise of horizontal velocity, m/s per root second."
    )
    sigma_pos_m: float = Field(
        1.0, gt=0, description="Process noise of horizontal position, m per root second."
    )
    sigma_acc_up_mps2: float = Field(
        0.002, gt=0, description="Process noise of vertical acceleration, m/s2 per root second."
    )
    sigma_vel_up_mps: float = Field(
        0.03, gt=0, description="Process noise of vertical velocity, m/s per root second."
    )
    sigma_pos_up_m: float = Field(2.0, gt=0, description="Process noise of altitude, m per root second.")
    dem_sigma_m: float = Field(
        12.6, gt=0, description="Accuracy of the terrain's height, m (thesis: 12.6 ASTER, 6 World 30)."
    )
    dem_correlation_m: float = Field(
        0.0,
        ge=0,
        description="Terrain errors hang together this far, m (original: not at all): an epoch counts for "
        "dx / (dx + 2 L).",
    )
    doppler: bool = Field(
        False,
        description="Use velocity too, Doppler or else the fixes' own rate of change; the original has none.",
    )
    dem_window: Annotated[str, Registered(WINDOWS)] = Field(
        "tin", description="Selection of terrain points (original: tin, triangles)."
    )
    alpha: float = Field(
        1e-3, gt=0, le=1, description="How far sigma points lie from the mean, as a share of their spread."
    )
    beta: float = Field(2.0, ge=0, description="What is known of the distribution's tails; 2 for a Gaussian.")
    kappa: float = Field(
        0.0,
        gt=-9,
        le=100,
        description="Secondary spread of the sigma points, above minus the number of states.",
    )


class UkfDemMethod:
    """The filter behind the ``Method`` protocol."""

    name = "ukf-dem"
    source = "Boucher and Noyer, as Al Assaad 2020 describes them"
    description = "Unscented Kalman filter over GNSS positions, road map and a triangulated DEM."
    needs = ("positions", "a DEM")
    options_model = UkfDemOptions

    def estimate(
        self,
        log: DriveLog,
        network: RoadNetwork,
        dem: Dem | None,
        options: UkfDemOptions,
        progress: Progress,
    ) -> DriveResult:
        """See ``Method.estimate``."""
        if dem is None:
            raise MissingSensorError(
                "Method 'ukf-dem' needs a DEM to correct heights by, and none is there. Import one that covers the "
                "drive, or choose another method."
            )
        run = prepare(log, network, dem, options)
        run.run(progress)
        track = run.track()
        tilt = _terrain_grade(run, track, dem, options)
        slopes = line_slopes(track, _SHARES, tilt, options.min_epochs, _wandering_m(run, options))
        return DriveResult(track, slopes, run.report())


def prepare(log: DriveLog, network: RoadNetwork, dem: Dem, options: UkfDemOptions) -> DriveRun:
    """The run of a drive through the unscented filter."""
    epochs = _positions(build_epochs(log, network.projection, options.period_s), options.doppler)
    terrain = Terrain(dem, options.dem_window, network, epochs, options, options.antenna_height_m)
    engine = UnscentedFilter(options, Unscented(options.alpha, options.beta, options.kappa))
    return DriveRun(epochs, network, engine, options, Sensors(epochs, options), terrain)


def _wandering_m(run: DriveRun, options: UkfDemOptions) -> Floats | float:
    """Accuracy of what the heights follow: of the receiver, or of the terrain where the log has no heights."""
    if not np.isfinite(run.epochs.alt_m).any():
        return _TERRAIN * options.dem_sigma_m
    accuracy: Floats = run.sensors.columns.fix_sigma[run.rows.done, 1]
    return accuracy


def _terrain_grade(run: DriveRun, track: Track, dem: Dem, options: UkfDemOptions) -> float:
    """Grade error that the terrain's errors leave in the heights: they scatter as this drive shows, and the filter
    follows them by the weight that it gives them beside the receiver.
    """
    difference = dem.heights(track.lon_deg, track.lat_deg) - track.alt_m
    known = difference[np.isfinite(difference)]
    if not len(known):
        return 0.0
    scatter_m = _MAD_TO_SIGMA * float(np.median(np.abs(known - np.median(known))))
    step_s = float(np.median(np.diff(track.time_s))) if len(track) > 1 else 1.0
    receiver = whitened(
        float(np.median(run.sensors.columns.fix_sigma[:, 1])) ** 2, step_s, options.gnss_correlation_s
    )
    weight = 1.0
    if np.isfinite(run.epochs.alt_m).any():
        weight = receiver / (receiver + options.dem_sigma_m**2)
    return _TERRAIN_GRADE_PER_M * weight * scatter_m


def _positions(epochs: Epochs, doppler: bool) -> Epochs:
    """The epochs without what the filter has no sensor for; other sensors still say when an epoch is in an outage."""
    if doppler:
        return epochs
    unknown = np.full(len(epochs), np.nan)
    by_position = np.hypot(epochs.rate_e_mps, epochs.rate_n_mps)
    return replace(epochs, vel_e_mps=unknown, vel_n_mps=unknown, vel_u_mps=unknown, speed_mps=by_position)
