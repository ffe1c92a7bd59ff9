"""GnssLogger texts: positions, and what version to version changes in their columns."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fusion.errors import EmptyLogError, LogError, MalformedLogError
from fusion.formats import FORMATS, read_log
from fusion.types import no_progress
from log_support import same


def test_positions_are_those_of_the_satellite_receiver(samples: dict[str, bytes]) -> None:
    log = read_log(samples["gnsslogger"])
    assert len(log.fix) == len(log.velocity) == 20
    assert np.all(log.fix.lat_deg < 51)
    assert log.fix.height_ell_m[0] == 158.2
    assert (log.fix.h_acc_m[0], log.fix.v_acc_m[0], log.velocity.s_acc_mps[0]) == (3.8, 5.0, 0.2)
    assert np.hypot(log.velocity.vel_n_mps, log.velocity.vel_e_mps) == pytest.approx(7.1)
    assert log.raw is not None
    assert len(log.raw.signals) == 20
    assert not len(log.force)


def test_old_names_of_columns_are_known() -> None:
    log = read_log(
        b"# Raw,ElapsedRealtimeMillis,TimeNanos,ReceivedSvTimeNanos\n#\n"
        b"# Fix,Provider,Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs\n"
        b"Fix,gps,50.95,1.88,100.5,3.0,0.0,1525448060000\nFix,network,1,1,1,1,1,1525448061000\n"
    )
    assert (log.fix.time_s[0], log.fix.lat_deg[0], log.fix.height_ell_m[0]) == (1525448060, 50.95, 100.5)
    assert np.isnan(log.fix.h_acc_m[0])
    assert len(log.fix) == 1


def test_sentences_among_the_lines_change_nothing(samples: dict[str, bytes]) -> None:
    sentences = b"".join(b"NMEA," + line + b",1525448060000\n" for line in samples["nmea"].splitlines())
    assert same(read_log(samples["gnsslogger"] + sentences), read_log(samples["gnsslogger"]))


def test_damaged_lines_cost_themselves_only(make: SimpleNamespace) -> None:
    lines = [
        f"Fix,GPS,{lat},1.88,158.2,7.1,3.8,348,{1525448060000 + 1000 * k},0.2,,1,5.0"
        for k, lat in enumerate(["50.95", "x", "91", "", "50.96"])
    ]
    log = read_log(make.gnsslogger([*lines, "Fix,GPS,50.97", make.raw_line("G", 3, 10**12, 7 * 10**7)]))
    assert log.fix.lat_deg.tolist() == [50.95, 50.96]
    assert log.skipped["incomplete position"] == 2
    assert log.skipped["latitude out of range"] == 1
    assert log.skipped["Fix lines with another number of cells"] == 1
    assert log.raw is not None
    assert log.raw.signals.number.tolist() == [3]


def test_a_text_without_anything_to_use_says_why(make: SimpleNamespace) -> None:
    with pytest.raises(MalformedLogError, match="no line after it"):
        read_log(make.gnsslogger([]))
    with pytest.raises(EmptyLogError, match="no usable position"):
        read_log(make.gnsslogger(["Accel,1,2,3"]))
    with pytest.raises(EmptyLogError, match="no usable pseudorange"):
        read_log(make.gnsslogger([make.raw_line("G", 3, 10**12, 7 * 10**7, State=0)]))


def test_the_shared_recordings_read(shared_data: Path) -> None:
    folder = shared_data / "formats"
    log = read_log(folder / "gnsslogger_pixel6.txt")
    assert len(log.fix) == 94
    assert log.raw is not None
    assert (len(log.raw.signals), len(log.raw.signals.system)) == (31, 619)
    small = read_log(folder / "gnsslogger_Pixel4_GnssLog.txt")
    assert small.raw is not None
    assert (len(small.fix), len(small.raw.signals), len(small.raw.signals.system)) == (2, 1, 21)
    with pytest.raises(LogError):  # a line of each sensor, and nothing of satellites
        read_log(folder / "gnsslogger_all_sensors.txt")


FLP_FIX = "Fix,FLP,50.95,1.88,158.2,7.1,3.8,348,1525448060000,0.2,,1,5.0"
NLP_FIX = "Fix,NLP,50.99,1.88,8.3,,15.1,,1525448061000,,,2,2.6"


def test_without_the_receivers_own_positions_the_phones_mix_is_taken_and_said(make: SimpleNamespace) -> None:
    log = read_log(make.gnsslogger([FLP_FIX, NLP_FIX]))
    assert log.fix.lat_deg.tolist() == [50.95]
    assert any("no positions of the satellite receiver itself" in warning for warning in log.warnings)
    with pytest.raises(EmptyLogError):
        read_log(make.gnsslogger([NLP_FIX]))


SENSOR_HEADER = (
    b"# Accel,utcTimeMillis,elapsedRealtimeNanos,AccelXMps2,AccelYMps2,AccelZMps2\n"
    b"# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,BiasXMps2\n"
    b"# UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec\n"
    b"# Pressure,utcTimeMillis,elapsedRealtimeNanos,PressureHpa\n"
    b"# OrientationDeg,utcTimeMillis,elapsedRealtimeNanos,yawDeg,rollDeg,pitchDeg\n"
    b"# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
    b"UnixTimeMillis\n"
)


def sensor_text() -> bytes:
    """Three seconds of sensors whose time of day jitters by milliseconds and whose other clock does not."""
    lines = [b"Fix,GPS,50.95,1.88,158.2,7.1,3.8,348,1525448060000"]
    for k in range(300):
        utc, even = 1525448060000 + 10 * k + k % 3, 5_000_000_000 + 10_000_000 * k
        lines.append(b"Accel,%d,%d,0.1,9.8,0.2" % (utc, even))
        lines.append(b"UncalAccel,%d,%d,1,1,1,0" % (utc, even))
        lines.append(b"UncalGyro,%d,%d,0.01,0.02,0.03" % (utc, even))
        lines.append(b"OrientationDeg,%d,%d,245.0,0.0,-2.0" % (utc, even))
    lines.append(b"Pressure,1525448061000,6000000000,1002.5")
    return SENSOR_HEADER + b"\n".join(lines) + b"\n"


def test_sensors_are_read_in_the_phones_axes_on_the_clock_that_runs_evenly() -> None:
    device = FORMATS["gnsslogger"].read(sensor_text(), no_progress).device
    assert (device.force.x[0], device.force.y[0], device.force.z[0]) == (0.1, 9.8, 0.2)
    assert (device.rate.x[0], device.rate.y[0], device.rate.z[0]) == (0.01, 0.02, 0.03)
    assert np.diff(device.force.time_s) == pytest.approx(0.01, abs=1e-6)
    assert device.force.time_s[0] == pytest.approx(1525448060.001, abs=1e-3)
    log = read_log(sensor_text())
    assert log.pressure.pressure_pa.tolist() == [100250]
    assert log.pressure.time_s[0] == pytest.approx(1525448061, abs=0.01)
    assert not len(log.force)  # three seconds tell nothing of how the phone lies
    assert not len(log.attitude)
    assert any("on for 2.99 s only" in warning for warning in log.warnings)
