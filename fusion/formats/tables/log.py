"""The log that a CSV holds: the numbers of its rows as sensor tables, whoever named the columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from fusion.formats.base import (
    Data,
    EitherWay,
    Notes,
    build_log,
    ground_velocity,
    refuse_many,
    usable_positions,
)
from fusion.formats.tables import header as csv_header
from fusion.formats.tables.cells import Block, read_blocks
from fusion.formats.tables.header import COLUMNS
from fusion.formats.tables.names import GPS_TIME, PRESSURE_OF_VEHICLE, UNSTATED_SPEED, Schema
from fusion.messages import say
from fusion.types import (
    AngularRate,
    Attitude,
    DeviceMotion,
    DriveLog,
    Floats,
    GnssFix,
    GnssVelocity,
    Odometry,
    Pressure,
    Progress,
    SensorTable,
    SpecificForce,
    ThreeAxes,
)

DEG = np.pi / 180
FREEZING_K = 273.15
_WORST_ACCURACY = 10_000.0
DEVICE_TIME = "_device_time"
"""When a row was written by the device's clock, where ``time`` is that of the position."""
DEVICE_AXES = ("_device_x", "_device_y", "_device_z")
"""An accelerometer with gravity, in axes of its own, g or m/s2."""
_COARSE_PA = 100.0
"""A barometer with larger steps, 8 m of height, says nothing of slopes."""
_SPEED_UNITS = (("m/s", 1.0, 0.8, 1.25), ("knots", 1852 / 3600, 1.75, 2.085), ("mph", 0.44704, 2.085, 2.5),
                ("km/h", 1 / 3.6, 3.1, 4.2))  # fmt: skip
"""Units of speed: what a value is multiplied by, and how many times that of the positions it may be."""
_LEAST_STEPS, _SLOWEST_MPS = 5, 2.0


@dataclass
class _SpeedUnit:
    """The unit of a speed that the header does not name: that which agrees with the positions."""

    factor: float = float("nan")
    seen: bool = False

    def in_mps(self, speed: Floats, time_s: Floats, lat_deg: Floats, lon_deg: Floats, notes: Notes) -> Floats:
        """The speed in m/s; NaN where the unit cannot be told."""
        if not np.isfinite(self.factor):
            self._find(speed, time_s, lat_deg, lon_deg, notes)
        return speed * self.factor

    def _find(self, speed: Floats, time_s: Floats, lat_deg: Floats, lon_deg: Floats, notes: Notes) -> None:
        here = np.isfinite(time_s + lat_deg + lon_deg)
        time, lat, lon, stated = time_s[here], lat_deg[here], lon_deg[here], speed[here]
        new = np.concatenate([[True], np.diff(time) > 0]) if len(time) else np.zeros(0, bool)
        time, lat, lon, stated = time[new], lat[new], lon[new], stated[new]
        metres = 111_200.0 * np.hypot(np.diff(lat), np.diff(lon) * np.cos(np.radians(lat[1:])))
        lasted = np.diff(time)
        with np.errstate(invalid="ignore", divide="ignore"):
            moved = metres / lasted
            mean = 0.5 * (stated[1:] + stated[:-1])
            usable = (lasted < 15) & (moved > _SLOWEST_MPS) & (moved < 100) & (mean > 0)
        ratios = mean[usable] / moved[usable]
        ratio = float(np.median(ratios)) if len(ratios) >= _LEAST_STEPS else float("nan")
        fitting = [(name, factor) for name, factor, low, high in _SPEED_UNITS if low <= ratio < high]
        if fitting:
            self.factor = fitting[0][1]
            notes.warn(say("csv.speed_unit_taken", unit=fitting[0][0]))
        elif not self.seen:
            notes.warn(say("csv.speed_unit_unknown"))
        self.seen = True


