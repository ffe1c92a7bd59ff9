"""From UBX messages to tables: navigation and high-rate messages here, sensor messages through ``ubx_sensors``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.formats.base import Data, Notes, Place, ground_velocity, usable_positions
from fusion.formats.receiver import time_tags, ubx_older
from fusion.formats.receiver.time_tags import Evidence, Marks, WeekClock
from fusion.formats.receiver.ubx_frames import Frames
from fusion.formats.receiver.ubx_messages import DEG, TYPES, Records, decode, kind_name
from fusion.formats.receiver.ubx_raw import LEAP_KNOWN, RAWX, epoch_marks, utc_of
from fusion.formats.receiver.ubx_sensors import sensor_tables
from fusion.frames import GRAVITY_MPS2
from fusion.messages import say
from fusion.types import (
    AngularRate,
    Attitude,
    Bools,
    Floats,
    GnssFix,
    GnssVelocity,
    Ints,
    SensorTable,
    SpecificForce,
)

GEOID = "the receiver's own (u-blox: coarse EGM96 grid)"
UNKNOWN_U4 = 0xFFFFFFFF
DEAD_RECKONING, FIX_2D, FIX_3D, FIX_COMBINED = 1, 2, 3, 4


@dataclass(frozen=True)
class Stream:
    """A byte stream with its UBX messages found and decoded: name -> (records, byte offsets)."""

    data: Data
    frames: Frames
    messages: dict[str, tuple[Records, Ints]]

    @classmethod
    def decode(cls, data: Data, frames: Frames, notes: Notes) -> Stream:
        """Decode every known message; those too short for their type are counted.

        Where there is no NAV-PVT, it is put together from older messages.
        """
        messages = {}
        for name in TYPES:
            records, offset, short = decode(data, frames, name)
            notes.skip(f"{name} messages too short", short)
            if len(records):
                messages[name] = records, offset
        if "NAV-PVT" not in messages and (epochs := ubx_older.epochs(messages)):
            messages["NAV-PVT"] = epochs
        return cls(data, frames, messages)

    def inventory(self) -> str:
        """The messages of the stream by number, as in ``3600 x NAV-PVT, 40 x 0A-04``."""
        counts = Counter(self.frames.kind.tolist())
        return ", ".join(f"{n} x {kind_name(k)}" for k, n in counts.most_common(6))


def ubx_tables(
    stream: Stream, fallback: Marks, dated: bool, notes: Notes, place: Place
) -> dict[str, SensorTable]:
    """Every table that the UBX messages of a stream fill.

    ``fallback`` are time marks from elsewhere (NMEA between the messages): for sensors without any NAV
    message, and, if ``dated``, for NAV messages without a date.
    """
    evidence = utc_evidence(stream)
    if dated and not np.any(evidence.trust > 0):
        evidence = _evidence_from_nmea(stream, fallback)
    clock = WeekClock(evidence, notes)
    tables: dict[str, SensorTable] = {}
    for name in ("NAV-PVT", "HNR-PVT"):
        if name in stream.messages and "fix" not in tables:
            tables |= _positions(stream, name, clock, notes, place)
    tables["attitude"] = _attitude(stream, clock, notes)
    marks = _marks(stream, clock)
    if not len(marks):
        marks = fallback
    force, rate, odometry = sensor_tables(stream.data, stream.frames, marks, notes)
    tables |= {"force": force, "rate": rate, "odometry": odometry}
    if "HNR-INS" in stream.messages:
        _add_dynamics(tables, stream, clock, notes)
    return {name: table for name, table in tables.items() if len(table)}


_UTC: dict[str, tuple[Callable[[Records], Floats], Callable[[Records], Ints]]] = {
    "NAV-PVT": (time_tags.utc_seconds, time_tags.trust_of),
    "HNR-PVT": (time_tags.utc_seconds, time_tags.trust_of),
    "NAV-TIMEUTC": (time_tags.utc_seconds, time_tags.trust_of),
    "NAV-TIMEGPS": (time_tags.gps_utc_seconds, lambda records: np.where(records["valid"] & 7 == 7, 3, 0)),
    "NAV-SOL": (ubx_older.week_utc_seconds, lambda records: np.full(len(records), 2)),
    RAWX: (utc_of, lambda records: np.where(records["recStat"] & LEAP_KNOWN == 1, 3, 2)),
}
"""What messages say of UTC, Unix seconds, and the trust in it (see ``Evidence``)."""


def utc_evidence(stream: Stream) -> Evidence:
    """What the messages say of UTC beside the time of week."""
    parts = []
    for name, (utc_of_records, trust) in _UTC.items():
        if name in stream.messages:
            records, offset = stream.messages[name]
            itow_s = records["rcvTow"] if name == RAWX else records["iTOW"] * 1e-3
            parts.append(Evidence(offset, itow_s, utc_of_records(records), trust(records)))
    evidence = Evidence().joined(*parts)
    return evidence.take(np.isfinite(evidence.utc_s) & (evidence.trust > 0))


def _evidence_from_nmea(stream: Stream, marks: Marks) -> Evidence:
    """UTC beside iTOW from dated NMEA: the difference most often seen to the NAV-PVT that follows."""
    if "NAV-PVT" not in stream.messages or not len(marks):
        return Evidence()
    records, offset = stream.messages["NAV-PVT"]
    itow_s = records["iTOW"] * 1e-3
    at = np.clip(np.searchsorted(offset, marks.offset), 0, len(offset) - 1)
    differences, count = np.unique(np.round(marks.time_s - itow_s[at]), return_counts=True)
    difference = differences[count.argmax()]
    return Evidence(offset[:1], itow_s[:1], itow_s[:1] + difference, np.full(1, 2, np.int64))


def _marks(stream: Stream, clock: WeekClock) -> Marks:
    """The first message of each epoch; high-rate ones if there are any, being sent sooner."""
    for group in (("HNR-PVT", "HNR-ATT", "HNR-INS"), ("NAV-PVT", "NAV-ATT", "NAV-EOE")):
        present = [stream.messages[name] for name in group if name in stream.messages]
        if not present:
            continue
        offset = np.concatenate([o for _, o in present])
        itow = np.concatenate([r["iTOW"].astype(np.int64) for r, _ in present])
        order = np.argsort(offset)
        offset, itow = offset[order], itow[order]
        first = np.append(True, np.diff(itow) != 0)
        return Marks(offset[first], clock.time_s(itow[first] * 1e-3, offset[first]))
    if RAWX in stream.messages:
        return epoch_marks(*stream.messages[RAWX])
    return Marks()


def _valid_fix(records: Records, notes: Notes, place: Place, offset: Ints) -> Bools:
    kind, fine = records["fixType"], records["flags"] & 1
    flagged = fine == 0
    if "flags3" in (records.dtype.names or ()):
        flagged |= records["flags3"] & 1 == 1
    faults = (
        ("epochs without a fix", ~np.isin(kind, (DEAD_RECKONING, FIX_2D, FIX_3D, FIX_COMBINED))),
        ("epochs by dead reckoning alone", kind == DEAD_RECKONING),
        ("fixes that the receiver flags as not OK", flagged),
    )

    def tell(row: int) -> str:
        return f"{place(int(offset[row]))}: fixType {int(kind[row])}, gnssFixOK {int(fine[row])}"

    return notes.sift(faults, tell, position=True)


def _positions(
    stream: Stream, name: str, clock: WeekClock, notes: Notes, place: Place
) -> dict[str, SensorTable]:
    records, offset = stream.messages[name]
    valid = _valid_fix(records, notes, place, offset)
    records, offset = records[valid], offset[valid]
    if not len(records):
        return {}
    time_s = clock.time_s(records["iTOW"] * 1e-3, offset)
    declared = time_tags.trust_of(records) > 1
    time_s = time_tags.own_time(time_s, time_tags.utc_seconds(records), declared)
    lat, lon = records["lat"] * 1e-7, records["lon"] * 1e-7
    good = usable_positions(time_s, lat, lon, notes, lambda i: place(int(offset[i])))
    records, time_s, lat, lon = records[good], time_s[good], lat[good], lon[good]
    flat = records["fixType"] == FIX_2D
    if flat.any():
        notes.repaired["heights of 2-D fixes left out"] += int(flat.sum())
    fix = GnssFix.assemble(
        time_s,
        notes.repaired,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl_m=np.where(flat, np.nan, records["hMSL"] * 1e-3),
        height_ell_m=np.where(flat, np.nan, records["height"] * 1e-3),
        h_acc_m=_accuracy(records["hAcc"]) * 1e-3,
        v_acc_m=np.where(flat, np.nan, _accuracy(records["vAcc"]) * 1e-3),
    )
    if name == "NAV-PVT":
        north, east = records["velN"] * 1e-3, records["velE"] * 1e-3
        down = np.where(flat, np.nan, records["velD"] * 1e-3)
    else:
        north, east = ground_velocity(records["gSpeed"] * 1e-3, records["headMot"] * 1e-5 * DEG)
        down = np.full(len(records), np.nan)
    velocity = GnssVelocity.assemble(
        time_s, vel_n_mps=north, vel_e_mps=east, vel_d_mps=down, s_acc_mps=_accuracy(records["sAcc"]) * 1e-3
    )
    return {"fix": fix, "velocity": velocity} if len(fix) else {}


def _accuracy(raw: Ints) -> Floats:
    """Accuracies as floats; 0 and all ones mean not known."""
    return np.where((raw == 0) | (raw == UNKNOWN_U4), np.nan, raw.astype(float))


def _attitude(stream: Stream, clock: WeekClock, notes: Notes) -> Attitude:
    """NAV-ATT or HNR-ATT, whichever has more samples; an angle with accuracy 0 is not available."""
    tables = [Attitude.empty()]
    for name in ("NAV-ATT", "HNR-ATT"):
        if name not in stream.messages:
            continue
        records, offset = stream.messages[name]
        columns = {}
        for angle, field in (("roll", "roll"), ("pitch", "pitch"), ("yaw", "heading")):
            sigma = _accuracy(records[f"acc{field.capitalize()}"]) * 1e-5 * DEG
            columns[f"{angle}_acc_rad"] = sigma
            columns[f"{angle}_rad"] = np.where(np.isnan(sigma), np.nan, records[field] * 1e-5 * DEG)
        notes.skip(f"{name}: pitch not available", int(np.isnan(columns["pitch_rad"]).sum()))
        time_s = clock.time_s(records["iTOW"] * 1e-3, offset)
        tables.append(Attitude.assemble(time_s, notes.repaired, **columns))
    return max(tables, key=len)


def _add_dynamics(tables: dict[str, SensorTable], stream: Stream, clock: WeekClock, notes: Notes) -> None:
    """HNR-INS fills angular rate and specific force where ESF messages give none.

    Its axes are the vehicle's (x forward, y right, z down) and its accelerations free of gravity, which is
    added back by the receiver's own attitude.
    """
    records, offset = stream.messages["HNR-INS"]
    time_s = clock.time_s(records["iTOW"] * 1e-3, offset)
    valid = records["valid"].astype(np.int64)

    def axis(field: str, bit: int, scale: float) -> Floats:
        return np.where(valid >> bit & 1 == 1, records[field] * scale, np.nan)

    if not len(tables["rate"]):
        tables["rate"] = AngularRate.assemble(
            time_s,
            gyr_x_radps=axis("xAngRate", 8, 1e-3 * DEG),
            gyr_y_radps=-axis("yAngRate", 9, 1e-3 * DEG),
            gyr_z_radps=-axis("zAngRate", 10, 1e-3 * DEG),
        )
    attitude = tables["attitude"]
    if len(tables["force"]) or not isinstance(attitude, Attitude):
        return
    level = attitude.take(np.isfinite(attitude.roll_rad) & np.isfinite(attitude.pitch_rad))
    if not len(level):
        notes.warn(say("receiver.no_gravity"))
        return
    roll, pitch = (
        np.interp(time_s, level.time_s, a, left=np.nan, right=np.nan)
        for a in (level.roll_rad, level.pitch_rad)
    )
    tables["force"] = SpecificForce.assemble(
        time_s,
        acc_x_mps2=axis("xAccel", 11, 1e-2) + GRAVITY_MPS2 * np.sin(pitch),
        acc_y_mps2=-axis("yAccel", 12, 1e-2) + GRAVITY_MPS2 * np.sin(roll) * np.cos(pitch),
        acc_z_mps2=-axis("zAccel", 13, 1e-2) + GRAVITY_MPS2 * np.cos(roll) * np.cos(pitch),
    )
    notes.repaired["gravity added back to HNR-INS accelerations"] += len(tables["force"])
