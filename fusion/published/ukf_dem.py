"""Method ``ukf-dem``: GPS, OSM and a triangulated DEM in an unscented Kalman filter.

The system of Boucher and Noyer that Al Assaad 2020 compares with (its reference [29], chapters 1 and 3): no inertial
sensor, the terrain's height by triangles between its posts. The thesis describes it in a few sentences; states,
measurements and matching are those that it took over from there (2.1)-(2.18).

The filter itself sends sigma points through every function, the linear ones too, as in the filters that the thesis
compares with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from fusion.errors import MissingSensorError
from fusion.filters.unscented import Unscented
from fusion.frames import wrap_angle
from fusion.messages import say
from fusion.methods.base import DriveResult
from fusion.options import Registered
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import MAD_TO_SIGMA, Epochs, build_epochs
from fusion.published.epochs.terrain import TerrainOptions
from fusion.published.nine_state import motion
from fusion.published.nine_state.measurements import SLOWEST_MPS, gaussian_estimate, predicted_map
from fusion.published.nine_state.options import NineStateOptions
from fusion.published.nine_state.protocol import Estimate, Measurement, PredictedMap, Road
from fusion.published.nine_state.run import DriveRun, Terrain
from fusion.published.nine_state.sensors import Sensors
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

_TERRAIN_SHARE = 0.6
"""Of the terrain's accuracy, what counts like a receiver's where heights follow the terrain alone; fitted likewise."""

_TERRAIN_GRADE_PER_M = 0.012
"""Grade error for each metre by which the terrain's errors pull at the height; fitted likewise."""


class UkfDemOptions(TerrainOptions, NineStateOptions):
    """Options of the filter. Process noises were chosen for positions alone, on four roads with three receivers."""

    sigma_acc_mps2: float = Field(3.0, gt=0)
    """Process noise of horizontal acceleration, m/s2 per root second."""
    sigma_vel_mps: float = Field(0.2, gt=0)
    """Process noise of horizontal velocity, m/s per root second."""
    sigma_pos_m: float = Field(1.0, gt=0)
    """Process noise of horizontal position, m per root second."""
    sigma_acc_up_mps2: float = Field(0.002, gt=0)
    """Process noise of vertical acceleration, m/s2 per root second."""
    sigma_vel_up_mps: float = Field(0.03, gt=0)
    """Process noise of vertical velocity, m/s per root second."""
    sigma_pos_up_m: float = Field(2.0, gt=0)
    """Process noise of altitude, m per root second."""
    dem_sigma_m: float = Field(12.6, gt=0)
    """Accuracy of the terrain's height, m (thesis: 12.6 ASTER, 6 World 30)."""
    dem_correlation_m: float = Field(0.0, ge=0)
    """Terrain errors hang together this far, m (original: not at all): an epoch counts for dx / (dx + 2 L)."""
    doppler: bool = False
    """Use velocity too, Doppler or else the fixes' own rate of change; the original has none."""
    dem_window: Annotated[str, Registered(WINDOWS)] = "tin"
    """Selection of terrain points (original: tin, triangles)."""
    alpha: float = Field(1e-3, gt=0, le=1)
    """How far sigma points lie from the mean, as a share of their spread."""
    beta: float = Field(2.0, ge=0)
    """What is known of the distribution's tails; 2 for a Gaussian."""
    kappa: float = Field(0.0, gt=-9, le=100)
    """Secondary spread of the sigma points, above minus the number of states."""


class UkfDemMethod:
    """The filter behind the ``Method`` protocol."""

    name = "ukf-dem"
    source = "Boucher and Noyer, as Al Assaad 2020 describes them"
    description = "Unscented Kalman filter over GNSS positions, road map and a triangulated DEM."
    needs = ("positions", "a DEM")
    cues: tuple[str, ...] = ()
    options_model = UkfDemOptions

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: UkfDemOptions, progress: Progress
    ) -> DriveResult:
        """See ``Method.estimate``."""
        if dem is None:
            raise MissingSensorError(say("method.ukf_needs_model"))
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
    return DriveRun(epochs, network, options, Sensors(epochs, options), terrain, engine)


def _positions(epochs: Epochs, doppler: bool) -> Epochs:
    """The epochs without what the filter has no sensor for; other sensors still say when an epoch is in an outage."""
    if doppler:
        return epochs
    unknown = np.full(len(epochs), np.nan)
    by_position = np.hypot(epochs.rate_e_mps, epochs.rate_n_mps)
    return replace(epochs, vel_e_mps=unknown, vel_n_mps=unknown, vel_u_mps=unknown, speed_mps=by_position)


