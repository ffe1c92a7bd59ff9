"""What the columns of a CSV are called: Versant's names, those of other programs, units in names, what a person says.

A name is taken for a column of ours only where its meaning is certain; axes of accelerometers are not, nor signs of
pitch. Whatever is taken for something else is said.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import product

from fusion.errors import MalformedLogError
from fusion.messages import joined, say
from fusion.registry import LOG_COLUMNS

DATE, TIME = "_date", "time"
UNSTATED_SPEED = "_speed"
"""A ground speed whose unit the header does not say."""
GPS_TIME = "_gps_time"
"""Seconds since the GPS epoch, on the GPS scale."""
PRESSURE_OF_VEHICLE = "_vehicle_pressure"
SHOWN_AS = {DATE: "date", UNSTATED_SPEED: "speed_mps", GPS_TIME: TIME, PRESSURE_OF_VEHICLE: "pressure_hpa"}
"""What people are told that these are."""
NOT_USED = "-"
"""What a person says of a column of ours that the file has not, whatever its names are like."""

_UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "length": {"m": (1, 0), "meter": (1, 0), "meters": (1, 0), "metre": (1, 0), "metres": (1, 0), "ft": (0.3048, 0),
               "feet": (0.3048, 0), "foot": (0.3048, 0), "mm": (1e-3, 0), "cm": (1e-2, 0), "km": (1e3, 0)},
    "speed": {"m_s": (1, 0), "mps": (1, 0), "ms": (1, 0), "meters_second": (1, 0), "meter_second": (1, 0),
              "metres_second": (1, 0), "km_h": (1 / 3.6, 0), "kmh": (1 / 3.6, 0), "kph": (1 / 3.6, 0),
              "kmph": (1 / 3.6, 0), "km_hr": (1 / 3.6, 0), "mph": (0.44704, 0), "mi_h": (0.44704, 0),
              "miles_h": (0.44704, 0), "miles_hour": (0.44704, 0), "kn": (1852 / 3600, 0), "kt": (1852 / 3600, 0),
              "kts": (1852 / 3600, 0), "knots": (1852 / 3600, 0), "knot": (1852 / 3600, 0)},
    "pressure": {"hpa": (1, 0), "mbar": (1, 0), "mb": (1, 0), "millibar": (1, 0), "kpa": (10, 0), "pa": (0.01, 0),
                 "psi": (68.94757293168361, 0), "inhg": (33.86389, 0), "mmhg": (1.333224, 0), "bar": (1000, 0)},
    "temperature": {"c": (1, 0), "celsius": (1, 0), "degc": (1, 0), "f": (5 / 9, -160 / 9), "degf": (5 / 9, -160 / 9),
                    "fahrenheit": (5 / 9, -160 / 9), "k": (1, -273.15), "kelvin": (1, -273.15)},
    "angle": {"deg": (1, 0), "degree": (1, 0), "degrees": (1, 0), "rad": (57.29577951308232, 0),
              "radians": (57.29577951308232, 0)},
    "time": {"s": (1, 0), "sec": (1, 0), "seconds": (1, 0), "ms": (1e-3, 0), "millis": (1e-3, 0),
             "milliseconds": (1e-3, 0), "us": (1e-6, 0), "ns": (1e-9, 0), "nanos": (1e-9, 0)},
}  # fmt: skip
"""By dimension: what a value is multiplied by, and what is added then, to be in our unit."""

_NAMES: dict[str, tuple[str, str]] = {
    name: (ours, dimension)
    for ours, dimension, names in (
        (TIME, "time", "time timestamp time_stamp datetime date_time utc utc_time time_utc timestamp_utc utc_timestamp "
         "unix unix_time unixtime unix_timestamp epoch epoch_time iso_time iso8601 recorded_at gps_time gpstime "
         "utc_date_time gps_timestamp utc_datetime datetime_utc device_time utc_time_in"),
        (DATE, "", "date utc_date date_utc gps_date"),
        (GPS_TIME, "time", "since_gps_epoch gps_epoch_time"),
        ("lat_deg", "angle", "lat latitude y_lat decimal_latitude"),
        ("lon_deg", "angle", "lon lng long longitude x_lon decimal_longitude"),
        ("alt_msl_m", "length", "alt altitude ele elev elevation altitude_msl alt_msl msl_altitude msl height_msl "
         "orthometric_height height_above_sea_level altitude_above_sea_level altitude_above_mean_sea_level height"),
        ("height_ell_m", "length", "height_ell ellipsoidal_height ellipsoid_height height_ellipsoid hae altitude_hae "
         "ellipsoidal_altitude altitude_ellipsoid altitude_wgs84 height_wgs84 wgs84_altitude wgs84_height "
         "height_above_ellipsoid height_above_wgs84_ellipsoid altitude_above_ellipsoid"),
        ("h_acc_m", "length", "accuracy h_acc hacc horizontal_accuracy position_accuracy accuracy_horizontal"),
        ("v_acc_m", "length", "v_acc vacc vertical_accuracy altitude_accuracy accuracy_vertical"),
        ("s_acc_mps", "speed", "s_acc sacc speed_accuracy"),
        ("vel_n_mps", "speed", "vel_n vel_north velocity_north velocity_n north_velocity"),
        ("vel_e_mps", "speed", "vel_e vel_east velocity_east velocity_e east_velocity"),
        ("vel_d_mps", "speed", "vel_d vel_down velocity_down velocity_d down_velocity"),
        ("speed_mps", "speed", "speed velocity ground_speed groundspeed speed_over_ground sog speed_gps"),
        ("heading_deg", "angle", "heading course bearing cog track_angle course_over_ground head direction_deg"),
        ("odo_speed_mps", "speed", "odo_speed vehicle_speed obd_speed speed_obd wheel_speed can_speed "
         "vehicle_speed_sensor car_speed"),
        ("pressure_hpa", "pressure", "pressure baro barometer barometric_pressure air_pressure baro_pressure "
         "barometer_on_android_device"),
        ("temperature_c", "temperature", "temperature temp air_temperature"),
        (PRESSURE_OF_VEHICLE, "pressure", "barometric_pressure_from_vehicle"),
    )
    for name in names.split()
}  # fmt: skip
_SOURCES = ("gps", "gnss", "location", "loc", "position", "pos", "obd")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_LAST_GROUP = re.compile(r"^(.*?)\s*[(\[]([^()\[\]]*)[)\]]\s*$")
_SHOWN, _MOST_SHOWN = 40, 20


@dataclass(frozen=True)
class Cell:
    """Where a column of ours is: the cell's number, and the line that turns its value into our unit."""

    index: int
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Known:
    """What a header holds: ``cells`` by the name of a column of ours; ``taken`` says which other names were understood;
    ``unknown`` are the names that were not."""

    cells: dict[str, Cell]
    taken: tuple[str, ...]
    unknown: tuple[str, ...]


