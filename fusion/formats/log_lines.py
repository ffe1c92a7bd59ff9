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
        self.has_kinds = re.search(rb"(?m)^[A-Z]\w*,", text) is not None

    def header(self, kind: str) -> list[str]:
        """The names of the columns of a kind; empty if the text does not say them."""
        found = re.search(rf"(?m)^# ?{kind},([^\r\n]*)".encode(), self._text)
        return (
            [name.strip() for name in found.group(1).decode("ascii", "replace").split(",")] if found else []
        )

    def table(
        self, kind: str, wanted: tuple[str, ...], notes: Notes, lead: re.Pattern[bytes] | None = None
    ) -> Table | None:
        """The wanted columns of the lines of a kind (that begin with ``lead``); None if its header is missing.

        Lines with another number of cells than most are left out, and so counted.
        """
        header = self.header(kind)
        if not header:
            return None
        found = list((lead or re.compile(rf"(?m)^{kind},".encode())).finditer(self._text))
        starts = np.array([m.start() for m in found], np.int64)
        text = self._text
        rows = [text[at : _end(text, at)] for at in starts.tolist()]
        cells = np.array([row.count(b",") for row in rows], np.int64)
        if not rows:
            return Table({}, np.empty(0, np.int64))
        usual = int(np.bincount(cells).argmax())
        line = np.searchsorted(np.flatnonzero(np.frombuffer(text, np.uint8) == 10), starts) + 1
        keep = cells == usual
        if not keep.all():
            first = int(np.flatnonzero(~keep)[0])
            notes.skip(
                f"{kind} lines with another number of cells", int((~keep).sum()),
                f"line {line[first]}: {cells[first] + 1} instead of {usual + 1}",
            )  # fmt: skip
        body = b"\n".join(row for row, kept in zip(rows, keep, strict=True) if kept) + b"\n"
        body = body.replace(b"\r", b"?")  # one in mid-line would end it
        # the first cell is the kind itself
        places = {name: header.index(name) + 1 for name in wanted if name in header[:usual]}
        return Table(_columns(body, usual + 1, places, int(keep.sum())), line[keep])


def _end(text: bytes, at: int) -> int:
    stop = text.find(b"\n", at)
    stop = len(text) if stop < 0 else stop
    return stop - 1 if text[stop - 1 : stop] == b"\r" else stop


def _columns(body: bytes, width: int, places: dict[str, int], rows: int) -> dict[str, NDArray[Any]]:
    """Typed columns of text without its header; slower, cell by cell, where a cell is no number."""
    try:
        table = _convert(body, width, places, typed=True)
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


def _convert(body: bytes, width: int, places: dict[str, int], *, typed: bool) -> pa.Table:
    types = {f"c{i}": pa.int64() if name in WHOLE else pa.float64() for name, i in places.items()}
    return csv.read_csv(
        pa.py_buffer(body),
        csv.ReadOptions(
            use_threads=False, block_size=max(1 << 20, len(body) + 1), column_names=[f"c{i}" for i in range(width)]
        ),
        csv.ParseOptions(quote_char=False, ignore_empty_lines=False),
        csv.ConvertOptions(
            check_utf8=False, include_columns=list(types), column_types=types if typed else {}, null_values=["", "NaN"]
        ),
    )  # fmt: skip


def _number(cell: bytes, whole: bool) -> float | int:
    try:
        if not whole:
            return float(cell)
        value = int(cell)
    except ValueError:
        return ABSENT if whole else np.nan
    return value if abs(value) < 1 << 62 else ABSENT
