"""UBX of receivers before NAV-PVT: written by pyubx2, and equal to what one message would say."""

from __future__ import annotations

import io
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage, UBXReader

from fusion.errors import EmptyLogError
from fusion.formats import read_log
from fusion.types import DriveLog

EPOCH_1980 = datetime(1980, 1, 6, tzinfo=UTC)
LEAP_S = 18


def message(name: str, **fields: Any) -> bytes:
    """One message of class NAV by pyubx2."""
    return bytes(UBXMessage("NAV", f"NAV-{name}", GET, **fields).serialize())


def posllh(itow: int, k: int = 0, **fields: Any) -> bytes:
    """A position."""
    default = {
        "iTOW": itow, "lon": 1.8833166, "lat": 50.9502524 + 6e-5 * k, "height": 38091 + 100 * k,
        "hMSL": -7563 + 100 * k, "hAcc": 971, "vAcc": 1636,
    }  # fmt: skip
    return message("POSLLH", **(default | fields))


def velned(itow: int) -> bytes:
    """A velocity, cm/s."""
    return message(
        "VELNED",
        iTOW=itow,
        velN=700,
        velE=-150,
        velD=-21,
        speed=717,
        gSpeed=716,
        heading=347.9,
        sAcc=12,
        cAcc=2.4,
    )


def sol(when: datetime, itow: int, fix: int = 3, **flags: int) -> bytes:
    """A solution, with the week."""
    week = ((when - EPOCH_1980).total_seconds() + LEAP_S) // 604800
    default = {"gpsfixOK": 1, "wknSet": 1, "towSet": 1}
    return message("SOL", iTOW=itow, week=int(week), gpsFix=fix, **(default | flags))


def drive(make: SimpleNamespace, epochs: int = 10, kinds: str = "posllh status sol velned") -> bytes:
    """A drive at 1 Hz."""
    out = b""
    for k in range(epochs):
        when = make.start + timedelta(seconds=k)
        itow = make.itow_ms(when)
        parts = {
            "posllh": posllh(itow, k), "velned": velned(itow), "sol": sol(when, itow),
            "status": message("STATUS", iTOW=itow, gpsFix=3, gpsFixOk=1),
        }  # fmt: skip
        out += b"".join(parts[kind] for kind in kinds.split())
    return out


@pytest.mark.parametrize("kinds", ["posllh status sol velned", "sol velned posllh", "velned posllh sol"])
def test_numbers_agree_with_pyubx2_in_any_order(make: SimpleNamespace, kinds: str) -> None:
    sample = drive(make, kinds=kinds)
    log = read_log(sample)
    parsed = [m for _, m in UBXReader(io.BytesIO(sample))]
    place = [m for m in parsed if m.identity == "NAV-POSLLH"]
    motion = [m for m in parsed if m.identity == "NAV-VELNED"]
    assert log.fix.time_s - make.start_s == pytest.approx(np.arange(10.0), abs=1e-6)
    for column, told, name, scale in (
        (log.fix.lat_deg, place, "lat", 1), (log.fix.lon_deg, place, "lon", 1),
        (log.fix.height_ell_m, place, "height", 1e-3), (log.fix.alt_msl_m, place, "hMSL", 1e-3),
        (log.fix.h_acc_m, place, "hAcc", 1e-3), (log.fix.v_acc_m, place, "vAcc", 1e-3),
        (log.velocity.vel_n_mps, motion, "velN", 1e-2), (log.velocity.vel_e_mps, motion, "velE", 1e-2),
        (log.velocity.vel_d_mps, motion, "velD", 1e-2), (log.velocity.s_acc_mps, motion, "sAcc", 1e-2),
    ):  # fmt: skip
        assert column == pytest.approx([getattr(m, name) * scale for m in told], abs=1e-9)
    assert not log.skipped and not log.repaired and not log.warnings


def same_numbers(a: DriveLog, b: DriveLog) -> bool:
    """Whether positions and velocities are the same."""
    return all(
        np.array_equal(getattr(x, c), getattr(y, c), equal_nan=True)
        for x, y in ((a.fix, b.fix), (a.velocity, b.velocity))
        for c in ("time_s", *x.columns())
    )


def test_beside_nav_pvt_they_are_not_doubled(make: SimpleNamespace) -> None:
    pvt = [make.pvt(make.start + timedelta(seconds=k)) for k in range(10)]
    alone = read_log(b"".join(pvt))
    beside = read_log(b"".join(pvt) + drive(make))
    assert same_numbers(alone, beside)


