"""Versant CSV."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log
from fusion.formats.versant_csv import COLUMNS, NUMBERS

ALL = (
    "time_s,lat_deg,lon_deg,alt_msl_m,height_ell_m,h_acc_m,v_acc_m,vel_n_mps,vel_e_mps,vel_d_mps,s_acc_mps,speed_mps,"
    "heading_deg,acc_x_mps2,acc_y_mps2,acc_z_mps2,gyr_x_dps,gyr_y_dps,gyr_z_dps,roll_deg,pitch_deg,yaw_deg,"
    "pitch_acc_deg,wheel_left_rad,wheel_right_rad,odo_speed_mps,pressure_hpa"
)
VALUES = "1525448060.5,49,8,100,148,1,2,3,4,-0.5,0.1,5,90,0.1,0.2,9.8,10,20,30,1,2,270,0.3,11,12,5.1,1013.25"


def test_every_column_of_the_design_reaches_its_table_in_si_units() -> None:
    assert set(ALL.split(",")) | {"time"} == set(COLUMNS)
    log = read_log(f"{ALL}\n{VALUES}\n".encode())
    f, v, a, g = log.fix, log.velocity, log.force, log.rate
    t, o, p = log.attitude, log.odometry, log.pressure
    assert log.missing == ("attitude.roll_acc_rad", "attitude.yaw_acc_rad")
    position = (f.lat_deg, f.lon_deg, f.alt_msl_m, f.height_ell_m, f.h_acc_m, f.v_acc_m)
    assert [float(c[0]) for c in position] == [49, 8, 100, 148, 1, 2]
    assert [float(c[0]) for c in (v.vel_n_mps, v.vel_e_mps, v.vel_d_mps, v.s_acc_mps)] == [3, 4, -0.5, 0.1]
    assert [float(c[0]) for c in (a.acc_x_mps2, a.acc_y_mps2, a.acc_z_mps2)] == [0.1, 0.2, 9.8]
    assert np.degrees([g.gyr_x_radps[0], g.gyr_y_radps[0], g.gyr_z_radps[0]]) == pytest.approx([10, 20, 30])
    assert np.degrees([t.roll_rad[0], t.pitch_rad[0], t.yaw_rad[0], t.pitch_acc_rad[0]]) == pytest.approx(
        [1, 2, 270, 0.3]
    )
    assert [float(c[0]) for c in (o.wheel_left_rad, o.wheel_right_rad, o.speed_mps)] == [11, 12, 5.1]
    assert p.pressure_pa[0] == pytest.approx(101325)
    assert f.time_s[0] == 1525448060.5


@pytest.mark.parametrize("name", NUMBERS)
def test_each_optional_column_may_be_absent_or_empty(name: str) -> None:
    if name in ("time_s", "lat_deg", "lon_deg"):
        return
    names, values = ALL.split(","), VALUES.split(",")
    at = names.index(name)
    empty = read_log(f"{ALL}\n{','.join([*values[:at], '', *values[at + 1 :]])}\n".encode())
    absent = read_log(
        f"{','.join(names[:at] + names[at + 1 :])}\n{','.join(values[:at] + values[at + 1 :])}\n".encode()
    )
    assert empty.missing == absent.missing
    assert len(empty.fix) == len(absent.fix) == 1


def test_velocity_comes_from_speed_and_heading_only_where_components_are_absent() -> None:
    log = read_log(
        b"time_s,lat_deg,lon_deg,speed_mps,heading_deg,vel_n_mps,vel_e_mps,vel_d_mps\n"
        b"1525448060,49,8,10,90,,,\n"
        b"1525448061,49,8,10,90,1,2,3\n"
        b"1525448062,49,8,0,,,,\n"
        b"1525448063,49,8,4,,,,\n"
    )
    assert log.velocity.time_s.tolist() == [1525448060, 1525448061, 1525448062]
    assert log.velocity.vel_n_mps == pytest.approx([0, 1, 0], abs=1e-12)
    assert log.velocity.vel_e_mps == pytest.approx([10, 2, 0])
    assert np.isnan(log.velocity.vel_d_mps).tolist() == [True, False, True]


def test_each_sensor_keeps_its_own_rate_and_an_outage_leaves_the_others() -> None:
    log = read_log(
        b"time_s,lat_deg,lon_deg,pitch_deg,pressure_hpa\n"
        b"1525448060,49,8,1,\n1525448060.1,,,2,\n1525448060.2,,,,1000\n1525448061,49,8,,\n"
    )
    assert {n: len(t) for n, t in log.tables().items() if len(t)} == {"fix": 2, "attitude": 2, "pressure": 1}
    assert not log.skipped


@pytest.mark.parametrize(
    "text",
    [
        "\ufefftime_s,lat_deg,lon_deg,alt_msl_m\r\n1525448060.5,49.1,8.2,100.25\r\n",
        "time_s;lat_deg;lon_deg;alt_msl_m\n1525448060,5;49,1;8,2;100,25\n",
        "time_s;lat_deg;lon_deg;alt_msl_m\n1525448060.5;49.1;8.2;100.25\n",
        "time_s\tlat_deg\tlon_deg\talt_msl_m\n1525448060.5\t49.1\t8.2\t100.25",
        ' Time_s , "lat_deg",LON_DEG,alt_msl_m\r"1525448060.5", 49.1 ,8.2,100.25\r',
        "# made by a logger\n\ntime_s,lat_deg,lon_deg,alt_msl_m\n\n1525448060.5,49.1,8.2,100.25\n\n",
        "time,lat_deg,lon_deg,alt_msl_m\n2018-05-04T15:34:20.5Z,49.1,8.2,100.25\n",
        "time,lat_deg,lon_deg,alt_msl_m\n2018-05-04T17:34:20.5+02:00,49.1,8.2,100.25\n",
        "alt_msl_m,lon_deg,lat_deg,time_s\n100.25,8.2,49.1,1525448060.5\n",
    ],
)
def test_dialects_read_alike(text: str) -> None:
    for blob in (text.encode(), text.lstrip("\ufeff").encode("utf-16")):
        log = read_log(blob)
        values = (log.fix.time_s[0], log.fix.lat_deg[0], log.fix.lon_deg[0], log.fix.alt_msl_m[0])
        assert values == pytest.approx((1525448060.5, 49.1, 8.2, 100.25), rel=0, abs=1e-6)
        assert not log.skipped


def test_unknown_columns_are_a_warning_missing_ones_an_error_with_the_list() -> None:
    log = read_log("time_s,lat_deg,lon_deg,smell_°\n1525448060,49,8,x\n".encode("latin-1"))
    assert any("smell_" in w for w in log.warnings)
    assert not log.skipped
    with pytest.raises(MalformedLogError) as caught:
        read_log(b"timestamp,lat_deg,longitude\n1,2,3\n")
    assert all(word in str(caught.value) for word in ("time_s", "lon_deg", "timestamp", "longitude"))
    assert "columns: time_s (Unix seconds) or time (RFC 3339), lon_deg." in str(caught.value)


def test_cells_that_are_no_numbers_are_counted_with_their_line() -> None:
    log = read_log(
        b"time_s,lat_deg,lon_deg,alt_msl_m\n1525448060,49,8,100\n\n1525448061,49,8,high\n1525448062,49,8,NaN\n"
        b"1525448063,49,8,inf\n1525448064,49,8,?\n"
    )
    assert log.skipped["cells that are not numbers"] == 2
    assert any("line 4: alt_msl_m is 'high'" in w for w in log.warnings)
    assert np.isfinite(log.fix.alt_msl_m).tolist() == [True, False, False, False, False]


def test_impossible_rows_are_skipped_and_named() -> None:
    log = read_log(
        b"time_s,lat_deg,lon_deg,pitch_deg\n"
        b"1525448060,49,8,1\n0,49,8,1\n1525448061,91,8,1\n1525448062,49,181,1\n7258118400,49,8,1\n"
        b",49,8,1\n1525448063,49,,1\n1525448064,0,0,1\n1525448065,49,8\n1525448066,49,8,1\n"
    )
    assert log.fix.time_s.tolist() == [1525448060, 1525448066]
    assert len(log.attitude) == 2
    assert dict(log.skipped) == {
        "impossible time": 2, "latitude out of range": 1, "longitude out of range": 1, "without a time": 1,
        "incomplete position": 1, "position 0, 0": 1, "rows with a wrong number of cells": 1,
    }  # fmt: skip
    said = " ".join(log.warnings)
    assert all(f"line {n}:" in said for n in (3, 4, 5, 7, 8, 9, 10))


def test_times_in_milliseconds_and_headers_alone_are_empty_logs() -> None:
    with pytest.raises(EmptyLogError, match="line 2: the time is 1525448060000 s"):
        read_log(b"time_s,lat_deg,lon_deg\n1525448060000,49,8\n")
    with pytest.raises(EmptyLogError, match="no usable position"):
        read_log(b"time_s,lat_deg,lon_deg\n")
    with pytest.raises(EmptyLogError, match="line 2: time is 'noon'"):
        read_log(b"time,lat_deg,lon_deg\nnoon,49,8\n")


def test_disorder_is_repaired_and_naive_times_are_said_to_be_utc() -> None:
    log = read_log(b"time_s,lat_deg,lon_deg\n1525448062,49,8\n1525448060,49,8\n1525448062,50,8\n")
    assert log.fix.time_s.tolist() == [1525448060, 1525448062]
    assert log.fix.lat_deg.tolist() == [49, 49]
    assert sum(log.repaired.values()) == 2
    naive = read_log(b"time,lat_deg,lon_deg\n2018-05-04 15:34:20,49,8\n")
    assert naive.fix.time_s.tolist() == [1525448060]
    assert any("UTC" in w for w in naive.warnings)


def test_a_stray_quote_costs_its_own_cell_only() -> None:
    log = read_log(
        b'time_s,lat_deg,lon_deg,alt_msl_m\n1525448060,49,8,1\n1525448061,49,8,"2\n1525448062,49,8,3\n'
    )
    assert len(log.fix) == 3
    assert log.skipped["cells that are not numbers"] <= 1
