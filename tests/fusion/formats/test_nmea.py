"""NMEA 0183, checked against pynmeagps."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pynmeagps import NMEAReader

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log


def test_numbers_agree_with_pynmeagps(make: SimpleNamespace) -> None:
    sample = make.drive_nmea()
    log = read_log(sample)
    parsed = [m for _, m in NMEAReader(BytesIO(sample))]
    gga = [m for m in parsed if m.msgID == "GGA"]
    rmc = [m for m in parsed if m.msgID == "RMC"]
    gst = [m for m in parsed if m.msgID == "GST"]
    when = [datetime.combine(m.date, m.time, UTC).timestamp() for m in rmc]
    assert log.fix.time_s == pytest.approx(when, abs=1e-6)
    assert log.fix.lat_deg == pytest.approx([m.lat for m in gga], abs=1e-9)
    assert log.fix.lon_deg == pytest.approx([m.lon for m in gga], abs=1e-9)
    assert log.fix.alt_msl_m == pytest.approx([m.alt for m in gga])
    assert log.fix.height_ell_m == pytest.approx([m.alt + m.sep for m in gga])
    assert log.fix.h_acc_m == pytest.approx([np.hypot(m.stdLat, m.stdLong) for m in gst])
    assert log.fix.v_acc_m == pytest.approx([m.stdAlt for m in gst])
    speed = np.array([m.spd for m in rmc]) * 1852 / 3600
    course = np.radians([m.cog for m in rmc])
    assert log.velocity.vel_n_mps == pytest.approx(speed * np.cos(course))
    assert log.velocity.vel_e_mps == pytest.approx(speed * np.sin(course))
    assert "GGA" in log.geoid


@settings(max_examples=50, deadline=None)
@given(lat=st.floats(-90, 90), lon=st.floats(-180, 180))
def test_every_place_on_earth_comes_back(make: SimpleNamespace, lat: float, lon: float) -> None:
    if abs(lat) < 1e-3 and abs(lon) < 1e-3:
        return
    log = read_log(make.burst(make.start, lat, lon))
    assert log.fix.lat_deg[0] == pytest.approx(lat, abs=2e-7)
    assert log.fix.lon_deg[0] == pytest.approx(lon, abs=2e-7)


@pytest.mark.parametrize("kinds", ["RMC", "GGA RMC", "GGA GST RMC VTG", "ZDA GGA", "GGA ZDA VTG", "RMC GGA"])
def test_any_choice_and_order_of_sentences(make: SimpleNamespace, kinds: str) -> None:
    log = read_log(make.drive_nmea(kinds=kinds))
    assert log.fix.time_s - make.start_s == pytest.approx(np.arange(20), abs=1e-6)
    assert log.fix.has("alt_msl_m") == ("GGA" in kinds)
    assert log.fix.has("v_acc_m") == ("GST" in kinds)
    expected = 20 if "RMC" in kinds or "VTG" in kinds else 0
    assert len(log.velocity) == expected


def test_mixed_talkers_count_once(make: SimpleNamespace) -> None:
    sample = b"".join(
        make.burst(make.start + timedelta(seconds=k), 50 + k / 1000, 8, talker=t)
        for k in range(9)
        for t in ("GP", "GN", "GL")
    )
    log = read_log(sample)
    assert len(log.fix) == 9
    assert len(log.velocity) == 9


@pytest.mark.parametrize("dates_at", [[0], [19], [5], [0, 19], range(20)])
def test_dates_roll_over_at_midnight_from_few_dated_sentences(
    make: SimpleNamespace, dates_at: list[int]
) -> None:
    start = datetime(2019, 12, 31, 23, 59, 50, tzinfo=UTC)
    sample = b"".join(
        make.burst(start + timedelta(seconds=k), 50, 8, kinds="GGA RMC" if k in dates_at else "GGA")
        for k in range(20)
    )
    log = read_log(sample)
    assert log.fix.time_s - start.timestamp() == pytest.approx(np.arange(20), abs=1e-6)


def test_two_drives_in_one_file_keep_their_days(make: SimpleNamespace) -> None:
    first = make.drive_nmea(kinds="GGA RMC")
    later = make.drive_nmea(start=make.start + timedelta(days=30, hours=9), kinds="GGA RMC")
    log = read_log(first + later)
    assert len(log.fix) == 40
    assert log.fix.time_s[20] - log.fix.time_s[0] == pytest.approx(30 * 86400 + 9 * 3600, abs=1e-3)


def test_without_any_date_times_run_from_1980_over_midnight_with_a_warning(make: SimpleNamespace) -> None:
    start = datetime(2019, 12, 31, 23, 59, 50, tzinfo=UTC)
    log = read_log(make.drive_nmea(start=start, kinds="GGA"))
    assert np.diff(log.fix.time_s) == pytest.approx(np.ones(19))
    assert datetime.fromtimestamp(log.fix.time_s[0], UTC).year == 1980
    assert any("no date" in w for w in log.warnings)


def test_bad_checksums_are_counted_and_named(make: SimpleNamespace) -> None:
    lines = make.drive_nmea(kinds="RMC GGA").splitlines(keepends=True)
    lines[7] = lines[7].replace(b"112.3", b"192.3")
    lines[9] = lines[9].replace(b"112.3", b"712.3")
    lines.append(lines[0][:30])
    log = read_log(b"".join(lines))
    assert log.skipped["NMEA sentences with a wrong checksum"] == 2
    assert log.skipped["NMEA sentences cut short"] == 1
    assert any("line 8" in w for w in log.warnings)
    assert np.isnan(log.fix.alt_msl_m).sum() == 2
    assert len(log.fix) == 20


def test_wrong_checksums_alone_are_said_with_their_number(make: SimpleNamespace) -> None:
    lines = make.drive_nmea(3).splitlines()
    bad = b"\r\n".join(line[:-1] + (b"1" if line.endswith(b"0") else b"0") for line in lines)
    with pytest.raises(MalformedLogError, match=f"checksum of {len(lines)} NMEA sentences is wrong"):
        read_log(bad)


def test_sentences_without_any_checksum_are_taken_on_trust(make: SimpleNamespace) -> None:
    bare = b"".join(line.split(b"*")[0] + b"\r\n" for line in make.drive_nmea().splitlines())
    log = read_log(bare)
    assert len(log.fix) == 20
    assert any("checksum" in w for w in log.warnings)


def test_a_recorders_time_stamps_before_the_sentences_do_no_harm(make: SimpleNamespace) -> None:
    stamped = b"".join(b"17:34:20  " + line + b"\r\n" for line in make.drive_nmea().splitlines())
    assert len(read_log(stamped).fix) == 20


def test_sentences_without_a_fix_are_dropped(make: SimpleNamespace) -> None:
    void = b"".join(
        make.nmea(body)
        for body in (
            "GNRMC,153420.00,V,,,,,,,040518,,,N",
            "GNGGA,153420.00,,,,,0,00,99.99,,,,,,",
            "GNRMC,153421.00,A,5057.0,N,00152.8,E,1.0,10.0,040518,,,E",
            "GNGGA,153421.00,5057.0,N,00152.8,E,6,00,99.99,100,M,45,M,,",
        )
    )
    log = read_log(void + make.burst(make.start + timedelta(seconds=5), 50.95, 1.88))
    assert log.fix.time_s - make.start_s == pytest.approx([5])
    assert log.skipped["GGA sentences without a satellite fix"] == 2
    assert log.skipped["RMC sentences without a satellite fix"] == 2
    with pytest.raises(EmptyLogError, match="line 1: the receiver had no fix"):
        read_log(void)


def test_latitude_91_is_named(make: SimpleNamespace) -> None:
    with pytest.raises(EmptyLogError, match=r"line 1: lat_deg is 91"):
        read_log(make.nmea("GNRMC,153420.00,A,9100.0,N,00152.8,E,1.0,10.0,040518,,,A"))


def test_standing_without_a_course_is_zero_velocity_only_at_speed_zero(make: SimpleNamespace) -> None:
    log = read_log(
        make.nmea("GNRMC,153420.00,A,5057.0,N,00152.8,E,0.000,,040518,,,A")
        + make.nmea("GNRMC,153421.00,A,5057.0,N,00152.8,E,0.004,,040518,,,A")
    )
    assert log.velocity.vel_n_mps.tolist() == [0]
    assert len(log.fix) == 2
