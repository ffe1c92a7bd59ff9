"""CSV of apps that read a car's bus: Torque, and others that name a car's speed beside positions.

Source: what Torque Pro writes. Units stand in the names and depend on the settings of the app; a header may come again
in the middle, with other columns. The accelerometer is the phone's, in the phone's axes.
"""

from __future__ import annotations

import re
from collections.abc import Collection

from fusion.formats.tables.header import COLUMNS, from_utf16, header_of
from fusion.formats.tables.log import DEVICE_AXES, DEVICE_TIME, NamedColumnsCsv
from fusion.formats.tables.names import Cell, Known, Schema, known_columns
from fusion.messages import say

_MARKS = re.compile(
    r"device ?time|\bobd\b|engine (?:rpm|load|coolant)|^rpm\b|vehicle ?speed|\bg\([xyz]\)|from vehicle|coolant temp|"
    r"throttle"
)
_PLACE = re.compile(r"^(?:gps |gnss )?(?:lat|latitude)\b")
_OWN = {"device time": DEVICE_TIME, "g(x)": DEVICE_AXES[0], "g(y)": DEVICE_AXES[1], "g(z)": DEVICE_AXES[2]}


def is_vehicle_log(names: Collection[str]) -> bool:
    """Whether a header names positions and what only a car's bus or such an app tells."""
    return any(map(_PLACE.search, names)) and any(map(_MARKS.search, names))


class TorqueFormat(NamedColumnsCsv):
    """Recognised by the names of positions beside those of an OBD app in the first line."""

    name = "torque"
    description = "CSV of Torque or another OBD app"
    suffixes = (".csv",)
    altitude_advice = say("advice.torque_altitude")
    doppler_advice = say("advice.torque_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        head = from_utf16(head)
        return b"\x00" not in head[:4096] and is_vehicle_log(header_of(head).names)

    def schema(self, *, part: bool) -> Schema:
        """See ``NamedColumnsCsv``."""
        return Schema(
            COLUMNS, _lacking, named=self.columns, loose=True, part=part,
            clocks=frozenset({"time", DEVICE_TIME}), understood=_understood,
        )  # fmt: skip


def _lacking(columns: Collection[str]) -> list[str]:
    timed = {"time_s", "time", DEVICE_TIME} & set(columns)
    missing = [] if timed else ["GPS Time or Device Time"]
    return missing + [name for name in ("lat_deg", "lon_deg") if name not in columns]


def _understood(header: list[str], schema: Schema) -> Known:
    """By names as in any CSV, and by those that only such apps write; what no slope needs is not complained of."""
    own = {_OWN[cell.lower()]: k for k, cell in enumerate(header) if cell.lower() in _OWN}
    rest = ["" if k in own.values() else cell for k, cell in enumerate(header)]
    columns = known_columns(rest, schema)
    cells = {**{ours: Cell(index) for ours, index in own.items()}, **columns.cells}
    return Known(cells, () if DEVICE_TIME in own else columns.taken, ())
