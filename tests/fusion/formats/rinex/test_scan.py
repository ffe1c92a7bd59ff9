"""Walks over observation files: version 2 with its lists and blocks, events, lines that are lost, files cut off."""

from __future__ import annotations

import pytest

from fusion.errors import LogError
from fusion.formats.rinex.log import RinexFormat
from fusion.signals import GALILEO, GLONASS, GPS, LIGHT_MPS, Signals
from fusion.simulate.write import rinex_file
from fusion.types import DriveLog, no_progress
from gnss_tables import rinex_head, some_signals

L1_M = LIGHT_MPS / 1575.42e6


def read(lines: list[str]) -> DriveLog:
    """The log of a text."""
    return RinexFormat().read(("\n".join(lines) + "\n").encode(), no_progress)


def signals_of(log: DriveLog) -> Signals:
    """Its measurements."""
    assert log.raw is not None
    return log.raw.signals


def version_2(*, offset: str = "") -> list[str]:
    """A file of version 2.11: 14 satellites, 6 types (two lines each)."""
    types = ("     6    L1    L2    C1    P1    D1    S1", "# / TYPES OF OBSERV")
    names = "G01G 2G03  4" + "".join(f"G{k:02d}" for k in range(5, 13)) + "R01E11"
    out = rinex_head("2.11", types)
    for second in range(2):
        out += [f" 23 11  7 23 43 {15 + second:2}.0000000  0 14{names[:36]}{offset}", " " * 32 + names[36:]]
        for k in range(14):
            p1 = f"{2.2e7:14.3f}  "
            c1 = " " * 16 if k == 1 else f"{2e7 + k:14.3f} 5"
            out += [(" " * 32 + c1 + p1 + f"{-100.0:14.3f}  ").rstrip(), f"{30.0 + k:14.3f}  ".rstrip()]
    return out


def test_version_2_with_continued_lists_blanks_and_two_digit_years() -> None:
    for lines in (version_2(), version_2(offset="  .000123456")):
        log = read(lines)
        s = signals_of(log)
        assert s.gps_s.tolist() == [1383435795.0, 1383435796.0]
        first = s.take_rows(s.epoch == 0)
        assert first.system.tolist() == [GPS] * 12 + [GLONASS, GALILEO]
        assert first.number.tolist() == [*range(1, 13), 1, 11]
        assert first.pseudorange_m.tolist() == [2e7, 2.2e7, *(2e7 + k for k in range(2, 14))]
        assert first.cn0_dbhz.tolist() == [30.0 + k for k in range(14)]
        assert first.range_rate_mps[0] == pytest.approx(100 * L1_M)
        assert not log.skipped


def test_version_2_takes_events_and_new_types() -> None:
    lines = version_2()
    event = [" " * 28 + "4  1", f"{'     1    C1':60}# / TYPES OF OBSERV"]
    slips = [" 23 11  7 23 43 18.0000000  6  1G01", f"{5.0:14.3f}"]
    new = [" 23 11  7 23 43 19.0000000  0  2G01G03", f"{2.3e7:14.3f}", f"{2.4e7:14.3f}"]
    log = read([*lines, *event, *slips, *new])
    assert signals_of(log).pseudorange_m[-2:].tolist() == [2.3e7, 2.4e7]
    assert len(signals_of(log)) == 3
    assert not log.skipped


def test_version_2_with_a_line_lost_loses_that_epoch_and_no_other() -> None:
    lines = version_2()
    end = next(i for i, line in enumerate(lines) if "END OF HEADER" in line)
    log = read([*lines[: end + 6], *lines[end + 7 :]])
    assert signals_of(log).gps_s.tolist() == [1383435796.0]
    assert log.skipped["epochs with fewer lines than they announce"] == 1


def test_a_file_cut_off_anywhere_gives_whole_numbers_or_none() -> None:
    for text in ("\n".join(version_2()), rinex_file.observations(some_signals(3, epochs=2))):
        whole = signals_of(read([text]))
        known = set(whole.pseudorange_m.tolist())
        for cut in range(0, len(text), 7):
            try:
                log = RinexFormat().read(text[:cut].encode(), no_progress)
            except LogError as error:
                assert str(error).endswith(".")
                continue
            part = signals_of(log)
            assert set(part.pseudorange_m.tolist()) <= known
