"""FIT: the recordings of Garmin, Wahoo and other bicycle computers, watches and action cameras.

What is read, and what not, by message of the FIT profile:

- ``record``: position, altitude, speed, stated accuracy, pressure. The altitude is the device's own, above mean sea
  level, by its barometer where it has one. The speed has no direction and may come from a wheel sensor: it is the
  vehicle's own signal. ``grade`` and ``vertical_speed`` are not used: the device derives them from altitudes that are
  here already, by filters that nobody states.
- ``gps_metadata`` (cameras): position, and velocity east, north and up, several times a second.
- ``barometer_data``: pressure, each sample at its own time. ``absolute_pressure`` of records counts only beside no
  altitude, which is made of it: the same barometer would count twice.
- ``event``: where the timer was stopped and started, nothing was recorded in between, and there is a gap.
- ``accelerometer_data`` and ``gyroscope_data``: calibrated samples along the device's axes; how these lie in the
  vehicle is told from the drive, as for phones. Counts of a converter (beside ``three_d_sensor_calibration``) are not
  used.
- Fields of developers' apps are left out.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.base import Data, LogFormat, Notes, build_log, ground_velocity, positive, usable_positions
from fusion.formats.fit.messages import HEAD_BYTES, MAGIC, FitFile, read_files, sport_words
from fusion.formats.fit.walk import walk
from fusion.formats.glance import Ends, Glance, Told, along_m
from fusion.frames import GRAVITY_MPS2
from fusion.messages import say
from fusion.types import (
    DeviceMotion,
    DriveLog,
    Floats,
    GnssFix,
    GnssVelocity,
    Odometry,
    Pressure,
    Progress,
    SensorTable,
    ThreeAxes,
)

EPOCH_S = 631065600.0
"""1989-12-31 in Unix seconds, from which FIT counts."""
SYSTEM_TIME_S = float(0x10000000)
"""Timestamps below are seconds since the device was switched on (FIT profile, ``date_time``)."""
SEMICIRCLE_DEG = 180.0 / 2**31
LONGEST_PAUSE_STEP_S = 2.0
"""Records around a pause that are no farther apart have none between them missing."""
ZERO_CELSIUS_K = 273.15
GEOID = "the device's own (bicycle computers and watches: mostly barometric, set by its GNSS or by hand)"
STARTS, STOPS = ("start",), ("stop", "stop_all", "stop_disable", "stop_disable_all")
UNRECORDED = {
    "course": "a planned course",
    "workout": "a planned workout",
    "settings": "a device's settings",
    "sport": "a device's settings",
    "segment": "a segment to race on",
    "totals": "totals of past activities",
    "monitoring_a": "a day of steps and heart rate",
    "monitoring_b": "a day of steps and heart rate",
    "monitoring_daily": "a day of steps and heart rate",
}
"""What kinds of FIT files that are no recordings hold."""
EXPORT = say("advice.fit_export")


class FitFormat(LogFormat):
    """Recognised by ``.FIT`` in the header."""

    name = "fit"
    description = "FIT file"
    suffixes = (".fit",)
    altitude_advice = say("advice.fit_altitude")
    doppler_advice = say("advice.fit_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return head[8:HEAD_BYTES] == MAGIC and head[0] >= HEAD_BYTES

    def glance(self, ends: Ends) -> Glance:
        """See ``LogFormat``: of its records, which a long file has all along."""
        records, walked = walk(ends.head)
        records = records[records[:, 0] >= SYSTEM_TIME_S]
        if not len(records):
            return super().glance(ends) if ends.is_short else Glance(self.name, is_unread=True)
        track = records * [1.0, SEMICIRCLE_DEG, SEMICIRCLE_DEG] + [EPOCH_S, 0.0, 0.0]
        first_s, last_s = track[:, 0].min(), track[:, 0].max()
        # As many messages a second in what was not walked through.
        last_s += (last_s - first_s) * (ends.size / walked - 1.0)
        return Glance(self.name, float(first_s), float(last_s), track)

    def told(self, ends: Ends) -> Told:
        """See ``LogFormat``: what its sessions say, or else the way along its records."""
        said: dict[str, list[int]] = {}
        records, _ = walk(ends.head, said)
        metres = [cm / 100.0 for cm in said.get("distance", ()) if cm != 0xFFFFFFFF]
        along = along_m(records[:, 1:] * SEMICIRCLE_DEG) if not ends.tail else np.nan
        return Told(sport_words(said), sum(metres) if metres else along)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        progress("read messages", 0.0)
        files = read_files(data, notes, progress)
        _refuse_unrecorded(files, notes)
        parts = [_Part(file, notes) for file in files]
        tables, gaps = _tables(parts, notes)
        for file in files:
            for name, count in file.uncalibrated.items():
                notes.skip(f"{name} samples that are not calibrated", count)
        device = DeviceMotion(
            force=_axes(parts, "accelerometer_data", "calibrated_accel", GRAVITY_MPS2),
            rate=_axes(parts, "gyroscope_data", "calibrated_gyro", np.pi / 180),
        )
        return build_log(self, notes, tables, outages_s=gaps, geoid=GEOID, advice=EXPORT, device=device)


def _refuse_unrecorded(files: list[FitFile], notes: Notes) -> None:
    """Raise ``EmptyLogError`` for what nobody drove, ``MalformedLogError`` where damage left nothing of it."""
    kinds = [UNRECORDED.get(file.kind, "") for file in files]
    records = [len(file.columns["record"]["timestamp"]) for file in files]
    if all(kinds) and kinds:
        raise EmptyLogError(say("fit.no_recording", kind=kinds[0], advice=EXPORT))
    sports = [str(row.get("sub_sport")) for file in files for row in file.words.get("session", ())]
    if sports and all(sport == "virtual_activity" for sport in sports):
        raise EmptyLogError(say("fit.virtual"))
    if not any(records) and not any(len(file.columns["gps_metadata"]["timestamp"]) for file in files):
        if notes.warnings:
            raise MalformedLogError(say("fit.damaged_at_start", damage=notes.warnings[0]))
        raise EmptyLogError(say("fit.no_records", advice=EXPORT))
    indoors = next((s for s in sports if s.startswith("indoor") or s in ("treadmill", "spin")), "")
    placed = any(
        np.isfinite(file.columns[name]["position_lat"]).any()
        for file in files
        for name in ("record", "gps_metadata")
    )
    if not placed:
        where = say("fit.sport", sport=indoors.replace("_", " ")) if indoors else ""
        raise EmptyLogError(say("fit.no_positions", n=sum(records), where=where))


class _Part:
    """One FIT file of a chain with its times in Unix seconds."""

    def __init__(self, file: FitFile, notes: Notes) -> None:
        self.file = file
        self._turned_on_s = _turned_on(file)
        self.record = file.columns["record"]
        # an absent or invalid fraction is none
        self.record_s = self._unix(self.record["timestamp"], np.nan_to_num(self.record["time128"]))
        camera = file.columns["gps_metadata"]
        self.camera = camera
        self.camera_s = self._unix(camera["timestamp"], np.nan_to_num(camera["timestamp_ms"]) * 1e-3)

    def sampled_s(self, message: str) -> Floats:
        """The times of a message's samples, Unix seconds."""
        columns = self.file.columns[message]
        offset_ms = np.nan_to_num(columns["timestamp_ms"]) + columns["sample_time_offset"]
        return self._unix(columns["timestamp"], offset_ms * 1e-3)

    @property
    def is_cameras(self) -> bool:
        """Whether its positions are a camera's, which come several times a second."""
        counts = [np.isfinite(one["position_lat"]).sum() for one in (self.camera, self.record)]
        return bool(counts[0] > counts[1])

    def _unix(self, stamp: Floats, fraction_s: Floats) -> Floats:
        """Unix seconds; NaN for those since switching on where no message says when that was."""
        system = stamp < SYSTEM_TIME_S
        return np.asarray(np.where(system, self._turned_on_s, EPOCH_S) + stamp + fraction_s)

    def pauses(self) -> list[tuple[float, float]]:
        """(stopped, started), Unix seconds, each time that the timer was started again."""
        out, stopped = [], None
        for event in self.file.words.get("event", ()):
            stamp = event.get("timestamp")
            if event.get("event") != "timer" or not isinstance(stamp, int | float):
                continue
            now = float(self._unix(np.array([float(stamp)]), np.zeros(1))[0])
            if event.get("event_type") in STOPS and stopped is None:
                stopped = now
            elif event.get("event_type") in STARTS and stopped is not None:
                out.append((stopped, now))
                stopped = None
        return out


