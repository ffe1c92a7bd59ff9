"""Inertial data that are late or misaligned: on roads with known slopes, and in the report."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.pipeline import run_drive
from fusion.profile import method
from fusion.profile.inertia import Inertia, set_right
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import (
    AngularRate,
    Attitude,
    DriveLog,
    Floats,
    GnssFix,
    GnssVelocity,
    SensorTable,
    SpecificForce,
)
from inertia_support import Ride, ride

INERTIAL = ("acc_x_mps2", "acc_y_mps2", "acc_z_mps2", "yaw_deg")
GNSS = ("lat_deg", "lon_deg", "alt_msl_m", "h_acc_m", "v_acc_m", "vel_n_mps", "vel_e_mps", "s_acc_mps")
Columns = dict[str, Floats]
Key = tuple[int, int, int]
Table = TypeVar("Table", bound=SensorTable)


def log_of(one: Ride) -> DriveLog:
    north, east = (np.cumsum(v) for v in (one.north_mps, one.east_mps))
    return DriveLog(
        "csv",
        GnssFix.assemble(one.gnss_s, lat_deg=49 + north / 111_000, lon_deg=8 + east / 73_000),
        velocity=GnssVelocity.assemble(
            one.gnss_s, vel_n_mps=one.north_mps, vel_e_mps=one.east_mps, vel_d_mps=one.down_mps
        ),
        force=SpecificForce.assemble(one.inertial_s, acc_x_mps2=one.forward_mps2, acc_y_mps2=one.left_mps2),
        rate=AngularRate.assemble(one.inertial_s, gyr_z_radps=one.turning_radps),
    )


def test_a_sound_log_is_left_as_it_is() -> None:
    log = log_of(ride(1))
    right, found = set_right(log)
    assert right is log
    assert (found.lag_s, found.yaw_rad) == (0, 0)
    assert abs(found.lag.value) < 0.02
    assert abs(np.degrees(found.yaw.value)) < 1


def test_times_and_axes_are_set_right() -> None:
    true, log = ride(2), log_of(ride(2, lag_s=0.25, yaw_deg=6.0))
    right, found = set_right(log)
    assert found.lag_s == pytest.approx(0.25, abs=0.02)
    assert np.degrees(found.yaw_rad) == pytest.approx(6.0, abs=1.0)
    np.testing.assert_allclose(right.force.time_s, log.force.time_s - found.lag_s)
    np.testing.assert_allclose(right.rate.time_s, log.rate.time_s - found.lag_s)
    np.testing.assert_array_equal(right.fix.time_s, log.fix.time_s)
    # The noise of the true samples is in both differences.
    forward = np.interp(right.force.time_s, true.inertial_s, true.forward_mps2)
    late = np.interp(log.force.time_s, true.inertial_s, true.forward_mps2)
    assert np.std(right.force.acc_x_mps2 - forward) < np.std(log.force.acc_x_mps2 - late)


def test_an_axis_that_is_not_the_forward_one_is_left_alone() -> None:
    found = set_right(log_of(ride(3, yaw_deg=90.0)))[1]
    assert found.yaw_rad == 0


def test_a_log_without_inertial_data_is_left_alone() -> None:
    log = replace(log_of(ride(4)), force=SpecificForce.empty(), rate=AngularRate.empty())
    right, found = set_right(log)
    assert right is log
    assert found == Inertia(found.lag, found.yaw, 0.0, 0.0)
    assert not np.isfinite(found.lag.sigma)


def read_columns(path: Path) -> Columns:
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    table = np.array([[float(c) if c else np.nan for c in row] for row in rows])
    return dict(zip(head, table.T, strict=True))


def recorded(columns: Mapping[str, Floats], lag_s: float = 0.0, yaw_deg: float = 0.0) -> DriveLog:
    """A log at 10 Hz with GNSS once a second, no climb and no pitch: grades rest on the accelerometer."""
    time = columns["time_s"]
    out: Columns = {"time_s": time}
    every = np.arange(len(time)) % 10 == 0
    out |= {name: np.where(every, columns[name], np.nan) for name in GNSS}
    turned = dict(columns)
    angle, x, y = np.radians(yaw_deg), columns["acc_x_mps2"], columns["acc_y_mps2"]
    turned["acc_x_mps2"] = np.cos(angle) * x + np.sin(angle) * y
    turned["acc_y_mps2"] = np.cos(angle) * y - np.sin(angle) * x
    turned["yaw_deg"] = np.degrees(np.unwrap(np.radians(columns["yaw_deg"])))
    out |= {name: np.interp(time - lag_s, time, turned[name]) for name in INERTIAL}
    text = io.StringIO(newline="")
    lines = csv.writer(text)
    lines.writerow(out)
    lines.writerows(
        zip(*(["" if np.isnan(v) else f"{v:.14g}" for v in c] for c in out.values()), strict=True)
    )
    return read_log(io.BytesIO(text.getvalue().encode()))


class Road(NamedTuple):
    roads: RoadTable
    truth: dict[Key, float]

    def error(self, log: DriveLog) -> Floats:
        network, result = run_drive(log, self.roads, None)
        table = network.table
        found = {
            (
                int(table.osm_way_id[s.segment]),
                int(table.from_node[s.segment]),
                int(table.to_node[s.segment]),
            ): s
            for s in result.slopes
        }
        return np.array([found[key].slope_percent - true for key, true in self.truth.items() if key in found])


def road_of(folder: Path, name: str) -> Road:
    with (folder / f"truth_{name}.csv").open(newline="") as file:
        truth = {
            (int(r["osm_way_id"]), int(r["from_node"]), int(r["to_node"])): float(r["slope_percent"])
            for r in csv.DictReader(file)
        }
    return Road(read_roads(folder / ("roads_00.osm" if name == "00" else "roads_09_10.osm")), truth)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "error"), [("09", {"lag_s": 0.3}), ("00", {"yaw_deg": 10.0})])
def test_slopes_of_recorded_roads_are_as_good_as_without_the_error(
    name: str,
    error: dict[str, float],
    karlsruhe: Path,
    receiver_log: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And visibly worse where it is not set right."""
    road = road_of(karlsruhe, name)
    columns = [read_columns(receiver_log(name, tmp_path / "log.csv", seed, rate=10.0)) for seed in range(2)]

    def rmse(**error: float) -> float:
        errors = [road.error(recorded(c, **error)) for c in columns]
        return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))

    clean, right = rmse(), rmse(**error)
    nothing = set_right(DriveLog("csv", GnssFix.empty()))[1]
    monkeypatch.setattr(method, "set_right", lambda log: (log, nothing))
    wrong = rmse(**error)
    assert right < 1.05 * clean
    assert wrong > 1.15 * clean


