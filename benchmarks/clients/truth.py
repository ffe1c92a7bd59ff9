"""What is in the database, by SQL, and whether a client got the same: ids, values, types."""

from __future__ import annotations

import hashlib
import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import pandas
import psycopg

from app.core.text import COORDINATE_DIGITS
from app.map.segment import COLUMNS

Row = Mapping[str, Any]
ENDS = ("lon0", "lat0", "lon1", "lat1")
DRAWN = ("slope_percent", "slope_sigma_percent", "drives", "highway", "oneway")
"""What tiles carry of a segment beside its id."""

KINDS = {
    "int64": "integer", "int32": "integer", "int16": "integer", "double": "number", "string": "text", "bool": "boolean",
    "timestamp[ms, tz=UTC]": "time",
}  # fmt: skip
EXPECTED_KINDS = {name: KINDS[column.arrow] for name, column in COLUMNS.items()}

_SEGMENTS = """
    SELECT {columns}, ST_X(ST_StartPoint(s.geom)) AS lon0, ST_Y(ST_StartPoint(s.geom)) AS lat0,
           ST_X(ST_EndPoint(s.geom)) AS lon1, ST_Y(ST_EndPoint(s.geom)) AS lat1
    FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
"""


@dataclass(frozen=True)
class Reading:
    """What a client got."""

    rows: Iterable[Row]
    """Each with the names of ``COLUMNS``, or ``DRAWN`` and id, and ``ENDS`` where it knows lines."""
    names: tuple[str, ...]
    version: str
    kinds: Mapping[str, str] = field(default_factory=dict)
    """Kind of each property as the client declares it, where it does."""
    remarks: str = ""
    seconds: float = math.nan
    """Of the reading alone."""


@dataclass(frozen=True)
class Comparison:
    """A client's line of the table."""

    client: str
    version: str
    features: int
    equal: bool
    checksum: str
    wrong_kinds: dict[str, str]
    seconds: float
    remarks: str


class Truth:
    """All segments of the database, once."""

    def __init__(self, database_url: str) -> None:
        columns = ", ".join(f"{column.sql} AS {name}" for name, column in COLUMNS.items())
        with psycopg.connect(database_url) as connection:
            cursor = connection.execute(_SEGMENTS.format(columns=columns))
            names = [column.name for column in cursor.description or ()]
            self.rows: list[Row] = [dict(zip(names, row, strict=True)) for row in cursor]
        self._checksums: dict[tuple[str, ...], str] = {}

    def __len__(self) -> int:
        return len(self.rows)

    def judged(self, client: str, reading: Reading) -> Comparison:
        """Compare checksums over all that the client knows of each segment, and its kinds with the contract's."""
        if reading.names not in self._checksums:
            self._checksums[reading.names] = checksum(self.rows, reading.names)[1]
        count, digest = checksum(reading.rows, reading.names)
        wrong = {name: kind for name, kind in reading.kinds.items() if EXPECTED_KINDS.get(name, kind) != kind}
        equal = count == len(self) and digest == self._checksums[reading.names]
        return Comparison(
            client, reading.version, count, equal, digest[:12], wrong, reading.seconds, reading.remarks
        )

    def difference(self, reading: Reading) -> str:
        """The first value that differs, for a person who looks for the reason."""
        by_id = {int(row["id"]): line(row, reading.names) for row in reading.rows}
        for row in self.rows:
            ours, theirs = line(row, reading.names), by_id.get(int(row["id"]))
            if ours != theirs:
                return f"SQL: {ours}\nclient: {theirs}"
        return "it has segments that SQL does not have"


def checksum(rows: Iterable[Row], names: tuple[str, ...]) -> tuple[int, str]:
    """How many rows, and one text of all of them in the order of their ids."""
    lines = sorted((int(row["id"]), line(row, names)) for row in rows)
    return len(lines), hashlib.sha256("\n".join(text for _, text in lines).encode()).hexdigest()


def line(row: Row, names: tuple[str, ...]) -> str:
    """One row as a text in which equal values are equal, whatever a client's types are."""
    return "|".join(_TEXTS[name](row[name]) for name in names)


def _missing(value: Any) -> bool:
    return value is None or value is pandas.NaT or (isinstance(value, float) and math.isnan(value))


def _as_text(value: Any) -> str:
    return "" if _missing(value) else str(int(value)) if int(value) == value else repr(value)


def _fraction(digits: int) -> Callable[[Any], str]:
    def text(value: Any) -> str:
        return "" if _missing(value) else f"{round(float(value), digits) + 0.0:.{digits}f}"

    return text


def _time(value: Any) -> str:
    if _missing(value):
        return ""
    if isinstance(value, numbers.Number):
        raise TypeError(f"{value!r} is no time")
    moment = datetime.fromisoformat(value.replace("/", "-")) if isinstance(value, str) else value
    aware = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    return f"{math.floor(aware.timestamp() * 1000 + 1e-3)}"


def _texts() -> dict[str, Callable[[Any], str]]:
    by_kind: dict[str, Callable[[Any], str]] = {
        "integer": _as_text,
        "text": lambda value: "" if _missing(value) else str(value),
        "boolean": lambda value: "" if _missing(value) else str(bool(value)),
        "time": _time,
    }
    kinds = {}
    for name, column in COLUMNS.items():
        digits = column.digits
        kinds[name] = by_kind[EXPECTED_KINDS[name]] if digits is None else _fraction(digits)
    return kinds | dict.fromkeys(ENDS, _fraction(COORDINATE_DIGITS))


_TEXTS = _texts()
