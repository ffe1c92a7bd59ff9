"""The smoothed drive as it is shown: its track, its measurements as they are drawn over it, and its report.

The report says how the profile was made, and what its driver can do better. Nothing is estimated here; the smoother
runs again only to show what each sensor was worth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from fusion.arrays import nearest
from fusion.filters.smoother import Smoothed
from fusion.messages import say
from fusion.network.pass_columns import table_of
from fusion.network.pass_factor import PassFactor
from fusion.network.terrain import displaced
from fusion.profile.blocks import Estimate, spaced
from fusion.profile.factors import MIN_CONFIDENCE
from fusion.profile.inertia import Inertia
from fusion.profile.measurements import (
    ALTITUDE,
    BARO,
    DEM_SPACING_M,
    DOPPLER,
    FORCE,
    PITCH,
    SENSORS,
    TERRAIN,
    Measurements,
)
from fusion.profile.model import (
    BARO_DRIFT,
    BIAS,
    DRIFT,
    GRADE,
    HEIGHT,
    MOUNT,
    SPEED_PRESSURE,
    SQUAT,
    SmootherEpochs,
    linear_model,
)
from fusion.profile.noise import Learned
from fusion.profile.path import DrivenPath, ground_speed
from fusion.profile.traversals import SmoothedDrive
from fusion.types import (
    LONGEST_BRIDGED_OUTAGE_S,
    DrawnMeasurements,
    DriveLog,
    Floats,
    Ints,
    Progress,
    Track,
    no_progress,
)

PERIOD_S = 0.5
"""Rows of a track are about so far apart, or as far as the positions."""
_FIX_WITHIN_S = 1.0
"""A position farther away than this was not measured there."""
_ALONG_SIGMA_M = 2.0
"""What a track states as its horizontal accuracy: the path is a road's, only the place along it is estimated."""


def build_track(drive: SmoothedDrive) -> Track:
    """One row for each position on the path, and between positions that are far apart for what else was measured.

    At least 0.95 ``PERIOD_S`` apart: on the path, with the smoothed height.
    """
    path = drive.path
    time = _row_times(path, drive.epochs)
    along, run = path.at(time)
    height, height_sigma, grade, grade_sigma = _smoothed_at(time, along, run, drive.epochs, drive.learned).T
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
    mean, variance = learned.smoothed.mean, learned.smoothed.variance
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
    return np.asarray(np.abs(fixes[nearest(fixes, time)] - time))


def _speed(path: DrivenPath, time: Floats) -> Floats:
    """Speed along the path over a second or more."""
    ahead, behind = (np.interp(time + h, path.time_s, path.along_m) for h in (0.5, -0.5))
    return np.asarray(ahead - behind)


def drawn_measurements(drive: SmoothedDrive) -> DrawnMeasurements:
    """The measurements as heights and grades of the road: mount pitch, bias, squat and barometer taken off.

    The drift of GNSS heights and the error of the DEM stay in: a picture shows what the receiver said.
    """
    measured, mean, at = drive.measured, drive.learned.smoothed.mean, drive.epochs.of_measurement
    heights = measured.of(ALTITUDE, BARO, TERRAIN)
    felt = measured.of(PITCH, FORCE)
    shared = mean[at, MOUNT] + mean[at, SQUAT] * measured.acceleration_mps2
    shared = shared + np.where(measured.sensor == FORCE, mean[at, BIAS], 0.0)
    level = np.where(measured.sensor == BARO, mean[at, BARO_DRIFT], 0.0)
    value = measured.value - np.where(felt, shared, 0.0) - level
    return DrawnMeasurements(SENSORS, measured.sensor, measured.time_s, measured.along_m, value, heights)


WHOLE_SHARE = 0.98
"""A segment counts as driven whole from this share on."""
FEW_MATCHED = 0.8
"""A smaller share of positions on known roads is worth a warning."""
WRONG_ACCURACY = 3.0
"""... and stated accuracies that are wrong by so many times."""
MANY_OUTLIERS = 0.05
"""... and a larger share of outliers in a sensor."""
LOOSE_MOUNT = 0.01
"""... and a mount pitch that is known less well than this, rad."""


