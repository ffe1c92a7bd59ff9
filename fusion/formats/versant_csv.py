"""Versant CSV: one header, one row per instant, empty cells where a sensor did not measure; others' likewise."""

from __future__ import annotations

import re
from collections.abc import Collection

from fusion.formats.phones.gnsslogger import has_log_header
from fusion.formats.phones.sensor_logger import is_sensor_logger
from fusion.formats.pseudoranges_csv import PSEUDORANGE
from fusion.formats.tables.header import COLUMNS, from_utf16, header_of
from fusion.formats.tables.log import NamedColumnsCsv
from fusion.formats.tables.names import GPS_TIME, Schema
from fusion.formats.torque import is_vehicle_log
from fusion.messages import say

_OTHER_KINDS = (b"$", b"<", b"{", b"[", b"%")


class VersantCsvFormat(NamedColumnsCsv):
    """``COLUMNS`` in any order; recognised by any header line, refused if required columns are missing."""

    name = "csv"
    description = "Versant CSV"
    suffixes = (".csv",)
    altitude_advice = say("advice.csv_altitude")
    doppler_advice = say("advice.csv_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``: text whose first line has several cells, or one that is a column of ours."""
        head = from_utf16(head)
        header = header_of(head)
        line, names = header.line, header.names
        if not line or line.startswith(_OTHER_KINDS) or re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", head[:4096]):
            return False
        if PSEUDORANGE in names or has_log_header(head) or is_sensor_logger(names) or is_vehicle_log(names):
            return False
        return any(name in COLUMNS for name in names) or (len(names) > 1 and _is_text(line))

    def schema(self, *, part: bool) -> Schema:
        """See ``NamedColumnsCsv``: a CSV of sensors alone, as a part of a drive, needs no columns of positions."""
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