def _turned_on(file: FitFile) -> float:
    """When the device was switched on, Unix seconds, from messages that state both times; NaN where none does."""
    pairs = file.columns["timestamp_correlation"]
    camera = file.columns["gps_metadata"]
    utc = np.concatenate(
        [pairs["timestamp"] + np.nan_to_num(pairs["timestamp_ms"]) * 1e-3, camera["utc_timestamp"]]
    )
    system = np.concatenate([
        pairs["system_timestamp"] + np.nan_to_num(pairs["system_timestamp_ms"]) * 1e-3,
        camera["timestamp"] + np.nan_to_num(camera["timestamp_ms"]) * 1e-3,
    ])  # fmt: skip
    both_clocks = (utc >= SYSTEM_TIME_S) & (system < SYSTEM_TIME_S)
    return EPOCH_S + float(np.median((utc - system)[both_clocks])) if both_clocks.any() else float("nan")


def _tables(parts: list[_Part], notes: Notes) -> tuple[dict[str, SensorTable], Floats]:
    """The tables, and where the recording begins anew."""
    sources = [(p.camera, p.camera_s) if p.is_cameras else (p.record, p.record_s) for p in parts]
    columns = [source for source, _ in sources]
    time_s = np.concatenate([time for _, time in sources])

    def column(name: str) -> Floats:
        return np.concatenate([c.get(name, np.full(len(c["timestamp"]), np.nan)) for c in columns])

    lat, lon = column("position_lat") * SEMICIRCLE_DEG, column("position_long") * SEMICIRCLE_DEG
    placed = np.isfinite(lat) | np.isfinite(lon)
    notes.skip("records without a position", int((~placed).sum()))
    good = placed & usable_positions(
        time_s, lat, lon, notes, lambda i: say("place.record", n=i + 1), need=placed
    )
    fix = GnssFix.assemble(
        time_s[good],
        notes.repaired,
        lat_deg=lat[good],
        lon_deg=lon[good],
        alt_msl_m=column("enhanced_altitude")[good],
        h_acc_m=positive(column("gps_accuracy"))[good],
    )
    record_s, record = np.concatenate([p.record_s for p in parts]), _joined(p.record for p in parts)
    return {
        "fix": fix,
        "velocity": _velocity(parts),
        "odometry": Odometry.assemble(record_s, speed_mps=record["enhanced_speed"]),
        "pressure": _pressure(parts, record_s, record, notes),
    }, _gaps(parts, fix.time_s)


