"""Lines of several kinds in one text, each kind a table whose columns a comment names: ``# Raw,TimeNanos,...``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import Notes
from fusion.formats.tables.cells import plain_columns
from fusion.messages import say
from fusion.types import Ints

WHOLE = frozenset({
    "TimeNanos", "FullBiasNanos", "ReceivedSvTimeNanos", "State", "Svid", "ConstellationType",
    "HardwareClockDiscontinuityCount",
})  # fmt: skip
"""Columns of whole numbers, which have more digits than a float holds."""
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
        return say("place.line", n=self.line[row])


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
        names = match.group(1).decode("ascii", "replace").split(",") if match else ()
        return [name.strip() for name in names]

    def table(self, kind: str, names: tuple[str, ...], notes: Notes, first_cell: str = "") -> Table:
        """The wanted columns of the lines of a kind, or those with that first cell; no line without a header.

        Lines with another number of cells than most are left out, and so counted.
        """
        header = self.header(kind)
        numbers = self._numbers.get(kind.encode(), []) if header else []
        if first_cell:
            lead = f"{kind},{first_cell},".lower().encode()
            numbers = [k for k in numbers if self._lines[k][: len(lead)].lower() == lead]
        # a return in mid-line would end the row
        rows = [self._lines[k].rstrip(b"\r").replace(b"\r", b"?") for k in numbers]
        line = np.array(numbers, np.int64) + 1
        cells = np.array([row.count(b",") for row in rows], np.int64)
        usual = int(np.bincount(cells).argmax()) if rows else 0
        odd = np.flatnonzero(cells != usual)
        if len(odd):
            example = say("phone.cells_of_line", line=line[odd[0]], n=cells[odd[0]] + 1, usual=usual + 1)
            notes.skip(f"{kind} lines with another number of cells", len(odd), example)
            rows = [row for row, count in zip(rows, cells, strict=True) if count == usual]
        # the first cell is the kind itself
        places = {name: header.index(name) + 1 for name in names if name in header[:usual]}
        return Table(plain_columns(rows, ",", places, WHOLE) if rows else {}, line[cells == usual])
