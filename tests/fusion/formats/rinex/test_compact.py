"""Compact RINEX: the same as plain; nothing that damage does to it stops or hangs the reader."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import hatanaka
import numpy as np
import pytest

from fusion.errors import LogError, MalformedLogError
from fusion.formats import read_log
from fusion.formats.rinex import reading as compact
from fusion.formats.rinex.log import is_compact
from fusion.simulate.write import rinex_file
from gnss_tables import agree, some_signals

TEXT = rinex_file.observations(some_signals(4, epochs=30)).encode()
PACKED = hatanaka.rnx2crx(TEXT)


def program(folder: Path, script: str) -> Path:
    """A program that does what a shell script says."""
    path = folder / "program"
    path.write_text(f"#!/bin/sh\n{script}\n")
    os.chmod(path, path.stat().st_mode | stat.S_IXUSR)  # noqa: PTH101
    return path


def test_it_holds_what_the_plain_file_does() -> None:
    assert is_compact(PACKED)
    assert not is_compact(TEXT)
    plain, packed = read_log(TEXT).raw, read_log(PACKED).raw
    assert plain is not None
    assert packed is not None
    assert agree(plain.signals, packed.signals)


def test_version_1_of_rinex_2_too() -> None:
    lines = [
        f"{'     2.11':20}{'OBSERVATION DATA':20}{'G':20}RINEX VERSION / TYPE",
        f"{'test':60}PGM / RUN BY / DATE",
        f"{'     2    C1    S1':60}# / TYPES OF OBSERV",
        f"{'  2023    11     7    23    43   15.0000000     GPS':60}TIME OF FIRST OBS",
        f"{'':60}END OF HEADER",
        *(f" 23 11  7 23 43 {15 + k:2}.0000000  0  1G01\n{2e7 + k:14.3f}  {40.0:14.3f}" for k in range(4)),
    ]
    raw = read_log(hatanaka.rnx2crx(("\n".join(lines) + "\n").encode())).raw
    assert raw is not None
    assert raw.signals.pseudorange_m.tolist() == [2e7, 2e7 + 1, 2e7 + 2, 2e7 + 3]


def test_cut_or_damaged_it_reads_or_raises_a_log_error() -> None:
    rng = np.random.default_rng(8)
    for k in range(12):
        data = bytearray(PACKED[: rng.integers(1, len(PACKED))] if k % 2 else PACKED)
        for _ in range(3):
            data[rng.integers(len(data))] = rng.integers(256)
        try:
            log = read_log(bytes(data))
        except LogError as error:
            assert str(error).endswith(".")
        else:
            assert log.raw is not None


def test_a_cut_file_is_said_to_be_damaged() -> None:
    log = read_log(PACKED[: len(PACKED) // 2])
    assert log.raw is not None
    assert 0 < len(log.raw.signals) < 30
    assert any("damaged or ends early" in w for w in log.warnings)


def test_a_program_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compact, "_PROGRAM", program(tmp_path, "exec sleep 30"))
    monkeypatch.setattr(compact, "LONGEST_S", 0.1)
    with pytest.raises(MalformedLogError, match="cannot be unpacked"):
        read_log(PACKED)


def test_a_program_that_writes_for_ever_is_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compact, "_PROGRAM", program(tmp_path, "exec yes"))
    monkeypatch.setattr(compact, "FREE_BYTES", 1 << 20)
    monkeypatch.setattr(compact, "MOST_GROWTH", 1)
    with pytest.raises(MalformedLogError, match="which no recording does"):
        read_log(PACKED)
