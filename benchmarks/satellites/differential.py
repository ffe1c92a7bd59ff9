#!/usr/bin/env python3
"""What a base is worth: differential corrections (Saadaoui 2011, 1.3.1) on simulated drives through a town.

    PYTHONPATH=.:benchmarks python -m satellites.differential [--seeds 6] [--base-km 8] [--solvers wls ekf one-sided]
                                                             [--streets open urban] [--json FILE]

Each drive's raw signals have, beside noise and reflections, errors that all receivers of the region share: of each
satellite's clock and orbit (1.5 m, for good), and of the ionosphere's model (3 m at the zenith, more at low elevations,
over half an hour). A base with the same kind of receiver stands under open sky ``--base-km`` away. Between the two the
ionosphere differs by 2 mm a kilometre at the zenith.

    alone      no base
    position   the base's error of place is added to each position, as printed: its own solution by wls
    code       each satellite's pseudorange is corrected (``versant track --base``)

Errors are medians over the seeds: 2-D and height, root mean squares over a drive; slopes as ``versant fuse`` makes them
of the drive by these positions, RMS over segments that were driven whole. ``position`` has no slopes: it moves all
positions of a minute alike. ``gps-ins`` below: the same positions through the published filter of positions, speed and
heading (method ``gps-ins-ekf``, of Redmill's kind, 2.2.6), 2-D.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from accuracy.arguments import parser_of
from accuracy.scoring import show_progress, text_table, write_json
from fusion.arrays import nearest
from fusion.frames import local_axes
from fusion.gnss.measurements import Solution
from fusion.gnss.positioning import Positioned, positioned
from fusion.pipeline import run_drive
from fusion.published.canyon.drive import CanyonDrive, canyon_of, simulate_canyon
from fusion.published.canyon.fronts import NO_FRONTS
from fusion.published.canyon.radio import TOWN
from fusion.published.canyon.ride import Ride
from fusion.published.canyon.sky import synthetic_navigation
from fusion.published.positioning.relative import relative_positions
from fusion.signals import Navigation, RawGnss, gps_from_unix
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.receiver.readings import gauss_markov
from fusion.simulate.scene.town import Town, make_town
from fusion.types import DriveLog, Floats, GnssFix, Odometry
from published.positioning.canyon_slopes import SPEED_NOISE_MPS, outcome

SATELLITE_SIGMA_M = 1.5
"""Error of a satellite's broadcast clock and orbit along the sight: 0.5 to 2 m for GPS and Galileo."""
AIR_SIGMA_M, AIR_TAU_S = 3.0, 1800.0
"""What Klobuchar's model leaves of the ionosphere at the zenith, and for how long: half of 2 to 10 m."""
GRADIENT = 2e-6
"""The ionosphere's change with place, as a share: 1 to 4 mm a kilometre on a quiet day."""
SURROUNDINGS = ("open", "urban")
"""Fronts along every street (``fronts.STREETS``)."""
COLUMNS = {
    "streets": ("streets", ""),
    "gnss": ("solver", ""),
    "base": ("base", ""),
    "horizontal_m": ("2-D m", ".2f"),
    "height_m": ("height m", ".2f"),
    "slope_percent": ("slope RMSE %", ".3f"),
    "off_road": ("other segment", ".1%"),
    "gps_ins_m": ("gps-ins 2-D m", ".2f"),
}


class Common:
    """The errors that receivers of a region share: satellites' own, and the air's, which goes with the elevation."""

    def __init__(self, start_s: float, seconds: int, rng: np.random.Generator) -> None:
        self._start_s = start_s
        self._of_satellite = SATELLITE_SIGMA_M * rng.normal(size=100_000)
        self._air = gauss_markov(seconds + 2, 1.0, AIR_SIGMA_M, AIR_TAU_S, rng)

    def added(self, canyon: CanyonDrive, away_m: float = 0.0) -> RawGnss:
        """The raw signals of a receiver so far from where the air is as drawn."""
        raw, sky = canyon.raw(), canyon.sky
        own = self._of_satellite[1000 * sky.system + sky.number]
        air = np.interp(canyon.ride.gps_s[sky.epoch], self._start_s + np.arange(len(self._air)), self._air)
        # A thin shell at 350 km: the ray crosses it the more slantingly the lower the satellite stands.
        slant = 1.0 / np.sqrt(1.0 - (np.cos(sky.elevation_rad) * 6371.0 / 6721.0) ** 2)
        common = own + slant * (air + GRADIENT * away_m)
        signals = replace(raw.signals, pseudorange_m=raw.signals.pseudorange_m + common)
        return replace(raw, signals=signals)


def base_near(town: Town, drive: SimulatedDrive, navigation: Navigation, away_m: float) -> CanyonDrive:
    """A receiver that stands under open sky, so far to the north-east of the town's middle."""
    place = np.tile([away_m / np.sqrt(2), away_m / np.sqrt(2), 120.0], (len(drive.time_s), 1))
    ride = Ride.on_plane(drive.time_s, place, np.zeros(place.shape), town.projection)
    return simulate_canyon(ride, NO_FRONTS, TOWN, navigation, np.random.default_rng([drive.seed, 7]))


