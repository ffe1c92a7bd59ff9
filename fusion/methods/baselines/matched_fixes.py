"""Raw fixes put on roads one by one, by the thesis's rule: what both baselines start from."""

from __future__ import annotations

import numpy as np

from fusion.frames import wrap_angle
from fusion.matching.points.mahalanobis import GATE, match_points
from fusion.methods.epochs.table import Epochs, build_epochs
from fusion.roads.network import RoadNetwork
from fusion.types import DriveLog, Floats, Track

_MIN_SPEED_MPS = 1.0
_DEFAULT_H_ACC_M = 2.5
_MAP_SIGMA_M = 4.0
_HEADING_SIGMA_RAD = 0.3


def match_fixes(log: DriveLog, network: RoadNetwork, period_s: float) -> tuple[Epochs, Track]:
    """Epochs with a position, and a track through the raw fixes: heights as logged, nearest segments."""
    epochs = build_epochs(log, network.projection, period_s)
    epochs = epochs.with_fix()
    heading = _heading(epochs)
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
        after_gap=epochs.after_gap,
    )


def _heading(epochs: Epochs) -> Floats:
    """Course from east, anticlockwise: Doppler, else the fixes on either side; NaN while standing."""
    heading = np.arctan2(epochs.vel_n_mps, epochs.vel_e_mps)
    if len(epochs) > 1:
        by_position = np.arctan2(np.gradient(epochs.y_m), np.gradient(epochs.x_m))
        heading = np.where(np.isfinite(heading), heading, by_position)
    moving = np.nan_to_num(epochs.speed_mps) >= _MIN_SPEED_MPS
    return np.where(moving, wrap_angle(heading), np.nan)
