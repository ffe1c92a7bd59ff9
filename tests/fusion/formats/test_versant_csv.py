"""Versant CSV."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log
from fusion.formats.tables import cells as csv_cells
from fusion.formats.tables.header import COLUMNS

ALL = (
    "time_s,lat_deg,lon_deg,alt_msl_m,height_ell_m,h_acc_m,v_acc_m,vel_n_mps,vel_e_mps,vel_d_mps,s_acc_mps,speed_mps,"
    "heading_deg,acc_x_mps2,acc_y_mps2,acc_z_mps2,gyr_x_dps,gyr_y_dps,gyr_z_dps,roll_deg,pitch_deg,yaw_deg,"
    "pitch_acc_deg,wheel_left_rad,wheel_right_rad,odo_speed_mps,pressure_hpa,temperature_c"
)
VALUES = (
    "1525448060.5,49,8,100,148,1,2,3,4,-0.5,0.1,5,90,0.1,0.2,9.8,10,20,30,1,2,270,0.3,11,12,5.1,1013.25,12.5"
)


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
    assert p.temperature_k[0] == pytest.approx(285.65)
    assert f.time_s[0] == 1525448060.5


@pytest.mark.parametrize("name", [name for name in COLUMNS if name != "time"])
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
        read_log(b"moment,lat_deg,lon_degs\n1,2,3\n")
    assert all(word in str(caught.value) for word in ("time_s", "lon_deg", "moment", "lon_degs"))
    assert "Perhaps: --columns lon_deg=lon_degs." in str(caught.value)
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


SPOILT = (
    "time_s,time,lat_deg,lon_deg,alt_msl_m,pitch_deg\r\n"
    "1525448060,,49,8,100,1\r\n"
    "1525448061,,49,8,high,1\r\n"
    "\r\n"
    "1525448062,,91,8,100,1\r\n"
    "1525448059,,49,8,100,\r\n"
    ",2018-05-04T15:34:30Z,49,8,101,1\r\n"
    "1525448064,49,8\r\n"
    ",noon,49,8,101,1\r\n"
    '1525448059,,49,8,"102",1\r\n'
    "1525448066,,49,8,low,1\r\n"
    "1525448067,,92,8,100,1\r\n"
    "1525448068,49,8\r\n"
    ",2018-05-04 15:34:40,49,8,\u00b0,1\r\n"
)


@pytest.mark.parametrize("newline", ["\r\n", "\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16"])
def test_the_size_of_the_blocks_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, newline: str, encoding: str
) -> None:
    text = SPOILT.replace("\r\n", newline).encode(encoding)
    whole = read_log(text)
    assert len(whole.fix) == 6
    for size in (30, 60, 100, 200):
        monkeypatch.setattr(csv_cells, "BLOCK_BYTES", size)
        log = read_log(text)
        assert (log.skipped, log.repaired) == (whole.skipped, whole.repaired)
        assert sorted(log.warnings) == sorted(whole.warnings)
        for name, table in whole.tables().items():
            for column in ("time_s", *table.columns()):
                assert np.array_equal(
                    getattr(log.tables()[name], column), getattr(table, column), equal_nan=True
                )


@pytest.mark.slow
@pytest.mark.parametrize("row", [b"1525448060,,49,8,,\n", b",2018-05-04T15:34:20Z,49,8,,\n", b"x,,49,8,,\n"])
def test_a_large_file_takes_a_small_multiple_of_its_size(monkeypatch: pytest.MonkeyPatch, row: bytes) -> None:
    monkeypatch.setattr(csv_cells, "BLOCK_BYTES", 1 << 16)
    text = b"time_s,time,lat_deg,lon_deg,alt_msl_m,pitch_deg\n1525448059,,49,8,,\n" + row * 200_000
    read_log(text[:1000])  # what is imported on first use is not to be counted
    tracemalloc.start()
    try:
        read_log(text)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2 * len(text)


def test_numbers_that_stand_for_unknown_become_unknown() -> None:
    log = read_log(
        b"time_s,lat_deg,lon_deg,h_acc_m,v_acc_m,roll_deg,pitch_deg,yaw_deg,pitch_acc_deg\n"
        b"1525448060,49,8,0,-1,0,0,0,0.3\n"
        b"1525448061,49,8,4294967.295,3,0,0,90,0\n"
        b"1525448062,49,8,2,3,1,0,0,0.3\n"
        b"1525448063,49,8,2,3,,0,0,0.3\n"
    )
    assert np.isfinite(log.fix.h_acc_m).tolist() == [False, False, True, True]
    assert np.isfinite(log.fix.v_acc_m).tolist() == [False, True, True, True]
    known = log.attitude.time_s[np.isfinite(log.attitude.pitch_rad)]
    assert known.tolist() == [1525448061, 1525448062]
    assert np.isfinite(log.attitude.pitch_acc_rad).tolist() == [True, False, True, True]
    assert {name.split(":")[0].split(" of ")[0]: n for name, n in log.repaired.items()} == {
        "h_acc_m": 2, "v_acc_m": 1, "pitch_acc_deg": 1, "attitude": 2,
    }  # fmt: skip


def test_a_pitch_alone_may_be_0_on_a_level_road() -> None:
    log = read_log(b"time_s,lat_deg,lon_deg,pitch_deg\n1525448060,49,8,0\n1525448061,49,8,0\n")
    assert log.attitude.pitch_rad.tolist() == [0, 0]
    assert not log.repaired
