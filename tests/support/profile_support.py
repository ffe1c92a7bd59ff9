"""Drives for the tests of method ``profile``: through simulated towns with things gone wrong, and along one street."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from factor_support import PLANE
from fusion.formats import read_log
from fusion.frames import GRAVITY_MPS2, LocalProjection
from fusion.matching.drive import MatchOptions
from fusion.methods.base import DriveResult
from fusion.pipeline import run_drive
from fusion.profile.inertia import set_right
from fusion.profile.measurements import build_measurements
from fusion.profile.method import MIN_MEASUREMENTS, ProfileOptions
from fusion.profile.model import build_smoother_epochs
from fusion.profile.noise import learn
from fusion.profile.path import find_path
from fusion.profile.prior import prior_of
from fusion.profile.traversals import SmoothedDrive
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import structures
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write.csv_file import csv_columns
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.types import Attitude, DriveLog, Floats, GnssFix, GnssVelocity, Ints, Pressure, SpecificForce

Columns = dict[str, Floats]
Change = Callable[[Columns], None]
"""Changes the columns of a log in place."""
NEVER: tuple[str, ...] = ()
_DIGITS = {"time_s": 3, "lat_deg": 8, "lon_deg": 8}
_WHOLE_SHARE = 0.8


def unchanged(table: Columns) -> None:
    """The log as it was recorded."""


def log_of(table: Mapping[str, Floats]) -> DriveLog:
    """The columns written as a Versant CSV and read back."""
    text = io.StringIO(newline="")
    out = csv.writer(text)
    out.writerow(table)
    out.writerows(
        zip(
            *(["" if np.isnan(v) else f"{v:.{_DIGITS.get(k, 4)}f}" for v in c] for k, c in table.items()),
            strict=True,
        )
    )
    return read_log(io.BytesIO(text.getvalue().encode()))


class MovedDem(Dem):
    """An elevation model that lies ``east_m``, ``north_m`` and ``up_m`` from where it should."""

    def __init__(self, dem: Dem, east_m: float, north_m: float, up_m: float) -> None:
        self.datum, self.description = dem.datum, dem.description
        self._dem, self._move = dem, (east_m, north_m, up_m)

    def heights(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """See ``Dem.heights``."""
        east, north, up = self._move
        lat = np.asarray(lat_deg, float)
        lon = np.asarray(lon_deg, float) - east / (111_320.0 * np.cos(np.radians(lat)))
        return self._dem.heights(lon, lat - north / 111_320.0) + up

    def heights_along(self, lon_deg: Floats, lat_deg: Floats, line: Ints) -> Floats:
        """See ``Dem.heights_along``: of one raster."""
        return self.heights(lon_deg, lat_deg)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a drive's slopes are worth: error and sigma (%) of the segments driven over most of their length."""

    town: Town
    segment: Ints
    error: Floats
    sigma: Floats
    driven: int
    network: RoadNetwork
    result: DriveResult

    @property
    def structure(self) -> np.ndarray:
        """Which are bridges and tunnels."""
        return np.asarray((self.town.roads.bridge | self.town.roads.tunnel)[self.segment])

    @property
    def report(self) -> dict[str, Any]:
        """The drive's report."""
        return self.result.report


def identities(table: RoadTable) -> list[tuple[int, int, int]]:
    """(way, from, to) of every row."""
    ids = np.column_stack([table.osm_way_id, table.from_node, table.to_node])
    return [(int(a), int(b), int(c)) for a, b, c in ids]


def whole(town: Town, drive: SimulatedDrive) -> list[int]:
    """Segments that one pass drove over most of their length, the slope of which is therefore known."""
    wanted = {p.segment for p in drive.passes() if p.driven_m > _WHOLE_SHARE * town.length_m[p.segment]}
    return sorted(wanted)


