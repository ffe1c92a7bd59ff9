"""Sensor Logger's CSVs: one a sensor, in a folder or a zip; those of one drive are read together.

Every file has ``time`` (nanoseconds since 1970) and ``seconds_elapsed``. Positions and pressure are known by their
columns; accelerometer, gravity and gyroscope have the same columns, and are known by the files' names. They are in the
phone's axes (``mounting``). Orientation, magnetometer and watches are not used.

Source: the app's reference of units and of differences between platforms.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Self

import numpy as np

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.base import (
    Data,
    EitherWay,
    Notes,
    build_log,
    fix_and_velocity,
    is_possible_time,
    usable_positions,
)
from fusion.formats.tables import header as csv_header
from fusion.formats.tables.cells import Block, read_blocks
from fusion.formats.tables.names import Known, Schema, known_columns
from fusion.formats.time_texts import of_epoch
from fusion.messages import say
from fusion.types import DeviceMotion, DriveLog, Floats, Pressure, Progress, SensorTable, ThreeAxes

_LOCATION = {
    "latitude": "lat_deg", "longitude": "lon_deg", "altitude": "height_ell_m",
    "altitudeabovemeansealevel": "alt_msl_m", "speed": "speed_mps", "bearing": "course_deg",
    "horizontalaccuracy": "h_acc_m", "verticalaccuracy": "v_acc_m", "speedaccuracy": "s_acc_mps",
}  # fmt: skip
_COLUMNS = ("time", *_LOCATION, "pressure", "x", "y", "z")
_MOTION = {"accelerometer": "moved", "gravity": "gravity", "totalacceleration": "force", "gyroscope": "rate"}
"""File -> what it is in ``DeviceMotion``."""
_MARKS = ({"time", "seconds_elapsed"}, {"device name", "recording time", "platform"})
"""Columns by which the app's files are known, in small letters."""
_UNUSED = ("watch", "headphone", "locationnetwork")
_LARGEST_KPA = 200.0
"""Air never has so few hPa where there are roads: a smaller number is of kPa."""


def is_sensor_logger(names: Collection[str]) -> bool:
    """Whether a header is that of one of the app's files."""
    return any(own <= set(names) for own in _MARKS)


@dataclass(frozen=True)
class SensorLoggerFormat(EitherWay):
    """Recognised by the columns that all of the app's files have."""

    file: str = ""
    """What the file is called, in small letters and without ending; empty if unknown."""

    name = "sensor-logger"
    description = "zip or CSV of Sensor Logger"
    suffixes = (".zip", ".csv")
    is_of_several = True
    altitude_advice = say("advice.sensor_logger_altitude")
    doppler_advice = say("advice.sensor_logger_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return is_sensor_logger(csv_header.header_of(head).names)

    def with_name(self, name: str) -> Self:
        """See ``LogFormat``."""
        return replace(self, file=PurePath(name.lower().removesuffix(".gz")).stem)

    def read(self, data: Data, progress: Progress, *, part: bool = False) -> DriveLog:
        """See ``EitherWay``."""
        notes = Notes()
        text = csv_header.from_utf16(bytes(data))
        cells = csv_header.header_of(text).names
        positions = "latitude" in cells and "longitude" in cells
        if not part and not positions:
            raise EmptyLogError(say("phone.no_location", description=self.description))
        used = positions or "pressure" in cells or {"x", "y", "z"} <= set(cells)
        if not used or self.file.startswith(_UNUSED):
            return build_log(self, notes, {}, part=part)
        if "time" not in cells:
            raise MalformedLogError(say("phone.no_time_column", description=self.description))
        col, blocks = _columns(text, notes, progress)
        time_s = of_epoch(col["time"])
        tables: dict[str, SensorTable] = {}
        device = DeviceMotion()
        if positions:
            tables = _positions(time_s, col, blocks, notes)
        elif "pressure" in cells:
            tables["pressure"] = _pressure(time_s, col["pressure"], notes)
        elif kind := _MOTION.get(self.file):
            axes = ThreeAxes.assemble(_sane(time_s, notes), None, **{n: col[n] for n in "xyz"})
            device = DeviceMotion(**{kind: axes})
        return build_log(self, notes, tables, part=part, device=device)


def _columns(text: bytes, notes: Notes, progress: Progress) -> tuple[dict[str, Floats], list[Block]]:
    schema = Schema(_COLUMNS, lambda columns: [], clocks=frozenset(), understood=_understood)
    blocks = list(read_blocks(text, csv_header.layout_of(text, notes, schema), notes, progress))
    progress("read rows", 1.0)
    columns = {name: [np.empty(0), *(block.column(name) for block in blocks)] for name in _COLUMNS}
    return {name: np.concatenate(parts) for name, parts in columns.items()}, blocks


def _understood(header: list[str], schema: Schema) -> Known:
    """The columns by their names; what else the app writes is no reason for a word."""
    columns = known_columns(header, schema)
    return Known(columns.cells, (), ())


def _place(blocks: list[Block], row: int) -> str:
    for block in blocks:
        if row < len(block):
            return block.place(row)
        row -= len(block)
    return say("place.row", n=row + 1)


def _positions(
    time_s: Floats, col: dict[str, Floats], blocks: list[Block], notes: Notes
) -> dict[str, SensorTable]:
    """Positions and velocities; what is below 0 stands for unknown."""
    good = usable_positions(time_s, col["latitude"], col["longitude"], notes, lambda row: _place(blocks, row))
    columns = {ours: col[theirs][good] for theirs, ours in _LOCATION.items()}
    for name in ("speed_mps", "course_deg"):
        columns[name] = np.where(columns[name] >= 0, columns[name], np.nan)
    return fix_and_velocity(time_s[good], columns, notes)


def _sane(time_s: Floats, notes: Notes) -> Floats:
    """Times of a sensor, NaN where there can be none."""
    sane = is_possible_time(time_s)
    notes.skip("samples at an impossible time", int((~sane).sum()))
    return np.where(sane, time_s, np.nan)


def _pressure(time_s: Floats, pressure: Floats, notes: Notes) -> Pressure:
    measured = pressure[np.isfinite(pressure)]
    in_kpa = len(measured) and float(np.median(measured)) < _LARGEST_KPA
    pascals = pressure * (1000.0 if in_kpa else 100.0)
    return Pressure.assemble(_sane(time_s, notes), None, pressure_pa=pascals)
