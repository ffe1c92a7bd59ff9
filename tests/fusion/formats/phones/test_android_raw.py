"""Pseudoranges of phones: made-up measurements come back; real ones agree with the phone's own RINEX file."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from fusion.formats import read_log
from fusion.signals import LIGHT_MPS, SYSTEMS, Signals
from fusion.types import DriveLog

FIX = "Fix,GPS,50.95,1.88,158.2,7.1,3.8,348,1525448060000,0.2,,1,5.0"
RECEIVED_S = 1_209_483_250.123456789 + 1000


def signals_of(log: DriveLog) -> Signals:
    """Its measurements."""
    assert log.raw is not None
    return log.raw.signals


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from("GRECJS"), st.integers(0, 8 * 86_400), st.integers(40_000_000, 150_000_000))
def test_every_system_at_any_time_of_week_and_day(
    make: SimpleNamespace, letter: str, second: int, flight_ns: int
) -> None:
    clock_ns = second * 10**9 + 123
    s = signals_of(read_log(make.gnsslogger([FIX, make.raw_line(letter, 5, clock_ns, flight_ns)])))
    assert (SYSTEMS[s.system[0]], s.number[0]) == (letter, 5)
    assert s.pseudorange_m[0] == pytest.approx(flight_ns * 1e-9 * LIGHT_MPS, abs=1e-6)
    assert s.gps_s[0] == pytest.approx(RECEIVED_S - 1000 + second, abs=1e-6)
    assert (s.range_rate_mps[0], s.cn0_dbhz[0]) == (-321.5, 40.5)
    assert s.sigma_m[0] == pytest.approx(20e-9 * LIGHT_MPS)


@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        ({"CarrierFrequencyHz": 1176450050}, "on other bands than L1"),
        ({"State": 0}, "without code lock"),
        ({"State": 1 | 2}, "time of transmission is not known"),
        ({"State": 1 | 8 | 16}, "time of transmission is not known"),
        ({"ConstellationType": 7}, "of other systems"),
        ({"ConstellationType": 99}, "of other systems"),
        ({"ConstellationType": 3, "Svid": 97, "State": 32911}, "of other systems"),
        ({"FullBiasNanos": ""}, "with numbers missing"),
        ({"TimeNanos": "noon"}, "with numbers missing"),
        ({"ReceivedSvTimeNanos": 17}, "whose pseudorange or time cannot be"),
    ],
)
def test_measurements_that_say_too_little_are_counted(
    make: SimpleNamespace, cells: dict[str, object], reason: str
) -> None:
    lines = [FIX, make.raw_line("G", 3, 10**12, 7 * 10**7), make.raw_line("G", 5, 10**12, 7 * 10**7, **cells)]
    log = read_log(make.gnsslogger(lines))
    assert signals_of(log).number.tolist() == [3]
    assert [count for what, count in log.skipped.items() if reason in what] == [1]


def test_phones_of_one_band_state_no_carrier_and_b1i_goes_before_b1c(make: SimpleNamespace) -> None:
    lines = [
        make.raw_line("G", 3, 10**12, 7 * 10**7, CarrierFrequencyHz=""),
        make.raw_line("C", 30, 10**12, 8 * 10**7, CarrierFrequencyHz="1575420030"),
        make.raw_line("C", 30, 10**12, 7 * 10**7, CarrierFrequencyHz="1561097980"),
    ]
    s = signals_of(read_log(make.gnsslogger(lines)))
    assert s.number.tolist() == [3, 30]
    assert s.pseudorange_m == pytest.approx(0.07 * LIGHT_MPS)
    assert s.frequency_hz.tolist() == [1575420000.0, 1561097980.0]


def test_the_clocks_offset_is_taken_once_for_each_run_of_it(make: SimpleNamespace) -> None:
    bias = -1_209_483_250_123_456_789
    lines = []
    for k in range(5):
        run = 1 if k < 3 else 2
        jitter = (k % 3) * 100
        cells = {"HardwareClockDiscontinuityCount": run, "FullBiasNanos": bias + jitter}
        lines.append(make.raw_line("G", 3, (1000 + k) * 10**9, 7 * 10**7, **cells))
    log = read_log(make.gnsslogger(lines))
    spread = signals_of(log).pseudorange_m
    assert spread[:3] == pytest.approx(spread[0], abs=1e-6)
    assert np.diff(signals_of(log).gps_s)[:2] == pytest.approx(1, abs=1e-6)
    assert log.repaired["restarts of the phone's clock"] == 1


def test_time_offsets_and_parts_of_nanoseconds_count(make: SimpleNamespace) -> None:
    line = make.raw_line("G", 3, 10**12, 7 * 10**7, TimeOffsetNanos="1000.5", BiasNanos="0.25")
    s = signals_of(read_log(make.gnsslogger([line])))
    assert s.pseudorange_m[0] == pytest.approx((7e7 + 1000.5 - 0.25) * 1e-9 * LIGHT_MPS, abs=1e-6)


def test_a_header_that_names_too_little_is_a_warning(make: SimpleNamespace) -> None:
    text = make.gnsslogger([FIX, make.raw_line("G", 3, 10**12, 7 * 10**7)]).replace(
        b",FullBiasNanos,", b",Other,"
    )
    log = read_log(text)
    assert log.raw is None
    assert any("does not name FullBiasNanos" in w for w in log.warnings)


def test_real_pseudoranges_agree_with_the_phones_own_rinex_file(shared_data: Path) -> None:
    """Both files are thinned out of one recording, at other epochs: the RINEX file is interpolated by its Doppler.

    One clock a epoch is common. Code noise of a phone is some metres, of both files.
    """
    ours = signals_of(read_log(shared_data / "formats" / "gnsslogger_pixel6.txt"))
    theirs = signals_of(read_log(shared_data / "gnss" / "pixel6.23o"))
    rows = {}
    for system, number in set(zip(ours.system.tolist(), ours.number.tolist(), strict=True)):
        own = (theirs.system == system) & (theirs.number == number)
        mine = np.flatnonzero((ours.system == system) & (ours.number == number))
        at = theirs.gps_s[theirs.epoch][own]
        if own.sum() < 40:
            continue
        curve = CubicHermiteSpline(
            at, theirs.pseudorange_m[own], theirs.range_rate_mps[own], extrapolate=False
        )
        for r in mine:
            rows[int(r)] = float(ours.pseudorange_m[r] - curve(ours.gps_s[ours.epoch[r]]))
    error = np.full(len(ours.system), np.nan)
    error[list(rows)] = list(rows.values())
    for k in range(len(ours)):
        own = slice(ours.first[k], ours.first[k + 1])
        error[own] -= np.nanmedian(error[own])
    assert np.isfinite(error).sum() > 200
    assert np.nanmedian(np.abs(error)) < 5
    by_system = [np.nanmedian(error[ours.system == s]) for s in np.unique(ours.system)]
    assert np.all(np.abs(by_system) < 1)  # scales of time differ by 300 m for each microsecond