def errors_of(canyon: CanyonDrive, time_s: Floats, position_m: Floats) -> tuple[float, float]:
    """Root mean squares of horizontal and height errors, m."""
    known = np.isfinite(position_m).all(axis=1)
    true_m = canyon.ride.position_m[nearest(canyon.ride.time_s, time_s[known])]
    off = np.einsum("nij,nj->ni", local_axes(true_m), position_m[known] - true_m)
    return float(np.sqrt(np.mean(off[:, 0] ** 2 + off[:, 1] ** 2))), float(np.sqrt(np.mean(off[:, 2] ** 2)))


class Solved(NamedTuple):
    """A solver's places and their times."""

    solution: Solution
    time_s: Floats

    @classmethod
    def of(cls, one: Positioned) -> Solved:
        """Of a log that a solver positioned."""
        if one.solution is None or one.measured is None:
            raise ValueError(f"{one.name} solves nothing")
        return cls(one.solution, one.measured.time_s)


def gps_ins(town: Town, drive: SimulatedDrive, log: DriveLog) -> float:
    """2-D error of the published filter that the log's positions are fed to, m."""
    _, result = run_drive(log, town.roads, None, method="gps-ins-ekf", options={"gnss": "receiver"})
    track = result.track
    x, y = town.projection.to_xy(track.lon_deg, track.lat_deg)
    true_x, true_y = (np.interp(track.time_s, drive.time_s, v) for v in (drive.truth.x_m, drive.truth.y_m))
    return float(np.sqrt(np.nanmean((x - true_x) ** 2 + (y - true_y) ** 2)))


def rows_of_seed(seed: int, streets: str, solvers: list[str], away_m: float) -> list[dict[str, Any]]:
    """A row for each solver, without base and with both kinds of corrections."""
    town = make_town(seed)
    drive = simulate_drive(town, seed, 900.0)
    rng = np.random.default_rng([seed, 31])
    start_s, seconds = float(gps_from_unix(drive.time_s[:1])[0]), int(np.ptp(drive.time_s)) + 1
    navigation = synthetic_navigation(start_s, float(seconds), rng)
    common = Common(start_s, seconds, rng)
    canyon = canyon_of(drive, navigation=navigation, everywhere=streets)
    base = base_near(town, drive, navigation, away_m)
    speed = np.linalg.norm(drive.truth.velocity_mps, axis=1) + rng.normal(
        0, SPEED_NOISE_MPS, len(drive.time_s)
    )
    odometry = Odometry.assemble(drive.time_s, speed_mps=np.maximum(speed, 0.0))
    raw = common.added(canyon)
    place_m = base.ride.position_m[0]
    station = replace(common.added(base, away_m), place_m=place_m)
    logs = {"alone": raw, "code": raw.beside(station)}
    found = Solved.of(positioned(DriveLog("base", GnssFix.empty(), raw=station), "wls"))
    rows = []
    for gnss in solvers:
        for kind, signals in logs.items():
            log = DriveLog("simulated", GnssFix.empty(), raw=signals, odometry=odometry)
            computed = positioned(log, gnss)
            solved = Solved.of(computed)
            errors, _, off_road = outcome(town, drive, log, gnss)
            rows.append(
                _row(streets, gnss, kind, errors_of(canyon, solved.time_s, solved.solution.position_m))
                | {"slope_percent": float(np.sqrt(np.mean(errors.error_percent**2))), "off_road": off_road}
                | {"gps_ins_m": gps_ins(town, drive, computed.log)}
            )
            if kind == "alone":
                moved = relative_positions(solved.solution, solved.time_s, *found, place_m)
                rows.append(
                    _row(streets, gnss, "position", errors_of(canyon, solved.time_s, moved.position_m))
                )
    return rows


def _row(streets: str, gnss: str, base: str, errors_m: tuple[float, float]) -> dict[str, Any]:
    named = {"streets": streets, "gnss": gnss, "base": base}
    return named | dict(zip(("horizontal_m", "height_m"), errors_m, strict=True))


def medians(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The median of each figure over the seeds."""
    keys = dict.fromkeys((row["streets"], row["gnss"], row["base"]) for row in rows)
    out = []
    for key in keys:
        mine = [row for row in rows if (row["streets"], row["gnss"], row["base"]) == key]
        figures = [name for name in COLUMNS if isinstance(mine[0].get(name), float)]
        names = dict(zip(("streets", "gnss", "base"), key, strict=True))
        out.append(names | {name: float(np.median([row[name] for row in mine])) for name in figures})
    return out


def main() -> None:
    """Measure, print and write."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--base-km", type=float, default=8.0)
    parser.add_argument("--solvers", nargs="+", default=["wls", "ekf", "one-sided"])
    parser.add_argument("--streets", nargs="+", default=list(SURROUNDINGS), choices=SURROUNDINGS)
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for streets in args.streets:
        for seed in range(args.seeds):
            show_progress(f"{streets}, seed {seed}")
            rows += rows_of_seed(seed, streets, args.solvers, 1000.0 * args.base_km)
    show_progress("")
    found = medians(rows)
    print(text_table(found, COLUMNS))
    write_json(args.json, {"rows": found, "each": rows})


if __name__ == "__main__":
    main()
