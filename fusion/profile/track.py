"""The smoothed drive as a track, and its measurements as they are drawn over it."""

from __future__ import annotations

import numpy as np

from fusion.profile.blocks import spaced
from fusion.profile.measurements import ALTITUDE, BARO, FORCE, PITCH, SENSORS, TERRAIN, Measurements
from fusion.profile.model import BARO_DRIFT, BIAS, GRADE, HEIGHT, MOUNT, SQUAT, SmootherEpochs
from fusion.profile.noise import Learned
from fusion.profile.path import DrivenPath
from fusion.types import LONGEST_BRIDGED_OUTAGE_S, DrawnMeasurements, Floats, Ints, Track

PERIOD_S = 0.5
"""Rows of a track are about so far apart, or as far as the positions."""
_FIX_WITHIN_S = 1.0
"""A position farther away than this was not measured there."""
_ALONG_SIGMA_M = 2.0
"""What a track states as its horizontal accuracy: the path is a road's, only the place along it is estimated."""


def build_track(path: DrivenPath, epochs: SmootherEpochs, learned: Learned) -> Track:
    """One row for each position on the path, and between positions that are far apart for what else was measured.

    At least 0.95 ``PERIOD_S`` apart: on the path, with the smoothed height.
    """
    time = _row_times(path, epochs)
    along, run = path.at(time)
    height, height_sigma, grade, grade_sigma = _smoothed_at(time, along, run, epochs, learned).T
    traversal, distance = path.match.position_on(along)
    known = traversal >= 0
    segment = np.where(known, path.match.segment[traversal], -1)
    network = path.network
    share = np.where(known, distance / np.maximum(network.length_m[segment], 1e-9), 0.0)
    x = network.x0[segment] + share * (network.x1 - network.x0)[segment]
    y = network.y0[segment] + share * (network.y1 - network.y0)[segment]
    lon, lat = network.projection.to_lonlat(np.where(known, x, np.nan), np.where(known, y, np.nan))
    heading = np.mod(np.pi / 2 - path.direction_rad(along), 2 * np.pi)
    after_outage = np.concatenate([[True], (np.diff(run) != 0) | (np.diff(time) > LONGEST_BRIDGED_OUTAGE_S)])
    return Track(
        time_s=time,
        lat_deg=lat,
        lon_deg=lon,
        alt_m=height,
        h_sigma_m=np.full(len(time), _ALONG_SIGMA_M),
        alt_sigma_m=height_sigma,
        speed_mps=_speed(path, time),
        heading_rad=heading,
        pitch_rad=np.arctan(grade),
        pitch_sigma_rad=grade_sigma / (1 + grade**2),
        segment=segment,
        distance_m=np.where(known, share * network.table.length_m[segment], np.nan),
        has_gnss=_since_fix(path, time) < _FIX_WITHIN_S,
        after_outage=after_outage,
    )


def _row_times(path: DrivenPath, epochs: SmootherEpochs) -> Floats:
    """Times of the positions on the path, and of epochs that have none near; those that follow too soon left out.

    Epochs are where anything was measured: at means of inertial samples, and before the positions where a sensor of
    height is late.
    """
    alone = epochs.time_s[_since_fix(path, epochs.time_s) >= _FIX_WITHIN_S]
    _, run = path.at(path.fix_time_s)
    time = np.union1d(path.fix_time_s[run >= 0], alone)
    return time[spaced(time, 0.95 * PERIOD_S)]


def _smoothed_at(time: Floats, along: Floats, run: Ints, epochs: SmootherEpochs, learned: Learned) -> Floats:
    """Height, its sigma, grade and its sigma at rows of the track, (n, 4); NaN on stretches without any epoch.

    Between epochs by proportion, before the first and behind the last of a stretch straight on.
    """
    mean, variance = learned.smoothed.mean, np.diagonal(learned.smoothed.covariance, axis1=1, axis2=2)
    columns = [c for s in (HEIGHT, GRADE) for c in (mean[:, s], np.sqrt(variance[:, s]))]
    out = np.full((len(time), len(columns)), np.nan)
    for number in np.unique(epochs.run):
        here, mine = run == number, epochs.run == number
        for k, column in enumerate(columns):
            out[here, k] = np.interp(time[here], epochs.time_s[mine], column[mine])
        reached = np.clip(along[here], *epochs.along_m[mine][[0, -1]])
        out[here, 0] += out[here, 2] * (along[here] - reached)
    return out


def _since_fix(path: DrivenPath, time: Floats) -> Floats:
    """Seconds to the nearest position, (n,)."""
    fixes = path.fix_time_s
    right = np.clip(np.searchsorted(fixes, time), 0, len(fixes) - 1)
    return np.minimum(np.abs(fixes[right] - time), np.abs(fixes[np.maximum(right - 1, 0)] - time))


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