@dataclass(frozen=True)
class Schema:
    """What a kind of CSV may have: its columns, those of them that hold words, and which are ``lacking`` of those.

    The columns ``clocks`` hold times as texts or as numbers since 1970. ``named`` is what a person says of names,
    ours -> the header's. ``loose``: names of other programs are understood. ``part``: the file may hold
    a part of a drive only.
    """

    columns: tuple[str, ...]
    lacking: Callable[[Collection[str]], list[str]]
    words: frozenset[str] = frozenset()
    named: Mapping[str, str] = field(default_factory=dict)
    loose: bool = False
    part: bool = False
    clocks: frozenset[str] = frozenset({TIME})
    understood: Callable[[list[str], Schema], Known] | None = None
    """How the header is understood, where not by ``known_columns``."""


def known_columns(header: Sequence[str], schema: Schema) -> Known:
    """Which of a header's cells (as they are written) are which columns of the schema.

    ``MalformedLogError`` where the header has no cell that a person names, unless the file is a part of a drive.
    """
    cells = _named(header, schema.named, part=schema.part)
    used = {cell.index for cell in cells.values()}
    barred = {ours for ours, theirs in schema.named.items() if theirs == NOT_USED and ours not in cells}
    lower = [cell.lower() for cell in header]
    often = Counter(lower)
    for ours in schema.columns:
        if ours not in {*cells, *barred} and ours in lower and lower.index(ours) not in used:
            cells[ours] = Cell(lower.index(ours))
            used.add(cells[ours].index)
    by_name: list[str] = []
    for index, name in enumerate(header) if schema.loose else ():
        ours, cell = _understood(name, index)
        if index in used or not ours or ours in cells or (ours in _SAME and _SAME[ours] in cells):
            continue
        if ours in barred or SHOWN_AS.get(ours) in barred:
            continue
        cells[ours] = cell
        used.add(index)
        by_name.append(f"{name[:_SHOWN]!r} as {_shown(ours)}{_converted(cell)}")
    unknown = [n for k, n in enumerate(header) if k not in used and often[n.lower()] == 1]
    unknown += sorted({n for n in header if often[n.lower()] > 1 and n.lower() not in cells})
    return Known(cells, tuple(by_name), tuple(n for n in unknown if n.lower() not in schema.columns))


_SAME = {TIME: "time_s", GPS_TIME: "time_s", UNSTATED_SPEED: "speed_mps"}
"""What is not looked for where that is there."""


def _named(header: Sequence[str], named: Mapping[str, str], *, part: bool) -> dict[str, Cell]:
    plain = [_plain(cell) for cell in header]
    cells: dict[str, Cell] = {}
    for ours, theirs in named.items():
        if _plain(theirs) not in plain:
            if part or theirs == NOT_USED:
                continue
            near = get_close_matches(_plain(theirs), plain, 1, 0.6)
            hint = say("columns.near", near=header[plain.index(near[0])][:_SHOWN]) if near else ""
            raise MalformedLogError(
                say("columns.no_such", theirs=theirs[:60], ours=ours, hint=hint, names=shown_header(header))
            )
        index = plain.index(_plain(theirs))
        dimension = _dimension(ours)
        unit = next(
            (u for camel in (True, False) if (u := _split(header[index], dimension, camel=camel)[1])), ""
        )
        cells[ours] = Cell(index, *(_UNITS[dimension][unit] if unit and ours != "time_s" else (1.0, 0.0)))
    return cells


