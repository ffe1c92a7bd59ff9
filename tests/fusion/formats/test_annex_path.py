"""The way of the thesis's annexes, whole: a u-blox file or u-center dump in, ENU accelerations, pitch and slopes out.

Annex B.4 turns accelerations from the sensor's axes to NED and ENU; that gravity has to come off is spec 1's
correction. The known answers here go through the files, so that scales, signs and time tags count as well.
"""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.formats.receiver.ubx_messages import ESF_DATA, signed_24
from fusion.frames import GRAVITY_MPS2
from fusion.methods.base import DriveResult
from fusion.pipeline import run_drive
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.ubx_file import write_ubx
from fusion.types import DriveLog
from ucenter_support import ucenter_listing

G = GRAVITY_MPS2
SECONDS = 12
LEAP_SECONDS = 18
KEY = ("osm_way_id", "from_node", "to_node")


@pytest.mark.parametrize(
    ("data_type", "word", "column", "value", "step"),
    [
        (16, 0xFFFD7D, "acc_x_mps2", -0.628, 1e-3),
        (17, 0x000144, "acc_y_mps2", 0.316, 1e-3),
        (18, 0x00273C, "acc_z_mps2", 9.809, 1e-3),
        (14, 0x00053E, "gyr_x_radps", np.radians(0.328), np.radians(1e-3)),
        (13, 0xFFF9A8, "gyr_y_radps", np.radians(-0.396), np.radians(1e-3)),
        (5, 0x000731, "gyr_z_radps", np.radians(0.449), np.radians(1e-3)),
        (12, 0x00060B, "temperature_c", 15.47, 1e-2),
    ],
)
def test_words_mean_what_the_thesis_prints_beside_them(
    data_type: int, word: int, column: str, value: float, step: float
) -> None:
    name, scale = ESF_DATA[data_type]
    assert name == column
    assert int(signed_24(np.array([word]))[0]) * scale == pytest.approx(value, abs=step)


def standing_log(
    make: SimpleNamespace,
    force: tuple[float, float, float],
    attitude_deg: tuple[float, float, float],
    **accuracies: float,
) -> DriveLog:
    """Twelve seconds of one specific force (x forward, y left, z up) and attitude (roll, pitch, heading).

    Sensor messages come at 10 Hz between the epochs, their counter wraps, and the GNSS says that nothing moves.
    """
    words = [(16 + k, round(f * 1024)) for k, f in enumerate(force)]
    roll, pitch, heading = attitude_deg
    out = b""
    for k in range(SECONDS):
        when = make.start + timedelta(seconds=k)
        out += make.pvt(when, velN=0, velE=0, velD=0, gSpeed=0)
        out += make.att(when, roll=roll, pitch=pitch, heading=heading, **accuracies) + make.eoe(when)
        for j in range(10):
            out += make.esf_meas((4_294_960_000 + 1000 * k + 100 * j + 50) % 2**32, words)
    return read_log(out)


def epochs_of(log: DriveLog, town: Town) -> Epochs:
    return build_epochs(log, town.projection)


TEN_UP = (G * np.sin(np.radians(10)), 0.0, G * np.cos(np.radians(10)))
FIVE_RIGHT_DOWN = (0.0, G * np.sin(np.radians(5)), G * np.cos(np.radians(5)))