@dataclass(frozen=True)
class NamedColumnsCsv(EitherWay):
    """What CSVs have in common of which a person may say what their ``columns`` are (``LogFormat.with_columns``)."""

    columns: Mapping[str, str] = field(default_factory=dict)
    has_named_columns = True

    def schema(self, *, part: bool) -> Schema:
        """The columns that a file may have and must have, one that is a ``part`` of a drive too."""
        raise NotImplementedError

    def with_columns(self, columns: Mapping[str, str]) -> Self:
        """See ``LogFormat``."""
        return replace(self, columns=columns)

    def refuse_header(self, head: bytes, *, part: bool) -> None:
        """See ``LogFormat``."""
        csv_header.understood_header(head, self.schema(part=part))

    def read(self, data: Data, progress: Progress, *, part: bool = False) -> DriveLog:
        """See ``EitherWay``."""
        schema, text = self.schema(part=part), csv_header.from_utf16(bytes(data))
        notes, unit = Notes(), _SpeedUnit()
        parts: dict[str, list[SensorTable]] = {}
        for section, before in csv_header.sections(text, notes):
            layout = csv_header.layout_of(section, notes, schema, lines_before=before)
            for block in read_blocks(section, layout, notes, progress):
                for sensor, table in _assemble(block, unit, notes).items():
                    if len(table):
                        parts.setdefault(sensor, []).append(table)
                refuse_many(sum(map(len, parts.get("fix", ()))))
        tables = {sensor: _joined(parts.pop(sensor), notes) for sensor in list(parts)}
        progress("read rows", 1.0)
        force = tables.pop("device", None)
        motion = DeviceMotion(force=force) if isinstance(force, ThreeAxes) else DeviceMotion()
        _drop_coarse_pressure(tables, notes)
        return build_log(self, notes, tables, part=part, device=motion)


def _drop_coarse_pressure(tables: dict[str, SensorTable], notes: Notes) -> None:
    pressure = tables.get("pressure")
    if not isinstance(pressure, Pressure) or not len(pressure):
        return
    steps = np.diff(np.unique(np.round(pressure.pressure_pa[np.isfinite(pressure.pressure_pa)], 1)))
    if len(steps) and float(np.median(steps)) > _COARSE_PA and len(steps) < len(pressure) / 10:
        del tables["pressure"]
        notes.warn(say("csv.coarse_barometer", step_hpa=np.median(steps) / 100, step_m=np.median(steps) / 12))


def _joined(parts: list[SensorTable], notes: Notes) -> SensorTable:
    """One table of those of the blocks; disorder between blocks counts like that within one."""
    if len(parts) == 1:
        return parts[0]
    kind = type(parts[0])
    columns = {name: np.concatenate([getattr(p, name) for p in parts]) for name in kind.columns()}
    time_s = np.concatenate([p.time_s for p in parts])
    if np.all(np.diff(time_s) > 0):  # as usual: no need of the copies that sorting takes
        return kind(time_s=time_s, **columns)
    return kind.assemble(time_s, notes.repaired if kind is GnssFix else None, **columns)


