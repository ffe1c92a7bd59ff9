"""The report says what a driver can do better, and nothing where nothing is to be done."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, cast

import numpy as np
import pytest

from factor_support import street
from fusion.pipeline import run_drive
from fusion.profile import method
from fusion.roads.table import rows_of
from fusion.simulate.write.csv_file import csv_columns
from fusion.terrain.dem import Dem
from fusion.together import FusedDrive, solve_network
from fusion.types import DriveLog
from profile_support import Levels, World, hills, log_of, pressure_of, street_log

TABLE = street(*[60.0] * 30)
TIME_S = 1.7e9 + np.arange(175.0)
ALONG_M = 5 + 10 * (TIME_S - TIME_S[0])


def drive_log(seed: int = 1, **options: Any) -> DriveLog:
    return street_log(TIME_S, ALONG_M, hills, np.random.default_rng(seed), **options)


def report(log: DriveLog, **options: object) -> dict[str, Any]:
    found: dict[str, Any] = run_drive(log, TABLE, None, options=options)[1].report
    return found


def said(log: DriveLog, word: str, **options: object) -> list[str]:
    return [sentence for sentence in report(log, **options)["warnings"] if word in sentence]


def test_a_report_is_json_with_every_field() -> None:
    again = json.loads(json.dumps(report(drive_log()), allow_nan=False))
    assert again["matched_share"] == 1
    assert again["breaks"] == []
    assert again["passes"] == 30
    assert again["passes_of_part_of_a_segment"] <= 2
    assert again["passes_dropped_as_uncertain"] == 0
    assert again["own_speed_scale"] == 1
    assert again["height_jumps_s"] == []
    assert set(again["sensors"]) == {"altitude", "doppler", "pitch", "specific force"}
    assert {"roughness", "altitude_m", "drift", "doppler", "pitch", "force", "shared"} <= set(again["noise"])
    for figures in again["sensors"].values():
        assert figures["measurements"] > 150
        assert 0 < figures["grade_sigma_percent"] <= figures["grade_sigma_percent_without"] * (1 + 1e-9)


def test_the_best_sensor_is_missed_most() -> None:
    """Without an excellent Doppler the grade's sigma grows; without a miserable accelerometer it hardly does."""
    sensors = report(drive_log(levels=Levels(doppler_mps=0.02, springs=0.03)))["sensors"]
    loss = {k: v["grade_sigma_percent_without"] / v["grade_sigma_percent"] for k, v in sensors.items()}
    assert loss["doppler"] > 1.3
    assert max(loss, key=lambda name: loss[name]) == "doppler"
    assert loss["specific force"] < 1.1


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_drive_is_warned_of_nothing(seed: int) -> None:
    assert report(drive_log(seed))["warnings"] == []


