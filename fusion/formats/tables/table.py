"""What the columns of a CSV are taken as, with a few of their values: for people to look at and to correct."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass

from fusion.formats.tables.header import MOST_CELLS, Header, from_utf16, header_of
from fusion.formats.tables.log import DEVICE_AXES, DEVICE_TIME
from fusion.formats.tables.names import (
    DATE,
    GPS_TIME,
    SHOWN_AS,
    UNSTATED_SPEED,
    Cell,
    Schema,
    known_columns,
    units_of,
)
from fusion.registry import LOG_COLUMNS

VALUES = 3
LONGEST = 40
"""Characters of a name or a value that are shown."""
DEVICE_ACCELERATION = "device_acceleration"
_SHOWN_AS = SHOWN_AS | {DEVICE_TIME: "time"} | dict.fromkeys(DEVICE_AXES, DEVICE_ACCELERATION)
TAKEN_AS = (*LOG_COLUMNS, *sorted({name for name in _SHOWN_AS.values() if name not in LOG_COLUMNS}))
"""All that a column can be taken as: a column of ours, a date, or an acceleration in the device's axes."""
_OWN_UNITS = (("_mps2", "m/s²"), ("_mps", "m/s"), ("_dps", "°/s"), ("_deg", "°"), ("_rad", "rad"), ("_hpa", "hPa"),
              ("_c", "°C"), ("_m", "m"), ("_s", "s"))  # fmt: skip
_SIGNS = {
    "km_h": "km/h",
    "kn": "kn",
    "pa": "Pa",
    "kpa": "kPa",
    "inhg": "inHg",
    "mmhg": "mmHg",
    "f": "°F",
    "k": "K",
}
_WITHOUT_UNIT = frozenset({DATE, "time", DEVICE_TIME, UNSTATED_SPEED, *DEVICE_AXES})


@dataclass(frozen=True)
class TakenColumn:
    """A column by its ``name`` in the header, what it is ``taken_as`` (one of ``TAKEN_AS``; None: it is not used) and
    in which ``unit`` (None: it has none, or none is named), and its first values.

    ``guessed``: by its name alone, which nobody said and which is none of ours.
    """

    name: str
    taken_as: str | None
    unit: str | None
    guessed: bool
    values: tuple[str, ...]


def taken_columns(head: bytes, schema: Schema) -> tuple[TakenColumn, ...]:
    """The columns of the header that ``head``, the beginning of a file, begins with; of equal names the first."""
    text = from_utf16(head)
    header = header_of(text)
    if len(header.cells) > MOST_CELLS:
        return ()
    known = (schema.understood or known_columns)(header.cells, schema)
    by_index = {cell.index: (ours, cell) for ours, cell in known.cells.items()}
    values: list[list[str]] = [[] for _ in header.cells]
    for row in _rows(text, header):
        for seen, value in zip(values, row, strict=False):
            if value.strip() and len(seen) < VALUES:
                seen.append(value.strip()[:LONGEST])
    said = {ours for ours in schema.named if ours in known.cells}
    lower = [name.lower() for name in header.cells]
    return tuple(
        _taken(name, by_index.get(k), said, tuple(values[k]))
        for k, name in enumerate(header.cells)
        if name and lower.index(lower[k]) == k
    )


def _taken(name: str, found: tuple[str, Cell] | None, said: set[str], values: tuple[str, ...]) -> TakenColumn:
    if found is None:
        return TakenColumn(name, None, None, False, values)
    ours, cell = found
    guessed = ours not in said and ours != name.lower()
    return TakenColumn(name, _SHOWN_AS.get(ours, ours), _unit(ours, cell), guessed, values)


def _unit(ours: str, cell: Cell) -> str | None:
    """The unit that the column's values are taken in."""
    if ours in _WITHOUT_UNIT and cell.factor == 1:
        return None
    if (cell.factor, cell.offset) != (1.0, 0.0):
        line = (cell.factor, cell.offset)
        unit = next((name for name, other in units_of(ours).items() if other == line), None)
        return None if unit is None else _SIGNS.get(unit, unit)
    if ours == GPS_TIME:
        return "s"
    shown = _SHOWN_AS.get(ours, ours)
    return next((sign for ending, sign in _OWN_UNITS if shown.endswith(ending)), None)


def _rows(text: bytes, header: Header) -> Iterator[list[str]]:
    """The rows behind the header, as far as they are whole."""
    behind = text[header.at + len(header.line) :]
    lines = behind.decode("utf-8", "replace").replace("\0", "").splitlines(keepends=True)
    if len(lines) > 2 and not lines[-1].endswith(("\n", "\r")):
        lines.pop()  # it may be cut off
    try:
        for row in csv.reader(lines, delimiter=header.delimiter):
            if row and not row[0].startswith("#"):
                yield row
    except csv.Error:
        return
