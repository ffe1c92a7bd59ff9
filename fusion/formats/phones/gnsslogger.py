"""The text that Google's GnssLogger writes on Android phones: positions (``Fix``), raw measurements (``Raw``), sensors.

The header names the columns of every kind of line, ``# Raw,utcTimeMillis,TimeNanos,...``; they differ by version.
Accelerometer and gyroscope are in the phone's axes (``mounting``). ``OrientationDeg`` is so too, in whole degrees, and
``Mag`` tells a compass more of the car's steel than of north: both are left out.
"""

from __future__ import annotations

import re

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
from fusion.formats.phones.android_raw import MEASURED, measured
from fusion.formats.phones.log_lines import LogLines, Table
from fusion.messages import say
from fusion.signals import RawGnss, Signals
from fusion.types import DeviceMotion, DriveLog, Floats, Pressure, Progress, SensorTable, ThreeAxes

_FIX: dict[str, tuple[str, ...]] = {
    "lat_deg": ("LatitudeDegrees", "Latitude"),
    "lon_deg": ("LongitudeDegrees", "Longitude"),
    "height_ell_m": ("AltitudeMeters", "Altitude"),
    "speed_mps": ("SpeedMps", "Speed"),
    "h_acc_m": ("AccuracyMeters", "Accuracy"),
    "course_deg": ("BearingDegrees", "Bearing"),
    "time_ms": ("UnixTimeMillis", "(UTC)TimeInMs", "UTCTimeInMs"),
    "s_acc_mps": ("SpeedAccuracyMps",),
    "v_acc_m": ("VerticalAccuracyMeters",),
}
"""Ours -> the names that versions 1.4 to 3 have for it."""
_PROVIDERS = ("GPS", "FLP")
"""The satellite receiver itself, and, for want of it, what the phone mixes with networks' positions; these alone
(``NLP``) are wrong by whole streets."""
_SENSORS = {
    "force": (("Accel", "Accel{}Mps2"), ("UncalAccel", "UncalAccel{}Mps2")),
    "rate": (("Gyro", "Gyro{}RadPerSec"), ("UncalGyro", "UncalGyro{}RadPerSec")),
}
"""``DeviceMotion`` -> the kinds of lines that hold it, the better first, and what their columns are called."""
_PRESSURES = ("Pressure", "Baro", "Barometer")
_PRESSURE_COLUMNS = ("PressureHpa", "PressureHPa", "PressureMbar", "Pressure", "BaroHpa", "pressureHpa")
_CLOCK = ("utcTimeMillis", "elapsedRealtimeNanos")
_MOST_APART_S = 5.0
"""The clocks may drift by so much; beyond, one of them was set anew."""
_HEADER = re.compile(rb"(?m)^# ?(?:Raw,[^\r\n]*\bReceivedSvTimeNanos\b|Fix,Provider,)")


def has_log_header(head: bytes) -> bool:
    """Whether the header of a GnssLogger file is in the bytes."""
    return _HEADER.search(head[:65536]) is not None


class GnssLoggerFormat(EitherWay):
    """Recognised by the header that names the columns of ``Raw`` or ``Fix`` lines."""

    name = "gnsslogger"
    description = "GnssLogger text"
    suffixes = (".txt",)
    altitude_advice = say("advice.gnsslogger_altitude")
    doppler_advice = say("advice.gnsslogger_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return has_log_header(head)

    def read(self, data: Data, progress: Progress, *, part: bool = False) -> DriveLog:
        """See ``EitherWay``."""
        notes = Notes()
        lines = LogLines(bytes(data))
        progress("read lines", 0.1)
        tables = _fixes(lines, notes) | {"pressure": _pressure(lines, notes)}
        device = DeviceMotion(**{name: _axes(lines, kinds, notes) for name, kinds in _SENSORS.items()})
        progress("read lines", 0.3)
        table = lines.table("Raw", MEASURED, notes)
        signals = measured(table, notes) if len(table) else Signals.empty()
        raw = RawGnss(signals) if len(signals) else None
        progress("read lines", 1.0)
        if raw is None and not len(tables.get("fix", ())) and notes.first_offender:
            raise EmptyLogError(
                say("phone.nothing_usable", description=self.description, fault=notes.first_offender)
            )
        if not lines.has_kinds and not part:
            raise MalformedLogError(say("phone.header_only", description=self.description))
        return build_log(self, notes, tables, raw=raw, part=part, device=device)


def _fixes(lines: LogLines, notes: Notes) -> dict[str, SensorTable]:
    """Positions and velocities: the satellite receiver's own if there are any."""
    names = tuple(name for variants in _FIX.values() for name in variants)
    for provider in _PROVIDERS:
        table = lines.table("Fix", names, notes, provider)
        if len(table):
            if provider != _PROVIDERS[0]:
                notes.warn(say("phone.mixed_positions", provider=provider))
            return _positions(table, notes)
    return {}


def _positions(table: Table, notes: Notes) -> dict[str, SensorTable]:
    col = {ours: _first_present(table, variants) for ours, variants in _FIX.items()}
    time_s = col.pop("time_ms") / 1000.0
    good = usable_positions(time_s, col["lat_deg"], col["lon_deg"], notes, table.place)
    return fix_and_velocity(time_s[good], {name: column[good] for name, column in col.items()}, notes)


def _first_present(table: Table, names: tuple[str, ...]) -> Floats:
    present = [table.columns[name] for name in names if name in table.columns]
    return present[0].astype(float) if present else np.full(len(table), np.nan)


def _axes(lines: LogLines, kinds: tuple[tuple[str, str], ...], notes: Notes) -> ThreeAxes:
    """An inertial sensor in the phone's axes, of the first kind of lines that there is."""
    for kind, column in kinds:
        names = tuple(column.format(axis) for axis in "XYZ")
        table = lines.table(kind, (*_CLOCK, *names), notes)
        if len(table) and all(name in table.columns for name in names):
            x, y, z = (np.where(np.isfinite(table.columns[n]), table.columns[n], np.nan) for n in names)
            return ThreeAxes.assemble(_sensor_times(table, notes), None, x=x, y=y, z=z)
    return ThreeAxes.empty()


def _pressure(lines: LogLines, notes: Notes) -> Pressure:
    for kind in _PRESSURES:
        table = lines.table(kind, (*_CLOCK, *_PRESSURE_COLUMNS), notes)
        if len(table):
            value = _first_present(table, _PRESSURE_COLUMNS)
            return Pressure.assemble(_sensor_times(table, notes), None, pressure_pa=value * 100)
    return Pressure.empty()


def _sensor_times(table: Table, notes: Notes) -> Floats:
    """Unix seconds of a sensor's lines: the clock that runs evenly, set by the one that knows the time of day."""
    utc_s, even_s = (
        table.columns[name] * unit if name in table.columns else np.full(len(table), np.nan)
        for name, unit in zip(_CLOCK, (1e-3, 1e-9), strict=True)
    )
    utc_s = np.where(is_possible_time(utc_s), utc_s, np.nan)
    late = utc_s - even_s
    has_both = np.isfinite(late)
    time_s = utc_s
    if has_both.mean() >= 0.5:
        even_s = even_s + float(np.median(late[has_both]))
        time_s = np.where(np.abs(even_s - utc_s) < _MOST_APART_S, even_s, utc_s)

    notes.skip("sensor lines without a time", int((~np.isfinite(time_s)).sum()))
    return time_s
