"""Versant CSV: one header, one row per instant, empty cells where a sensor did not measure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import compute as pc
from pyarrow import csv

from fusion.errors import MalformedLogError
from fusion.formats.base import Data, Notes, build_log, ground_velocity, usable_positions
from fusion.formats.timestamps import unix_seconds
from fusion.types import (
    AngularRate,
    Attitude,
    DriveLog,
    Floats,
    GnssFix,
    GnssVelocity,
    Ints,
    Odometry,
    Pressure,
    Progress,
    SensorTable,
    SpecificForce,
)

DEG = np.pi / 180
NUMBERS: tuple[str, ...] = (
    "time_s", "lat_deg", "lon_deg", "alt_msl_m", "height_ell_m", "h_acc_m", "v_acc_m",
    "vel_n_mps", "vel_e_mps", "vel_d_mps", "s_acc_mps", "speed_mps", "heading_deg",
    "acc_x_mps2", "acc_y_mps2", "acc_z_mps2", "gyr_x_dps", "gyr_y_dps", "gyr_z_dps",
    "roll_deg", "pitch_deg", "yaw_deg", "pitch_acc_deg",
    "wheel_left_rad", "wheel_right_rad", "odo_speed_mps", "pressure_hpa",
)  # fmt: skip
COLUMNS = ("time", *NUMBERS)
NOT_MEASURED = ["", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None"]
DELIMITERS = ",;\t|"
_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t|\n]) *-?\d{1,20},\d{1,20} *(?:[;\t|\r\n]|$)")
_ZONE = re.compile(r"(?:[zZ]|[+-]\d\d:?\d\d)\s*\"?\s*$")
_OTHER_KINDS = (b"$", b"<", b"{", b"[", b"%")


class VersantCsvFormat:
    """``COLUMNS`` in any order; recognised by any header line, refused if required columns are missing."""

    name = "csv"
    description = "Versant CSV"
    suffixes = (".csv",)

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``: text whose first line has several cells, or one that is a column of ours."""
        if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
            head = _utf8(head[: len(head) // 2 * 2])
        line = _first_line(head.removeprefix(b"\xef\xbb\xbf"))[1]
        if not line or line.startswith(_OTHER_KINDS) or re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", head[:4096]):
            return False
        cells = _cells(line, _delimiter(line))
        return any(c in COLUMNS for c in cells) or (len(cells) > 1 and _is_text(line))

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        table = _parse(_utf8(bytes(data)), notes)
        progress("read rows", 0.7)
        log = _assemble(table, notes)
        progress("read rows", 1.0)
        return log


def _is_text(line: bytes) -> bool:
    try:
        return line.decode("utf-8").isprintable() or b"\t" in line
    except UnicodeDecodeError:
        return False


def _utf8(data: bytes) -> bytes:
    """UTF-8 without a byte order mark; spreadsheets also write UTF-16."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    try:
        data.decode()
    except UnicodeDecodeError:  # a degree sign of an old code page in the header, say
        return data.decode("utf-8", "replace").encode()
    return data


def _first_line(data: bytes) -> tuple[int, bytes]:
    """Number and content of the first line that is neither blank nor a # comment."""
    for number, match in enumerate(re.finditer(rb"[^\r\n]*(?:\r\n|\r|\n|$)", data[:65536]), 1):
        line = match.group().strip()
        if line and not line.startswith(b"#"):
            return number, line
    return 1, b""


def _delimiter(line: bytes) -> str:
    return max(DELIMITERS, key=lambda d: line.count(d.encode()))


def _cells(line: bytes, delimiter: str) -> list[str]:
    return [c.strip().strip('"').strip().lower() for c in line.decode("utf-8", "replace").split(delimiter)]


@dataclass
class _Table:
    """The cells of the known columns as numbers, and what is needed to say where a row is.

    ``first_line`` is the number of the first line of ``body``; ``ragged`` holds the numbers (from 1, blank
    lines not counted) of the rows that were left out.
    """

    body: bytes
    first_line: int
    columns: dict[str, Floats]
    ragged: list[int]

    @cached_property
    def _lines(self) -> Ints:
        """The line of the file that each kept row stands on."""
        lines = [n for n, text in enumerate(self.body.splitlines(), self.first_line) if text]
        return np.delete(np.array(lines, np.int64), [r - 1 for r in self.ragged if 0 < r <= len(lines)])

    def place(self, row: int) -> str:
        """``line 7`` for a row number from 0."""
        return f"line {self._lines[min(row, len(self._lines) - 1)]}" if len(self._lines) else f"row {row + 1}"


def _parse(data: bytes, notes: Notes) -> _Table:
    number, line = _first_line(data)
    delimiter = _delimiter(line)
    header = _cells(line, delimiter)
    _check_header(header, number, notes)
    body = data[data.index(line) + len(line) :].lstrip(b" \t")
    body = body.removeprefix(b"\r").removeprefix(b"\n")
    known = {name: header.index(name) for name in COLUMNS if name in header}
    table = _Table(body, number + 1, {}, [])
    if not body.strip():
        table.columns = {name: np.empty(0) for name in known}
        return table
    comma = delimiter != "," and bool(_DECIMAL_COMMA.search(body[:65536]))
    cells, faulty = _cells_of(body, delimiter, len(header), known, comma, table.ragged)
    if table.ragged:
        # numbers of ragged rows count every row that is not blank
        rows = _Table(body, number + 1, {}, [])
        example = f"{rows.place(table.ragged[0] - 1)}: not {len(header)} cells as in the header"
        notes.skip("rows with a wrong number of cells", len(table.ragged), example, position=True)
    for name, index in known.items():
        column = cells.column(f"c{index}")
        if name == "time":
            table.columns[name] = _times(column, table, notes)
        elif faulty:
            table.columns[name] = _numbers(name, column, comma, table, notes)
        else:
            values = column.to_numpy(zero_copy_only=False)
            table.columns[name] = np.where(np.isfinite(values), values, np.nan)
    return table


def _cells_of(
    body: bytes, delimiter: str, width: int, known: dict[str, int], comma: bool, ragged: list[int]
) -> tuple[pa.Table, bool]:
    """The known columns, as numbers if every cell is one (the usual case, fast), else as text and True."""

    def count(row: csv.InvalidRow) -> str:
        ragged.append(row.number or 0)
        return "skip"

    def convert(kind: pa.DataType) -> pa.Table:
        ragged.clear()
        return csv.read_csv(
            pa.py_buffer(body),
            csv.ReadOptions(
                use_threads=False, block_size=16 << 20, column_names=[f"c{i}" for i in range(width)]
            ),
            csv.ParseOptions(
                delimiter=delimiter,
                # an odd number of quotes would swallow rows: then they are taken as they stand
                quote_char='"' if body.count(b'"') % 2 == 0 else False,
                invalid_row_handler=count,
            ),
            csv.ConvertOptions(
                check_utf8=False,
                include_columns=[f"c{i}" for i in known.values()],
                column_types={f"c{i}": pa.string() if n == "time" else kind for n, i in known.items()},
                null_values=NOT_MEASURED,
                strings_can_be_null=True,
                decimal_point="," if comma else ".",
            ),
        )

    try:
        try:
            return convert(pa.float64()), False
        except pa.ArrowInvalid:
            return convert(pa.string()), True
    except pa.ArrowException as error:
        raise MalformedLogError(f"This CSV cannot be split into cells: {error}. Export it again.") from error


def _check_header(header: list[str], line: int, notes: Notes) -> None:
    missing = [name for name in ("lat_deg", "lon_deg") if name not in header]
    if "time_s" not in header and "time" not in header:
        missing.insert(0, "time_s (Unix seconds) or time (RFC 3339)")
    if missing:
        shown = ", ".join(c[:40] or "(empty)" for c in header[:30])
        raise MalformedLogError(
            f"This CSV lacks required columns: {', '.join(missing)}. Its header, line {line}, names: "
            f"{shown}. Rename the columns or add them; all others are optional.",
            where=f"line {line}",
        )
    unknown = [c for c in header if c not in COLUMNS]
    if unknown:
        shown = ", ".join(repr(c[:40]) for c in unknown[:20])
        notes.warn(f"The CSV has columns that are not known here and were left out: {shown}.")
    twice = sorted({c for c in header if c in COLUMNS and header.count(c) > 1})
    if twice:
        notes.warn(f"The CSV names columns twice, of which the first is used: {', '.join(twice)}.")


def _times(column: pa.ChunkedArray, table: _Table, notes: Notes) -> Floats:
    texts = column.to_pylist()
    out = unix_seconds([t.strip().strip('"') if t else None for t in texts])
    given = np.array([bool(t) for t in texts], bool)
    bad = np.flatnonzero(given & np.isnan(out))
    if len(bad):
        example = f"{table.place(int(bad[0]))}: time is {texts[bad[0]][:40]!r}"
        notes.skip("cells that are no RFC 3339 time", len(bad), example, position=True)
    naive = [t for t in texts if t and not _ZONE.search(t)]
    if naive:
        notes.warn(f"{len(naive)} times have no UTC offset (such as Z) and are taken as UTC.")
    return out


def _numbers(name: str, column: pa.ChunkedArray, comma: bool, table: _Table, notes: Notes) -> Floats:
    if not comma:
        try:
            values = pc.utf8_trim_whitespace(column).cast(pa.float64()).to_numpy()
            return np.where(np.isfinite(values), values, np.nan)
        except pa.ArrowInvalid:  # this is the column, or one of them, with a faulty cell
            pass
    texts = pd.Series(column.to_pylist(), dtype=object)
    plain = texts.str.strip().str.strip('"') if texts.notna().any() else texts
    if comma:
        plain = plain.str.replace(",", ".", regex=False)
    plain = plain.mask(plain.isin(NOT_MEASURED))
    out = np.array(pd.to_numeric(plain, errors="coerce"), float)
    bad = np.flatnonzero(plain.notna().to_numpy(bool) & np.isnan(out))
    if len(bad):
        example = f"{table.place(int(bad[0]))}: {name} is {str(texts[bad[0]])[:40]!r}"
        notes.skip("cells that are not numbers", len(bad), example)
        if name in ("time_s", "lat_deg", "lon_deg") and not notes.first_offender:
            notes.first_offender = example
    return np.where(np.isfinite(out), out, np.nan)


def _assemble(table: _Table, notes: Notes) -> DriveLog:
    rows = len(next(iter(table.columns.values())))
    unknown = np.full(rows, np.nan)
    col = {name: table.columns.get(name, unknown) for name in COLUMNS}
    _forget_placeholders(col, notes)
    time_s = np.where(np.isfinite(col["time_s"]), col["time_s"], col["time"])
    lat, lon = col["lat_deg"], col["lon_deg"]
    claims = np.isfinite(lat) | np.isfinite(lon)
    good = usable_positions(time_s, lat, lon, notes, table.place, need=claims)
    time_s, col = time_s[good], {name: c[good] for name, c in col.items()}
    here = claims[good]
    north, east = ground_velocity(col["speed_mps"], col["heading_deg"] * DEG)
    has = np.isfinite(col["vel_n_mps"]) & np.isfinite(col["vel_e_mps"])
    velocity = {
        "vel_n_mps": np.where(has, col["vel_n_mps"], north),
        "vel_e_mps": np.where(has, col["vel_e_mps"], east),
        "vel_d_mps": col["vel_d_mps"],
        "s_acc_mps": col["s_acc_mps"],
    }
    moving = np.isfinite(velocity["vel_n_mps"]) | np.isfinite(velocity["vel_d_mps"])
    used = {n: col[n] for n in COLUMNS}
    used |= {n.replace("dps", "radps"): col[n] * DEG for n in COLUMNS if n.endswith("_dps")}
    used |= {
        n.replace("deg", "rad"): col[n] * DEG for n in ("roll_deg", "pitch_deg", "yaw_deg", "pitch_acc_deg")
    }
    used |= {"speed_mps": col["odo_speed_mps"], "pressure_pa": col["pressure_hpa"] * 100}
    position = {n: used[n][here] for n in GnssFix.columns()}
    tables: dict[str, SensorTable] = {
        "fix": GnssFix.assemble(time_s[here], notes.repaired, **position),
        "velocity": GnssVelocity.assemble(time_s[moving], **{n: c[moving] for n, c in velocity.items()}),
    }
    for name, kind in _OTHERS.items():
        tables[name] = kind.assemble(time_s, None, **{n: used[n] for n in kind.columns() if n in used})
    return build_log("csv", "Versant CSV", notes, tables)


def _forget_placeholders(col: dict[str, Floats], notes: Notes) -> None:
    """Make numbers that stand for "unknown" unknown: phones write accuracies of 0 or -1, receivers 2^32 mm, and an
    attitude of exactly 0, 0, 0 until they are aligned. In place."""
    for name in ("h_acc_m", "v_acc_m", "s_acc_mps", "pitch_acc_deg"):
        senseless = (col[name] <= 0) | (col[name] > _WORST_ACCURACY)
        if senseless.any():
            col[name] = np.where(senseless, np.nan, col[name])
            notes.repaired[f"{name}: not above 0 or absurdly large, taken as unknown"] += int(senseless.sum())
    angles = np.array([col[name] for name in ("roll_deg", "pitch_deg", "yaw_deg")])
    asleep = np.isfinite(angles[1]) & np.all((angles == 0) | np.isnan(angles), axis=0)
    # A pitch column alone may well read 0 on a level road; only with roll or yaw beside it does 0 mean nothing.
    asleep &= np.isfinite(angles[[0, 2]]).any(axis=0)
    if asleep.any():
        for name in ("roll_deg", "pitch_deg", "yaw_deg"):
            col[name] = np.where(asleep, np.nan, col[name])
        notes.repaired["attitude of exactly 0, taken as unknown"] += int(asleep.sum())


_WORST_ACCURACY = 10_000.0

_OTHERS: dict[str, type[SensorTable]] = {
    "force": SpecificForce,
    "rate": AngularRate,
    "attitude": Attitude,
    "odometry": Odometry,
    "pressure": Pressure,
}