@pytest.mark.parametrize(
    ("force", "attitude_deg", "enu"),
    [
        pytest.param((0, 0, G), (0, 0, 0), (0, 0, 0), id="at rest"),
        pytest.param(TEN_UP, (0, 10, 0), (0, 0, 0), id="at rest, nose up, facing north"),
        pytest.param(TEN_UP, (0, 10, 237), (0, 0, 0), id="at rest, nose up, facing south-west"),
        pytest.param(FIVE_RIGHT_DOWN, (5, 0, 90), (0, 0, 0), id="at rest, right side down"),
        pytest.param((-3, 0, G), (0, 0, 90), (-3, 0, 0), id="braking eastwards"),
        pytest.param((-3, 0, G), (0, 0, 180), (0, 3, 0), id="braking southwards"),
        pytest.param((0, 4, G), (0, 0, 0), (-4, 0, 0), id="turning left from north: to the west"),
        pytest.param((0, -4, G), (0, 0, 90), (0, -4, 0), id="turning right from east: to the south"),
        pytest.param((0, 0, G + 1.5), (0, 0, 45), (0, 0, 1.5), id="over a sag"),
        pytest.param(
            (TEN_UP[0] + 2, 0, TEN_UP[2]),
            (0, 10, 90),
            (2 * np.cos(np.radians(10)), 0, 2 * np.sin(np.radians(10))),
            id="speeding up eastwards, uphill",
        ),
    ],
)
def test_known_manoeuvres_give_known_accelerations(
    make: SimpleNamespace,
    town: Town,
    force: tuple[float, float, float],
    attitude_deg: tuple[float, float, float],
    enu: tuple[float, float, float],
) -> None:
    """To the sensor's own step of 2^-10 m/s2."""
    epochs = epochs_of(standing_log(make, force, attitude_deg), town)
    assert len(epochs) == SECONDS
    for found, expected in zip((epochs.acc_e_mps2, epochs.acc_n_mps2, epochs.acc_u_mps2), enu, strict=True):
        assert found == pytest.approx(np.full(SECONDS, expected), abs=1e-3)


@pytest.mark.parametrize(
    ("lost", "angle", "known"),
    [("accRoll", "roll_rad", True), ("accPitch", "pitch_rad", False), ("accHeading", "yaw_rad", False)],
)
def test_an_angle_of_accuracy_zero_is_not_available(
    make: SimpleNamespace, town: Town, lost: str, angle: str, known: bool
) -> None:
    """Without pitch or heading there is no way to ENU; without roll the vehicle is taken as level across."""
    log = standing_log(make, (0, 0, G), (0.0, 2.0, 30.0), **{lost: 0.0})
    assert f"attitude.{angle}" in log.missing
    epochs = epochs_of(log, town)
    assert np.isfinite(epochs.acc_e_mps2).all() == known
    if lost == "accPitch":  # the accelerometer tells the pitch instead
        assert np.isfinite(epochs.pitch_rad).all()
        assert epochs.pitch_acc_rad.min() > np.radians(1)
    else:
        assert np.degrees(epochs.pitch_rad) == pytest.approx(np.full(SECONDS, 2.0), abs=2e-5)


def test_heights_are_the_receivers_above_mean_sea_level(make: SimpleNamespace, town: Town) -> None:
    """hMSL of the thesis's message, not the height above the ellipsoid 45.654 m away."""
    log = standing_log(make, (0, 0, G), (0.0, 0.0, 0.0))
    assert epochs_of(log, town).alt_m == pytest.approx(np.full(SECONDS, -7.563))
    assert "EGM96" in log.geoid


class Files(NamedTuple):
    """One simulated drive, and its log by way of each kind of file."""

    drive: SimulatedDrive
    ubx: DriveLog
    dump: DriveLog
    csv: DriveLog