def test_only_fixes_count_whichever_message_says_so(make: SimpleNamespace) -> None:
    itow = make.itow_ms(make.start)
    for kind, fix, ok, reason in (
        ("SOL", 0, 1, "epochs without a fix"),
        ("SOL", 5, 1, "epochs without a fix"),
        ("SOL", 1, 1, "epochs by dead reckoning alone"),
        ("SOL", 3, 0, "fixes that the receiver flags as not OK"),
        ("STATUS", 0, 1, "epochs without a fix"),
        ("STATUS", 3, 0, "fixes that the receiver flags as not OK"),
    ):
        bad = make.start + timedelta(seconds=20)
        at = make.itow_ms(bad)
        status = message("STATUS", iTOW=at, gpsFix=fix, gpsFixOk=ok)
        said = sol(bad, at, fix, gpsfixOK=ok) if kind == "SOL" else status
        log = read_log(drive(make) + posllh(at) + said)
        assert len(log.fix) == 10
        assert log.skipped[reason] == 1
    flat = read_log(posllh(itow) + sol(make.start, itow, 2) + velned(itow))
    assert np.isnan(flat.fix.alt_msl_m).all() and np.isnan(flat.velocity.vel_d_mps).all()
    assert flat.velocity.vel_n_mps.tolist() == [7]
    unsaid = read_log(drive(make, kinds="posllh") + posllh(itow + 20000, hAcc=4_000_000_000))
    assert len(unsaid.fix) == 10
    with pytest.raises(EmptyLogError, match=r"2 x NAV-SOL.*NAV-POSLLH"):
        read_log(sol(make.start, itow) * 2)


def test_the_date_comes_from_whichever_message_has_it(make: SimpleNamespace) -> None:
    bare = drive(make, kinds="posllh velned")
    log = read_log(bare)
    assert any("no date" in w for w in log.warnings)
    assert np.diff(log.fix.time_s) == pytest.approx(np.ones(9))
    itow = make.itow_ms(make.start)
    week = int(((make.start - EPOCH_1980).total_seconds() + LEAP_S) // 604800)
    start = make.start
    for dated in (
        sol(start, itow),
        message("TIMEGPS", iTOW=itow, week=week, leapS=LEAP_S, towValid=1, weekValid=1, leapSValid=1),
        message(
            "TIMEUTC", iTOW=itow, year=start.year, month=start.month, day=start.day, hour=start.hour,
            min=start.minute, sec=start.second, validTOW=1, validWKN=1, validUTC=1,
        ),
        make.burst(start, 10, 20, kinds="RMC"),
    ):  # fmt: skip
        log = read_log(dated + bare)
        assert log.fix.time_s - make.start_s == pytest.approx(np.arange(10.0), abs=1e-6)
        assert not any("no date" in w for w in log.warnings)
    unset = read_log(sol(start, itow, wknSet=0) + bare)
    assert any("no date" in w for w in unset.warnings)


def test_velocities_of_other_epochs_are_not_taken(make: SimpleNamespace) -> None:
    itow = make.itow_ms(make.start)
    log = read_log(posllh(itow) + sol(make.start, itow) + velned(itow + 1000) + posllh(itow + 1000, 1))
    assert len(log.fix) == 2
    assert (log.velocity.time_s - make.start_s).tolist() == pytest.approx([1])


def test_sensors_find_their_times_by_them(make: SimpleNamespace) -> None:
    out = b""
    for k in range(20):
        when = make.start + timedelta(seconds=k)
        out += posllh(make.itow_ms(when), k) + sol(when, make.itow_ms(when))
        out += b"".join(
            make.esf_meas(1000 * k + 100 * j + 50, [(16, 1024), (17, 0), (18, 10042)]) for j in range(10)
        )
    log = read_log(out)
    assert log.force.time_s[:3] - make.start_s == pytest.approx([0.05, 0.15, 0.25], abs=0.06)


def test_in_hexadecimal_lines_of_the_console_too(make: SimpleNamespace) -> None:
    sample = drive(make, 3)
    lines = [
        f"15:34:20  {at:04X}  {' '.join(f'{b:02X}' for b in sample[at : at + 16])}"
        for at in range(0, len(sample), 16)
    ]
    log = read_log("\n".join(lines).encode())
    assert log.source_format == "u-center"
    assert same_numbers(log, read_log(sample))
