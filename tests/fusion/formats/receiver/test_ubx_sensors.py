"""What a receiver says of its sensors, written by pyubx2 and minded here."""

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
