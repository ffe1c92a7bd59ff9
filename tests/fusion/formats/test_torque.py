"""CSVs of OBD apps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fusion.errors import MalformedLogError
from fusion.formats import FORMATS, read_log
from fusion.formats.tables.cells import NO_OFFSET

HEADER = "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second), Altitude, Bearing"
MIDNIGHT_S = 1_520_208_000.0  # 2018-03-05


def torque(*rows: str, more: str = "") -> bytes:
    """A log with these rows."""
    return "\n".join([HEADER + more, *rows, ""]).encode()


def row(second: int, gps: str = "", more: str = "") -> str:
    """A row at 10:11 and so many seconds, German time, on 5 March 2018."""
    gps = gps or f"Mon Mar 05 10:11:{second:02d} GMT+01:00 2018"
    return f"{gps},05-Mar-2018 10:11:{second:02d}.500,8.4,{49 + second * 1e-4:.4f},11.1,120.5,0{more}"


def test_every_column_reaches_its_table_in_si_units(make: SimpleNamespace) -> None:
    log = read_log(make.torque())
    assert log.source_format == "torque"
    assert log.fix.time_s[0] == make.start_s
    assert (log.fix.lat_deg[0], log.fix.lon_deg[0], log.fix.alt_msl_m[0]) == (50.95, 1.88, 112)
    assert np.hypot(log.velocity.vel_n_mps, log.velocity.vel_e_mps) == pytest.approx(7.1)
    assert np.isnan(log.velocity.vel_d_mps).all()
    assert log.odometry.speed_mps == pytest.approx(25.6 / 3.6)
    assert len(log.odometry) == 19  # the first row has a dash
    assert log.pressure.pressure_pa[0] == pytest.approx(14.5 * 6894.757)
    assert not log.skipped


def test_times_of_positions_are_the_receivers_and_others_lie_between() -> None:
    log = read_log(torque(row(1, more=",36"), row(2, more=",36"), more=",Speed (OBD)(km/h)"))
    assert log.fix.time_s.tolist() == [MIDNIGHT_S + 9 * 3600 + 11 * 60 + s for s in (1, 2)]
    # the phone's clock, set by the receiver's: a constant lag is not told from a wrong clock
    assert np.diff(log.odometry.time_s).tolist() == [1.0]
    assert NO_OFFSET not in log.warnings


def test_without_gps_time_the_phones_clock_is_read_as_utc_and_that_is_said() -> None:
    log = read_log(torque(row(1, gps="-"), row(2, gps="-")))
    assert log.fix.time_s.tolist() == [MIDNIGHT_S + 10 * 3600 + 11 * 60 + s + 0.5 for s in (1, 2)]
    bare = read_log("\n".join([HEADER.split(",", 1)[1].strip(), row(1).split(",", 1)[1], ""]).encode())
    assert NO_OFFSET in bare.warnings
    assert bare.source_format == "torque"


def test_headers_in_the_middle_are_no_rows_and_may_change_the_columns() -> None:
    again = torque(row(1), row(2), HEADER, row(3))
    log = read_log(again)
    assert len(log.fix) == 3
    assert not log.skipped
    assert log.repaired["headers repeated among the rows"] == 1
    other = HEADER.replace(" Altitude,", "") + ",Speed (OBD)(mph)"
    changed = row(4).replace(",120.5", "") + ",10"
    log = read_log(torque(row(1), row(2), other, changed))
    assert len(log.fix) == 3
    assert np.isfinite(log.fix.alt_msl_m).tolist() == [True, True, False]
    assert log.odometry.speed_mps.tolist() == [pytest.approx(4.4704)]


def test_a_fault_behind_a_repeated_header_is_on_its_line() -> None:
    log = read_log(torque(row(1), HEADER, row(2), HEADER + ",x", row(3).replace("49.0003", "999") + ",1"))
    assert any("line 6: lat_deg is 999" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("unit", "factor"), [("kPa", 1000), ("psi", 6894.757), ("mb", 100), ("inHg", 3386.389)]
)
def test_units_of_pressure(unit: str, factor: float) -> None:
    log = read_log(torque(row(1, more=",14"), more=f",Barometric pressure (from vehicle)({unit})"))
    assert log.pressure.pressure_pa[0] == pytest.approx(14 * factor, rel=1e-6)


def test_a_cars_barometer_of_one_kilopascal_is_left_out() -> None:
    rows = [row(k % 60, more=f",{99 + k // 30}").replace("10:11", f"10:{11 + k // 60}") for k in range(120)]
    log = read_log(torque(*rows, more=",Barometric pressure (from vehicle)(kPa)"))
    assert not len(log.pressure)
    assert any("steps of 10.0 hPa, 83 m of height" in warning for warning in log.warnings)


def test_other_apps_name_things_otherwise() -> None:
    log = read_log(
        b"Time;Latitude;Longitude;Altitude (ft);Vehicle speed (mph);Engine RPM (rpm)\n"
        b"2018-03-05T09:11:01Z;49;8.4;100;10;2000\n"
    )
    assert log.source_format == "torque"
    assert log.fix.alt_msl_m[0] == pytest.approx(30.48)
    assert log.odometry.speed_mps[0] == pytest.approx(4.4704)
    assert any("'Altitude (ft)' as alt_msl_m (times 0.3048)" in warning for warning in log.warnings)


def test_without_times_it_is_refused_with_what_is_missing() -> None:
    with pytest.raises(MalformedLogError, match="lacks required columns: GPS Time or Device Time"):
        read_log(b"Latitude,Longitude,Speed (OBD)(km/h)\n49,8,10\n")
    with pytest.raises(MalformedLogError, match="lacks required columns"):
        FORMATS["torque"].refuse_header(b"Latitude,Longitude,Speed (OBD)(km/h)\n", part=False)  # type: ignore[attr-defined]
