"""The text that Google's GnssLogger writes on Android phones: positions (``Fix``) and raw measurements (``Raw``).

The header names the columns of every kind of line, ``# Raw,utcTimeMillis,TimeNanos,...``; they differ by version. Lines
of the inertial sensors are left out: they are in the phone's axes, and how it lies in the vehicle is not known.
"""

from __future__ import annotations

import re

import numpy as np

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.android_raw import MEASURED, measured
from fusion.formats.base import Data, Notes, build_log, ground_velocity, usable_positions
from fusion.formats.log_lines import LogLines, Table
from fusion.signals import Navigation, RawGnss
from fusion.types import DriveLog, Floats, GnssFix, GnssVelocity, Progress, SensorTable

_FIX: dict[str, tuple[str, ...]] = {
    "lat_deg": ("LatitudeDegrees", "Latitude"),
    "lon_deg": ("LongitudeDegrees", "Longitude"),
    "height_m": ("AltitudeMeters", "Altitude"),
    "speed_mps": ("SpeedMps", "Speed"),
    "h_acc_m": ("AccuracyMeters", "Accuracy"),
    "bearing_deg": ("BearingDegrees", "Bearing"),
    "time_ms": ("UnixTimeMillis", "(UTC)TimeInMs", "UTCTimeInMs"),
    "s_acc_mps": ("SpeedAccuracyMps",),
    "v_acc_m": ("VerticalAccuracyMeters",),
}
"""Ours -> the names that versions 1.4 to 3 have for it."""
_OWN_PROVIDER = "GPS"
_HEADER = re.compile(rb"(?m)^# ?(?:Raw,[^\r\n]*\bReceivedSvTimeNanos\b|Fix,Provider,)")


def has_log_header(head: bytes) -> bool:
    """Whether the header of a GnssLogger file is in the bytes."""
    return _HEADER.search(head[:65536]) is not None


class GnssLoggerFormat:
    """Recognised by the header that names the columns of ``Raw`` or ``Fix`` lines."""

    name = "gnsslogger"
    description = "GnssLogger text"
    suffixes = (".txt",)
    altitude_advice = (
        "Tick `Location` beside the measurements in GnssLogger: its `Fix` lines of the provider GPS hold "
        "heights above the ellipsoid."
    )
    doppler_advice = (
        "Tick `Measurements` in GnssLogger: the `Raw` lines hold each satellite's Doppler shift, which "
        "Android's own positions keep no vertical velocity of."
    )

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return has_log_header(head)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        return self._read(data, progress, part=False)

    def comes_first(self, head: bytes) -> bool:
        """See ``PartFormat``."""
        return False

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """See ``PartFormat``."""
        return self._read(data, progress, part=True)

    def _read(self, data: Data, progress: Progress, *, part: bool) -> DriveLog:
        notes = Notes()
        lines = LogLines(bytes(data))
        progress("read lines", 0.1)
        tables = _fixes(lines, notes)
        progress("read lines", 0.3)
        table = lines.table("Raw", MEASURED, notes)
        raw = RawGnss(measured(table, notes)) if table is not None and len(table) else None
        progress("read lines", 1.0)
        if raw is not None and not len(raw.signals):
            raw = None
        if raw is None and not len(tables.get("fix", ())) and notes.first_offender:
            raise EmptyLogError(
                f"This {self.description} holds no usable position and no usable pseudorange. The first fault: "
                f"{notes.first_offender}. Record with satellite reception and upload it again."
            )
        if not lines.has_kinds and not part:
            raise MalformedLogError(
                f"This {self.description} has a header and no line after it. Upload the whole file."
            )
        return build_log(self.name, self.description, notes, tables, raw=raw, part=part)


def _fixes(lines: LogLines, notes: Notes) -> dict[str, SensorTable]:
    """Positions and velocities of the satellite receiver itself, not those that the phone mixed with networks'."""
    names = [name for known in _FIX.values() for name in known]
    table = lines.table("Fix", tuple(names), notes, _OWN_PROVIDER)
    if table is None or not len(table):
        return {}
    col = {ours: _first_known(table, known) for ours, known in _FIX.items()}
    time_s = col["time_ms"] / 1000.0
    good = usable_positions(time_s, col["lat_deg"], col["lon_deg"], notes, table.place)
    time_s, col = time_s[good], {name: column[good] for name, column in col.items()}
    for name in ("h_acc_m", "v_acc_m", "s_acc_mps"):
        col[name] = np.where(col[name] > 0, col[name], np.nan)  # 0 is written for unknown
    north, east = ground_velocity(col["speed_mps"], np.radians(col["bearing_deg"]))
    moving = np.isfinite(north)
    fix = GnssFix.assemble(
        time_s, notes.repaired, lat_deg=col["lat_deg"], lon_deg=col["lon_deg"], height_ell_m=col["height_m"],
        h_acc_m=col["h_acc_m"], v_acc_m=col["v_acc_m"],
    )  # fmt: skip
    velocity = GnssVelocity.assemble(
        time_s[moving], vel_n_mps=north[moving], vel_e_mps=east[moving], s_acc_mps=col["s_acc_mps"][moving]
    )
    return {"fix": fix, "velocity": velocity}


def _first_known(table: Table, names: tuple[str, ...]) -> Floats:
    known = [table.columns[name] for name in names if name in table.columns]
    return known[0].astype(float) if known else np.full(len(table), np.nan)