def _joined(columns: Iterable[dict[str, Floats]]) -> dict[str, Floats]:
    """The columns of a message, of all files of a chain."""
    files = list(columns)
    return {name: np.concatenate([file[name] for file in files]) for name in files[0]}


def _velocity(parts: list[_Part]) -> GnssVelocity:
    """The camera's velocity vector; for want of it, its speed and course."""
    columns = _joined(p.camera for p in parts)
    north, east = ground_velocity(columns["enhanced_speed"], np.radians(columns["heading"]))
    has_vector = np.isfinite(columns["velocity_0"]) & np.isfinite(columns["velocity_1"])
    return GnssVelocity.assemble(
        np.concatenate([p.camera_s for p in parts]),
        vel_n_mps=np.where(has_vector, columns["velocity_1"], north),
        vel_e_mps=np.where(has_vector, columns["velocity_0"], east),
        vel_d_mps=-columns["velocity_2"],
    )


def _pressure(parts: list[_Part], record_s: Floats, record: dict[str, Floats], notes: Notes) -> Pressure:
    """Pressures, with the temperature that the device states at the time."""
    time_s = np.concatenate([p.sampled_s("barometer_data") for p in parts])
    pressure = np.concatenate([p.file.columns["barometer_data"]["baro_pres"] for p in parts])
    own = np.isfinite(record["absolute_pressure"])
    if np.isfinite(record["enhanced_altitude"]).any():
        notes.skip("pressures of records whose altitude is made of them", int(own.sum()))
    elif not len(time_s):
        time_s, pressure = record_s[own], record["absolute_pressure"][own]
    warm = np.isfinite(record["temperature"]) & np.isfinite(record_s)
    temperature = np.full(len(time_s), np.nan)
    if warm.any() and len(time_s):
        order = np.argsort(record_s[warm], kind="stable")
        temperature = (
            np.interp(time_s, record_s[warm][order], record["temperature"][warm][order]) + ZERO_CELSIUS_K
        )
    measured = np.isfinite(pressure) & (pressure > 0)
    return Pressure.assemble(
        time_s[measured], notes.repaired, pressure_pa=pressure[measured], temperature_k=temperature[measured]
    )


def _axes(parts: list[_Part], message: str, name: str, unit: float) -> ThreeAxes:
    """Calibrated samples along the device's axes, in SI units."""
    columns = _joined(p.file.columns[message] for p in parts)
    x, y, z = (unit * columns[f"{name}_{axis}"] for axis in "xyz")
    return ThreeAxes.assemble(np.concatenate([p.sampled_s(message) for p in parts]), x=x, y=y, z=z)


def _gaps(parts: list[_Part], time_s: Floats) -> Floats:
    """The first position after each pause, and of each file of a chain but the first."""
    begins = sorted(float(np.nanmin(p.record_s)) for p in parts if np.isfinite(p.record_s).any())
    out = [time_s[k] for k in np.searchsorted(time_s, begins[1:]) if 0 < k < len(time_s)]
    for stopped, started in (pause for p in parts for pause in p.pauses()):
        first = max(int(np.searchsorted(time_s, stopped, side="right")), 1)
        last = int(np.searchsorted(time_s, started))
        k = np.arange(first, min(last, len(time_s) - 1) + 1)
        # some devices record on while the timer stands still
        missing_s = np.minimum(time_s[k], started) - np.maximum(time_s[k - 1], stopped)
        out += time_s[k[missing_s > LONGEST_PAUSE_STEP_S]].tolist()
    return np.array(out, float)
