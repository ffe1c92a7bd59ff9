"""Sigma that is honest where it hurts: wrong accuracies, a mount that moves, jumps of the receiver, a wrong DEM."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.write.csv_file import csv_columns
from profile_support import Columns, World, coverage, inside, rmse, unchanged

pytestmark = pytest.mark.slow

HONEST = 0.9
WORSE = 1.4
FLEET = ((1, "m8"), (2, "phone"), (3, "f9p"))
"""Town and receiver of the drives that each disturbance is tried on: some 300 segments together."""

ACCURACIES = ("v_acc_m", "s_acc_mps", "h_acc_m", "pitch_acc_deg")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return World(tmp_path_factory.mktemp("profile"))


@pytest.fixture(scope="module")
def fleet(world: World) -> list[SimulatedDrive]:
    return [world.drive(seed, receiver=receiver, duration_s=450.0) for seed, receiver in FLEET]


def stated(factor: float, *columns: str) -> Callable[[Columns], None]:
    def change(table: Columns) -> None:
        for name in columns:
            table[name] = factor * table[name]

    return change


def elapsed_share(table: Columns) -> np.ndarray:
    t = table["time_s"]
    return np.asarray((t - t[0]) / (t[-1] - t[0]))


def during(table: Columns, begin_share: float, length_s: float) -> np.ndarray:
    t = table["time_s"] - table["time_s"][0]
    begin = begin_share * t[-1]
    return np.asarray((t > begin) & (t < begin + length_s))


def mount_moves(table: Columns) -> None:
    """The sensor turns up by 2.5 degrees in its holder: pitch and accelerometer alike."""
    late = elapsed_share(table) > 0.45
    turn = np.radians(2.5) * late
    forward, up = table["acc_x_mps2"].copy(), table["acc_z_mps2"].copy()
    table["acc_x_mps2"] = np.cos(turn) * forward + np.sin(turn) * up
    table["acc_z_mps2"] = np.cos(turn) * up - np.sin(turn) * forward
    table["pitch_deg"] = table["pitch_deg"] + np.degrees(turn)


def height_jumps(table: Columns) -> None:
    table["alt_msl_m"] = table["alt_msl_m"] + 30.0 * during(table, 0.4, 60.0)


def height_and_place_jump(table: Columns) -> None:
    """For 20 s the receiver follows a reflection: 30 m up, 37 m aside."""
    wrong = during(table, 0.4, 20.0)
    table["alt_msl_m"] = table["alt_msl_m"] + 30.0 * wrong
    table["lat_deg"] = table["lat_deg"] + 30.0 / 111_320 * wrong
    table["lon_deg"] = table["lon_deg"] + 22.0 / 74_500 * wrong


def height_stays_wrong(table: Columns) -> None:
    table["alt_msl_m"] = table["alt_msl_m"] + 30.0 * (elapsed_share(table) > 0.4)


SINGLE = {f"{name} x {f:g}": stated(f, name) for name in ACCURACIES for f in (0.1, 10.0)}
"""One column alone is tried on one drive only, all of them together on every one."""
DISTURBANCES: dict[str, Callable[[Columns], None]] = {
    **SINGLE,
    "all accuracies x 0.1": stated(0.1, *ACCURACIES),
    "all accuracies x 10": stated(10.0, *ACCURACIES),
    "mount moves": mount_moves,
    "height jumps": height_jumps,
    "height and place jump": height_and_place_jump,
    "height stays wrong": height_stays_wrong,
}
DEMS = {"100 m east": (100.0, 0.0, 0.0), "100 m north": (0.0, 100.0, 0.0), "100 m up": (0.0, 0.0, 100.0)}


def test_undisturbed_drives_are_good_to_begin_with(world: World, fleet: list[SimulatedDrive]) -> None:
    outcomes = [world.clean(drive) for drive in fleet]
    assert coverage(outcomes) >= 0.97
    assert rmse(outcomes) < 0.7
    assert inside(outcomes) > 0.9
    # Nor are the sigmas so wide that anything lies within them.
    assert inside(outcomes, 0.5) < 0.97


@pytest.mark.parametrize("name", DISTURBANCES)
def test_a_log_with_something_wrong_keeps_its_promise(
    name: str, world: World, fleet: list[SimulatedDrive]
) -> None:
    tried = fleet if name not in SINGLE else fleet[:1]
    outcomes = [world.outcome(drive, DISTURBANCES[name]) for drive in tried]
    assert coverage(outcomes) >= 0.95
    assert inside(outcomes) > HONEST
    for drive, disturbed in zip(tried, outcomes, strict=True):
        assert rmse([disturbed]) < WORSE * rmse([world.clean(drive)]), drive.receiver


@pytest.mark.parametrize("name", DEMS)
def test_a_wrong_dem_is_given_little_weight(name: str, world: World, fleet: list[SimulatedDrive]) -> None:
    outcomes = [world.outcome(drive, unchanged, move_dem=DEMS[name]) for drive in fleet]
    assert inside(outcomes) > HONEST
    for drive, disturbed in zip(fleet, outcomes, strict=True):
        assert rmse([disturbed]) < WORSE * rmse([world.clean(drive)]), drive.receiver


def test_the_disturbances_are_what_they_say(fleet: list[SimulatedDrive]) -> None:
    """They change the log, and none but the accuracies only says something else about it."""
    for name, change in DISTURBANCES.items():
        before, after = csv_columns(fleet[0]), csv_columns(fleet[0])
        change(after)
        changed = {k for k in before if not np.array_equal(before[k], after[k], equal_nan=True)}
        assert changed, name
        assert changed <= {*ACCURACIES} if "acc" in name else not changed & {*ACCURACIES}, name
