"""The cells of a CSV log: header, delimiter, rows in blocks, and the known columns of a block as numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pyarrow as pa
from pyarrow import compute as pc
from pyarrow import csv

from fusion.errors import MalformedLogError
from fusion.formats.base import Notes, unix_seconds
from fusion.types import Floats, Ints

NUMBERS: tuple[str, ...] = (
    "time_s", "lat_deg", "lon_deg", "alt_msl_m", "height_ell_m", "h_acc_m", "v_acc_m",
    "vel_n_mps", "vel_e_mps", "vel_d_mps", "s_acc_mps", "speed_mps", "heading_deg",
    "acc_x_mps2", "acc_y_mps2", "acc_z_mps2", "gyr_x_dps", "gyr_y_dps", "gyr_z_dps",
    "roll_deg", "pitch_deg", "yaw_deg", "pitch_acc_deg",
    "wheel_left_rad", "wheel_right_rad", "odo_speed_mps", "pressure_hpa", "temperature_c",
)  # fmt: skip
COLUMNS = ("time", *NUMBERS)
NOT_MEASURED = ["", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None"]
DELIMITERS = ",;\t|"
BLOCK_BYTES = 16 << 20
"""Rows are read in blocks of about this size, so that only the numbers of a log are held at once, not its cells."""

_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t|\n]) *-?\d{1,20},\d{1,20} *(?:[;\t|\r\n]|$)")
_LINE_END = re.compile(rb"\r\n|\r|\n")
_ZONE = re.compile(r"(?:[zZ]|[+-]\d\d:?\d\d)\s*\"?\s*$")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Schema:
    """What a kind of CSV may have: its columns, those of them that hold words, and which of a header are ``lacking``.

    The column ``time``, where there is one, holds RFC 3339 times.
    """

    columns: tuple[str, ...]
    lacking: Callable[[list[str]], list[str]]
    words: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Layout:
    """How the cells lie: ``known`` gives the cell number of each column of ours, ``width`` counts all cells.

    ``body_at`` is the offset of the first row, ``line`` the number of its line; ``words`` as in ``Schema``.
    """

    delimiter: str
    width: int
    known: dict[str, int]
    comma: bool
    body_at: int
    line: int
    words: frozenset[str] = frozenset()

    def is_text(self, name: str) -> bool:
        """Whether a column is read as it stands."""
        return name == "time" or name in self.words


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

    @cached_property
    def _lines(self) -> Ints:
        """The line of the file that each kept row stands on."""
        lines = [n for n, text in enumerate(self.body.splitlines(), self.first_line) if text]
        return np.delete(np.array(lines, np.int64), [r - 1 for r in self.ragged if 0 < r <= len(lines)])

    def place(self, row: int) -> str:
        """``line 7`` for a row number from 0."""
        return f"line {self._lines[min(row, len(self._lines) - 1)]}" if len(self._lines) else f"row {row + 1}"


def from_utf16(data: bytes) -> bytes:
    """The same text in UTF-8 if it is UTF-16, which spreadsheets write, else ``data`` itself."""
    return data.decode("utf-16", "replace").encode() if data[:2] in _UTF16 else data


def first_line(data: bytes) -> tuple[int, int, bytes]:
    """Number, offset and content of the first line that is neither blank nor a # comment."""
    start = len(_BOM) if data.startswith(_BOM) else 0
    for number, match in enumerate(re.finditer(rb"[^\r\n]*(?:\r\n|\r|\n|$)", data[start:65536]), 1):
        line = match.group().strip()
        if line and not line.startswith(b"#"):
            return number, start + match.start() + match.group().index(line), line
    return 1, start, b""


def delimiter_of(line: bytes) -> str:
    """The delimiter that occurs most in the header."""
    return max(DELIMITERS, key=lambda d: line.count(d.encode()))


def header_cells(line: bytes, delimiter: str) -> list[str]:
    """The names in the header, lower case, without blanks and quotes around."""
    return [c.strip().strip('"').strip().lower() for c in line.decode("utf-8", "replace").split(delimiter)]


