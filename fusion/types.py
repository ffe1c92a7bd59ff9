"""What passes between the rooms of the library: drive logs in, tracks and slopes out.

SI units and UTC Unix seconds throughout; an unmeasured value is NaN, never 0. Here belongs what two rooms or more share
and what needs nothing but arrays: no roads, no terrain, no method (a method's whole result is in ``methods.base``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np

from fusion.arrays import Bools as Bools  # noqa: PLC0414 - all of the library takes these from here
from fusion.arrays import ColumnTable
from fusion.arrays import Floats as Floats  # noqa: PLC0414
from fusion.arrays import Ints as Ints  # noqa: PLC0414
from fusion.signals import RawGnss

MAX_SPEED_MPS = 150.0
"""No road vehicle is faster: where positions ask for more, one of them is wrong."""
LONGEST_BRIDGED_OUTAGE_S = 120.0
"""An estimate bridges outages of the recording up to this long. After a longer one, or one that the log states, it
begins anew."""

PAUSE_S = 10.0
"""Longer pauses between two epochs interrupt a track: nothing is counted or drawn over what was not recorded."""

CUES = ("altitude", "doppler", "pitch", "specific force", "barometer")
"""What a drive's own sensors can say of height and grade."""

Progress = Callable[[str, float], None]
"""Called with the stage's name and the share of the work done, 0..1. It may raise to abort the work."""


def no_progress(stage: str, share: float) -> None:
    """The silent ``Progress``."""


def within(progress: Progress, start: float, end: float) -> Progress:
    """A ``Progress`` for a part of the work, which goes from one share of the whole to another."""
    return lambda stage, share: progress(stage, start + (end - start) * share)


@dataclass(frozen=True)
class SensorTable(ColumnTable):
    """One sensor's samples at its own rate: ``time_s`` strictly increasing, every column of that length."""

    time_s: Floats

    def __post_init__(self) -> None:
        for spec in fields(self):
            column = np.ascontiguousarray(getattr(self, spec.name), dtype=np.float64)
            if column.shape != np.shape(self.time_s):
                raise ValueError(
                    f"{type(self).__name__}.{spec.name} has shape {column.shape}, time_s {np.shape(self.time_s)}"
                )
            object.__setattr__(self, spec.name, column)
        if len(self.time_s) and not np.all(np.diff(self.time_s) > 0):
            raise ValueError(f"{type(self).__name__}.time_s must increase strictly")

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """The names of the measured columns, without ``time_s``."""
        return tuple(spec.name for spec in fields(cls) if spec.name != "time_s")

    @classmethod
    def assemble(cls, time_s: Floats, repairs: Counter[str] | None = None, **columns: Floats) -> Self:
        """Build a table from raw samples in any order; columns not given are NaN.

        Samples without a time or without any value are dropped silently; out-of-order samples are sorted and
        later duplicates of a time dropped, both counted in ``repairs`` (keys ``<Table>: out of order`` and
        ``<Table>: repeated time``).
        """
        time_s = np.asarray(time_s, float)
        table = {n: np.asarray(columns.get(n, np.full(time_s.shape, np.nan)), float) for n in cls.columns()}
        known = np.isfinite(time_s)
        if table:
            known &= np.any([np.isfinite(c) for c in table.values()], axis=0)
        if not known.all():
            time_s, table = time_s[known], {n: c[known] for n, c in table.items()}
        if (np.diff(time_s) > 0).all():
            return cls(time_s=time_s, **table)  # as it is, for want of a reason to copy long logs
        backwards = int(np.count_nonzero(np.diff(time_s) < 0))
        order = np.argsort(time_s, kind="stable")
        first = np.ones(len(order), bool)
        first[1:] = np.diff(time_s[order]) > 0
        if repairs is not None:
            for what, count in (("out of order", backwards), ("repeated time", int((~first).sum()))):
                if count:
                    repairs[f"{cls.__name__}: {what}"] += count
        keep = order[first]
        return cls(time_s=time_s[keep], **{n: c[keep] for n, c in table.items()})

    def has(self, *names: str) -> bool:
        """Whether each named column holds at least one finite value."""
        return all(bool(np.isfinite(getattr(self, n)).any()) for n in names)


