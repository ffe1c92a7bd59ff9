"""Columns by other names: what is understood and said, what is not, and what a person says of them."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.errors import BadOptionsError, MalformedLogError
from fusion.formats import read_log, read_logs
from fusion.formats.tables.cells import NO_OFFSET
from fusion.types import DriveLog

TIMES = [f"2018-05-04T15:34:{20 + k}Z" for k in range(20)]
START_S = 1525448060.0


def one(header: str, row: str) -> DriveLog:
    """The log of one row."""
    return read_log(f"{header}\n{row}\n".encode())


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("timestamp,latitude,longitude,altitude", "2018-05-04T15:34:20Z,49.5,8.25,100"),
        ("Time,Lat,Lng,Ele", "2018-05-04T15:34:20Z,49.5,8.25,100"),
        ("time_utc,lat,lon,elevation", "2018-05-04 15:34:20+00:00,49.5,8.25,100"),
        ("timestamp_ms,GPSLatitude,GPSLongitude,altitude (m)", "1525448060000,49.5,8.25,100"),
        ("unixTime,latDeg,lngDeg,altitudeM", "1525448060,49.5,8.25,100"),
        (
            "timestamp [ns];Latitude (deg);Longitude (°);Altitude [ft]",
            "1525448060000000000;49.5;8.25;328.08399",
        ),
        ("date,time,latitude,longitude,alt", "2018-05-04,15:34:20Z,49.5,8.25,100"),
        ("Date,Time,gps_lat,gps_lon,height", "04.05.2018,15:34:20,49.5,8.25,100"),
        ("millisSinceGpsEpoch,latDeg,lngDeg,alt", "1209483278000,49.5,8.25,100"),
        ('"time";"latitude";"longitude";"altitude_msl"', "2018-05-04T15:34:20Z;49,5;8,25;100,0"),
    ],
)
def test_usual_names_are_understood(header: str, row: str) -> None:
    log = one(header, row)
    assert log.fix.time_s[0] == pytest.approx(START_S, abs=1e-4)
    assert (log.fix.lat_deg[0], log.fix.lon_deg[0]) == (49.5, 8.25)
    assert log.fix.alt_msl_m[0] == pytest.approx(100)
    assert not log.skipped
    assert any("Columns were taken by their names" in warning for warning in log.warnings)
    assert not any("not known" in warning for warning in log.warnings)


@pytest.mark.parametrize(
    ("name", "value", "column", "expected"),
    [
        ("speed_kmh", 36, "speed", 10),
        ("Speed (km/h)", 36, "speed", 10),
        ("speed_mph", 10, "speed", 4.4704),
        ("GPS Speed [m/s]", 10, "speed", 10),
        ("sog_kn", 10, "speed", 5.144444),
        ("pressure_kPa", 100, "pressure", 100000),
        ("Barometer (psi)", 14.5, "pressure", 99973.98),
        ("pressure_pa", 99000, "pressure", 99000),
        ("temperature_f", 50, "temperature", 283.15),
        ("vehicle_speed", 36, "odo", 10),
        ("horizontal_accuracy", 3, "h_acc", 3),
        ("altitude_wgs84_ft", 100, "height_ell", 30.48),
    ],
)
def test_units_in_names_are_converted(name: str, value: float, column: str, expected: float) -> None:
    log = one(f"time_s,lat_deg,lon_deg,heading_deg,{name}", f"1525448060,49,8,90,{value}")
    found = {
        "speed": lambda: log.velocity.vel_e_mps,
        "pressure": lambda: log.pressure.pressure_pa,
        "temperature": lambda: log.pressure.temperature_k,
        "odo": lambda: log.odometry.speed_mps,
        "h_acc": lambda: log.fix.h_acc_m,
        "height_ell": lambda: log.fix.height_ell_m,
    }[column]()
    assert found[0] == pytest.approx(expected)


def a_drive(speed_name: str, factor: float) -> DriveLog:
    """20 s northwards at 20 m/s, with the speed in some unit."""
    rows = [f"{t},{49 + 20 / 111200 * k:.7f},8,0,{20 / factor}" for k, t in enumerate(TIMES)]
    return read_log("\n".join([f"time,lat,lon,course,{speed_name}", *rows, ""]).encode())


@pytest.mark.parametrize(
    ("unit", "factor"), [("m/s", 1.0), ("km/h", 1 / 3.6), ("mph", 0.44704), ("knots", 1852 / 3600)]
)
def test_a_speed_without_a_unit_is_in_that_which_agrees_with_the_positions(unit: str, factor: float) -> None:
    log = a_drive("speed", factor)
    assert log.velocity.vel_n_mps == pytest.approx(20)
    assert any(f"unit of the speed is not named: taken as {unit}" in warning for warning in log.warnings)


def test_a_speed_whose_unit_cannot_be_told_is_left_out() -> None:
    log = a_drive("speed", 7.0)
    assert not len(log.velocity)
    assert any("left out" in warning and "Name the column" in warning for warning in log.warnings)


def test_names_whose_meaning_is_uncertain_are_not_taken() -> None:
    log = one("time,lat,lon,pitch,accel_x,vertical_speed", "2018-05-04T15:34:20Z,49,8,1,2,3")
    assert not len(log.attitude)
    assert not len(log.force)
    assert not len(log.velocity)
    assert any("'pitch', 'accel_x', 'vertical_speed'" in warning for warning in log.warnings)


def test_a_near_name_is_asked_for() -> None:
    log = one("time_s,lat_deg,lon_deg,altitud_msl_m", "1525448060,49,8,100")
    assert not log.fix.has("alt_msl_m")
    assert any(
        "altitud_msl_m is not known; did you mean alt_msl_m? Name it by --columns alt_msl_m=altitud_msl_m."
        in warning
        for warning in log.warnings
    )


def test_times_without_offset_are_utc_and_that_is_said() -> None:
    log = one("timestamp,lat,lon", "2018-05-04 15:34:20,49,8")
    assert log.fix.time_s[0] == START_S
    assert NO_OFFSET in log.warnings
    assert NO_OFFSET not in one("timestamp,lat,lon", "1525448060,49,8").warnings


def test_what_a_person_says_goes_before_what_names_say() -> None:
    text = b"time,latitude,longitude,altitude,Hoehe (ft)\n2018-05-04T15:34:20Z,49,8,1,100\n"
    log = read_log(text, columns={"alt_msl_m": "hoehe (FT)"})
    assert log.fix.alt_msl_m[0] == pytest.approx(30.48)
    log = read_log(text, columns={"height_ell_m": "altitude", "alt_msl_m": "Hoehe (ft)"})
    assert (log.fix.height_ell_m[0], log.fix.alt_msl_m[0]) == pytest.approx((1, 30.48))


def test_required_columns_may_be_named() -> None:
    text = b"moment;breite;laenge\n2018-05-04T15:34:20Z;49;8\n"
    with pytest.raises(MalformedLogError, match=r"lacks required columns: time_s .*, lat_deg, lon_deg"):
        read_log(text)
    log = read_log(text, columns={"time": "moment", "lat_deg": "breite", "lon_deg": "laenge"})
    assert (log.fix.time_s[0], log.fix.lat_deg[0], log.fix.lon_deg[0]) == (START_S, 49, 8)
    assert np.isnan(log.fix.alt_msl_m[0])


def test_a_wrong_column_of_ours_is_refused_with_what_is_near() -> None:
    with pytest.raises(
        BadOptionsError, match=r"'alt_msl' \(of alt_msl=Altitude\) is no column.*Did you mean alt_msl_m"
    ):
        read_log(b"time,lat,lon\n", columns={"alt_msl": "Altitude"})


def test_a_wrong_name_of_the_header_is_refused_with_the_header() -> None:
    with pytest.raises(
        MalformedLogError, match=r"no 'Altitude', which was to be alt_msl_m.*names: time, lat, lon"
    ):
        read_log(b"time,lat,lon\n2018-05-04T15:34:20Z,49,8\n", columns={"alt_msl_m": "Altitude"})


def test_of_several_files_that_one_is_meant_that_has_the_name(samples: dict[str, bytes]) -> None:
    baro = b"time_s,Luftdruck\n1525448060,1000\n"
    log = read_logs([samples["ubx"], baro], columns={"pressure_hpa": "Luftdruck"})
    assert log.pressure.pressure_pa.tolist() == [100000]


def test_columns_said_of_another_format_are_not_used(samples: dict[str, bytes]) -> None:
    log = read_log(samples["gpx"], columns={"alt_msl_m": "ele"})
    assert any("are not used" in warning for warning in log.warnings)