def layout_of(data: bytes, notes: Notes, schema: Schema) -> Layout:
    """Read the header; raises ``MalformedLogError`` naming the required columns that it lacks."""
    number, at, line = first_line(data)
    delimiter = delimiter_of(line)
    header = header_cells(line, delimiter)
    _check_header(header, number, notes, schema)
    at += len(line)
    while data[at : at + 1] in (b" ", b"\t"):
        at += 1
    end = _LINE_END.match(data, at)
    at = end.end() if end else at
    comma = delimiter != "," and bool(_DECIMAL_COMMA.search(data[at : at + 65536]))
    known = {name: header.index(name) for name in schema.columns if name in header}
    return Layout(delimiter, len(header), known, comma, at, number + 1, schema.words)


def read_blocks(data: bytes, layout: Layout, notes: Notes) -> Iterator[tuple[Block, float]]:
    """The rows block by block, each with the share of the file that is read with it."""
    at, line = layout.body_at, layout.line
    while at < len(data):
        cut = _LINE_END.search(data, at + BLOCK_BYTES)
        end = cut.end() if cut else len(data)
        body = _utf8(data[at:end])
        if body.strip():
            yield _parse(body, line, layout, notes), end / len(data)
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
        example = f"{rows.place(block.ragged[0] - 1)}: not {layout.width} cells as in the header"
        notes.skip("rows with a wrong number of cells", len(block.ragged), example, position=True)
    for name, index in layout.known.items():
        column = cells.column(f"c{index}")
        if name == "time":
            block.columns[name] = _times(column, block, notes)
        elif name in layout.words:
            block.words[name] = [(cell or "").strip().strip('"').strip() for cell in column.to_pylist()]
        elif faulty:
            block.columns[name] = _numbers(name, column, layout.comma, block, notes)
        else:
            values = column.to_numpy(zero_copy_only=False)
            block.columns[name] = np.where(np.isfinite(values), values, np.nan)
    return block


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
                column_names=[f"c{i}" for i in range(layout.width)],
            ),
            csv.ParseOptions(
                delimiter=layout.delimiter,
                # an odd number of quotes would swallow rows: then they are taken as they stand
                quote_char='"' if body.count(b'"') % 2 == 0 else False,
                invalid_row_handler=count,
            ),
            csv.ConvertOptions(
                check_utf8=False,
                include_columns=[f"c{i}" for i in layout.known.values()],
                column_types={
                    f"c{i}": pa.string() if layout.is_text(n) else kind for n, i in layout.known.items()
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
        raise MalformedLogError(f"This CSV cannot be split into cells: {error}. Export it again.") from error


def _check_header(header: list[str], line: int, notes: Notes, schema: Schema) -> None:
    missing = schema.lacking(header)
    if missing:
        shown = ", ".join(c[:40] or "(empty)" for c in header[:30])
        raise MalformedLogError(
            f"This CSV lacks required columns: {', '.join(missing)}. Its header, line {line}, names: "
            f"{shown}. Rename the columns or add them; all others are optional.",
            where=f"line {line}",
        )
    unknown = [c for c in header if c not in schema.columns]
    if unknown:
        shown = ", ".join(repr(c[:40]) for c in unknown[:20])
        notes.warn(f"The CSV has columns that are not known here and were left out: {shown}.")
    twice = sorted({c for c in header if c in schema.columns and header.count(c) > 1})
    if twice:
        notes.warn(f"The CSV names columns twice, of which the first is used: {', '.join(twice)}.")


def _times(column: pa.ChunkedArray, block: Block, notes: Notes) -> Floats:
    texts = column.to_pylist()
    out = unix_seconds([t.strip().strip('"') if t else None for t in texts])
    given = np.array([bool(t) for t in texts], bool)
    bad = np.flatnonzero(given & np.isnan(out))
    if len(bad):
        example = f"{block.place(int(bad[0]))}: time is {texts[bad[0]][:40]!r}"
        notes.skip("cells that are no RFC 3339 time", len(bad), example, position=True)
    if any(t and not _ZONE.search(t) for t in texts):
        notes.warn("Times without a UTC offset (such as Z) are taken as UTC.")
    return out


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