@pytest.mark.slow
def test_a_real_log_whose_velocities_are_late(shared_data: Path) -> None:
    """Doppler of comma2k19 comes out of a filter: forces and turning are ahead of it."""
    log = read_log(shared_data / "comma2k19" / "log.csv")
    assert -0.25 < set_right(log)[1].lag_s < -0.05


def test_the_report_says_what_was_set_right(make_log: Callable[..., DriveLog], town: Town) -> None:
    log = make_log(3, duration_s=300.0)
    late = replace(log, force=moved(log.force), rate=moved(log.rate), attitude=moved(log.attitude))
    report = json.loads(json.dumps(run_drive(late, town.roads, None)[1].report, allow_nan=False))
    assert report["inertia"]["imu_lag_s"] == pytest.approx(0.4, abs=0.05)
    assert report["inertia"]["found_imu_lag_s"]["sigma"] < 0.05
    assert report["inertia"]["mount_yaw_deg"] == 0
    assert report["speed_pressure"] is None
    blind = replace(log, force=SpecificForce.empty(), attitude=Attitude.empty())
    assert run_drive(blind, town.roads, None)[1].report["inertia"] is None


def moved(table: Table) -> Table:
    """The same samples 0.4 s late."""
    return replace(table, time_s=table.time_s + 0.4)
