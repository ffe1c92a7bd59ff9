"""CSVs of pseudoranges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import FORMATS, read_log
from fusion.signals import SYSTEMS, Signals, satellite_name
from fusion.types import DriveLog
from gnss_tables import agree, some_signals


def signals_of(log: DriveLog) -> Signals:
    """Its measurements."""
    assert log.raw is not None
    return log.raw.signals


def cell(value: float) -> str:
    """A number, or nothing."""
    return "" if np.isnan(value) else repr(float(value))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
def test_what_is_written_comes_back(seed: int, by_week: bool, by_name: bool) -> None:
    s = some_signals(seed, epochs=3)
    rng = np.random.default_rng(seed)
    place, motion = rng.normal(size=(len(s.system), 3)) * 2.6e7, rng.normal(size=(len(s.system), 3))
    place += np.sign(place) * 6e6
    s = Signals(
        **{**vars(s), "position_m": place, "velocity_mps": motion, "sigma_m": rng.uniform(1, 9, len(place))}
    )
    columns = {
        "range_rate_mps": s.range_rate_mps, "cn0_dbhz": s.cn0_dbhz, "sigma_m": s.sigma_m,
        "frequency_hz": s.frequency_hz, "pseudorange_m": s.pseudorange_m,
        **{f"sat_{a}_m": place[:, i] for i, a in enumerate("xyz")},
        **{f"sat_v{a}_mps": motion[:, i] for i, a in enumerate("xyz")},
    }  # fmt: skip
    rows = [[cell(c[r]) for c in columns.values()] for r in range(len(place))]
    header = list(columns)
    gps_s = s.gps_s[s.epoch]
    if by_week:
        header += ["gps_week", "tow_s"]
        rows = [
            [*row, str(int(t // 604800)), repr(float(t % 604800))] for row, t in zip(rows, gps_s, strict=True)
        ]
    else:
        header += ["time_s"]
        rows = [[*row, repr(float(t))] for row, t in zip(rows, s.time_s[s.epoch], strict=True)]
    satellites = list(zip(s.system.tolist(), s.number.tolist(), strict=True))
    if by_name:
        header += ["sv"]
        rows = [[*row, satellite_name(*sat)] for row, sat in zip(rows, satellites, strict=True)]
    else:
        header += ["system", "satellite"]
        rows = [[*row, SYSTEMS[k], str(n)] for row, (k, n) in zip(rows, satellites, strict=True)]
    log = read_log("\n".join(",".join(row) for row in [header, *rows]).encode())
    assert agree(s, signals_of(log))
    assert signals_of(log).brings_satellites
    assert log.source_format == "pseudoranges-csv"
    assert not log.warnings
    assert not log.skipped


def test_columns_that_are_missing_are_listed_and_unknown_ones_named() -> None:
    with pytest.raises(MalformedLogError) as caught:
        read_log(b"pseudorange_m,sat_x_m,tow_s,system\n1,2,3,G\n")
    for name in ("time_s (Unix seconds) or gps_week and tow_s", "sv (such as G07)", "sat_y_m, sat_z_m"):
        assert name in str(caught.value)
    log = read_log(b"time_s,sv,pseudorange_m,colour\n1699400595,G07,2e7,red\n")
    assert any("'colour'" in w for w in log.warnings)


def test_rows_that_cannot_be_used_are_counted_with_their_line() -> None:
    log = read_log(
        b"time_s;sv;pseudorange_m;cn0_dbhz\n1699400595;G07;2e7;40\n1699400595;X07;2e7;40\n1699400595;G07;2e7;41\n"
        b"1699400595;G00;2e7;40\n;G08;2e7;40\n1699400595;G09;-5;40\n1699400595;G10;;40\n17;G11;2e7;40\n"
        b"1699400595;C11;2e7;\n1699400595;R11;2e7;\n"
    )
    s = signals_of(log)
    assert [satellite_name(*sat) for sat in zip(s.system, s.number, strict=True)] == ["G07", "R11", "C11"]
    assert s.cn0_dbhz[0] == 40
    assert s.frequency_hz[[0, 2]].tolist() == [1575.42e6, 1561.098e6]
    assert np.isnan(s.frequency_hz[1])
    assert dict(log.skipped) == {
        "rows at no possible time": 2,
        "rows of satellites that are not known": 2,
        "pseudoranges that are missing or cannot be": 2,
        "repeated rows of one satellite and time": 1,
    }
    assert any("line 3" in w for w in log.warnings)


def test_rows_without_a_place_are_left_out_where_others_have_one() -> None:
    log = read_log(
        b"time_s,sv,pseudorange_m,sat_x_m,sat_y_m,sat_z_m\n"
        b"1699400595,G07,2e7,2e7,1e7,1e7\n1699400595,G08,2e7,,,\n1699400595,G09,2e7,0,0,0\n"
    )
    assert signals_of(log).number.tolist() == [7]
    assert signals_of(log).brings_satellites
    assert any("2 rows have no position" in w for w in log.warnings)


def test_no_usable_row_is_an_empty_log_that_says_why() -> None:
    for body in (b"", b"1699400595,Q7,2e7\n"):
        with pytest.raises(EmptyLogError, match="no usable pseudorange"):
            read_log(b"time_s,sv,pseudorange_m\n" + body)


def test_it_is_told_from_a_versant_csv_by_its_header() -> None:
    head = b"# by hand\ntime_s,SV,Pseudorange_m\n"
    assert [name for name, f in FORMATS.items() if f.recognises(head)] == ["pseudoranges-csv"]
    utf16 = head.decode().encode("utf-16")
    assert FORMATS["pseudoranges-csv"].recognises(utf16)