@pytest.fixture(scope="module", params=["m8", "perfect"])
def files(town: Town, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Files:
    drive = simulate_drive(town, 11, 240.0, receiver=request.param)
    folder: Path = tmp_path_factory.mktemp("annex")
    write_ubx(drive, folder / "drive.ubx")
    write_csv(drive, folder / "drive.csv")
    listing = ucenter_listing((folder / "drive.ubx").read_bytes(), float(drive.time_s[0]), LEAP_SECONDS)
    (folder / "drive.txt").write_bytes(listing.encode("ascii"))
    return Files(drive, *(read_log(folder / f"drive.{suffix}") for suffix in ("ubx", "txt", "csv")))


def test_a_dump_holds_what_the_binary_holds(files: Files) -> None:
    assert (files.ubx.source_format, files.dump.source_format) == ("ubx", "u-center")
    assert (files.dump.warnings, files.dump.missing) == (files.ubx.warnings, files.ubx.missing)
    for name, table in files.ubx.tables().items():
        other = files.dump.tables()[name]
        np.testing.assert_array_equal(other.time_s, table.time_s)
        for column in table.columns():
            np.testing.assert_array_equal(getattr(other, column), getattr(table, column), err_msg=column)


def test_time_tags_are_aligned_to_the_epochs(files: Files) -> None:
    """Early by the receiver's latency of 50 to 60 ms, as ``time_tags`` says, and no sample lost."""
    true_s = np.round(np.arange(0.0, files.drive.motion.duration_s, 0.1) + 0.007, 3)
    error = files.ubx.force.time_s - files.drive.start_time_s - true_s[true_s < files.drive.motion.duration_s]
    assert error.mean() == pytest.approx(-0.055, abs=0.01)
    assert np.ptp(error) < 0.01


def test_accelerations_are_the_vehicles_own(files: Files, town: Town) -> None:
    """Mean over each epoch's second, within what pitch, noise, bias and the shifted time tags leave."""
    drive, profile = files.drive, files.drive.profile
    epochs = epochs_of(files.ubx, town)
    within = (epochs.time_s - drive.start_time_s)[:, None] + np.arange(-0.49, 0.5, 0.02)
    whole = (within.min(axis=1) > 0) & (within.max(axis=1) < drive.motion.duration_s)
    truth = (
        drive.motion.at(within[whole].ravel()).acceleration_mps2.reshape(-1, within.shape[1], 3).mean(axis=1)
    )
    found = np.column_stack([epochs.acc_e_mps2, epochs.acc_n_mps2, epochs.acc_u_mps2])[whole]
    error = np.sqrt(np.mean((found - truth) ** 2, axis=0))
    white = profile.acc_mps2 / np.sqrt(10)
    shifted = 0.04  # of harsh turns and stops, by 50 ms
    level = float(np.hypot(white, 1.5 * profile.acc_bias_mps2))
    tilt = G * np.radians(profile.pitch_deg)
    assert np.all(error[:2] < np.linalg.norm([level, tilt, shifted]))
    assert error[2] < np.hypot(level, 0.01)
    assert np.all(error[:2] < 0.2 * truth[:, :2].std(axis=0))


def test_pitch_is_the_roads_and_the_mounts(files: Files, town: Town) -> None:
    drive, profile = files.drive, files.drive.profile
    epochs = epochs_of(files.ubx, town)
    state = drive.motion.at(epochs.time_s - drive.start_time_s)
    off = np.degrees(epochs.pitch_rad - state.pitch_rad)
    assert off.mean() == pytest.approx(np.degrees(drive.mounting.pitch_rad), abs=0.05 + 1e-4)
    assert off.std() == pytest.approx(profile.pitch_deg, rel=0.2, abs=1e-3)
    springs = np.degrees(epochs.pitch_rad - np.arctan(state.grade)).std()
    assert springs < (0.8 if profile.springs else 0.01)


def slopes_of(result: DriveResult) -> dict[int, tuple[float, float]]:
    return {s.segment: (s.slope_percent, s.slope_sigma_percent) for s in result.slopes}


def test_slopes_are_the_same_from_every_kind_of_file(files: Files, town: Town) -> None:
    """Dump and binary hold the same readings; those of the CSV are others of the same drive."""
    slopes = {}
    for name in ("ubx", "dump", "csv"):
        network, result = run_drive(
            getattr(files, name), town.roads, None, method="particle", options={"particles": 2000}
        )
        slopes[name] = slopes_of(result)
    assert slopes["dump"] == slopes["ubx"]
    both = sorted(set(slopes["ubx"]) & set(slopes["csv"]))
    assert len(both) > 0.9 * max(len(slopes["ubx"]), len(slopes["csv"])) > 20
    ubx, csv = (np.array([slopes[name][s] for s in both]) for name in ("ubx", "csv"))
    apart = (ubx[:, 0] - csv[:, 0]) / np.hypot(ubx[:, 1], csv[:, 1])
    assert np.sqrt(np.mean(apart**2)) < 1.0
    where = {
        key: k for k, key in enumerate(zip(*(getattr(town.roads, c).tolist() for c in KEY), strict=True))
    }
    rows = [where[tuple(int(getattr(network.table, c)[s]) for c in KEY)] for s in both]
    truth = town.true_slope_percent[rows]
    for found in (ubx, csv):
        assert np.mean(np.abs(found[:, 0] - truth) < 1.96 * found[:, 1]) > 0.8
