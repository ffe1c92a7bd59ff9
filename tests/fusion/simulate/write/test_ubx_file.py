"""UBX files, read by pyubx2 as an independent reader."""

from __future__ import annotations

from collections import defaultdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyubx2 import ERR_RAISE, VALCKSUM, UBXReader

from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import GEOID_UNDULATION_M, Town
from fusion.simulate.write.csv_file import csv_columns
from fusion.simulate.write.ubx_file import write_ubx

GPS_EPOCH_S = 315964800
LEAP_SECONDS = 18


@pytest.fixture(scope="module")
def drive(town: Town) -> SimulatedDrive:
    return simulate_drive(town, 21, 90.0, rate_hz=2.0, outages=[(0.0, 5.0), (40.0, 10.0)])


@pytest.fixture(scope="module")
def messages(drive: SimulatedDrive, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    path: Path = tmp_path_factory.mktemp("ubx") / "drive.ubx"
    write_ubx(drive, path)
    with path.open("rb") as stream:
        reader = UBXReader(stream, validate=VALCKSUM, quitonerror=ERR_RAISE)
        read = [(raw, parsed) for raw, parsed in reader]
    assert b"".join(raw for raw, _ in read) == path.read_bytes()  # nothing passed over
    return [parsed for _, parsed in read]


@pytest.fixture(scope="module")
def by_name(messages: list[Any]) -> dict[str, list[Any]]:
    groups: dict[str, list[Any]] = defaultdict(list)
    for message in messages:
        groups[message.identity].append(message)
    return groups


def column(group: list[Any], name: str) -> np.ndarray:
    return np.array([getattr(m, name) for m in group], float)


def test_each_epoch_has_its_messages(drive: SimulatedDrive, by_name: dict[str, list[Any]]) -> None:
    assert set(by_name) == {"NAV-PVT", "NAV-ATT", "NAV-EOE", "ESF-MEAS"}
    week_ms = 7 * 86400 * 1000
    expected = np.round((drive.time_s - GPS_EPOCH_S + LEAP_SECONDS) * 1000) % week_ms
    for name in ("NAV-PVT", "NAV-ATT", "NAV-EOE"):
        np.testing.assert_array_equal(column(by_name[name], "iTOW"), expected)


def test_pvt_clock(drive: SimulatedDrive, by_name: dict[str, list[Any]]) -> None:
    for message, time_s in zip(by_name["NAV-PVT"], drive.time_s, strict=True):
        m = message
        assert (m.validDate, m.validTime, m.fullyResolved) == (1, 1, 1)
        whole = datetime(m.year, m.month, m.day, m.hour, m.min, m.second, tzinfo=UTC).timestamp()
        assert abs(m.nano) <= 5e8
        assert whole + m.nano * 1e-9 == pytest.approx(time_s, abs=1e-6)


def test_pvt_positions_and_velocities(drive: SimulatedDrive, by_name: dict[str, list[Any]]) -> None:
    pvt, fix, table = by_name["NAV-PVT"], drive.has_gnss, csv_columns(drive)
    np.testing.assert_array_equal(column(pvt, "fixType"), np.where(fix, 3, 0))
    np.testing.assert_array_equal(column(pvt, "gnssFixOk"), fix)
    for name, reference, unit in (
        ("lon", "lon_deg", 1.0),
        ("lat", "lat_deg", 1.0),
        ("hMSL", "alt_msl_m", 1e-3),
        ("velN", "vel_n_mps", 1e-3),
        ("velE", "vel_e_mps", 1e-3),
        ("velD", "vel_d_mps", 1e-3),
        ("hAcc", "h_acc_m", 1e-3),
        ("vAcc", "v_acc_m", 1e-3),
        ("sAcc", "s_acc_mps", 1e-3),
    ):
        step = 1e-7 if unit == 1.0 else 1e-3
        np.testing.assert_allclose(column(pvt, name)[fix] * unit, table[reference][fix], atol=0.51 * step)
    ellipsoidal = column(pvt, "height") - column(pvt, "hMSL")
    np.testing.assert_allclose(ellipsoidal[fix] / 1e3, GEOID_UNDULATION_M, atol=2e-3)
    speed = np.hypot(table["vel_n_mps"], table["vel_e_mps"])
    np.testing.assert_allclose(column(pvt, "gSpeed")[fix] / 1e3, speed[fix], atol=1e-3)


def test_without_a_fix_nothing_is_claimed(drive: SimulatedDrive, by_name: dict[str, list[Any]]) -> None:
    lost = [m for m, fix in zip(by_name["NAV-PVT"], drive.has_gnss, strict=True) if not fix]
    assert len(lost) >= 20
    assert all(m.hAcc > 1e6 and m.vAcc > 1e6 and m.numSV == 0 for m in lost)
    assert (lost[0].lon, lost[0].lat) == (0, 0)  # the drive begins without a fix
    assert abs(lost[-1].lat - drive.town.node_lat_deg.mean()) < 0.02  # later it repeats the last one


def test_attitude(drive: SimulatedDrive, by_name: dict[str, list[Any]]) -> None:
    att, imu = by_name["NAV-ATT"], drive.inertial
    np.testing.assert_allclose(np.radians(column(att, "pitch")), imu.pitch_rad, atol=2e-7)
    np.testing.assert_allclose(np.radians(column(att, "roll")), imu.roll_rad, atol=2e-7)
    turn = np.radians(column(att, "heading")) - imu.yaw_rad
    np.testing.assert_allclose(np.cos(turn), 1.0, atol=1e-9)
    assert np.all(column(att, "accPitch") == pytest.approx(drive.profile.pitch_acc_deg, abs=1e-5))


def signed(field: int) -> int:
    return field - (1 << 24) if field >= 1 << 23 else field


def test_inertial_measurements(drive: SimulatedDrive, by_name: dict[str, list[Any]]) -> None:
    esf = by_name["ESF-MEAS"]
    tag = column(esf, "timeTag")
    elapsed = (tag - tag[0]) / 1e3
    np.testing.assert_allclose(np.diff(elapsed), 0.1, atol=2e-3)
    assert elapsed[-1] == pytest.approx(drive.motion.duration_s, abs=0.2)
    assert all(m.numMeas == 6 for m in esf)
    scale = {16: 2**-10, 17: 2**-10, 18: 2**-10, 14: 2**-12, 13: 2**-12, 5: 2**-12}
    values: dict[int, list[float]] = defaultdict(list)
    for m in esf:
        for k in range(1, 7):
            kind = getattr(m, f"dataType_{k:02d}")
            values[kind].append(signed(getattr(m, f"dataField_{k:02d}")) * scale[kind])
    assert set(values) == set(scale)
    readings = drive.inertial_at(np.arange(len(esf), dtype=np.float64) * 0.1 + 0.007)
    force = np.column_stack([values[k] for k in (16, 17, 18)])
    rate = np.column_stack([values[k] for k in (14, 13, 5)])
    np.testing.assert_allclose(force, readings.force_mps2, atol=0.51 / 2**10)
    np.testing.assert_allclose(rate, np.degrees(readings.rate_radps), atol=0.51 / 2**12)
    assert np.mean(force[:, 2]) == pytest.approx(9.8, abs=0.3)
    assert np.min(rate) < 0 < np.max(rate)


def test_sensor_clocks_differ_between_drives_and_drift_little(town: Town, tmp_path: Path) -> None:
    offsets = []
    for seed in (31, 32, 33):
        made = simulate_drive(town, seed, 60.0)
        write_ubx(made, tmp_path / "x.ubx")
        with (tmp_path / "x.ubx").open("rb") as stream:
            tags = [m.timeTag for _, m in UBXReader(stream) if m.identity == "ESF-MEAS"]
        offsets.append(tags[0])
        span = (tags[-1] - tags[0]) % 2**32
        assert span == pytest.approx(100 * (len(tags) - 1), rel=1e-3)
    assert len(set(offsets)) == 3


def test_messages_stand_in_the_order_of_sending(messages: list[Any]) -> None:
    names = [m.identity for m in messages]
    nav = [n for n in names if n != "ESF-MEAS"]
    assert nav == ["NAV-PVT", "NAV-ATT", "NAV-EOE"] * (len(nav) // 3)
    between = np.diff([k for k, n in enumerate(names) if n == "NAV-PVT"]) - 3
    assert set(between) <= {4, 5, 6}  # ESF-MEAS at 10 Hz between epochs at 2 Hz
