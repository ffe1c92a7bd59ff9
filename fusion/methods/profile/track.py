"""The smoothed drive as a track, and its measurements as they are drawn over it."""

from __future__ import annotations

import numpy as np

from fusion.methods.profile.measurements import ALTITUDE, BARO, FORCE, PITCH, SENSORS, TERRAIN, Measurements
from fusion.methods.profile.model import BARO_DRIFT, BIAS, GRADE, HEIGHT, MOUNT, SQUAT, SmootherEpochs
from fusion.methods.profile.noise import Learned
from fusion.methods.profile.path import DrivenPath
from fusion.types import LONGEST_BRIDGED_GAP_S, Bools, DrawnMeasurements, Floats, Ints, Track

PERIOD_S = 0.5
"""Rows of a track are about so far apart, or as far as the epochs."""
_ALONG_SIGMA_M = 2.0
"""What a track states as its horizontal accuracy: the path is a road's, only the place along it is estimated."""


def build_track(path: DrivenPath, measured: Measurements, epochs: SmootherEpochs, learned: Learned) -> Track:
    """One row for each epoch at least 0.95 ``PERIOD_S`` after the last: on the path, with the smoothed height."""
    keep = _spaced(epochs.time_s, 0.95 * PERIOD_S)
    time, along, run = epochs.time_s[keep], epochs.along_m[keep], epochs.run[keep]
    mean, covariance = learned.smoothed.mean[keep], learned.smoothed.covariance[keep]
    traversal, distance = path.match.position_on(along)
    known = traversal >= 0
    segment = np.where(known, path.match.segment[traversal], -1)
    network = path.network
    share = np.where(known, distance / np.maximum(network.length_m[segment], 1e-9), 0.0)
    x = network.x0[segment] + share * (network.x1 - network.x0)[segment]
    y = network.y0[segment] + share * (network.y1 - network.y0)[segment]
    lon, lat = network.projection.to_lonlat(np.where(known, x, np.nan), np.where(known, y, np.nan))
    heading = np.mod(np.pi / 2 - path.direction_rad(along), 2 * np.pi)
    grade = mean[:, GRADE]
    after_gap = np.concatenate([[True], (np.diff(run) != 0) | (np.diff(time) > LONGEST_BRIDGED_GAP_S)])
    return Track(
        time_s=time,
        lat_deg=lat,
        lon_deg=lon,
        alt_m=mean[:, HEIGHT],
        h_sigma_m=np.full(len(time), _ALONG_SIGMA_M),
        alt_sigma_m=np.sqrt(covariance[:, HEIGHT, HEIGHT]),
        speed_mps=_speed(path, time),
        heading_rad=heading,
        pitch_rad=np.arctan(grade),
        pitch_sigma_rad=np.sqrt(covariance[:, GRADE, GRADE]) / (1 + grade**2),
        segment=segment,
        distance_m=np.where(known, share * network.table.length_m[segment], np.nan),
        has_gnss=_has_fix(path, time),
        after_gap=after_gap,
    )


def _spaced(time: Floats, period_s: float) -> Ints:
    """Indices of times at least ``period_s`` apart, the first included."""
    keep, last = [], -np.inf
    for k, t in enumerate(time.tolist()):
        if t - last >= period_s:
            keep.append(k)
            last = t
    return np.array(keep, np.int64)


def _has_fix(path: DrivenPath, time: Floats) -> Bools:
    """Whether a position was measured within a second."""
    fixes = path.fix_time_s
    right = np.clip(np.searchsorted(fixes, time), 0, len(fixes) - 1)
    nearest = np.minimum(np.abs(fixes[right] - time), np.abs(fixes[np.maximum(right - 1, 0)] - time))
    return np.asarray(nearest < 1.0)


def _speed(path: DrivenPath, time: Floats) -> Floats:
    """Speed along the path over a second or more."""
    ahead, behind = (np.interp(time + h, path.time_s, path.along_m) for h in (0.5, -0.5))
    return np.asarray(ahead - behind)


def drawn_measurements(measured: Measurements, learned: Learned, epochs: SmootherEpochs) -> DrawnMeasurements:
    """The measurements as heights and grades of the road: mount pitch, bias, squat and barometer taken off.

    The drift of GNSS heights and the error of the DEM stay in: a picture shows what the receiver said.
    """
    mean = learned.smoothed.mean[epochs.of_measurement]
    heights = np.isin(measured.sensor, (ALTITUDE, BARO, TERRAIN))
    felt = np.isin(measured.sensor, (PITCH, FORCE))
    shared = mean[:, MOUNT] + mean[:, SQUAT] * measured.acceleration_mps2
    shared = shared + np.where(measured.sensor == FORCE, mean[:, BIAS], 0.0)
    level = np.where(measured.sensor == BARO, mean[:, BARO_DRIFT], 0.0)
    value = measured.value - np.where(felt, shared, 0.0) - level
    return DrawnMeasurements(SENSORS, measured.sensor, measured.time_s, measured.along_m, value, heights)