def drive_report(
    log: DriveLog, drive: SmoothedDrive, inertia: Inertia | None, progress: Progress = no_progress
) -> dict[str, Any]:
    """JSON-serialisable; angles in degrees, slopes in percent, times in Unix seconds.

    ``inertia`` is what was found before sensors were used. ``path_report`` says what needs no smoothed drive.
    """
    measured, learned = drive.measured, drive.learned
    without = _without_each(drive, progress)
    report = {
        "noise": asdict(learned.noise),
        "own_speed_scale": ground_speed(log)[2],
        "mount": _mount(drive),
        "inertia": _inertia(inertia, measured),
        "speed_pressure": _speed_pressure(learned, measured),
        "altimeter": drive.altimeter.sensor >= 0,
        "height_jumps_s": [float(drive.epochs.time_s[k]) for k, state in learned.jumps if state == DRIFT],
        "sensors": _contributions(measured, learned, without),
    }
    model_report = _elevation_model(drive, without.get(TERRAIN))
    return {**report, "warnings": [*_warnings(log, drive, report), *model_report]}


def path_report(path: DrivenPath, factors: Sequence[PassFactor]) -> dict[str, Any]:
    """How much of a drive lies on roads, and how many of its passes count; JSON-serialisable."""
    passes = table_of(factors)
    complete = passes.end_m - passes.start_m >= WHOLE_SHARE * path.network.table.length_m[passes.segment]
    return {
        "matched_share": _matched_share(path),
        "breaks": [{"time_s": float(b.time_s), "reason": b.reason} for b in path.match.breaks],
        "passes": len(factors),
        "passes_of_part_of_a_segment": len(factors) - int(np.count_nonzero(complete)),
        "passes_dropped_as_uncertain": int(np.count_nonzero(path.match.confidence < MIN_CONFIDENCE)),
    }


def _matched_share(path: DrivenPath) -> float:
    return float(np.mean(path.matched))


def _mount(drive: SmoothedDrive) -> dict[str, Any] | None:
    """Mount pitch at the end of the drive, and when it changed; None without pitch and specific force."""
    if not drive.measured.of(PITCH, FORCE).any():
        return None
    learned, smoothed = drive.learned, drive.learned.smoothed
    grade = smoothed.mean[-1, MOUNT]
    sigma = float(np.sqrt(smoothed.variance[-1, MOUNT]))
    moves = []
    for k in sorted(k for k, state in learned.jumps if state == MOUNT):
        before, after = smoothed.mean[[k - 1, k], MOUNT]
        change_deg = float(np.degrees(np.arctan(after - before)))
        moves.append({"time_s": float(drive.epochs.time_s[k]), "change_deg": change_deg})
    return {
        "pitch_deg": float(np.degrees(np.arctan(grade))),
        "sigma_deg": float(np.degrees(sigma)),
        "moves": moves,
    }


def _inertia(inertia: Inertia | None, measured: Measurements) -> dict[str, Any] | None:
    """How late inertial data are against GNSS, and the yaw of their sensor; None without pitch and specific force.

    What was set right, which is 0 where it is not clear, and what was found (None where nothing shows it).
    """
    if inertia is None or not measured.of(PITCH, FORCE).any():
        return None
    return {
        "imu_lag_s": inertia.lag_s,
        "found_imu_lag_s": _found(inertia.lag),
        "mount_yaw_deg": float(np.degrees(inertia.yaw_rad)),
        "found_mount_yaw_deg": _found(inertia.yaw, 180 / np.pi),
    }


def _speed_pressure(learned: Learned, measured: Measurements) -> dict[str, Any] | None:
    """The share of the dynamic pressure that a barometer feels; None without pressure."""
    if not (measured.sensor == BARO).any():
        return None
    mean, variance = learned.smoothed.mean[-1], learned.smoothed.variance[-1]
    share, sigma = float(mean[SPEED_PRESSURE]), float(np.sqrt(variance[SPEED_PRESSURE]))
    return {"share": share, "found_share": {"value": share, "sigma": sigma}}


def _found(estimate: Estimate, unit: float = 1.0) -> dict[str, float] | None:
    known = np.isfinite(estimate.sigma)
    return {"value": unit * estimate.value, "sigma": unit * estimate.sigma} if known else None


