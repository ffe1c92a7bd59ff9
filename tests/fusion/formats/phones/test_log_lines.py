"""Texts with several kinds of lines: the same table, whether cells are all numbers or some are not."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.formats.base import Notes
from fusion.formats.phones.log_lines import LogLines
from fusion.formats.tables.cells import ABSENT

HEAD = b"# notes\n# Raw,TimeNanos,Cn0DbHz,CodeType,State\n#\n# Fix,Provider,Latitude\n"
WANTED = ("TimeNanos", "Cn0DbHz", "State", "Svid")


def test_columns_are_found_by_their_names() -> None:
    text = HEAD + b"Raw,1230000000000000001,40.5,C,7\nFix,GPS,1\nRaw,-2,,X,\n"
    table = LogLines(text).table("Raw", WANTED, Notes())
    assert set(table.columns) == {"TimeNanos", "Cn0DbHz", "State"}
    assert table.columns["TimeNanos"].tolist() == [1230000000000000001, -2]
    assert table.columns["State"].tolist() == [7, ABSENT]
    assert np.array_equal(table.columns["Cn0DbHz"], [40.5, np.nan], equal_nan=True)
    assert [table.place(k) for k in range(2)] == ["line 5", "line 7"]


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_cell_that_is_no_number_costs_itself_only(end: bytes) -> None:
    rows = [b"Raw,%d,%d.5,C,3" % (k + 2**60, k) for k in range(5)]
    clean = LogLines(HEAD + end.join(rows)).table("Raw", WANTED, Notes())
    rows[2] = b"Raw,noon,hi\rgh,C,3.5"
    spoilt = LogLines(HEAD + end.join(rows)).table("Raw", WANTED, Notes())
    for name, column in clean.columns.items():
        assert spoilt.columns[name].dtype == column.dtype
        assert np.array_equal(np.delete(spoilt.columns[name], 2), np.delete(column, 2))
    assert spoilt.columns["TimeNanos"][2] == spoilt.columns["State"][2] == ABSENT
    assert np.isnan(spoilt.columns["Cn0DbHz"][2])


def test_lines_unlike_most_are_counted() -> None:
    notes = Notes()
    text = HEAD + b"Raw,1,2,C,3\nRaw,1,2\nRaw,1,2,C,3\n"
    table = LogLines(text).table("Raw", WANTED, notes)
    assert len(table) == 2
    assert notes.warnings == [
        "Skipped 1 x Raw lines with another number of cells; the first: line 6: 3 instead of 5."
    ]


def test_lines_may_all_end_before_their_header_does() -> None:
    table = LogLines(HEAD + b"Raw,1,2\n").table("Raw", WANTED, Notes())
    assert set(table.columns) == {"TimeNanos", "Cn0DbHz"}


def test_kinds_without_a_header_or_without_lines() -> None:
    lines = LogLines(HEAD)
    assert not lines.has_kinds
    for kind in ("Accel", "Raw"):
        assert len(lines.table(kind, WANTED, Notes())) == 0
