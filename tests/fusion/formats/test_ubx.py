"""UBX messages, written by pyubx2 and read back here."""

from __future__ import annotations

import io
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage, UBXReader

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log
from fusion.formats.receiver.ubx_frames import find_frames, frame
from fusion.frames import acceleration_enu


def test_the_thesis_values_of_spec_1_section_9(make: SimpleNamespace) -> None:
    words = [(16, 0xFFFD7D), (17, 0x000144), (18, 0x00273C), (14, 0x00053E), (13, 0xFFF9A8), (5, 0x000731)]
    message = make.esf_raw([(kind, value, 8738081) for kind, value in [*words, (12, 0x60B)]])
    assert len(message) == 8 + 4 + 7 * 8
    log = read_log(make.pvt() + message)
    force, rate = log.force, log.rate
    assert [force.acc_x_mps2[0], force.acc_y_mps2[0], force.acc_z_mps2[0]] == pytest.approx(
        [-0.628, 0.316, 9.809], abs=6e-4
    )
    assert np.degrees([rate.gyr_x_radps[0], rate.gyr_y_radps[0], rate.gyr_z_radps[0]]) == pytest.approx(
        [0.328, -0.396, 0.449], abs=6e-4
    )
    fix = log.fix
    assert (fix.lon_deg[0], fix.lat_deg[0]) == pytest.approx((1.8833166, 50.9502524), abs=1e-9)
    assert (fix.height_ell_m[0], fix.alt_msl_m[0]) == (38.091, -7.563)
    assert (fix.h_acc_m[0], fix.v_acc_m[0]) == pytest.approx((0.971, 1.636))


def test_numbers_agree_with_pyubx2(make: SimpleNamespace) -> None:
    sample = make.drive_ubx()
    log = read_log(sample)
    parsed = [m for _, m in UBXReader(io.BytesIO(sample))]
    pvt = [m for m in parsed if m.identity == "NAV-PVT"]
    att = [m for m in parsed if m.identity == "NAV-ATT"]
    assert log.fix.time_s == pytest.approx(
        [datetime(m.year, m.month, m.day, m.hour, m.min, m.second, tzinfo=UTC).timestamp() for m in pvt],
        abs=1e-6,
    )
    for column, field, scale in (
        (log.fix.lat_deg, "lat", 1), (log.fix.lon_deg, "lon", 1), (log.fix.alt_msl_m, "hMSL", 1e-3),
        (log.fix.height_ell_m, "height", 1e-3),
        (log.fix.h_acc_m, "hAcc", 1e-3), (log.fix.v_acc_m, "vAcc", 1e-3),
        (log.velocity.vel_n_mps, "velN", 1e-3), (log.velocity.vel_e_mps, "velE", 1e-3),
        (log.velocity.vel_d_mps, "velD", 1e-3), (log.velocity.s_acc_mps, "sAcc", 1e-3),
    ):  # fmt: skip
        assert column == pytest.approx([getattr(m, field) * scale for m in pvt], abs=1e-9)
    for column, field in (
        (log.attitude.roll_rad, "roll"), (log.attitude.pitch_rad, "pitch"), (log.attitude.yaw_rad, "heading"),
        (log.attitude.pitch_acc_rad, "accPitch"),
    ):  # fmt: skip
        assert np.degrees(column) == pytest.approx([getattr(m, field) for m in att], abs=1e-9)
    assert log.attitude.time_s == pytest.approx(log.fix.time_s, abs=1e-6)
    words = [m.dataField_01 for m in parsed if m.identity == "ESF-MEAS" and m.dataType_01 == 16]
    assert log.force.acc_x_mps2 == pytest.approx([(w - 2**24) / 1024 for w in words])
    assert not log.skipped and not log.warnings


def test_corrupt_bytes_cost_only_the_messages_they_hit(make: SimpleNamespace) -> None:
    sample = bytearray(make.drive_ubx())
    starts = find_frames(bytes(sample)).start
    kinds = find_frames(bytes(sample)).kind
    pvt = starts[kinds == 0x0107]
    sample[pvt[3] + 40] ^= 0x55
    sample[pvt[5] + 4] = 0xFF  # length
    del sample[pvt[9] + 20 : pvt[9] + 33]
    log = read_log(bytes(sample))
    assert len(log.fix) == 17
    assert len(log.force) == 200
    assert log.skipped["UBX messages with a wrong checksum"] == 3
    assert any(f"byte {pvt[3]}" in w for w in log.warnings)


def test_truncated_the_complete_messages_are_used(make: SimpleNamespace) -> None:
    one = make.pvt()
    log = read_log(one + make.pvt(make.start + timedelta(seconds=1))[:50])
    assert len(log.fix) == 1
    assert log.skipped["UBX messages cut off at the end of the file"] == 1
    for cut in (2, 5, 30, len(one) - 1):
        with pytest.raises(MalformedLogError, match="no complete message"):
            read_log(one[:cut])