@dataclass(frozen=True, eq=False)
class _Without:
    """The drive without a sensor: the median sigma of its grades, and its heights (n,) at the epochs."""

    grade_sigma_percent: float
    height_m: Floats


def _without_each(drive: SmoothedDrive, progress: Progress) -> dict[int, _Without]:
    """By each sensor's code, as if its errors were beyond all measure. The epochs stay the same."""
    measured, learned, without = drive.measured, drive.learned, dict[int, _Without]()
    epochs = replace(drive.epochs, between=lambda: progress("smooth", len(without) / len(SENSORS)))
    model = linear_model(measured, epochs, learned.expected, learned.variance, learned.jumps)
    for code in np.unique(measured.sensor).tolist():
        variance = np.where(measured.sensor == code, 1e12, learned.variance)
        smoothed = model.at_levels({}, {}, variance).smooth(states=(HEIGHT, GRADE))
        without[code] = _Without(_grade_sigma(smoothed), smoothed.mean[:, HEIGHT].copy())
    return without


def _contributions(
    measured: Measurements, learned: Learned, without: Mapping[int, _Without]
) -> dict[str, dict[str, float]]:
    """For each sensor: measurements, outliers, and the median sigma of the grade with all and without this one."""
    everything = _grade_sigma(learned.smoothed)
    return {
        SENSORS[code]: {
            "measurements": int(np.count_nonzero(measured.sensor == code)),
            "outliers": int(learned.outlier[measured.sensor == code].sum()),
            "grade_sigma_percent": everything,
            "grade_sigma_percent_without": one.grade_sigma_percent,
        }
        for code, one in without.items()
    }


def _elevation_model(drive: SmoothedDrive, without: _Without | None) -> list[str]:
    """Where the elevation model stands out, by the drive's own heights; nothing where it has none."""
    path, measured = drive.path, drive.measured
    if without is None or not measured.of(ALTITUDE, BARO).any():
        return []
    mine = np.flatnonzero(measured.sensor == TERRAIN)
    above = measured.value[mine] - without.height_m[drive.epochs.of_measurement[mine]]
    outliers = displaced(above, np.full(len(mine), DEM_SPACING_M))
    if outliers is None:
        return []
    row, _ = path.match.position_on(measured.along_m[mine[outliers.where][:1]])
    table, segment = path.network.table, int(path.match.segment[row[0]])
    return [outliers.said(float(table.lat0_deg[segment]), float(table.lon0_deg[segment]))]


def _grade_sigma(smoothed: Smoothed) -> float:
    return 100 * float(np.sqrt(np.median(smoothed.variance[:, GRADE])))


def _warnings(log: DriveLog, drive: SmoothedDrive, report: dict[str, Any]) -> list[str]:
    """Sentences that a driver can act on."""
    measured, sentences = drive.measured, list[str]()
    if (share := _matched_share(drive.path)) < FEW_MATCHED:
        sentences.append(say("drive.few_on_roads", share=share))
    factor = report["noise"]["doppler"]
    if (measured.sensor == DOPPLER).any() and not 1 / WRONG_ACCURACY < factor < WRONG_ACCURACY:
        wrong = "better" if factor < 1 else "worse"
        sentences.append(say("drive.vertical_velocities", factor=max(factor, 1 / factor), wrong=wrong))
    mount = report["mount"]
    for move in mount["moves"] if mount else ():
        sentences.append(
            say("drive.mount_moved", change_deg=move["change_deg"], clock=_clock(move["time_s"]))
        )
    if mount and np.radians(mount["sigma_deg"]) > LOOSE_MOUNT:
        sentences.append(say("drive.mount_unsure", sigma_deg=mount["sigma_deg"]))
    sentences += [say("drive.height_jump", clock=_clock(t)) for t in report["height_jumps_s"]]
    for name, sensor in report["sensors"].items():
        if sensor["outliers"] > MANY_OUTLIERS * sensor["measurements"]:
            sentences.append(
                say("drive.far_off", n=sensor["outliers"], all=sensor["measurements"], name=name)
            )
    return sentences


def _clock(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).strftime("%H:%M:%S UTC")
