"""u-center text dumps."""

from __future__ import annotations

from datetime import timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from fusion.errors import EmptyLogError
from fusion.formats import read_log
from fusion.types import DriveLog


def console(data: bytes) -> str:
    """As u-center's binary console shows bytes."""
    out = []
    for at in range(0, len(data), 16):
        piece = data[at : at + 16]
        stamp = "15:34:20" if at == 0 else " " * 8
        shown = "".join(chr(b) if 32 <= b < 127 else "." for b in piece)
        out.append(f"{stamp}  {at:04X}  {' '.join(f'{b:02X}' for b in piece):<48} {shown}.")
    return "\n".join(out) + "\n          \n"


def listing(itow_ms: int, lat: int, tag: int) -> str:
    """One epoch as in the thesis's annex."""
    return f"""-----
01 07 NAV-PVT    - 8C 3B : 8C 3B 100
NAV-PVT {itow_ms} -8451 3
    18833166  {lat}  38091  -7563  971  1636
    7000  -1500  -10  7159  34790000  115  237647
    1.59 14
-----
""" + "".join(
        f"""10 02 ESF-MEAS   - AC 7A : AC 7A 32
ESF-MEAS  {t} TTAG: {t / 1000} FLAGS:1818 ID:0000
calibTtagValid
    16 Accelerometer X  FFFD76  -0.635
    17 Accelerometer Y  000142   0.314
    18 Accelerometer Z  002749   9.821
    {t} {t / 1000} calibtTag (Receiver Time Tag)
-----
"""
        for t in range(tag, tag + 1000, 100)
    )


def test_the_thesis_dump_gives_the_thesis_values(make: SimpleNamespace) -> None:
    log = read_log(make.thesis_dump.encode())
    fix, attitude = log.fix, log.attitude
    assert (fix.lon_deg[0], fix.lat_deg[0]) == pytest.approx((1.8833166, 50.9502524), abs=1e-9)
    assert (fix.height_ell_m[0], fix.alt_msl_m[0]) == (38.091, -7.563)
    assert (fix.h_acc_m[0], fix.v_acc_m[0]) == pytest.approx((0.971, 1.636))
    assert (log.velocity.vel_d_mps[0], log.velocity.s_acc_mps[0]) == pytest.approx((-0.010, 0.115))
    assert np.degrees([attitude.roll_rad[0], attitude.pitch_rad[0], attitude.yaw_rad[0]]) == pytest.approx(
        [2.71816, -68.19019, 185.58394]
    )
    assert np.degrees([attitude.roll_acc_rad[0], attitude.yaw_acc_rad[0]]) == pytest.approx(
        [0.38143, 2.37647]
    )
    force, rate = log.force, log.rate
    assert [force.acc_x_mps2[0], force.acc_y_mps2[0], force.acc_z_mps2[0]] == pytest.approx(
        [-0.635, 0.314, 9.821], abs=6e-4
    )
    assert np.degrees([rate.gyr_x_radps[0], rate.gyr_y_radps[0], rate.gyr_z_radps[0]]) == pytest.approx(
        [0.333, -0.389, 0.446], abs=6e-4
    )
    assert any("no date" in w for w in log.warnings)


def test_a_dump_of_many_epochs_is_timed_like_the_binary(make: SimpleNamespace) -> None:
    text = "".join(listing(401678000 + 1000 * k, 509502524 + 600 * k, 346050 + 1000 * k) for k in range(10))
    log = read_log(text.replace("\n", "\r\n").encode())
    assert np.diff(log.fix.time_s) == pytest.approx(np.ones(9))
    assert len(log.force) == 100
    assert log.force.time_s[:2] - log.fix.time_s[0] == pytest.approx([0.05, 0.15], abs=0.06)


@pytest.mark.parametrize("dated", ["NAV-TIMEGPS 401678000 0 1999 18 7\n-----\n", "sentence"])
def test_another_message_of_the_dump_dates_it(make: SimpleNamespace, dated: str) -> None:
    if dated == "sentence":
        dated = make.nmea("GNZDA,153420.00,04,05,2018,00,00").decode()
    log = read_log((dated + listing(make.itow_ms(make.start), 509502524, 1000)).encode())
    if dated.startswith("NAV"):
        expected = 315964800 + 1999 * 604800 + 401678 - 18 + (make.itow_ms(make.start) - 401678000) / 1000
        assert log.fix.time_s[0] == pytest.approx(expected, abs=1e-6)
    else:
        assert log.fix.time_s[0] == pytest.approx(make.start_s, abs=1e-3)
        assert not any("no date" in w for w in log.warnings)


def test_the_binary_console_is_read_as_the_bytes_it_shows(make: SimpleNamespace) -> None:
    binary = make.drive_ubx(3)
    text = "".join(
        console(part)
        for k in range(3)
        for part in (make.pvt(make.start + timedelta(seconds=k), lat=50.95 + 6e-5 * k), b"\r\n", make.att())
    )
    log: DriveLog = read_log(text.encode("latin-1"))
    assert log.source_format == "u-center"
    assert log.fix.lat_deg == pytest.approx(read_log(binary).fix.lat_deg, abs=1e-9)
    assert not log.skipped


def test_broken_listings_are_counted_by_line(make: SimpleNamespace) -> None:
    good = listing(401678000, 509502524, 1000)
    damaged = good.replace("8C 3B : 8C 3B", "8C 3B : 8C 3C").replace("401678000", "401679000")
    cut = "-----\nNAV-PVT 401680000 0 3\n 18833166 509502524\n-----\n"
    log = read_log((good + damaged + cut).encode())
    assert len(log.fix) == 1
    assert log.skipped["listed messages with a wrong checksum"] == 1
    assert log.skipped["listed messages that cannot be read"] == 1
    line = (good + damaged).count("\n") + 2
    assert any(f"line {line}" in w for w in log.warnings)


def test_a_packet_console_alone_says_why_it_is_no_use() -> None:
    text = "17:14:47  R ->  100 UBX-NAV-PVT          iTOW=234905000, fix=3, llh=40.8/-89.6/195.7\n" * 5
    with pytest.raises(EmptyLogError, match="names only"):
        read_log(text.encode())


def test_positions_out_of_range_name_the_line_of_the_dump() -> None:
    text = listing(401678000, 910000000, 1000)
    with pytest.raises(EmptyLogError, match=r"line 3: lat_deg is 91"):
        read_log(text.encode())