def _wandering_m(run: DriveRun, options: UkfDemOptions) -> Floats | float:
    """Accuracy of what the heights follow: of the receiver, or of the terrain where the log has no heights."""
    if not np.isfinite(run.epochs.alt_m).any():
        return _TERRAIN_SHARE * options.dem_sigma_m
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
    scatter_m = MAD_TO_SIGMA * float(np.median(np.abs(known - np.median(known))))
    step_s = float(np.median(np.diff(track.time_s))) if len(track) > 1 else 1.0
    receiver = motion.whitened(
        float(np.median(run.sensors.columns.fix_sigma[:, 1])) ** 2, step_s, options.gnss_correlation_s
    )
    weight = 1.0
    if np.isfinite(run.epochs.alt_m).any():
        weight = receiver / (receiver + options.dem_sigma_m**2)
    return _TERRAIN_GRADE_PER_M * weight * scatter_m


@dataclass
class UnscentedFilter:
    """A Gaussian of mean (9,) and covariance (9, 9), moved and corrected through ``unscented``'s sigma points.

    Corrections follow the order of the thesis; those that belong to one source enter together.
    """

    options: NineStateOptions
    unscented: Unscented

    def restart(self, mean: Floats, sigma: Floats) -> None:
        """See ``EpochFilter``."""
        self._mean, self._covariance = mean.copy(), np.diag(sigma**2)

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        """See ``EpochFilter``."""
        if dt_s is not None:
            F = motion.transition(self.options, dt_s)
            Q = np.diag(motion.process_noise_rates(self.options) * dt_s)
            self._mean, self._covariance = self.unscented.predict(
                self._mean, self._covariance, lambda points: points @ F.T, Q
            )
        seen = np.flatnonzero(measured.inv_var > 0.0)
        if len(seen):
            self._correct(measured.z[seen], 1.0 / measured.inv_var[seen], lambda points: points[:, seen])
        if measured.inv_var_pitch > 0.0:
            pitch, variance = np.array([measured.pitch_rad]), np.array([1.0 / measured.inv_var_pitch])
            self._correct(pitch, variance, lambda points: _pitch(points)[:, None])
        return predicted_map(self._mean, self._covariance)

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        """See ``EpochFilter``."""
        if road is not None:
            self._correct_by_road(road, 3 if use_heading else 2)
        if ground_m is not None:
            ground, variance = np.array([ground_m]), np.array([1.0 / inv_var_ground])
            self._correct(ground, variance, self._ground_under)
        return gaussian_estimate(self._mean, self._covariance)

    def _correct_by_road(self, road: Road, count: int) -> None:
        """The matched point, and with a ``count`` of 3 the direction of the road there."""
        o = self.options
        variances = np.array([o.map_sigma_m, o.map_sigma_m, o.map_sigma_rad]) ** 2

        def subtract(a: Floats, b: Floats) -> Floats:
            difference = a - b
            difference[..., 2:] = wrap_angle(difference[..., 2:])
            return difference

        self._correct(
            np.array(road)[:count], variances[:count], lambda points: _on_map(points)[:, :count], subtract
        )

    def _correct(
        self,
        measured: Floats,
        variances: Floats,
        h: Callable[[Floats], Floats],
        subtract: Callable[[Floats, Floats], Floats] = np.subtract,
    ) -> None:
        self._mean, self._covariance = self.unscented.correct(
            self._mean, self._covariance, measured, h, np.diag(variances), subtract
        )

    def _ground_under(self, points: Floats) -> Floats:
        """(2.17): z - H / cos(pitch), shape (k, 1)."""
        steep = np.clip(_pitch(points), -motion.STEEPEST_RAD, motion.STEEPEST_RAD)
        return (points[:, motion.Z] - self.options.antenna_height_m / np.cos(steep))[:, None]


def _on_map(points: Floats) -> Floats:
    """(2.14): x, y and the direction of travel, shape (k, 3)."""
    return np.column_stack(
        [points[:, motion.X], points[:, motion.Y], np.arctan2(points[:, motion.VY], points[:, motion.VX])]
    )


def _pitch(points: Floats) -> Floats:
    """(3.14), shape (k,)."""
    along = np.maximum(np.hypot(points[:, motion.VX], points[:, motion.VY]), SLOWEST_MPS)
    pitch: Floats = np.arctan(points[:, motion.VZ] / along)
    return pitch
