"""Observation files: versions, events, damage, and what RTKLIB reads of the same files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.rinex import observations as rinex_observations
from fusion.formats.rinex.log import RinexFormat
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, LIGHT_MPS, Navigation, Signals, gps_from_unix
from fusion.simulate.write import rinex_file
from fusion.types import DriveLog, no_progress
from gnss_tables import agree, rinex_head, some_navigation, some_signals

L1_M = LIGHT_MPS / 1575.42e6


def read(lines: list[str], navigation: Navigation | None = None) -> DriveLog:
    """The log of a text."""
    text = "\n".join(lines) + "\n"
    return RinexFormat().read_part(text.encode(), no_progress, navigation or Navigation())


def signals_of(log: DriveLog) -> Signals:
    """Its measurements."""
    assert log.raw is not None
    return log.raw.signals


def row(name: str, *values: float | None) -> str:
    """A line of version 3."""
    return (name + "".join(" " * 16 if v is None else f"{v:14.3f} 5" for v in values)).rstrip()


GPS_3 = ("G    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES")
EPOCH = "> 2023 11 07 23 43 15.0000000  0"


def test_an_epoch_of_version_3() -> None:
    rows = [row("G07", 2e7, 1e8, -1000.5, 40.25), row("G 9", 2.1e7, None, 0.0)]
    log = read([*rinex_head("3.04", GPS_3), f"{EPOCH}  2", *rows])
    s = signals_of(log)
    assert s.gps_s.tolist() == [gps_from_unix(np.array([1699400595.0]))[0] - 18]
    assert s.number.tolist() == [7, 9]
    assert s.pseudorange_m.tolist() == [2e7, 2.1e7]
    assert s.range_rate_mps[0] == pytest.approx(1000.5 * L1_M)
    assert np.isnan(s.range_rate_mps[1])  # 0 stands for missing
    assert s.cn0_dbhz[0] == 40.25
    assert log.warnings == ()


@pytest.mark.parametrize(
    ("scale", "late_s"),
    [("GPS", 0.0), ("GAL", 0.0), ("QZS", 0.0), ("BDT", 14.0), ("GLO", 18.0), ("   ", 0.0)],
)
def test_epochs_of_every_scale_become_gps_seconds(scale: str, late_s: float) -> None:
    first = ("  2023    11    07    23    43   15.0000000     " + scale, "TIME OF FIRST OBS")
    s = signals_of(read([*rinex_head("3.04", GPS_3, first), f"{EPOCH}  1", row("G07", 2e7)]))
    assert s.gps_s[0] == 1383435795.0 + late_s


@pytest.mark.parametrize(("system", "late_s"), [("R", 18.0), ("C", 14.0), ("E", 0.0), ("G", 0.0)])
def test_a_file_of_one_system_alone_is_on_its_scale(system: str, late_s: float) -> None:
    types = (f"{system}    1 C1C", "SYS / # / OBS TYPES")
    if system == "C":
        types = ("C    1 C2I", "SYS / # / OBS TYPES")
    s = signals_of(read([*rinex_head("3.04", types, system=system), f"{EPOCH}  1", row(f"{system}07", 2e7)]))
    assert s.gps_s[0] == 1383435795.0 + late_s


@pytest.mark.parametrize(
    ("version", "codes", "value", "hz"),
    [
        ("3.04", "C2I C1P", 1, 1561.098e6),
        ("3.04", "C1P C2I", 2, 1561.098e6),
        ("3.04", "C1X C6I", 1, 1575.42e6),
        ("3.02", "C1X C6I", 1, 1561.098e6),
        ("3.01", "C1I C7I", 1, 1561.098e6),
        ("3.02", "C1I C7I", 1, 1561.098e6),
        ("4.01", "C5P C1D", 2, 1575.42e6),
    ],
)
def test_beidou_gives_b1i_before_b1c_whatever_the_version_calls_it(
    version: str, codes: str, value: int, hz: float
) -> None:
    lines = [
        *rinex_head(version, (f"C    2 {codes}", "SYS / # / OBS TYPES")),
        f"{EPOCH}  1",
        row("C21", 2e7 + 1, 2e7 + 2),
    ]
    s = signals_of(read(lines))
    assert s.pseudorange_m.tolist() == [2e7 + value]
    assert s.frequency_hz.tolist() == [hz]


def test_a_satellite_keeps_one_code_and_takes_doppler_of_the_same() -> None:
    types = ("G    6 C1C D1C S1C C1W D1W S1W", "SYS / # / OBS TYPES")
    lines = rinex_head("3.04", types)
    for k in range(12):
        lines += [f"> 2023 11 07 23 43 {15 + k:2}.0000000  0  2"]
        # G01 has C/A nearly always, G02 has P(Y) alone
        lines += [row("G01", 2e7 if k else None, 10.0, 40.0, 2.2e7, 20.0, 30.0)]
        lines += [row("G02", None, None, None, 2.2e7, 20.0, 30.0)]
    s = signals_of(read(lines))
    own = s.number == 1
    assert s.pseudorange_m[own].tolist() == [2e7] * 11
    assert s.range_rate_mps[own] == pytest.approx(-10 * L1_M)
    assert s.range_rate_mps[~own] == pytest.approx(-20 * L1_M)
    assert s.cn0_dbhz[~own].tolist() == [30.0] * 12


def test_glonass_channels_come_from_the_header_or_from_navigation_else_doppler_is_unknown() -> None:
    types = ("R    2 C1C D1C", "SYS / # / OBS TYPES")
    slots = ("  2 R01  1 R02 -4", "GLONASS SLOT / FRQ #")
    body = [f"{EPOCH}  2", row("R01", 2e7, 100.0), row("R02", 2e7, 100.0)]
    wanted = -100.0 * LIGHT_MPS / np.array([1602e6 + 562.5e3, 1602e6 - 4 * 562.5e3])
    stated = signals_of(read([*rinex_head("3.04", types, slots), *body]))
    assert stated.range_rate_mps == pytest.approx(wanted)
    beside = signals_of(read([*rinex_head("3.04", types), *body], some_navigation(1, 60)))
    assert beside.range_rate_mps == pytest.approx(wanted)
    alone = read([*rinex_head("3.04", types), *body])
    assert np.isnan(signals_of(alone).range_rate_mps).all()
    assert any("R01, R02" in w for w in alone.warnings)


def test_scale_factors_are_divided_by() -> None:
    lines = rinex_head(
        "3.04", ("G    2 C1C S1C", "SYS / # / OBS TYPES"), ("G   10   1 S1C", "SYS / SCALE FACTOR")
    )
    s = signals_of(read([*lines, f"{EPOCH}  1", row("G01", 2e7, 400.0)]))
    assert (s.pseudorange_m[0], s.cn0_dbhz[0]) == (2e7, 40.0)


def test_types_of_observation_may_take_lines_and_change_in_mid_file() -> None:
    many = (
        " ".join(f"C{k}X" for k in (2, 5, 6, 7, 8, 9))
        + " "
        + " ".join(f"L{k}X" for k in (1, 2, 5, 6, 7, 8, 9))
    )
    types = [(f"G   14 {many}", "SYS / # / OBS TYPES"), ("       C1C", "SYS / # / OBS TYPES")]
    lines = [*rinex_head("3.04", *types), f"{EPOCH}  1", row("G01", *[None] * 13, 2e7)]
    lines += [
        "> 2023 11 07 23 43 16.0000000  4  2",
        f"{'G    1 C1C':60}SYS / # / OBS TYPES",
        f"{'changed':60}COMMENT",
    ]
    lines += ["> 2023 11 07 23 43 17.0000000  0  1", row("G01", 2.1e7)]
    log = read(lines)
    assert signals_of(log).pseudorange_m.tolist() == [2e7, 2.1e7]
    assert not log.skipped


def test_events_without_a_date_and_cycle_slips_are_passed_over() -> None:
    lines = [
        *rinex_head("3.04", GPS_3),
        f"{EPOCH}  1",
        row("G01", 2e7),
        ">" + " " * 30 + "2  1",
        f"{'moving':60}COMMENT",
    ]
    lines += ["> 2023 11 07 23 43 16.0000000  6  1", row("G01", 9.0, 9.0)]
    lines += ["> 2023 11 07 23 43 17.0000000  0  1", row("G01", 2.1e7)]
    log = read(lines)
    assert signals_of(log).pseudorange_m.tolist() == [2e7, 2.1e7]
    assert not log.skipped


def test_power_failures_are_gaps() -> None:
    lines = rinex_head("3.04", GPS_3)
    for second, flag in ((15, 1), (16, 0), (50, 1)):
        lines += [f"> 2023 11 07 23 43 {second:2}.0000000  {flag}  1", row("G01", 2e7)]
    log = read(lines)
    assert log.outages_s.tolist() == [1699400630.0 - 18]
    assert any("lost power 1 times" in w for w in log.warnings)


def test_disorder_repetition_and_strange_systems_are_counted() -> None:
    lines = rinex_head("3.04", GPS_3)
    for second in (16, 15, 15, 61):
        lines += [
            f"> 2023 11 07 23 43 {second:2}.0000000  0  3",
            row("G01", 2e7),
            row("X01", 2e7),
            row("??", 2e7),
        ]
    lines += ["nonsense"]
    log = read(lines)
    assert len(signals_of(log)) == 2
    assert dict(log.repaired) == {"epochs out of order": 1, "epochs given twice": 1}
    assert log.skipped["satellites of systems that are not read"] == 4
    assert log.skipped["rows without the name of a satellite"] == 4
    assert log.skipped["epochs at no possible time"] == 1
    assert log.skipped["lines of no epoch"] == 1
    assert log.skipped["repeated rows of one satellite and time"] == 1


def test_pseudoranges_that_cannot_be_are_left_out() -> None:
    lines = [
        *rinex_head("3.04", GPS_3),
        f"{EPOCH}  3",
        row("G01", -2e7),
        row("G02", 9999999999.999),
        "G03    20000.x00",
    ]
    with pytest.raises(EmptyLogError, match="no usable pseudorange"):
        read(lines)


def test_too_many_headers_in_mid_file_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rinex_observations, "MOST_EVENTS", 3)
    with pytest.raises(MalformedLogError, match="headers in mid-file"):
        read([*rinex_head("3.04", GPS_3), *[">" + " " * 30 + "4  0"] * 5])


@pytest.mark.parametrize("name", ["pixel6.23o", "rinex_obs_mixed_types.20o"])
def test_real_files_hold_what_rtklib_reads(shared_data: Path, name: str) -> None:
    rtklib = pytest.importorskip("pyrtklib")
    path = shared_data / "gnss" / name
    table = rtklib.obs_t()
    assert rtklib.readrnx(str(path), 1, "", table, rtklib.nav_t(), rtklib.sta_t()) == 1
    theirs = {}
    number = rtklib.Arr1Dint(1)
    systems = {rtklib.SYS_GPS: GPS, rtklib.SYS_GLO: GLONASS, rtklib.SYS_GAL: GALILEO, rtklib.SYS_CMP: BEIDOU}
    for k in range(table.n):
        one = table.data[k]
        system = systems[rtklib.satsys(one.sat, number)]
        if one.P[0]:
            at = round((one.time.time - 315964800 + one.time.sec) * 1e4)
            theirs[at, system, number[0]] = (one.P[0], one.D[0], one.SNR[0] / 1000)
    s = signals_of(RinexFormat().read(path.read_bytes(), no_progress))
    doppler = -s.range_rate_mps * s.frequency_hz / LIGHT_MPS
    ours = {
        (round(t * 1e4), k, n): (p, d, c)
        for t, k, n, p, d, c in zip(
            s.gps_s[s.epoch].tolist(), s.system.tolist(), s.number.tolist(), s.pseudorange_m.tolist(),
            doppler.tolist(), s.cn0_dbhz.tolist(), strict=True,
        )
    }  # fmt: skip
    assert set(ours) == set(theirs)
    assert np.allclose(
        [ours[k] for k in sorted(ours)], [theirs[k] for k in sorted(ours)], rtol=1e-6, atol=1e-3
    )
    assert np.allclose([ours[k][0] for k in ours], [theirs[k][0] for k in ours], rtol=0, atol=1e-6)


def test_a_log_of_observations_has_no_position_and_says_so() -> None:
    log = RinexFormat().read(rinex_file.observations(some_signals(1)).encode(), no_progress)
    assert len(log.fix) == 0
    assert "fix" in log.missing
    assert agree(signals_of(log), some_signals(1), range_rate_mps=2e-4, gps_s=5e-7)
