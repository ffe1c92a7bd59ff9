"""A drive in the plane: options to filter, estimate, heading, and the road under each epoch.

The height stands beside it (``height``); the filter itself (``filter``) knows neither options nor roads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.filters.unscented import Unscented
from fusion.frames import wrap_angle
from fusion.published.epochs.table import Epochs
from fusion.published.gps_ins.filter import DriveReadings, Filtered, Settings, chi_square_gate, run
from fusion.published.gps_ins.ins import Ins, build_drive
from fusion.published.gps_ins.models import HEADING, ExtendedModel, KalmanModel, Model, UnscentedModel
from fusion.published.gps_ins.options import (
    ExtendedOptions,
    GpsInsOptions,
    HeadingOptions,
    KalmanOptions,
    UnscentedOptions,
)
from fusion.published.matchers.base import PointMatches
from fusion.published.matchers.mahalanobis import match_points
from fusion.roads.network import RoadNetwork
from fusion.types import Floats

_LOST_M = 50.0  # a position as vague as this is on no road in particular


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
    network: RoadNetwork,
    epochs: Epochs,
    ins: Ins,
    options: GpsInsOptions,
    progress: Callable[[float], None],
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
    third = options if isinstance(options, HeadingOptions) else None
    return Settings(
        heading=third.heading if third else "command",
        heading_reset=third.heading_reset if third else True,
        process_sigma_m=options.process_sigma_m,
        heading_walk_rad=third.heading_walk_rad if third else 0.0,
        drift_share=options.drift_share,
        fix_correlation_s=options.fix_correlation_s,
        gate=chi_square_gate(options.gate_probability),
        restart_after=options.restart_after,
        min_speed_mps=options.min_speed_mps,
    )


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
