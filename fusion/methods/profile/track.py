"""The smoothed drive as a track."""

from __future__ import annotations

import numpy as np

from fusion.methods.profile.measurements import ALTITUDE, BARO, FORCE, PITCH, SENSORS, TERRAIN, Rows
from fusion.methods.profile.model import BARO_DRIFT, BIAS, GRADE, HEIGHT, MOUNT, SQUAT, Steps
from fusion.methods.profile.noise import Learned
from fusion.methods.profile.path import LONGEST_HOLE_S, DrivenPath
from fusion.types import Floats, Measurements, Track

PERIOD_S = 0.5
_ALONG_SIGMA_M = 2.0


def build_track(path: DrivenPath, rows: Rows, steps: Steps, learned: Learned) -> Track:
    """One row for each step at least 0.95 ``PERIOD_S`` after the last: on the path, with the smoothed height."""
    keep = _spaced(steps.time_s, 0.95 * PERIOD_S)
    time, along, run = steps.time_s[keep], steps.along_m[keep], steps.run[keep]
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
    starts = np.concatenate([[True], (np.diff(run) != 0) | (np.diff(time) > LONGEST_HOLE_S)])
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
        starts=starts,
    )


def _spaced(time: Floats, period_s: float) -> np.ndarray:
    """Indices of times at least ``period_s`` apart, the first included."""
    keep, last = [], -np.inf
    for k, t in enumerate(time.tolist()):
        if t - last >= period_s:
            keep.append(k)
            last = t
    return np.array(keep, np.int64)


def _has_fix(path: DrivenPath, time: Floats) -> np.ndarray:
    """Whether a position was measured within a second."""
    fixes = path.fix_time_s
    right = np.clip(np.searchsorted(fixes, time), 0, len(fixes) - 1)
    nearest = np.minimum(np.abs(fixes[right] - time), np.abs(fixes[np.maximum(right - 1, 0)] - time))
    return nearest < 1.0


def _speed(path: DrivenPath, time: Floats) -> Floats:
    """Speed along the path over a second or more."""
    ahead, behind = (np.interp(time + h, path.time_s, path.along_m) for h in (0.5, -0.5))
    return np.asarray(ahead - behind)


def build_measurements(rows: Rows, learned: Learned, steps: Steps) -> Measurements:
    """The measurements as heights and grades of the road: mount, bias and squat taken off, drifts left in."""
    mean = learned.smoothed.mean[steps.step]
    heights = np.isin(rows.sensor, (ALTITUDE, BARO, TERRAIN))
    felt = np.isin(rows.sensor, (PITCH, FORCE))
    tilt = mean[:, MOUNT] + mean[:, SQUAT] * rows.acceleration_mps2
    tilt = tilt + np.where(rows.sensor == FORCE, mean[:, BIAS], 0.0)
    level = np.where(rows.sensor == BARO, mean[:, BARO_DRIFT], 0.0)
    value = rows.value - np.where(felt, tilt, 0.0) - level
    return Measurements(SENSORS, rows.sensor, rows.time_s, rows.along_m, value, heights)