def _assemble(block: Block, unit: _SpeedUnit, notes: Notes) -> dict[str, SensorTable]:
    col = {name: block.column(name) for name in COLUMNS}
    _forget_placeholders(col, notes)
    time_s, sensor_s = _row_times(block, col)
    lat, lon = col["lat_deg"], col["lon_deg"]
    if UNSTATED_SPEED in block.columns:
        col["speed_mps"] = unit.in_mps(block.columns[UNSTATED_SPEED], time_s, lat, lon, notes)
    if PRESSURE_OF_VEHICLE in block.columns:
        of_vehicle = block.columns[PRESSURE_OF_VEHICLE]
        col["pressure_hpa"] = np.where(np.isfinite(col["pressure_hpa"]), col["pressure_hpa"], of_vehicle)
    claims = np.isfinite(lat) | np.isfinite(lon)
    good = usable_positions(time_s, lat, lon, notes, block.place, need=claims)
    time_s, sensor_s, col = time_s[good], sensor_s[good], {name: c[good] for name, c in col.items()}
    here = claims[good]
    north, east = ground_velocity(col["speed_mps"], col["heading_deg"] * DEG)
    has = np.isfinite(col["vel_n_mps"]) & np.isfinite(col["vel_e_mps"])
    velocity = {
        "vel_n_mps": np.where(has, col["vel_n_mps"], north),
        "vel_e_mps": np.where(has, col["vel_e_mps"], east),
        "vel_d_mps": col["vel_d_mps"],
        "s_acc_mps": col["s_acc_mps"],
    }
    moving = np.isfinite(velocity["vel_n_mps"]) | np.isfinite(velocity["vel_d_mps"])
    used = {n: col[n] for n in COLUMNS}
    used |= {n.replace("dps", "radps"): col[n] * DEG for n in COLUMNS if n.endswith("_dps")}
    used |= {
        n.replace("deg", "rad"): col[n] * DEG for n in ("roll_deg", "pitch_deg", "yaw_deg", "pitch_acc_deg")
    }
    used |= {"speed_mps": col["odo_speed_mps"], "pressure_pa": col["pressure_hpa"] * 100}
    used["temperature_k"] = col["temperature_c"] + FREEZING_K
    position = {n: used[n][here] for n in GnssFix.columns()}
    tables: dict[str, SensorTable] = {
        "fix": GnssFix.assemble(time_s[here], notes.repaired, **position),
        "velocity": GnssVelocity.assemble(time_s[moving], **{n: c[moving] for n, c in velocity.items()}),
    }
    for name, kind in _OTHERS.items():
        tables[name] = kind.assemble(sensor_s, None, **{n: used[n] for n in kind.columns() if n in used})
    if all(name in block.columns for name in DEVICE_AXES):
        axes = (block.columns[name][good] for name in DEVICE_AXES)
        tables["device"] = ThreeAxes.assemble(sensor_s, None, **dict(zip("xyz", axes, strict=True)))
    return tables


def _row_times(block: Block, col: dict[str, Floats]) -> tuple[Floats, Floats]:
    """When the positions of rows are of, and when the other sensors' values were written, on the same clock."""
    time_s = np.where(np.isfinite(col["time_s"]), col["time_s"], col["time"])
    if GPS_TIME in block.columns:
        time_s = np.where(np.isfinite(time_s), time_s, block.columns[GPS_TIME])
    device_s = block.columns.get(DEVICE_TIME)
    if device_s is None:
        return time_s, time_s
    ahead = (time_s - device_s)[np.isfinite(time_s - device_s)]
    written_s = device_s + (float(np.median(ahead)) if len(ahead) else 0.0)
    written_s = np.where(np.isfinite(written_s), written_s, time_s)
    return np.where(np.isfinite(time_s), time_s, written_s), written_s


def _forget_placeholders(col: dict[str, Floats], notes: Notes) -> None:
    """Make numbers that stand for "unknown" unknown: phones write accuracies of 0 or -1, receivers 2^32 mm, and an
    attitude of exactly 0, 0, 0 until they are aligned. In place."""
    for name in ("h_acc_m", "v_acc_m", "s_acc_mps", "pitch_acc_deg"):
        senseless = (col[name] <= 0) | (col[name] > _WORST_ACCURACY)
        if senseless.any():
            col[name] = np.where(senseless, np.nan, col[name])
            notes.repaired[f"{name}: not above 0 or absurdly large, taken as unknown"] += int(senseless.sum())
    angles = np.array([col[name] for name in ("roll_deg", "pitch_deg", "yaw_deg")])
    asleep = np.isfinite(angles[1]) & np.all((angles == 0) | np.isnan(angles), axis=0)
    # A pitch column alone may well read 0 on a level road; only with roll or yaw beside it does 0 mean nothing.
    asleep &= np.isfinite(angles[[0, 2]]).any(axis=0)
    if asleep.any():
        for name in ("roll_deg", "pitch_deg", "yaw_deg"):
            col[name] = np.where(asleep, np.nan, col[name])
        notes.repaired["attitude of exactly 0, taken as unknown"] += int(asleep.sum())


_OTHERS: dict[str, type[SensorTable]] = {
    "force": SpecificForce,
    "rate": AngularRate,
    "attitude": Attitude,
    "odometry": Odometry,
    "pressure": Pressure,
}
