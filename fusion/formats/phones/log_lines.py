"""Lines of several kinds in one text, each kind a table whose columns a comment names: ``# Raw,TimeNanos,...``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from fusion.formats.base import Notes
from fusion.types import Ints

WHOLE = frozenset({
    "TimeNanos", "FullBiasNanos", "ReceivedSvTimeNanos", "State", "Svid", "ConstellationType",
    "HardwareClockDiscontinuityCount",
})  # fmt: skip
"""Columns of whole numbers, which have more digits than a float holds."""
ABSENT = np.iinfo(np.int64).min
"""What stands in a column of whole numbers where there is none."""
_LONGEST_KIND = 40


@dataclass(frozen=True)
class Table:
    """The lines of one kind: columns (n,) by name, int64 (``WHOLE``) or float64, ``ABSENT`` or NaN where empty."""

    columns: dict[str, NDArray[Any]]
    line: Ints

    def __len__(self) -> int:
        return len(self.line)

    def place(self, row: int) -> str:
        """Where a row stands, in words."""
        return f"line {self.line[row]}"


class LogLines:
    """A text, searched by kind of line."""

    def __init__(self, text: bytes) -> None:
        self._text = text
        self._lines = text.split(b"\n")
        self._numbers: dict[bytes, list[int]] = {}
        for number, row in enumerate(self._lines):
            self._numbers.setdefault(row[: row.find(b",", 0, _LONGEST_KIND)], []).append(number)
        self.has_kinds = any(re.match(rb"[A-Z]\w*$", kind) for kind in self._numbers)

    def header(self, kind: str) -> list[str]:
        """The names of the columns of a kind; empty if the text does not say them."""
        match = re.search(rf"(?m)^# ?{kind},([^\r\n]*)".encode(), self._text)
        return (
            [name.strip() for name in match.group(1).decode("ascii", "replace").split(",")] if match else []
        )

    def table(self, kind: str, names: tuple[str, ...], notes: Notes, first_cell: str = "") -> Table | None:
        """The wanted columns of the lines of a kind, or those with that first cell; None without a header.

        Lines with another number of cells than most are left out, and so counted.
        """
        header = self.header(kind)
        if not header:
            return None
        numbers = self._numbers.get(kind.encode(), [])
        if first_cell:
            lead = f"{kind},{first_cell},".lower().encode()
            numbers = [k for k in numbers if self._lines[k][: len(lead)].lower() == lead]
        rows = [self._lines[k].rstrip(b"\r") for k in numbers]
        line = np.array(numbers, np.int64) + 1
        cells = np.array([row.count(b",") for row in rows], np.int64)
        usual = int(np.bincount(cells).argmax()) if rows else 0
        odd = np.flatnonzero(cells != usual)
        if len(odd):
            example = f"line {line[odd[0]]}: {cells[odd[0]] + 1} instead of {usual + 1}"
            notes.skip(f"{kind} lines with another number of cells", len(odd), example)
            rows = [row for row, count in zip(rows, cells, strict=True) if count == usual]
        body = b"\n".join(rows).replace(b"\r", b"?") + b"\n"  # one in mid-line would end it
        # the first cell is the kind itself
        places = {name: header.index(name) + 1 for name in names if name in header[:usual]}
        return Table(_columns(body, usual + 1, places, len(rows)) if rows else {}, line[cells == usual])


def _columns(body: bytes, width: int, places: dict[str, int], rows: int) -> dict[str, NDArray[Any]]:
    """Typed columns of text without its header; slower, cell by cell, where a cell is no number."""
    try:
        table = _convert(body, width, places)
        if table.num_rows != rows:
            raise pa.ArrowInvalid("a cell holds quotes or the end of a line")
    except pa.ArrowException:
        cells = [row.split(b",") for row in body[:-1].split(b"\n")]
        return {
            name: np.array(
                [_number(row[i], name in WHOLE) for row in cells], np.int64 if name in WHOLE else float
            )
            for name, i in places.items()
        }
    out: dict[str, NDArray[Any]] = {}
    for name, i in places.items():
        column = table.column(f"c{i}")
        filled = column.fill_null(ABSENT) if name in WHOLE else column
        out[name] = filled.to_numpy()
    return out


def _convert(body: bytes, width: int, places: dict[str, int]) -> pa.Table:
    types = {f"c{i}": pa.int64() if name in WHOLE else pa.float64() for name, i in places.items()}
    return csv.read_csv(
        pa.py_buffer(body),
        csv.ReadOptions(
            use_threads=False, block_size=max(1 << 20, len(body) + 1), column_names=[f"c{i}" for i in range(width)]
        ),
        csv.ParseOptions(quote_char=False, ignore_empty_lines=False),
        csv.ConvertOptions(
            check_utf8=False, include_columns=list(types), column_types=types, null_values=["", "NaN"]
        ),
    )  # fmt: skip


def _number(cell: bytes, is_whole: bool) -> float | int:
    try:
        if not is_whole:
            return float(cell)
        value = int(cell)
    except ValueError:
        return ABSENT if is_whole else np.nan
    return value if abs(value) < 1 << 62 else ABSENT