@pytest.mark.slow
def test_clean_town_drives_are_warned_of_nothing(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Ten drives: no false alarm of a mount that moved or a height that jumped."""
    world = World(tmp_path_factory.mktemp("profile"))
    alarms = []
    for number in range(10):
        seed, receiver = 1 + number % 3, ("m8", "phone", "f9p")[number % 3]
        drive = world.drive(seed, number, receiver=receiver, duration_s=300.0)
        found = run_drive(log_of(csv_columns(drive)), drive.town.roads, None)[1].report
        alarms += found["height_jumps_s"] + found["mount"]["moves"]
        assert not [w for w in found["warnings"] if "tilt" not in w], (number, found["warnings"])
    assert alarms == []


def test_no_doppler() -> None:
    assert len(said(drive_log(without=["velocity"]), "Doppler")) == 1


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "word"), [(0.1, "worse"), (10.0, "better")])
def test_a_wrong_accuracy_of_velocities(factor: float, word: str) -> None:
    """Over a drive long enough to be sure."""
    table = street(*[60.0] * 120)
    time = 1.7e9 + np.arange(700.0)
    log = street_log(time, 5 + 10 * (time - time[0]), hills, np.random.default_rng(2))
    wrong = replace(log, velocity=replace(log.velocity, s_acc_mps=factor * log.velocity.s_acc_mps))
    warnings = run_drive(wrong, table, None)[1].report["warnings"]
    assert [w for w in warnings if word in w and "s_acc_mps" in w]
    assert run_drive(log, table, None)[1].report["warnings"] == []


def tilted(log: DriveLog, degrees: float, from_s: float) -> DriveLog:
    late = log.attitude.time_s > from_s
    turn = np.radians(degrees) * late
    force = log.force
    return replace(
        log,
        attitude=replace(log.attitude, pitch_rad=log.attitude.pitch_rad + turn),
        force=replace(force, acc_x_mps2=force.acc_x_mps2 + 9.81 * np.sin(turn)),
    )


@pytest.mark.parametrize("degrees", [3.0, -3.0])
def test_a_mount_that_moved(degrees: float) -> None:
    when = TIME_S[80] + 0.5
    found = report(tilted(drive_log(levels=Levels(springs=0.006)), degrees, when))
    (move,) = found["mount"]["moves"]
    assert abs(move["time_s"] - when) < 4
    assert move["change_deg"] == pytest.approx(degrees, abs=0.6)
    (sentence,) = (w for w in found["warnings"] if "moved" in w)
    assert f"{move['change_deg']:+.1f} degrees" in sentence
    assert datetime.fromtimestamp(move["time_s"], UTC).strftime("%H:%M:%S UTC") in sentence


def test_the_mount_s_tilt_is_found() -> None:
    found = [report(drive_log(seed, levels=Levels(mount=0.05)))["mount"] for seed in range(4)]
    for mount in found:
        true = float(np.degrees(np.arctan(0.05)))
        assert abs(mount["pitch_deg"] - true) < max(4 * mount["sigma_deg"], 0.1)
        assert mount["sigma_deg"] < 0.5


def test_no_mount_without_pitch_and_force() -> None:
    assert report(drive_log(without=["attitude", "force"]))["mount"] is None


def test_a_height_that_jumped() -> None:
    log = drive_log()
    late = log.fix.time_s > TIME_S[90]
    found = report(replace(log, fix=replace(log.fix, alt_msl_m=log.fix.alt_msl_m + 40.0 * late)))
    assert [t for t in found["height_jumps_s"] if abs(t - TIME_S[91]) <= 2]
    assert [w for w in found["warnings"] if "height jumped" in w]


def test_few_positions_on_roads() -> None:
    aside = np.where(ALONG_M > 1000, 150.0, 0.0)
    found = report(drive_log(aside_m=aside))
    assert found["matched_share"] < 0.8
    assert len(found["breaks"]) >= 1
    assert [w for w in found["warnings"] if f"Only {found['matched_share']:.0%} of the positions" in w]


def test_many_values_far_off() -> None:
    log = drive_log()
    rng = np.random.default_rng(1)
    chosen = rng.choice(len(TIME_S), 18, replace=False)
    down = log.velocity.vel_d_mps.copy()
    down[chosen] += 3.0 * rng.choice([-1.0, 1.0], len(chosen))
    found = report(replace(log, velocity=replace(log.velocity, vel_d_mps=down)))
    assert 15 <= found["sensors"]["doppler"]["outliers"] <= 20
    assert [w for w in found["warnings"] if "'doppler' are far off" in w]
    assert not [w for w in found["warnings"] if "'pitch'" in w or "'altitude'" in w]


def test_a_tilt_hardly_known() -> None:
    """Pitch alone cannot tell a tilted sensor from a hill."""
    found = report(drive_log(without=["velocity", "altitude"]))
    assert [w for w in found["warnings"] if "mount's tilt is known to" in w]


@dataclass
class Raster:
    """An elevation model of the street, ``off_m`` too high in its second quarter."""

    off_m: float
    description: str = "made"
    datum: str = "EGM96"

    def heights(self, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        first, last = TABLE.lon0_deg[0], TABLE.lon1_deg[-1]
        along = (lon - first) / (last - first) * TABLE.length_m.sum()
        return np.asarray(hills(along) + np.where((along > 450) & (along < 900), self.off_m, 0.0))

    def heights_along(self, lon: np.ndarray, lat: np.ndarray, line: np.ndarray) -> np.ndarray:
        return self.heights(lon, lat)


@pytest.mark.parametrize("off_m", [30.0, -30.0])
def test_an_elevation_model_that_is_off_is_named(off_m: float) -> None:
    found, fine = (run_drive(drive_log(), TABLE, cast(Dem, Raster(off)))[1].report for off in (off_m, 0.0))
    (sentence,) = [one for one in found["warnings"] if one.startswith("The elevation model")]
    said = re.search(r"about (\d+) m too (high|low) along (\d+) m", sentence)
    assert said is not None
    assert abs(int(said[1]) - 30) <= 2
    assert said[2] == ("high" if off_m > 0 else "low")
    assert abs(int(said[3]) - 450) <= 50
    assert not [one for one in fine["warnings"] if one.startswith("The elevation model")]


def test_drives_together_name_it_as_well() -> None:
    """What ``versant fuse`` says beside the reports of each log."""
    log, dem = drive_log(), cast(Dem, Raster(30.0))
    network, result = run_drive(log, TABLE, dem)
    one = FusedDrive(rows_of(TABLE, network.table), result, log.fix.time_s)
    (sentence,) = solve_network(TABLE, dem, [one]).remarks
    assert sentence.startswith("The elevation model is about ")
    assert solve_network(TABLE, cast(Dem, Raster(0.0)), [one]).remarks == []


def test_what_is_set_right_is_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The report says what the method found, and what it did not look for is not in it."""
    calls = []
    real = method.set_right
    monkeypatch.setattr(method, "set_right", lambda log: calls.append("set_right") or real(log))  # type: ignore[func-returns-value]
    log = drive_log()
    log = replace(log, pressure=pressure_of(TIME_S, hills(ALONG_M)))
    found = report(log)
    assert calls == ["set_right"]
    assert found["inertia"] is not None
    assert found["speed_pressure"]["share"] == pytest.approx(
        0, abs=found["speed_pressure"]["found_share"]["sigma"]
    )
    calls.clear()
    found = report(log, pitch=False, force=False, barometer=False)
    assert calls == []
    assert found["inertia"] is None
    assert found["speed_pressure"] is None
