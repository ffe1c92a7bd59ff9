"""Sensor messages (ESF): means and raw samples, counters, and what a receiver says of its sensors."""

from __future__ import annotations

from datetime import timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage

from fusion.formats import read_log
from fusion.formats.receiver.ubx_frames import frame

FAULTY = "sensor readings that the receiver marks as faulty"
SIX = (16, 17, 18, 14, 13, 5)


def status(itow_ms: int, *sensors: dict[str, int]) -> bytes:
    """One ESF-STATUS; each sensor by pyubx2's names without the number of its group."""
    fields: dict[str, Any] = {"iTOW": itow_ms, "version": 2, "fusionMode": 1, "numSens": len(sensors)}
    for k, sensor in enumerate(sensors, 1):
        whole = {"used": 1, "ready": 1, "calibStatus": 3, "timeStatus": 1, "freq": 10} | sensor
        fields |= {f"{name}_{k:02d}": value for name, value in whole.items()}
    return bytes(UBXMessage("ESF", "ESF-STATUS", GET, **fields).serialize())


def drive(make: SimpleNamespace, seconds: int, sensors: Any) -> bytes:
    """One measurement of each sensor half a second before each epoch, whose status follows it."""
    out = b""
    for k in range(seconds):
        when = make.start + timedelta(seconds=k)
        out += make.esf_meas(1000 * k + 500, [(t, 1024) for t in SIX])
        out += make.pvt(when) + status(make.itow_ms(when), *sensors(k))
    return out


def test_healthy_sensors_need_no_word(make: SimpleNamespace) -> None:
    log = read_log(drive(make, 10, lambda k: [{"type": t} for t in SIX]))
    assert (len(log.force), len(log.rate)) == (10, 10)
    assert not log.warnings and not log.skipped


@pytest.mark.parametrize("fault", ["badMeas", "badTTag", "noisyMeas"])
def test_readings_before_a_status_with_a_fault_are_left_out(make: SimpleNamespace, fault: str) -> None:
    """Only those of that sensor, and only since the status before."""
    sample = drive(make, 10, lambda k: [{"type": t, fault: int(t == 16 and k in (3, 4))} for t in SIX])
    log = read_log(sample)
    assert log.skipped[FAULTY] == 2
    assert np.flatnonzero(np.isnan(log.force.acc_x_mps2)).tolist() == [3, 4]
    assert np.isfinite(log.force.acc_z_mps2).all()
    assert np.isfinite(log.rate.gyr_x_radps).all()


def test_missing_measurements_spoil_none_that_are_there(make: SimpleNamespace) -> None:
    log = read_log(drive(make, 5, lambda k: [{"type": t, "missingMeas": 1} for t in SIX]))
    assert len(log.force) == 5 and not log.skipped


def test_a_sensor_that_is_faulty_throughout_is_missing(make: SimpleNamespace) -> None:
    log = read_log(drive(make, 5, lambda k: [{"type": t, "badMeas": int(t > 15)} for t in SIX]))
    assert "force" in log.missing
    assert len(log.rate) == 5
    assert log.skipped[FAULTY] == 15


def test_raw_messages_are_judged_alike(make: SimpleNamespace) -> None:
    out = b""
    for k in range(6):
        when = make.start + timedelta(seconds=k)
        out += make.esf_raw([(t, 512, 25600 * k + 12800) for t in SIX])
        out += make.pvt(when) + status(make.itow_ms(when), {"type": 18, "noisyMeas": int(k == 2)})
    log = read_log(out)
    assert np.flatnonzero(np.isnan(log.force.acc_z_mps2)).tolist() == [2]


def test_uncalibrated_sensors_are_used_and_counted(make: SimpleNamespace) -> None:
    """The readings are raw whatever the calibration; what it concerns is the receiver's own attitude."""

    def sensors(k: int) -> list[dict[str, int]]:
        return [{"type": t, "calibStatus": (0 if k < 2 else 1 if k < 4 else 2) if t > 15 else 3} for t in SIX]

    log = read_log(drive(make, 10, sensors))
    assert (len(log.force), len(log.rate)) == (10, 10)
    assert not log.skipped
    (said,) = log.warnings
    assert "accelerometer in 4 of 10 status messages" in said


