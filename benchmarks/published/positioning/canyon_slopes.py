"""What slopes gain from positions of raw pseudoranges: drives through a simulated town whose streets reflect.

Each drive is positioned by one solver at a time and fused as any log is. ``receiver`` is what a receiver logs that
takes reflections at face value: weighted least squares epoch by epoch, with that solver's stated accuracy, and
velocities from Doppler at those places. Velocities are made from Doppler in the same way for every solver's places.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from accuracy.scoring import Errors, Row, figures, show_progress
from accuracy.truth import TrueSlope
from fusion.errors import FusionError
from fusion.gnss.positioning import positioned
from fusion.pipeline import parse_options, run_drive
from fusion.published.canyon.drive import CanyonDrive, canyon_of
from fusion.published.canyon.sky import synthetic_navigation
from fusion.registry import DEFAULT_METHOD
from fusion.roads.table import rows_of
from fusion.signals import BEIDOU, GALILEO, GPS, gps_from_unix
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import Town, make_town
from fusion.together import FusedDrive, solve_network
from fusion.types import DriveLog, GnssFix, Ints, Odometry, Track

AS_LOGGED = "receiver"
FACE_VALUE = "wls"
STREETS = "urban"
"""Fronts of 25 m, 20 to 25 m apart, along every street."""
SPEED_NOISE_MPS = 0.05
LEAST_DRIVEN = 0.8
"""Segments that a drive leaves or enters in between are not scored; corners are cut by a few metres."""
SKIES = {
    "three systems": ((GPS, GALILEO, BEIDOU), False),
    "GPS alone": ((GPS,), False),
    "GPS and odometer": ((GPS,), True),
}
"""Systems that are received, and whether the log has a speed signal."""
COLUMNS = {
    "sky": ("sky", ""),
    "gnss": ("positions", ""),
    "error_m": ("2-D m", ".1f"),
    "off_road": ("other segment", ".1%"),
    "rmse_percent": ("slope RMSE %", ".2f"),
    "rmse_spread": ("(spread)", ".2f"),
    "p90_percent": ("p90 %", ".2f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
}


def log_of(drive: SimulatedDrive, canyon: CanyonDrive, gnss: str, *, odometer: bool) -> DriveLog:
    """Raw signals, or the positions and velocities that a receiver made of them; and maybe a speed signal."""
    log = DriveLog("simulated", GnssFix.empty(), raw=canyon.raw())
    if gnss == AS_LOGGED:
        log = positioned(log, FACE_VALUE).log
    if odometer:
        rng = np.random.default_rng([drive.town.seed, drive.seed, 124])
        speed = np.linalg.norm(drive.truth.velocity_mps, axis=1)
        noisy = speed + rng.normal(0, SPEED_NOISE_MPS, len(speed))
        log = replace(log, odometry=Odometry.assemble(drive.time_s, speed_mps=np.maximum(noisy, 0.0)))
    return log


def outcome(town: Town, drive: SimulatedDrive, log: DriveLog, gnss: str) -> tuple[Errors, float, float]:
    """Errors of slopes, mean horizontal error of the positions (m), share of epochs laid on a wrong road."""
    computed = positioned(log, gnss)
    options = parse_options(DEFAULT_METHOD, {"gnss": gnss})
    network, result = run_drive(computed, town.roads, None, options=options)
    rows = rows_of(town.roads, network.table)
    one = FusedDrive(rows, result, computed.log.fix.time_s)
    parts = solve_network(town.roads, None, [one]).parts
    driven = {
        p.segment for p in drive.passes() if p.driven_m >= LEAST_DRIVEN * town.roads.length_m[p.segment]
    }
    length = town.roads.length_m
    truth = {
        _key(row): TrueSlope(float(town.true_slope_percent[row]), float(length[row]), float(length[row]))
        for row in driven
    }
    estimates = {
        _key(row): (part[0].slope_percent, part[0].slope_sigma_percent) for row, part in parts.items()
    }
    return Errors.of(truth, estimates), *_places(
        drive, computed.log.fix, rows[result.track.segment], result.track
    )


def _key(row: int) -> tuple[int, int, int]:
    return row, 0, 0


def _places(drive: SimulatedDrive, fix: GnssFix, segment: Ints, track: Track) -> tuple[float, float]:
    """Mean horizontal error of positions (m), and the share of the track's rows that lie on another segment."""
    true_x, true_y = (
        np.interp(fix.time_s, drive.time_s, values) for values in (drive.truth.x_m, drive.truth.y_m)
    )
    x, y = drive.town.projection.to_xy(fix.lon_deg, fix.lat_deg)
    at = np.clip(np.searchsorted(drive.time_s, track.time_s), 0, len(drive.time_s) - 1)
    wrong = (segment != drive.truth.segment[at]) | (track.segment < 0)
    return float(np.hypot(x - true_x, y - true_y).mean()), float(wrong.mean())


def canyon(drive: SimulatedDrive, systems: tuple[int, ...]) -> CanyonDrive:
    """The drive between high fronts, under a sky of these systems."""
    begin_s = float(gps_from_unix(drive.time_s[:1])[0])
    rng = np.random.default_rng([drive.town.seed, drive.seed, 125])
    navigation = synthetic_navigation(begin_s, float(np.ptp(drive.time_s)), rng, systems)
    return canyon_of(drive, navigation=navigation, everywhere=STREETS)


def run(seeds: int) -> list[Row]:
    """A row for each sky and each way to positions."""
    rows: list[Row] = []
    for sky, (systems, odometer) in SKIES.items():
        for gnss in (AS_LOGGED, "ekf", "one-sided"):
            runs, places = [], []
            for seed in range(seeds):
                show_progress(f"{sky}, {gnss}, drive {seed + 1}/{seeds}")
                town = make_town(seed + 1)
                drive = simulate_drive(town, seed, 900.0)
                try:
                    log = log_of(drive, canyon(drive, systems), gnss, odometer=odometer)
                    errors, error_m, off = outcome(town, drive, log, gnss)
                except FusionError as error:
                    show_progress("")
                    print(f"{gnss}, drive {seed}: {error}")
                    continue
                runs.append([errors])
                places.append((error_m, off))
            scores = figures(runs)
            error_m, off = np.mean(places, axis=0) if places else (np.nan, np.nan)
            rows.append({"sky": sky, "gnss": gnss, "error_m": error_m, "off_road": off} | (scores or {}))
    show_progress("")
    return rows