class World:
    """Towns with their elevation models, and drives through them, each made once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._towns: dict[int, Town] = {}
        self._dems: dict[int, Dem] = {}
        self._drives: dict[str, SimulatedDrive] = {}
        self._clean: dict[str, Outcome] = {}

    def town(self, seed: int) -> Town:
        """The town of a seed."""
        if seed not in self._towns:
            self._towns[seed] = make_town(seed)
        return self._towns[seed]

    def dem(self, seed: int) -> Dem:
        """Its elevation model, errors and voids included."""
        if seed not in self._dems:
            path = self._folder / f"{seed}.tif"
            write_dem(self.town(seed), path)
            self._dems[seed] = Dem.open([path])
        return self._dems[seed]

    def drive(self, seed: int, number: int = 0, **options: Any) -> SimulatedDrive:
        """A drive through the town of a seed, over its structures first."""
        key = repr((seed, number, sorted(options.items())))
        if key not in self._drives:
            town = self.town(seed)
            wanted: dict[str, Any] = {"duration_s": 600.0, "first": structures(town)} | options
            self._drives[key] = simulate_drive(town, 1000 * seed + number, **wanted)
        return self._drives[key]

    def outcome(
        self,
        drive: SimulatedDrive,
        change: Change = unchanged,
        *,
        move_dem: tuple[float, float, float] = (0.0, 0.0, 0.0),
        options: Mapping[str, Any] | None = None,
        method: str = "profile",
    ) -> Outcome:
        """Estimate the slopes of a drive whose log was changed."""
        table = csv_columns(drive)
        change(table)
        dem = self.dem(drive.town.seed)
        if any(move_dem):
            dem = MovedDem(dem, *move_dem)
        network, result = run_drive(
            log_of(table), drive.town.roads, dem, method=method, options=dict(options or {})
        )
        return judged(drive, network, result)

    def clean(self, drive: SimulatedDrive) -> Outcome:
        """The outcome of a drive with nothing wrong."""
        key = repr((drive.town.seed, drive.seed, drive.receiver, drive.rate_hz, len(drive.time_s)))
        if key not in self._clean:
            self._clean[key] = self.outcome(drive)
        return self._clean[key]


def judged(drive: SimulatedDrive, network: RoadNetwork, result: DriveResult) -> Outcome:
    """A result beside the truth."""
    town = drive.town
    row_of = {key: row for row, key in enumerate(identities(town.roads))}
    own = identities(network.table)
    got = {
        row_of[own[s.segment]]: (s.slope_percent, s.slope_sigma_percent)
        for s in result.slopes
    }  # fmt: skip
    wanted = whole(town, drive)
    segment = np.array([s for s in wanted if s in got], np.int64)
    slope, sigma = np.array([got[int(s)] for s in segment]).reshape(-1, 2).T
    error = slope - town.true_slope_percent[segment]
    return Outcome(town, segment, error, sigma, len(wanted), network, result)


def rmse(outcomes: Iterable[Outcome]) -> float:
    """Root mean square error over all segments of several drives, %."""
    return float(np.sqrt(np.mean(np.concatenate([o.error for o in outcomes]) ** 2)))


def inside(outcomes: Iterable[Outcome], factor: float = 1.0) -> float:
    """Share of errors within 1.96 sigma; ``factor`` on the sigmas."""
    pooled = [np.abs(o.error) <= 1.96 * factor * o.sigma for o in outcomes]
    return float(np.mean(np.concatenate(pooled)))


def coverage(outcomes: Iterable[Outcome]) -> float:
    """Share of the driven segments that have a slope."""
    counts = np.array([(len(o.segment), o.driven) for o in outcomes])
    return float(counts[:, 0].sum() / counts[:, 1].sum())


@dataclass(frozen=True, eq=False)
class Smoothed(SmoothedDrive):
    """The parts of ``profile`` for one log, one after the other."""

    fix: GnssFix = field(kw_only=True)


def smoothed(log: DriveLog, roads: RoadTable, dem: Dem | None = None, **options: bool) -> Smoothed:
    """As ``ProfileMethod.estimate`` does it."""
    middle = LocalProjection.around(log.fix.lon_deg, log.fix.lat_deg)
    path = find_path(log, RoadNetwork.project(roads, middle), MatchOptions(radius_m=50.0))
    assert path is not None
    measured = build_measurements(set_right(log)[0], path, dem, ProfileOptions(**options).sensors())
    assert len(measured) >= MIN_MEASUREMENTS
    epochs = build_smoother_epochs(measured, path)
    return Smoothed(path, measured, epochs, learn(measured, epochs, prior_of(measured)), fix=log.fix)


@dataclass(frozen=True)
class Levels:
    """One sigma of each error of ``street_log``; ``drift`` is a variance per second, ``springs`` a grade."""

    altitude_m: float = 0.5
    drift: float = 0.15
    doppler_mps: float = 0.1
    speed_mps: float = 0.05
    springs: float = 0.01
    force: float = 0.006
    position_m: float = 1.0
    mount: float = 0.02
    pressure_drift: float = 0.01


def street_log(
    time_s: Floats,
    along_m: Floats,
    height: Callable[[Floats], Floats],
    rng: np.random.Generator,
    *,
    nose: Floats | float = 1.0,
    levels: Levels = Levels(),
    aside_m: Floats | float = 0.0,
    without: Iterable[str] = NEVER,
) -> DriveLog:
    """A log of a vehicle on the street eastwards (``factor_support.street``), ``along_m`` from its west end.

    ``nose`` is 1 where the vehicle looks east and -1 west, whichever way it moves; ``aside_m`` puts it off the street,
    north; sensors ``without`` are left out ("velocity", "attitude", "force", "altitude"). The springs' movement is
    seen by pitch and force alike.
    """
    n = len(time_s)
    nose = np.broadcast_to(np.asarray(nose, float), n)
    fine = np.linspace(along_m.min() - 1, along_m.max() + 1, 20_001)
    grade = np.interp(along_m, fine, np.gradient(height(fine), fine))
    speed, step = np.gradient(along_m, time_s), np.diff(time_s, prepend=time_s[0])
    wander = np.cumsum(rng.normal(size=n) * np.sqrt(levels.drift * step))
    lon, lat = PLANE.to_lonlat(
        along_m + levels.position_m * rng.normal(size=n), aside_m + levels.position_m * rng.normal(size=n)
    )
    v = levels.doppler_mps
    springs = levels.springs * rng.normal(size=n)
    felt = nose * grade + springs + levels.mount
    unknown = np.full(n, np.nan)
    altitude = height(along_m) + wander + levels.altitude_m * rng.normal(size=n)
    fix = GnssFix.assemble(
        time_s,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl_m=unknown if "altitude" in without else altitude,
        h_acc_m=np.full(n, 2.0),
        v_acc_m=np.full(n, 3.0),
    )
    velocity = GnssVelocity.assemble(
        time_s,
        vel_e_mps=speed + levels.speed_mps * rng.normal(size=n),
        vel_n_mps=levels.speed_mps * rng.normal(size=n),
        vel_d_mps=-speed * grade + v * rng.normal(size=n),
        s_acc_mps=np.full(n, 0.1),
    )
    attitude = Attitude.assemble(
        time_s, pitch_rad=np.arctan(felt), yaw_rad=np.where(nose > 0, 0.5, 1.5) * np.pi
    )
    sine = np.sin(np.arctan(felt)) + levels.force * rng.normal(size=n)
    force = SpecificForce.assemble(time_s, acc_x_mps2=nose * np.gradient(speed, time_s) + GRAVITY_MPS2 * sine)
    return DriveLog(
        "csv",
        fix,
        velocity=GnssVelocity.empty() if "velocity" in without else velocity,
        attitude=Attitude.empty() if "attitude" in without else attitude,
        force=SpecificForce.empty() if "force" in without else force,
    )


def pressure_of(time_s: Floats, height_m: Floats) -> Pressure:
    """What a barometer shows at these heights in the standard atmosphere."""
    return Pressure.assemble(time_s, pressure_pa=101_325.0 * (1 - height_m / 44_330.77) ** (1 / 0.190263))


def hills(along_m: Floats) -> Floats:
    """Heights of a street with grades up to 8 %."""
    return np.asarray(200 + 5 * np.sin(along_m / 90) + 1.5 * np.sin(along_m / 37 + 1))
