"""The cells of a CSV log: rows in blocks, and the known columns of a block as numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import compute as pc
from pyarrow import csv

from fusion.errors import MalformedLogError
from fusion.formats.base import Notes, number_or_nan
from fusion.formats.tables.header import LINE_END, Layout
from fusion.formats.tables.names import DATE, GPS_TIME, TIME, Cell
from fusion.formats.time_texts import times_of
from fusion.messages import say
from fusion.signals import unix_from_gps
from fusion.types import Floats, Ints, Progress

NOT_MEASURED = ["", "-", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None"]
BLOCK_BYTES = 16 << 20
"""Rows are read in blocks of about this size, so that only the numbers of a log are held at once, not its cells."""


@dataclass
class Block:
    """The cells of the known columns as numbers, and what is needed to say where a row is.

    ``first_line`` is the number of the first line of ``body``; ``ragged`` holds the numbers (from 1, blank
    lines not counted) of the rows that were left out.
    """

    body: bytes
    first_line: int
    columns: dict[str, Floats]
    ragged: list[int]
    words: dict[str, list[str]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def column(self, name: str) -> Floats:
        """A column of numbers, all NaN where the file does not have it."""
        return self.columns.get(name, np.full(len(self), np.nan))

    @cached_property
    def _lines(self) -> Ints:
        """The line of the file that each kept row stands on."""
        lines = [n for n, text in enumerate(self.body.splitlines(), self.first_line) if text]
        return np.delete(np.array(lines, np.int64), [r - 1 for r in self.ragged if 0 < r <= len(lines)])

    def place(self, row: int) -> str:
        """``line 7`` for a row number from 0."""
        return (
            say("place.line", n=self._lines[min(row, len(self._lines) - 1)])
            if len(self._lines)
            else say("place.row", n=row + 1)
        )


def read_blocks(data: bytes, layout: Layout, notes: Notes, progress: Progress) -> Iterator[Block]:
    """The rows block by block; after each, ``progress`` is told the share of the file that has been read."""
    at, line = layout.body_at, layout.line
    while at < len(data):
        cut = LINE_END.search(data, at + BLOCK_BYTES)
        end = cut.end() if cut else len(data)
        body = _utf8(data[at:end])
        if body.strip():
            yield _parse(body, line, layout, notes)
            progress("read rows", end / len(data))
        line += body.count(b"\n") + body.count(b"\r") - body.count(b"\r\n")
        at = end


def _utf8(body: bytes) -> bytes:
    try:
        body.decode()
    except UnicodeDecodeError:  # a degree sign of an old code page, say
        return body.decode("utf-8", "replace").encode()
    return body


def _parse(body: bytes, line: int, layout: Layout, notes: Notes) -> Block:
    block = Block(body, line, {}, [])
    cells, faulty = _cells_of(body, layout, block.ragged)
    if block.ragged:
        # numbers of ragged rows count every row that is not blank
        rows = Block(body, line, {}, [])
        example = say(
            "csv.cells_of_row", place=rows.place(block.ragged[0] - 1), cells=len(layout.header.cells)
        )
        notes.skip("rows with a wrong number of cells", len(block.ragged), example, position=True)
    dates = cells.column(f"c{layout.known[DATE].index}").to_pylist() if DATE in layout.known else None
    for name, cell in layout.known.items():
        column = cells.column(f"c{cell.index}")
        if name in layout.schema.clocks:
            value, bare = _times(column, dates if name == TIME else None, cell, block, notes)
            block.columns[name] = value
            if bare and (name == TIME or TIME not in layout.known):
                notes.warn(NO_OFFSET)
        elif name in layout.schema.words:
            block.words[name] = [(text or "").strip().strip('"').strip() for text in column.to_pylist()]
        elif name != DATE:
            if faulty:
                value = _numbers(name, column, layout.comma, block, notes)
            else:
                value = column.to_numpy(zero_copy_only=False)
            block.columns[name] = _converted(name, value, cell)
    return block


def _converted(name: str, value: Floats, cell: Cell) -> Floats:
    value = np.where(np.isfinite(value), value, np.nan)
    if (cell.factor, cell.offset) != (1.0, 0.0):
        with np.errstate(over="ignore"):
            value = value * cell.factor + cell.offset
        value = np.where(np.isfinite(value), value, np.nan)
    return unix_from_gps(np.nan_to_num(value, nan=-1e12)) if name == GPS_TIME else value


def _cells_of(body: bytes, layout: Layout, ragged: list[int]) -> tuple[pa.Table, bool]:
    """The known columns, as numbers if every cell is one (the usual case, fast), else as text and True."""

    def count(row: csv.InvalidRow) -> str:
        ragged.append(row.number or 0)
        return "skip"

    def convert(kind: pa.DataType) -> pa.Table:
        ragged.clear()
        return csv.read_csv(
            pa.py_buffer(body),
            csv.ReadOptions(
                use_threads=False,
                block_size=2 * BLOCK_BYTES,
                column_names=[f"c{i}" for i in range(len(layout.header.cells))],
            ),
            csv.ParseOptions(
                delimiter=layout.header.delimiter,
                # an odd number of quotes would swallow rows: then they are taken as they stand
                quote_char='"' if body.count(b'"') % 2 == 0 else False,
                invalid_row_handler=count,
            ),
            csv.ConvertOptions(
                check_utf8=False,
                include_columns=list(dict.fromkeys(f"c{c.index}" for c in layout.known.values())),
                column_types={
                    f"c{c.index}": pa.string() if layout.is_text(n) else kind for n, c in layout.known.items()
                },
                null_values=NOT_MEASURED,
                strings_can_be_null=True,
                decimal_point="," if layout.comma else ".",
            ),
        )

    try:
        try:
            return convert(pa.float64()), False
        except pa.ArrowInvalid:
            return convert(pa.string()), True
    except pa.ArrowException as error:
        raise MalformedLogError(say("csv.no_cells", error=error)) from error


NO_OFFSET = say("csv.local_times")


def _times(
    column: pa.ChunkedArray, dates: list[str | None] | None, cell: Cell, block: Block, notes: Notes
) -> tuple[Floats, bool]:
    """Unix seconds, and whether some of them were written without an offset."""
    texts = column.to_pylist()
    if dates is not None:
        texts = [f"{d.strip()} {t.strip()}" if d and t else None for d, t in zip(dates, texts, strict=True)]
    out, bare = times_of(texts, cell.factor if cell.factor != 1.0 else None)
    has_text = np.array([bool(t) for t in texts], bool)
    bad = np.flatnonzero(has_text & np.isnan(out))
    if len(bad):
        example = say("csv.time_is", place=block.place(int(bad[0])), text=texts[bad[0]][:40])
        notes.skip("cells that are no time", len(bad), example, position=True)
    return out, bool(bare.any())


def _numbers(name: str, column: pa.ChunkedArray, comma: bool, block: Block, notes: Notes) -> Floats:
    if not comma:
        try:
            values = pc.utf8_trim_whitespace(column).cast(pa.float64()).to_numpy()
            return np.where(np.isfinite(values), values, np.nan)
        except pa.ArrowInvalid:  # this is the column, or one of them, with a faulty cell
            pass
    import pandas as pd  # noqa: PLC0415 - it takes longer to load than most logs to read

    texts = pd.Series(column.to_pylist(), dtype=object)
    plain = texts.str.strip().str.strip('"') if texts.notna().any() else texts
    if comma:
        plain = plain.str.replace(",", ".", regex=False)
    plain = plain.mask(plain.isin(NOT_MEASURED))
    out = np.array(pd.to_numeric(plain, errors="coerce"), float)
    bad = np.flatnonzero(plain.notna().to_numpy(bool) & np.isnan(out))
    if len(bad):
        example = f"{block.place(int(bad[0]))}: {name} is {str(texts[bad[0]])[:40]!r}"
        notes.skip("cells that are not numbers", len(bad), example)
        if name in ("time_s", "lat_deg", "lon_deg") and not notes.first_offender:
            notes.first_offender = example
    return np.where(np.isfinite(out), out, np.nan)


ABSENT = np.iinfo(np.int64).min
"""What stands in a column of whole numbers where there is none."""


def plain_columns(
    rows: Sequence[bytes], delimiter: str, places: Mapping[str, int], whole: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """Columns of numbers (n,) by name, at these ``places`` of rows that have one number of cells and no quotes.

    int64 if ``whole``, with ``ABSENT`` where a cell is empty or no such number, else float64 with NaN. Slower, cell by
    cell, where a cell is no number.
    """
    body = b"\n".join(rows) + b"\n"
    names = [f"c{i}" for i in range(rows[0].count(delimiter.encode()) + 1)]
    types = {f"c{i}": pa.int64() if name in whole else pa.float64() for name, i in places.items()}
    try:
        table = csv.read_csv(
            pa.py_buffer(body),
            csv.ReadOptions(use_threads=False, block_size=max(1 << 20, len(body) + 1), column_names=names),
            csv.ParseOptions(delimiter=delimiter, quote_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                check_utf8=False, include_columns=list(types), column_types=types, null_values=["", "NaN"]
            ),
        )
        if table.num_rows != len(rows):
            raise pa.ArrowInvalid("a cell holds the end of a line")
    except pa.ArrowException:
        cells = [row.split(delimiter.encode()) for row in rows]
        number = {name: _whole_number if name in whole else number_or_nan for name in places}
        return {name: np.array([number[name](row[i]) for row in cells]) for name, i in places.items()}
    columns = {name: table.column(f"c{i}") for name, i in places.items()}
    return {name: (c.fill_null(ABSENT) if name in whole else c).to_numpy() for name, c in columns.items()}


def _whole_number(cell: bytes) -> int:
    try:
        value = int(cell)
    except ValueError:
        return ABSENT
    return value if abs(value) < 1 << 62 else ABSENT
