"""A drive as the bytes a u-blox M8 sends: NAV-PVT, NAV-ATT, NAV-EOE, ESF-MEAS (protocol 18), and raw signals if any.

Messages stand in the order in which a receiver would send them: an ESF-MEAS some milliseconds after its
samples, an epoch's NAV messages some 60 ms after the epoch. ESF-MEAS carries the sensor's own millisecond
counter, whose offset is arbitrary and whose rate is off by some parts in 100,000, as on real modules.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.signals import RawGnss
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.terrain import GEOID_UNDULATION_M
from fusion.simulate.write.ubx_raw import Sent, frames, in_order, raw_messages
from fusion.types import Floats

GPS_EPOCH_S = 315_964_800.0
LEAP_SECONDS = 18
WEEK_S = 604_800
SENSOR_RATE_HZ = 10.0
"""Of ESF-MEAS."""
_NAV_DELAY_S = 0.06
"""From an epoch to its messages, as ``_ESF_DELAY_S`` from a sample to its own."""
_ESF_DELAY_S = 0.012
_UNKNOWN_ACCURACY = 0xFFFFFFFF

PVT = np.dtype(
    [("iTOW", "<u4"), ("year", "<u2")]
    + [(n, "u1") for n in ("month", "day", "hour", "min", "sec", "valid")]
    + [("tAcc", "<u4"), ("nano", "<i4")]
    + [(n, "u1") for n in ("fixType", "flags", "flags2", "numSV")]
    + [(n, "<i4") for n in ("lon", "lat", "height", "hMSL")]
    + [("hAcc", "<u4"), ("vAcc", "<u4")]
    + [(n, "<i4") for n in ("velN", "velE", "velD", "gSpeed", "headMot")]
    + [("sAcc", "<u4"), ("headAcc", "<u4"), ("pDOP", "<u2"), ("flags3", "<u2"), ("reserved", "<u4")]
    + [("headVeh", "<i4"), ("magDec", "<i2"), ("magAcc", "<u2")]
)
ATT = np.dtype(
    [("iTOW", "<u4"), ("version", "u1"), ("reserved", "u1", 3)]
    + [(n, "<i4") for n in ("roll", "pitch", "heading")]
    + [(n, "<u4") for n in ("accRoll", "accPitch", "accHeading")]
)
EOE = np.dtype("<u4")
ESF = np.dtype([("timeTag", "<u4"), ("flags", "<u2"), ("id", "<u2"), ("data", "<u4", 6)])
_SENSOR_TYPES = (16, 17, 18, 14, 13, 5)
"""Data types of ESF-MEAS: accelerometer x, y, z, gyroscope x, y, z."""


def write_ubx(drive: SimulatedDrive, path: Path, raw: RawGnss | None = None) -> None:
    """Write the messages of a drive, and what ``raw`` holds beside them; they carry no wheels."""
    Path(path).write_bytes(ubx_bytes(drive, raw))


def ubx_bytes(drive: SimulatedDrive, raw: RawGnss | None = None) -> bytes:
    """Encode a drive, its messages sorted by the time of sending."""
    epoch = drive.elapsed_s + _NAV_DELAY_S
    sensor_s = np.round(np.arange(0.0, drive.motion.duration_s, 1 / SENSOR_RATE_HZ) + 0.007, 3)
    sensor_s = sensor_s[sensor_s < drive.motion.duration_s]
    kinds: list[Sent] = [
        (epoch, frames(0x01, 0x07, _pvt(drive))),
        (epoch + 0.001, frames(0x01, 0x05, _att(drive))),
        (epoch + 0.002, frames(0x01, 0x61, _itow(drive))),
        (sensor_s + _ESF_DELAY_S, frames(0x10, 0x02, _esf(drive, sensor_s))),
    ]
    if raw is not None:
        kinds += [(sent_s - drive.start_time_s, rows) for sent_s, rows in raw_messages(raw)]
    return in_order(kinds)


def _itow(drive: SimulatedDrive) -> NDArray[Any]:
    """GPS time of week of the epochs, milliseconds."""
    gps_ms = np.round((drive.time_s - GPS_EPOCH_S + LEAP_SECONDS) * 1000).astype(np.int64)
    return (gps_ms % (WEEK_S * 1000)).astype(EOE)


def _scaled(values: Floats, scale: float) -> NDArray[np.int64]:
    return np.round(values * scale).astype(np.int64)


def _pvt(drive: SimulatedDrive) -> NDArray[Any]:
    fix, p = drive.has_gnss, drive.profile
    out = np.zeros(len(fix), PVT)
    out["iTOW"] = _itow(drive)
    _fill_clock(out, drive.time_s)
    out["fixType"] = np.where(fix, 3, 0)
    out["flags"] = np.where(fix, 0x01, 0x00)
    out["numSV"] = np.where(fix, 14, 0)
    last = np.maximum.accumulate(np.where(fix, np.arange(len(fix)), -1))
    held = np.where(last < 0, 0, last)  # without a fix the receiver repeats the last position it had
    lon, lat = drive.lonlat()
    alt = drive.gnss.alt_msl_m
    for name, values, scale in (
        ("lon", lon, 1e7),
        ("lat", lat, 1e7),
        ("height", alt + GEOID_UNDULATION_M, 1e3),
        ("hMSL", alt, 1e3),
    ):
        out[name] = np.where(last < 0, 0, _scaled(values[held], scale))
    ned = drive.gnss.velocity_ned_mps
    speed = np.hypot(ned[:, 0], ned[:, 1])
    course = np.degrees(np.arctan2(ned[:, 1], ned[:, 0])) % 360.0
    for k, name in enumerate(("velN", "velE", "velD")):
        out[name] = np.where(fix, _scaled(ned[:, k], 1e3), 0)
    out["gSpeed"] = np.where(fix, _scaled(speed, 1e3), 0)
    out["headMot"] = _scaled(course[held], 1e5)
    for name, accuracy in (("hAcc", p.h_acc_m), ("vAcc", p.v_acc_m)):
        out[name] = np.where(fix, round(accuracy * 1e3), _UNKNOWN_ACCURACY)
    out["sAcc"] = np.where(fix, round(p.s_acc_mps * 1e3), 20_000)
    course_acc = np.degrees(np.minimum(np.pi, p.doppler_mps / np.maximum(speed, 0.05)))
    out["headAcc"] = np.where(fix, _scaled(course_acc, 1e5), 180 * 10**5)
    out["pDOP"] = np.where(fix, 140, 9999)
    return out


def _fill_clock(out: NDArray[Any], time_s: Floats) -> None:
    """UTC rounded to the nearest second, the rest in ``nano`` (which may be negative), valid throughout."""
    whole_s = np.round(time_s).astype(np.int64)
    start = datetime.fromtimestamp(int(whole_s[0]), UTC)
    clock = [start + timedelta(seconds=int(s)) for s in whole_s - whole_s[0]]
    for name, part in (
        ("year", "year"),
        ("month", "month"),
        ("day", "day"),
        ("hour", "hour"),
        ("min", "minute"),
        ("sec", "second"),
    ):
        out[name] = [getattr(c, part) for c in clock]
    out["nano"] = _scaled(np.round(time_s - whole_s, 3), 1e9)
    out["valid"] = 0x07
    out["tAcc"] = 25


def _att(drive: SimulatedDrive) -> NDArray[Any]:
    imu = drive.inertial
    out = np.zeros(len(imu.roll_rad), ATT)
    out["iTOW"] = _itow(drive)
    out["roll"] = _scaled(np.degrees(imu.roll_rad), 1e5)
    out["pitch"] = _scaled(np.degrees(imu.pitch_rad), 1e5)
    out["heading"] = _scaled(np.degrees(imu.yaw_rad) % 360.0, 1e5)
    out["accRoll"] = out["accPitch"] = round(drive.profile.pitch_acc_deg * 1e5)
    out["accHeading"] = 2 * 10**5
    return out


def _esf(drive: SimulatedDrive, elapsed_s: Floats) -> NDArray[Any]:
    rng = np.random.default_rng([drive.town.seed, drive.seed, 25])
    offset_ms, rate = float(rng.integers(10**6, 4 * 10**9)), 1.0 + 2e-5 * float(rng.normal())
    imu = drive.inertial_at(elapsed_s)
    out = np.zeros(len(elapsed_s), ESF)
    out["timeTag"] = np.round(offset_ms + 1e3 * elapsed_s * rate).astype(np.int64) % 2**32
    out["flags"] = len(_SENSOR_TYPES) << 11
    values = np.hstack([_scaled(imu.force_mps2, 2**10), _scaled(np.degrees(imu.rate_radps), 2**12)])
    out["data"] = (values & 0xFFFFFF) | (np.array(_SENSOR_TYPES) << 24)
    return out
