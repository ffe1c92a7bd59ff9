"""Versant CSV: one header, one row per instant, empty cells where a sensor did not measure; others' likewise."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from fusion.formats.base import Data, Notes
from fusion.formats.csv_header import (
    COLUMNS,
    Schema,
    delimiter_of,
    first_line,
    from_utf16,
    header_cells,
    understood_header,
)
from fusion.formats.csv_log import read_rows
from fusion.formats.csv_names import GPS_TIME
from fusion.formats.phones.gnsslogger import has_log_header
from fusion.formats.phones.sensor_logger import is_sensor_logger
from fusion.formats.pseudoranges_csv import PSEUDORANGE
from fusion.formats.torque import is_vehicle_log
from fusion.signals import Navigation
from fusion.types import DriveLog, Progress

_OTHER_KINDS = (b"$", b"<", b"{", b"[", b"%")


@dataclass(frozen=True)
class VersantCsvFormat:
    """``COLUMNS`` in any order; recognised by any header line, refused if required columns are missing."""

    columns: Mapping[str, str] = field(default_factory=dict)

    name = "csv"
    description = "Versant CSV"
    suffixes = (".csv",)
    altitude_advice = (
        "Add the column alt_msl_m or height_ell_m, or name the one that holds it, such as `--columns "
        "alt_msl_m=Altitude`."
    )
    doppler_advice = (
        "Add the column vel_d_mps (Doppler velocity downwards), or name the one that holds it by `--columns`."
    )

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``: text whose first line has several cells, or one that is a column of ours."""
        head = from_utf16(head[: len(head) // 2 * 2]) if head[:1] in (b"\xff", b"\xfe") else head
        line = first_line(head)[2]
        if not line or line.startswith(_OTHER_KINDS) or re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", head[:4096]):
            return False
        cells = header_cells(line, delimiter_of(line))
        if PSEUDORANGE in cells or has_log_header(head) or is_sensor_logger(line) or is_vehicle_log(head):
            return False
        return any(c in COLUMNS for c in cells) or (len(cells) > 1 and _is_text(line))

    def with_columns(self, columns: Mapping[str, str]) -> Self:
        """See ``NamedColumnsFormat``."""
        return replace(self, columns=columns)

    def refuse_header(self, head: bytes, *, part: bool) -> None:
        """See ``NamedColumnsFormat``."""
        head = from_utf16(head[: len(head) // 2 * 2])
        understood_header(head, self._schema(part=part))

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        return self._read(data, progress, self._schema(part=False))

    def comes_first(self, head: bytes) -> bool:
        """See ``PartFormat``."""
        return False

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """See ``PartFormat``: a CSV of sensors alone needs no columns of positions."""
        return self._read(data, progress, self._schema(part=True))

    def _read(self, data: Data, progress: Progress, schema: Schema) -> DriveLog:
        return read_rows(
            data, progress, schema, format_name=self.name, description=self.description, notes=Notes()
        )

    def _schema(self, *, part: bool) -> Schema:
        lacking = lacking_time if part else lacking_position
        return Schema(COLUMNS, lacking, named=self.columns, loose=True, part=part)


def lacking_time(columns: Collection[str]) -> list[str]:
    """The required columns that are not there of a file whose positions come from another."""
    timed = {"time_s", "time", GPS_TIME} & set(columns)
    return [] if timed else ["time_s (Unix seconds) or time (RFC 3339)"]


def lacking_position(columns: Collection[str]) -> list[str]:
    """The required columns that are not there."""
    return lacking_time(columns) + [name for name in ("lat_deg", "lon_deg") if name not in columns]


def _is_text(line: bytes) -> bool:
    try:
        return line.decode("utf-8").isprintable() or b"\t" in line
    except UnicodeDecodeError:
        return False
