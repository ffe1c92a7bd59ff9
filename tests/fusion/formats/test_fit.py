"""FIT."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import fitdecode
import numpy as np
import pytest

import garmin_files as g
from fusion.errors import EmptyLogError, LogError, MalformedLogError
from fusion.formats import FORMATS, read_log
from fusion.types import no_progress

START_S = g.START.timestamp()
RIDES = ("Edge810-Vector-2013-08-16-15-35-10", "2019-02-17-062644-ELEMNT-297E-195-0", "garmin-edge-820-bike")


def seconds(k: float) -> object:
    """A time of the ride."""
    return g.START + timedelta(seconds=k)


def by_the_library(path: Path) -> list[dict[str, float]]:
    """The records that have a position, as fitdecode gives them."""
    wanted = (
        "timestamp",
        "position_lat",
        "position_long",
        "enhanced_altitude",
        "enhanced_speed",
        "gps_accuracy",
    )
    out = []
    with fitdecode.FitReader(path) as reader:
        for frame in reader:
            if isinstance(frame, fitdecode.FitDataMessage) and frame.name == "record":
                row = {name: frame.get_value(name, fallback=None) for name in wanted}
                row["timestamp"] = row["timestamp"].timestamp()
                out.append({name: np.nan if value is None else value for name, value in row.items()})
    return out


@pytest.mark.parametrize("name", RIDES)
def test_numbers_of_real_rides_are_the_librarys(shared_data: Path, name: str) -> None:
    path = shared_data / "formats" / f"{name}.fit"
    rows = by_the_library(path)
    told = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    log = read_log(path)
    placed = np.isfinite(told["position_lat"])
    assert len(log.fix) == placed.sum() > 10
    assert np.array_equal(log.fix.time_s, told["timestamp"][placed])
    assert log.fix.lat_deg == pytest.approx(told["position_lat"][placed] * 180 / 2**31, abs=1e-9)
    assert log.fix.lon_deg == pytest.approx(told["position_long"][placed] * 180 / 2**31, abs=1e-9)
    assert np.array_equal(log.fix.alt_msl_m, told["enhanced_altitude"][placed], equal_nan=True)
    assert np.array_equal(log.fix.h_acc_m, told["gps_accuracy"][placed], equal_nan=True)
    fast = np.isfinite(told["enhanced_speed"])
    assert np.array_equal(log.odometry.time_s, told["timestamp"][fast])
    assert np.array_equal(log.odometry.speed_mps, told["enhanced_speed"][fast])
    assert log.fix.has("alt_msl_m") and log.odometry.has("speed_mps") and not log.warnings


def test_every_real_file_is_read_or_refused_with_its_reason(shared_data: Path) -> None:
    folder = shared_data / "formats"
    reasons = {
        "Settings": "holds a device's settings, no recording",
        "20170518-191602-1740899583": r"1641 records of this FIT file \(indoor rowing\) has a position",
        "garmin-fr935-cr": "7515 records of this FIT file has a position: .* under water",
    }
    damaged = {
        "activity-filecrc": "checksum",
        "activity-unexpected-eof": "ends early: the 21 messages up to byte 768",
    }
    for name, reason in reasons.items():
        with pytest.raises(EmptyLogError, match=reason):
            read_log(folder / f"{name}.fit")
    for name, reason in damaged.items():
        log = read_log(folder / f"{name}.fit")
        assert len(log.fix) == 14
        assert [w for w in log.warnings if reason in w] == list(log.warnings) != []


def test_pauses_of_the_timer_are_gaps(shared_data: Path) -> None:
    ride = g.fit([
        g.file_id(), g.timer(seconds(0), g.STARTED), *(g.record(seconds(k)) for k in range(10)),
        g.timer(seconds(9), g.STOPPED), g.timer(seconds(60), g.STARTED),
        *(g.record(seconds(k)) for k in range(60, 70)),
        # stopped and started again within a step, and recorded all the same
        g.timer(seconds(69), g.STOPPED), g.timer(seconds(70), g.STARTED),
        *(g.record(seconds(k)) for k in range(70, 75)),
        g.timer(seconds(72), g.STOPPED), g.timer(seconds(80), g.STARTED),
        *(g.record(seconds(k)) for k in range(75, 90)),
    ])  # fmt: skip
    assert (read_log(ride).outages_s - START_S).tolist() == [60]
    log = read_log(shared_data / "formats" / f"{RIDES[1]}.fit")
    steps = np.diff(log.fix.time_s)
    assert 40 < len(log.outages_s) <= 57
    assert np.isin(log.fix.time_s[1:][steps > 60], log.outages_s).all()


def test_a_chain_of_files_is_one_drive_with_gaps_between() -> None:
    log = read_log(g.drive_fit() + g.drive_fit(start=seconds(100)))
    assert len(log.fix) == 40
    assert (log.outages_s - START_S).tolist() == [100]
    broken = bytearray(g.drive_fit())
    broken[40] = 0x09  # a message of a kind that nothing has defined
    log = read_log(bytes(broken) + g.drive_fit(start=seconds(100)))
    assert len(log.fix) == 20
    assert any("is damaged before byte" in w for w in log.warnings)


def test_a_file_cut_anywhere_gives_what_is_whole() -> None:
    whole = g.drive_fit()
    counts = []
    for cut in range(0, len(whole), 7):
        try:
            log = read_log(whole[:cut])
        except LogError as error:
            assert str(error).endswith(".")
        else:
            counts.append(len(log.fix))
            assert any("ends early" in w for w in log.warnings)
    assert counts == sorted(counts) and counts[0] == 1 and counts[-1] == 20


def test_a_file_that_was_never_closed_is_read_to_its_end() -> None:
    whole = g.drive_fit()
    for size in (len(whole) - 2, len(whole) - 40):
        log = read_log(whole[:4] + bytes(4) + whole[8:size])
        assert len(log.fix) >= 19
        assert [w for w in log.warnings if "never closed" in w] == list(log.warnings)


def test_cameras_have_velocity_and_pressure_at_their_own_times() -> None:
    powered_s = 40  # the camera was switched on so long before
    metadata = [
        (g.GPS_METADATA, [
            (253, "I", powered_s + k), (0, "H", 250), (1, "i", g.semicircles(50.95)), (2, "i", g.semicircles(1.88)),
            (3, "I", (112 + 500) * 5), (6, "I", g.stamp(seconds(k))), (7, "h", (100, 700, -50)),
        ])
        for k in range(10)
    ]  # fmt: skip
    pressures = [
        (253, "I", powered_s + 1),
        (0, "H", 500),
        (1, "H", (0, 100, 200)),
        (2, "I", (99000, 99010, 99020)),
    ]
    barometer = (g.BAROMETER, pressures)
    counts = (
        g.ACCELEROMETER,
        [(253, "I", powered_s), (0, "H", 0), (1, "H", (0, 10)), (2, "H", (2000, 2010))],
    )
    log = read_log(g.fit([g.file_id(), *metadata, barometer, counts]))
    assert (log.fix.time_s - START_S).tolist() == pytest.approx(np.arange(10.0))
    assert log.fix.alt_msl_m.tolist() == [112] * 10
    assert log.velocity.vel_e_mps.tolist() == [1] * 10
    assert log.velocity.vel_n_mps.tolist() == [7] * 10
    assert log.velocity.vel_d_mps.tolist() == [0.5] * 10
    assert (log.pressure.time_s - START_S).tolist() == pytest.approx([1.25, 1.35, 1.45])
    assert log.pressure.pressure_pa.tolist() == [99000, 99010, 99020]
    assert log.skipped["accelerometer_data samples that are not calibrated"] == 2
    unknown = [(number, [field for field in fields if field[0] != 6]) for number, fields in metadata]
    with pytest.raises(EmptyLogError, match="it has no time"):
        read_log(g.fit([g.file_id(), *unknown]))


def test_calibrated_inertial_samples_are_along_the_devices_axes() -> None:
    head = [(253, "I", g.stamp(seconds(1))), (0, "H", 500), (1, "H", (0, 40))]
    force = (g.ACCELEROMETER, [*head, (5, "f", (0.5, 0.25)), (6, "f", (0.0, 0.0)), (7, "f", (1.0, -1.0))])
    rate = (g.GYROSCOPE, [*head, (5, "f", (90.0, 180.0)), (6, "f", (0.0, 0.0)), (7, "f", (0.0, 0.0))])
    ragged = (g.GYROSCOPE, [*head, (5, "f", (90.0, 180.0, 45.0)), (6, "f", (0.0, 0.0)), (7, "f", (0.0, 0.0))])
    sample = g.fit([g.file_id(), *(g.record(seconds(k)) for k in range(5)), force, rate, ragged])
    device = FORMATS["fit"].read(sample, no_progress).device
    assert (device.force.time_s - START_S).tolist() == pytest.approx([1.5, 1.54])
    assert device.force.x == pytest.approx([0.5 * 9.80665, 0.25 * 9.80665])
    assert device.force.z == pytest.approx([9.80665, -9.80665])
    assert device.rate.x == pytest.approx([np.pi / 2, np.pi])
    # two samples tell nothing of how the device lies in the vehicle
    log = read_log(sample)
    assert len(log.force) == 0
    assert any("The device's accelerometer and gyroscope are left out" in w for w in log.warnings)


def test_pressure_of_records_counts_where_no_altitude_is_made_of_it() -> None:
    def ride(altitude: bool) -> bytes:
        rows = [g.record(seconds(k), pressure=(91, "I", 99000 + k)) for k in range(5)]
        keep = [(n, [f for f in fields if altitude or f[0] != 2]) for n, fields in rows]
        return g.fit([g.file_id(), *keep])

    with_altitude, without = read_log(ride(True)), read_log(ride(False))
    assert len(with_altitude.pressure) == 0 and with_altitude.fix.has("alt_msl_m")
    assert with_altitude.skipped["pressures of records whose altitude is made of them"] == 5
    assert without.pressure.pressure_pa.tolist() == [99000, 99001, 99002, 99003, 99004]
    assert without.pressure.temperature_k == pytest.approx(np.full(5, 293.15))


def test_what_nobody_drove_is_refused() -> None:
    with pytest.raises(EmptyLogError, match="a planned course"):
        read_log(g.fit([g.file_id(g.COURSE), g.record(g.START)]))
    with pytest.raises(EmptyLogError, match="virtual ride"):
        read_log(g.fit([g.file_id(), g.record(g.START), (g.SESSION, [(6, "E", 58)])]))
    with pytest.raises(EmptyLogError, match="no record messages"):
        read_log(g.fit([g.file_id()]))
    with pytest.raises(MalformedLogError, match=r"no record before its damage.*ends early"):
        read_log(g.drive_fit()[:40])


def test_the_field_itself_counts_before_a_part_of_another() -> None:
    fine = g.record(g.START, fine=(78, "I", round((113.4 + 500) * 5)))
    for fields in (fine[1], fine[1][::-1]):
        assert read_log(g.fit([g.file_id(), (g.RECORD, fields)])).fix.alt_msl_m.tolist() == [
            pytest.approx(113.4)
        ]


def test_absurd_values_and_invalid_ones_are_no_measurements() -> None:
    rows = [g.record(seconds(k)) for k in range(5)]
    invalid = (g.RECORD, [(253, "I", g.stamp(seconds(5))), (0, "i", 0x7FFFFFFF), (1, "i", 0x7FFFFFFF)])
    late = g.record(seconds(6))[1]
    late[0] = (253, "I", 0xFFFFFFFE)
    north = (g.RECORD, [(253, "I", g.stamp(seconds(7))), (0, "i", g.semicircles(120)), (1, "i", 0)])
    log = read_log(g.fit([g.file_id(), *rows, invalid, (g.RECORD, late), north]))  # type: ignore[list-item]
    assert len(log.fix) == 5
    assert log.skipped["records without a position"] == 1
    assert log.skipped["impossible time"] == log.skipped["latitude out of range"] == 1