@dataclass(frozen=True)
class GnssFix(SensorTable):
    """Positions. ``height_ell_m`` is above WGS 84; ``alt_msl_m`` above the log's geoid (``DriveLog.geoid``).

    ``h_acc_m`` and ``v_acc_m`` are the receiver's own one-sigma accuracies (horizontal 2-D, vertical).
    """

    lat_deg: Floats
    lon_deg: Floats
    alt_msl_m: Floats
    height_ell_m: Floats
    h_acc_m: Floats
    v_acc_m: Floats


@dataclass(frozen=True)
class GnssVelocity(SensorTable):
    """Doppler velocity, north, east, down. ``vel_d_mps`` is NaN where the log has only ground speed and course."""

    vel_n_mps: Floats
    vel_e_mps: Floats
    vel_d_mps: Floats
    s_acc_mps: Floats


@dataclass(frozen=True)
class SpecificForce(SensorTable):
    """Accelerometer, sensor body frame: x forward, y left, z up; +9.8 on z at rest."""

    acc_x_mps2: Floats
    acc_y_mps2: Floats
    acc_z_mps2: Floats


@dataclass(frozen=True)
class AngularRate(SensorTable):
    """Gyroscope, sensor body frame: x forward, y left, z up; right-handed rotation positive."""

    gyr_x_radps: Floats
    gyr_y_radps: Floats
    gyr_z_radps: Floats


@dataclass(frozen=True)
class Attitude(SensorTable):
    """Pitch positive nose up, roll positive right side down, yaw clockwise from north; accuracies one sigma."""

    roll_rad: Floats
    pitch_rad: Floats
    yaw_rad: Floats
    roll_acc_rad: Floats
    pitch_acc_rad: Floats
    yaw_acc_rad: Floats


@dataclass(frozen=True)
class Odometry(SensorTable):
    """Wheel rotation (cumulative, radians) and the vehicle's own speed signal."""

    wheel_left_rad: Floats
    wheel_right_rad: Floats
    speed_mps: Floats


@dataclass(frozen=True)
class Pressure(SensorTable):
    """Barometric pressure, and the temperature that the device states (its own, for want of the air's)."""

    pressure_pa: Floats
    temperature_k: Floats


@dataclass(frozen=True)
class ThreeAxes(SensorTable):
    """A vector along a device's own axes, right-handed, whatever they are in the vehicle."""

    x: Floats
    y: Floats
    z: Floats


@dataclass(frozen=True)
class DeviceMotion:
    """What a phone's inertial sensors say in the phone's axes, m/s2 and rad/s.

    ``force`` is with gravity; ``moved`` without it, and ``gravity`` is what was taken off. Some devices state all three
    with the opposite sign, and some in units of standard gravity: who uses them finds that out.
    """

    force: ThreeAxes = field(default_factory=ThreeAxes.empty)
    moved: ThreeAxes = field(default_factory=ThreeAxes.empty)
    gravity: ThreeAxes = field(default_factory=ThreeAxes.empty)
    rate: ThreeAxes = field(default_factory=ThreeAxes.empty)

    def tables(self) -> dict[str, ThreeAxes]:
        """The tables by name."""
        return {spec.name: getattr(self, spec.name) for spec in fields(self)}

    def __bool__(self) -> bool:
        return any(len(table) for table in self.tables().values())