def units_of(ours: str) -> Mapping[str, tuple[float, float]]:
    """The units that a name for a column of ours may state: what its values are multiplied by, what is added then."""
    return _UNITS.get(_dimension(ours), {})


def _dimension(ours: str) -> str:
    return next((dimension for name, dimension in _NAMES.values() if name == ours), "")


def _plain(name: str) -> str:
    return " ".join(name.strip().strip('"').lower().split())


def _understood(name: str, index: int) -> tuple[str, Cell]:
    """Which column of ours another program's name means; an empty name if none for certain."""
    for camel, dimension in product((True, False), ("", *_UNITS)):
        base, unit = _split(name, dimension, camel=camel)
        for candidate in (base, *(base.removeprefix(f"{s}_") for s in _SOURCES if base.startswith(f"{s}_"))):
            ours, its_dimension = _NAMES.get(candidate, ("", ""))
            if not ours or ((dimension or unit) and its_dimension != dimension):
                continue
            if base.startswith("obd_") and ours == "speed_mps":
                ours = "odo_speed_mps"
            if not unit and ours == "speed_mps":
                ours = UNSTATED_SPEED
            if not unit and ours == "odo_speed_mps":
                unit = "km_h"  # as the bus of a car states it
            return ours, Cell(index, *_UNITS[its_dimension][unit]) if unit else Cell(index)
    return "", Cell(index)


def _split(name: str, dimension: str, *, camel: bool) -> tuple[str, str]:
    """A name without its unit, in small letters with _ between words, and the unit if it is one of the dimension.

    ``camel``: capitals begin words, as in ``latDeg``, and not in ``kPa``.
    """
    units = _UNITS.get(dimension, {})
    group = _LAST_GROUP.match(name)
    if group and (unit := _words(group.group(2).replace("°", " deg "), camel=False)) in units:
        return _words(group.group(1), camel=camel), unit
    words = _words(name, camel=camel)
    if dimension == "time" and (first := words.split("_")[0]) in units and "_" in words:
        return words.split("_", 1)[1], first
    for unit in sorted(units, key=len, reverse=True):
        if words.endswith(f"_{unit}"):
            return words.removesuffix(f"_{unit}"), unit
    return words, ""


def _words(name: str, *, camel: bool = True) -> str:
    parted = name.strip().strip('"')
    parted = _CAMEL.sub("_", parted) if camel else parted
    return re.sub(r"[^a-z0-9]+", "_", parted.lower()).strip("_")


def _shown(ours: str) -> str:
    return {
        DATE: "date", UNSTATED_SPEED: "speed", GPS_TIME: "GPS time", PRESSURE_OF_VEHICLE: "pressure_hpa",
    }.get(ours, ours)  # fmt: skip


def _converted(cell: Cell) -> str:
    if (cell.factor, cell.offset) == (1.0, 0.0):
        return ""
    return f" (times {cell.factor:.6g}{f' {cell.offset:+.6g}' if cell.offset else ''})"


def shown_header(header: Sequence[str]) -> str:
    """The names of a header for a message."""
    more = say("more", n=len(header) - 30) if len(header) > 30 else ""
    return ", ".join(cell[:_SHOWN] or "(empty)" for cell in header[:30]) + more


def taken_sentence(known: Known) -> str:
    """What was taken for what, in a sentence; empty where all names are ours."""
    if not known.taken:
        return ""
    return say("csv.taken", taken=", ".join(known.taken))


def unknown_sentence(known: Known, columns: Sequence[str]) -> str:
    """What was left out, each with the column of ours that its name is near to; empty if there is nothing."""
    if not known.unknown:
        return ""
    free = [name for name in columns if name not in known.cells]
    near: list[str] = []
    for name in known.unknown[:_MOST_SHOWN]:
        if match := nearest(name, free):
            near.append(say("csv.unknown_near", name=name[:_SHOWN], match=match))
    shown = ", ".join(repr(name[:_SHOWN]) for name in known.unknown[:_MOST_SHOWN])
    more = say("more", n=len(known.unknown) - _MOST_SHOWN) if len(known.unknown) > _MOST_SHOWN else ""
    return joined([say("csv.unknown", names=shown, more=more), *near])


def nearest(name: str, columns: Sequence[str]) -> str:
    """The column of ours that a name is most like; empty if none is."""
    matches = get_close_matches(_words(name), columns, 1, 0.75)
    return matches[0] if matches else ""


def missing_sentence(missing: Sequence[str], header: Sequence[str], line: int) -> str:
    """What a person is told of required columns that are not there."""
    near = [
        f"{column.split()[0]}={cell[:_SHOWN]}"
        for column in missing
        for cell in header
        if nearest(cell, [column.split()[0]])
    ]
    shown = {"missing": list(missing), "line": line, "names": shown_header(header)}
    if not near:
        return say("csv.missing", **shown)
    return say("csv.missing_near", **shown, near=near, options=" ".join(f"--columns {one}" for one in near))


assert all(ours in LOG_COLUMNS or ours.startswith("_") for ours, _ in _NAMES.values())  # noqa: S101 - a table of names
