"""The made-up logs by which readers are timed: one of every format, and read as that with all its records."""

from __future__ import annotations

import pytest

from fusion.formats import FORMATS, read_log
from reading.logs import LIBRARIES, MAKERS, SATELLITES

RECORDS = 400


def test_every_reader_is_measured() -> None:
    assert set(MAKERS) == set(FORMATS)
    assert set(LIBRARIES) < set(MAKERS)


@pytest.mark.parametrize("name", MAKERS)
def test_a_log_is_read_as_what_it_is(name: str) -> None:
    log = read_log(MAKERS[name](RECORDS))
    assert log.source_format == name
    assert not log.skipped
    of_raw = 0 if log.raw is None else len(log.raw.signals.epoch) // SATELLITES
    assert max(len(log.fix), len(log.force), of_raw) >= RECORDS // 10  # times of Torque are whole seconds


@pytest.mark.parametrize("name", LIBRARIES)
def test_the_library_reads_it_too(name: str) -> None:
    LIBRARIES[name][1](MAKERS[name](RECORDS))