@dataclass(frozen=True)
class DriveLog:
    """One drive as its sensors recorded it: a table per sensor, never resampled to a common clock.

    ``outages_s`` holds the times of outages of the recording that the log states (a new track or segment begins):
    nothing may be interpolated across them. In a GNSS outage only positions are missing, and other sensors go on.
    ``geoid`` says what ``alt_msl_m`` refers to, as far as the format says it. ``missing`` lists sensors and columns
    that the log does not have, ``skipped`` counts input that could not be used (by reason), ``repaired`` counts what
    was put right (by reason), ``warnings`` are sentences for the driver. ``raw`` holds pseudoranges and ephemerides,
    where there are any; a log may have those and no position yet. ``device`` holds what a phone's inertial sensors say
    in its own axes, until it is known how it lies in the vehicle.
    """

    source_format: str
    fix: GnssFix
    velocity: GnssVelocity = field(default_factory=GnssVelocity.empty)
    force: SpecificForce = field(default_factory=SpecificForce.empty)
    rate: AngularRate = field(default_factory=AngularRate.empty)
    attitude: Attitude = field(default_factory=Attitude.empty)
    odometry: Odometry = field(default_factory=Odometry.empty)
    pressure: Pressure = field(default_factory=Pressure.empty)
    outages_s: Floats = field(default_factory=lambda: np.empty(0))
    geoid: str = "unknown"
    skipped: Counter[str] = field(default_factory=Counter)
    repaired: Counter[str] = field(default_factory=Counter)
    warnings: tuple[str, ...] = ()
    raw: RawGnss | None = None
    device: DeviceMotion = field(default_factory=DeviceMotion)

    SENSORS = ("fix", "velocity", "force", "rate", "attitude", "odometry", "pressure")

    def tables(self) -> dict[str, SensorTable]:
        """The tables by name, in a fixed order."""
        return {name: getattr(self, name) for name in self.SENSORS}

    @property
    def missing(self) -> tuple[str, ...]:
        """Sensors (``attitude``) and columns (``fix.v_acc_m``) that the log does not have."""
        out: list[str] = []
        for name, table in self.tables().items():
            if not len(table):
                out.append(name)
            else:
                out += [f"{name}.{c}" for c in table.columns() if not table.has(c)]
        return tuple(out)

    def bounds_deg(self) -> tuple[float, float, float, float]:
        """(west, south, east, north) of the positions, degrees; wild fixes (see ``_reachable``) left out."""
        lon, lat = self.fix.lon_deg, self.fix.lat_deg
        keep = _reachable(self.fix.time_s, lon, lat)
        lon, lat = lon[keep], lat[keep]
        return float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())


def _reachable(time_s: Floats, lon_deg: Floats, lat_deg: Floats) -> Bools:
    """False for a fix that no road vehicle can reach from the one before nor leave to the one after.

    One such fix would stretch a log's extent over half a continent. Where everything is wild, all are kept.
    """
    turn = np.remainder(np.diff(lon_deg) + 180.0, 360.0) - 180.0
    metres = 111_320.0 * np.hypot(np.diff(lat_deg), turn * np.cos(np.radians(lat_deg[1:])))
    wild = metres > MAX_SPEED_MPS * np.diff(time_s) + 1000.0
    before, after = np.concatenate([[True], wild]), np.concatenate([wild, [True]])
    keep = ~(before & after) if len(lon_deg) > 2 else np.ones(len(lon_deg), bool)
    return keep if keep.any() else np.ones(len(lon_deg), bool)


@dataclass(frozen=True)
class Track:
    """What a method estimated, one row per epoch; columns a method does not estimate are NaN.

    ``segment`` is an index into the road network's segments, -1 where unmatched; ``distance_m`` is measured
    from the segment's from_node to the projection of the estimate. ``alt_m`` is the height of the road
    surface (not of the antenna) where the method knows the difference. ``heading_rad`` is clockwise from north,
    0 to 2 pi. ``after_outage`` marks rows where the estimate begins anew, after an outage of the recording or
    of the filter: nothing may be drawn or fitted across to the row before. Sigmas are one standard deviation.
    """

    time_s: Floats
    lat_deg: Floats
    lon_deg: Floats
    alt_m: Floats
    h_sigma_m: Floats
    alt_sigma_m: Floats
    speed_mps: Floats
    heading_rad: Floats
    pitch_rad: Floats
    pitch_sigma_rad: Floats
    segment: Ints
    distance_m: Floats
    has_gnss: Bools
    after_outage: Bools

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True)
class SegmentSlope:
    """One method's estimate for one segment from one drive (all its passes together).

    ``segment`` indexes the road network; ``slope_percent`` is positive uphill from from_node to to_node,
    whichever way the vehicle went; ``observations`` counts the epochs used; ``passes`` how often the
    segment was driven; ``first_time_s`` and ``last_time_s`` bracket the epochs used.
    """

    segment: int
    slope_percent: float
    slope_sigma_percent: float
    observations: int
    passes: int
    first_time_s: float
    last_time_s: float


@dataclass(frozen=True, eq=False)
class DrawnMeasurements:
    """What the sensors said along a drive, for pictures: shape (m,) each, ordered by time.

    ``sensor`` is an index into ``names``; ``value`` is a height (m) where ``is_height``, else a grade along the
    direction of travel, with mount pitch and the like taken off; ``along_m`` is the distance along the path.
    """

    names: tuple[str, ...]
    sensor: Ints
    time_s: Floats
    along_m: Floats
    value: Floats
    is_height: Bools