def test_readings_after_the_last_status_and_other_sensors_are_kept(make: SimpleNamespace) -> None:
    ends = drive(make, 3, lambda k: [{"type": 16, "badMeas": 1}]) + make.esf_meas(3500, [(16, 1024)])
    log = read_log(ends)
    assert np.isfinite(log.force.acc_x_mps2).tolist() == [False, False, False, True]
    assert np.isfinite(log.force.acc_y_mps2[:3]).all()


def test_what_follows_the_promised_sensors_is_none(make: SimpleNamespace) -> None:
    whole = bytearray(status(make.itow_ms(make.start), {"type": 16}, {"type": 17, "badMeas": 1})[6:-2])
    whole[15] = 1
    sample = make.esf_meas(500, [(16, 1024), (17, 1024)]) + make.pvt() + frame(0x10, 0x10, bytes(whole))
    assert not read_log(sample).skipped


def test_a_status_that_promises_more_sensors_than_it_holds_is_read_as_far_as_it_goes(
    make: SimpleNamespace,
) -> None:
    whole = bytearray(status(make.itow_ms(make.start), {"type": 16, "badMeas": 1})[6:-2])
    whole[15] = 200
    sample = make.esf_meas(500, [(16, 1024), (17, 1024)]) + make.pvt() + frame(0x10, 0x10, bytes(whole))
    log = read_log(sample + frame(0x10, 0x10, bytes(7)))
    assert log.skipped[FAULTY] == 1


def test_raw_messages_of_many_samples_with_a_wrapping_counter(make: SimpleNamespace) -> None:
    out = b""
    for k in range(40):
        out += make.pvt(make.start + timedelta(seconds=k))
        for j in range(10):
            tags = [(2**24 - 200_000 + round((k + j / 10 + i / 100) * 25600)) % 2**24 for i in range(1, 11)]
            out += make.esf_raw(
                [w for i, t in enumerate(tags) for w in ((16, i, t), (17, 0, t), (18, 10042, t))]
            )
    log = read_log(out)
    assert len(log.force) == 4000
    expected = make.start_s + 0.01 + np.arange(4000) / 100
    assert np.abs(log.force.time_s - expected).max() < 0.06
    assert log.force.acc_x_mps2[:10] == pytest.approx(np.arange(10) / 1024)


def test_means_are_preferred_to_the_raw_samples_they_are_made_of(make: SimpleNamespace) -> None:
    out = b""
    for k in range(30):
        out += make.pvt(make.start + timedelta(seconds=k))
        for j in range(10):
            ms = 1000 * k + 100 * j + 50
            out += make.esf_raw([(16, 2048, round(ms * 25.6)), (17, 0, round(ms * 25.6))])
            out += make.esf_meas(ms, [(16, 1024), (17, 0), (18, 10042)])
    log = read_log(out)
    assert len(log.force) == 300
    assert (log.force.acc_x_mps2 == 1).all()


def test_speed_and_wheel_ticks(make: SimpleNamespace) -> None:
    out = b"".join(
        make.pvt(make.start + timedelta(seconds=k)) + make.esf_meas(1000 * k + 500, [(11, 7123), (8, 55)])
        for k in range(5)
    )
    log = read_log(out)
    assert log.odometry.speed_mps == pytest.approx(np.full(5, 7.123))
    assert sum(n for reason, n in log.skipped.items() if "wheel ticks" in reason) == 5


def test_each_sensor_id_has_its_own_counter(make: SimpleNamespace) -> None:
    """An external speed sensor (id 3, its own clock) beside the receiver's accelerometer."""
    out = b""
    for k in range(20):
        out += make.pvt(make.start + timedelta(seconds=k))
        out += make.esf_meas(1000 * k + 500, [(16, 1024), (17, 0), (18, 10042)])
        out += make.esf_meas(900_000_000 + 1000 * k + 500, [(11, 7000)], sensor=3)
    log = read_log(out)
    expected = make.start_s + 0.5 + np.arange(20)
    assert log.force.time_s == pytest.approx(expected, abs=0.01)
    assert log.odometry.time_s == pytest.approx(expected, abs=0.01)


def test_an_uncalibrated_measurement_has_one_word_more(make: SimpleNamespace) -> None:
    log = read_log(make.pvt() + make.esf_meas(5, [(16, 1024), (17, 0), (18, 10042)], calibrated=False))
    assert log.force.acc_z_mps2 == pytest.approx([10042 / 1024])