@pytest.mark.parametrize("kept", [1, 2, 5, 50])
def test_a_file_that_ends_in_mid_message_says_so(make: SimpleNamespace, kept: int) -> None:
    whole = make.drive_ubx(3)
    assert not any("middle" in w for w in read_log(whole).warnings)
    said = [w for w in read_log(whole + make.pvt()[:kept]).warnings if "in the middle of a UBX message" in w]
    assert len(said) == 1 and f"byte {len(whole)}" in said[0]


def test_when_no_message_is_intact_that_is_said(make: SimpleNamespace) -> None:
    damaged = bytearray(make.pvt() * 3)
    damaged[30::100] = b"\xff\xff\xff"
    with pytest.raises(MalformedLogError, match="no intact message: 3 have a wrong checksum"):
        read_log(bytes(damaged))


def test_invalid_fixes_are_dropped_and_counted(make: SimpleNamespace) -> None:
    at = [make.start + timedelta(seconds=k) for k in range(6)]
    sample = (
        make.pvt(at[0], fixType=0) + make.pvt(at[1], fixType=1) + make.pvt(at[2], gnssFixOk=0)
        + make.pvt(at[3], fixType=5) + make.pvt(at[4], fixType=2) + make.pvt(at[5], fixType=4)
    )  # fmt: skip
    log = read_log(sample)
    assert log.fix.time_s - make.start_s == pytest.approx([4, 5])
    assert np.isnan(log.fix.alt_msl_m).tolist() == [True, False]
    assert np.isnan(log.velocity.vel_d_mps).tolist() == [True, False]
    assert log.skipped["epochs without a fix"] == 2
    assert log.skipped["epochs by dead reckoning alone"] == 1
    assert log.skipped["fixes that the receiver flags as not OK"] == 1
    with pytest.raises(EmptyLogError, match="byte 0: fixType 0"):
        read_log(make.pvt(fixType=0))


@pytest.mark.parametrize("year", [1970, 2200])
def test_an_impossible_year_is_skipped_alone_and_named(make: SimpleNamespace, year: int) -> None:
    later = make.start + timedelta(seconds=1)
    log = read_log(make.pvt() + make.pvt(later, year=year))
    assert log.fix.time_s - make.start_s == pytest.approx([0])
    assert log.skipped["impossible time"] == 1
    with pytest.raises(EmptyLogError, match=f"byte 0: the time is .*{year}"):
        read_log(make.pvt(year=year))


def test_latitude_91_and_0_0_are_skipped(make: SimpleNamespace) -> None:
    with pytest.raises(EmptyLogError, match="lat_deg is 91"):
        read_log(make.pvt(lat=91.0))
    with pytest.raises(EmptyLogError, match="0, 0"):
        read_log(make.pvt(lat=0.0, lon=0.0))


def test_dates_not_yet_valid_are_learned_from_later_messages(make: SimpleNamespace) -> None:
    at = [make.start + timedelta(seconds=k) for k in range(3)]
    early = make.pvt(at[0], year=2015, validDate=0, fullyResolved=0)
    leap = make.pvt(at[1] + timedelta(seconds=2), iTOW=make.itow_ms(at[1]), fullyResolved=0)
    log = read_log(early + make.pvt(at[2]))
    assert log.fix.time_s - make.start_s == pytest.approx([0, 2])
    assert read_log(leap + make.pvt(at[2])).fix.time_s[-1] - make.start_s == pytest.approx(2)


def test_the_week_turns_over_within_a_drive(make: SimpleNamespace) -> None:
    start = datetime(2018, 5, 5, 23, 59, 37, tzinfo=UTC)
    at = [start + timedelta(seconds=k) for k in range(10)]
    sample = b"".join(make.pvt(t) + make.att(t) for t in at)
    log = read_log(sample)
    assert make.itow_ms(at[0]) > make.itow_ms(at[9])
    assert log.fix.time_s == pytest.approx([t.timestamp() for t in at], abs=1e-6)
    assert log.attitude.time_s == pytest.approx(log.fix.time_s, abs=1e-6)
    undated = b"".join(
        make.pvt(t, year=0, month=0, day=0, validDate=0, validTime=0, fullyResolved=0) for t in at
    )
    log = read_log(undated)
    assert np.diff(log.fix.time_s) == pytest.approx(np.ones(9))
    assert any("no date" in w for w in log.warnings)


def test_zero_accuracy_means_not_available(make: SimpleNamespace) -> None:
    log = read_log(make.pvt(hAcc=0, sAcc=0) + make.att(accPitch=0))
    assert np.isnan(log.attitude.pitch_rad).all()
    assert np.isfinite(log.attitude.roll_rad).all()
    assert "fix.h_acc_m" in log.missing and "velocity.s_acc_mps" in log.missing
    assert log.skipped["NAV-ATT: pitch not available"] == 1


def test_nmea_between_fills_only_what_ubx_lacks(make: SimpleNamespace) -> None:
    text = make.drive_nmea()
    both = b"".join(
        make.burst(make.start + timedelta(seconds=k), 10, 20) + make.pvt(make.start + timedelta(seconds=k))
        for k in range(5)
    )
    log = read_log(both)
    assert log.source_format == "ubx"
    assert log.fix.lat_deg == pytest.approx(np.full(5, 50.9502524))
    assert any("UBX and NMEA" in w for w in log.warnings)
    lines = text.splitlines(keepends=True)
    mixed = b"".join(
        b"".join(lines[4 * k : 4 * k + 4])
        + b"".join(
            make.esf_meas(1000 * k + 100 * j + 50, [(16, 1024), (17, 0), (18, 10042)]) for j in range(10)
        )
        for k in range(20)
    )
    log = read_log(mixed)
    assert len(log.fix) == 20
    assert log.force.time_s[:3] - make.start_s == pytest.approx([0.05, 0.15, 0.25], abs=0.06)
    assert "NMEA" in log.geoid


def test_undated_sentences_beside_dated_messages_are_no_matter(make: SimpleNamespace) -> None:
    gga = make.drive_nmea(3, kinds="GGA")
    assert not any("no date" in w for w in read_log(gga + make.pvt()).warnings)
    assert any("no date" in w for w in read_log(gga + make.eoe()).warnings)


def test_ubx_is_recognised_after_a_megabyte_of_sentences(make: SimpleNamespace) -> None:
    text = make.drive_nmea() * 300
    assert len(text) > 1 << 20
    assert read_log(text + make.att()).source_format == "ubx"


def test_a_stream_without_positions_says_which_messages_it_has(make: SimpleNamespace) -> None:
    with pytest.raises(EmptyLogError, match=r"2 x NAV-SAT.*NAV-PVT"):
        read_log(frame(1, 0x35, bytes(8)) * 2)


def test_high_rate_messages(make: SimpleNamespace) -> None:
    out = b""
    for k in range(10):
        when = make.start + timedelta(seconds=k / 10)
        common = {
            "iTOW": make.itow_ms(when), "year": 2018, "month": 5, "day": 4, "hour": 15, "min": 34,
            "second": when.second, "nano": when.microsecond * 1000, "validDate": 1, "validTime": 1,
            "fullyResolved": 1, "gpsFix": 3, "GPSfixOK": 1,
        }  # fmt: skip
        out += UBXMessage(
            "HNR", "HNR-PVT", GET, **common, lat=50.0, lon=2.0, height=1000, hMSL=500, gSpeed=5000,
            speed=5000, headMot=90.0, hAcc=900, vAcc=1800, sAcc=90,
        ).serialize()  # fmt: skip
        out += UBXMessage(
            "HNR", "HNR-ATT", GET, iTOW=common["iTOW"], roll=4.0, pitch=3.0, heading=90.0, accRoll=1.0,
            accPitch=1.0, accHeading=1.0,
        ).serialize()  # fmt: skip
        out += UBXMessage(
            "HNR", "HNR-INS", GET, iTOW=common["iTOW"], xAngRateValid=1, yAngRateValid=1, zAngRateValid=0,
            xAccelValid=1, yAccelValid=1, zAccelValid=1, xAngRate=0.5, yAngRate=0.25, zAngRate=9.0,
            xAccel=1.5, yAccel=-0.5, zAccel=0.2,
        ).serialize()  # fmt: skip
    log = read_log(bytes(out))
    assert log.fix.time_s - make.start_s == pytest.approx(np.arange(10) / 10, abs=1e-6)
    assert log.velocity.vel_e_mps == pytest.approx(np.full(10, 5.0))
    assert not log.velocity.has("vel_d_mps")
    assert np.degrees(log.rate.gyr_x_radps) == pytest.approx(np.full(10, 0.5))
    assert np.degrees(log.rate.gyr_y_radps) == pytest.approx(np.full(10, -0.25))
    assert np.isnan(log.rate.gyr_z_radps).all()
    # put through the same attitude again, the gravity-free accelerations come back
    force = np.column_stack([log.force.acc_x_mps2, log.force.acc_y_mps2, log.force.acc_z_mps2])
    level = np.zeros(10)
    enu = acceleration_enu(force, log.attitude.roll_rad, log.attitude.pitch_rad, level + np.pi / 2)
    assert np.linalg.norm(enu, axis=1) == pytest.approx(
        np.full(10, np.linalg.norm([1.5, -0.5, 0.2])), abs=1e-6
    )
    assert enu[:, 0] == pytest.approx(np.full(10, 1.5), abs=0.1)
    assert log.repaired["gravity added back to HNR-INS accelerations"] == 10


def test_nav_pvt_wins_over_high_rate_positions_and_short_messages_are_counted(make: SimpleNamespace) -> None:
    log = read_log(make.pvt() + frame(1, 7, bytes(40)) + make.att())
    assert log.skipped["NAV-PVT messages too short"] == 1
    assert len(log.fix) == 1
