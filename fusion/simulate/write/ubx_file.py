"""A drive as the bytes a u-blox M8 sends: NAV-PVT, NAV-ATT, NAV-EOE, ESF-MEAS (protocol 18), and raw signals if any.

Messages stand in the order in which a receiver would send them: an ESF-MEAS some milliseconds after its
samples, an epoch's NAV messages some 60 ms after the epoch. ESF-MEAS carries the sensor's own millisecond
counter, whose offset is arbitrary and whose rate is off by some parts in 100,000, as on real modules.

Raw signals are those of an F9: RXM-RAWX (version 1), and RXM-SFRBX as satellites send them. Every satellite that is
measured sends its whole ephemeris in each frame of 30 s, the one whose reference time is nearest. What a receiver only
states in steps is rounded: C/N0 to 1 dB-Hz, the sigma to a power of two of 1 cm.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.formats.receiver.ubx_messages import TYPES
from fusion.formats.receiver.ubx_raw import LEAP_KNOWN, MEASUREMENT, PSEUDORANGE_VALID, RAWX, SYSTEM_OF
from fusion.formats.receiver.ubx_subframes import SFRBX
from fusion.signals import (
    CARRIER_HZ,
    GLONASS,
    GLONASS_STEP_HZ,
    GPS_EPOCH_S,
    LIGHT_MPS,
    WEEK_S,
    RawGnss,
    Signals,
    gps_from_unix,
    unix_from_gps,
)
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.town import GEOID_UNDULATION_M
from fusion.simulate.write.ubx_navigation import Sending, sendings
from fusion.types import Floats, Ints

Sent = tuple[Floats, NDArray[np.uint8]]
"""When messages leave the receiver (n,), UTC or since the drive began, and the messages, (n, bytes)."""
_RAWX_DELAY_S = 0.05
_GNSS_ID = {int(system): number for number, system in enumerate(SYSTEM_OF) if system >= 0}


def frames(message_class: int, message_id: int, payload: NDArray[np.void]) -> NDArray[np.uint8]:
    """Wrap payloads, shape (n,), into whole messages, shape (n, 8 + size), with the Fletcher checksum."""
    size = payload.dtype.itemsize
    body = np.ascontiguousarray(payload).view(np.uint8).reshape(len(payload), size)
    head = np.array([0xB5, 0x62, message_class, message_id, size & 0xFF, size >> 8], np.uint8)
    frame = np.empty((len(payload), size + 8), np.uint8)
    frame[:, :6], frame[:, 6:-2] = head, body
    first = np.cumsum(frame[:, 2:-2], axis=1, dtype=np.int64)
    frame[:, -2] = first[:, -1] & 0xFF
    frame[:, -1] = np.sum(first, axis=1) & 0xFF
    return frame


def in_order(messages: list[Sent]) -> bytes:
    """All messages, sorted by the time of sending."""
    sent = np.concatenate([np.empty(0), *(t for t, _ in messages)])
    messages_bytes = [row.tobytes() for _, rows in messages for row in rows]
    return b"".join(messages_bytes[k] for k in np.argsort(sent, kind="stable"))


def raw_messages(raw: RawGnss) -> list[Sent]:
    """The messages that carry all of ``raw``, with the UTC at which they are sent.

    Signals that bring their satellites with them are no measurements of a receiver: ``ValueError``.
    """
    if raw.signals.brings_satellites:
        raise ValueError(
            "pseudoranges that are free of clock and atmosphere are nothing that a receiver writes"
        )
    out = list(_rawx(raw.signals))
    if len(raw.signals):
        out += [_sfrbx(sending) for sending in sendings(raw.navigation, raw.signals)]
    return out


def _rawx(signals: Signals) -> Iterator[Sent]:
    """One group of messages for each number of measurements."""
    rows = _measurements(signals)
    counts = np.diff(signals.first)
    for count in np.unique(counts):
        mine = np.flatnonzero(counts == count)
        at = signals.first[mine][:, None] + np.arange(count)
        head = TYPES[RAWX][1].descr
        out = np.zeros(len(mine), np.dtype([*head, ("block", MEASUREMENT, (int(count),))]))
        gps_s = signals.gps_s[mine]
        out["week"] = gps_s // WEEK_S
        out["rcvTow"] = gps_s % WEEK_S
        out["leapS"] = np.round(gps_s + GPS_EPOCH_S - unix_from_gps(gps_s))
        out["numMeas"], out["recStat"], out["version"] = count, LEAP_KNOWN, 1
        out["block"] = rows[at]
        yield unix_from_gps(gps_s) + _RAWX_DELAY_S, frames(0x02, 0x15, out)


def _measurements(signals: Signals) -> NDArray[np.void]:
    out = np.zeros(len(signals.system), MEASUREMENT)
    out["prMes"] = signals.pseudorange_m
    wavelength_m = LIGHT_MPS / signals.frequency_hz
    out["cpMes"] = signals.pseudorange_m / wavelength_m
    out["doMes"] = -signals.range_rate_mps / wavelength_m
    out["gnssId"] = [_GNSS_ID[s] for s in signals.system.tolist()]
    out["svId"] = signals.number
    channel = np.round((signals.frequency_hz - CARRIER_HZ[GLONASS]) / GLONASS_STEP_HZ)
    out["freqId"] = np.where(signals.system == GLONASS, channel + 7, 0)
    out["locktime"] = 64_500
    out["cno"] = np.round(np.nan_to_num(signals.cn0_dbhz))
    centimetres = np.nan_to_num(signals.sigma_m, nan=np.inf) * 100
    out["prStdev"] = np.clip(np.round(np.log2(np.maximum(centimetres, 1))), 0, 15)
    out["cpStdev"] = 15  # no phase is simulated: it only follows the code
    out["doStdev"] = 7
    out["trkStat"] = PSEUDORANGE_VALID
    return out


def _sfrbx(sending: Sending) -> Sent:
    words: Ints = sending.words.astype(np.int64)
    out = np.zeros(len(words), np.dtype([*TYPES[SFRBX][1].descr, ("word", "<u4", (words.shape[1],))]))
    out["gnssId"], out["svId"] = _GNSS_ID[sending.system], sending.number
    out["freqId"] = sending.channel + 7
    out["sigId"] = sending.signal
    out["numWords"], out["version"], out["word"] = words.shape[1], 2, words
    return unix_from_gps(sending.sent_s), frames(0x02, 0x13, out)


SENSOR_RATE_HZ = 10.0
"""Of ESF-MEAS."""
_NAV_DELAY_S = 0.06
"""From an epoch to its messages, as ``_ESF_DELAY_S`` from a sample to its own."""
_ESF_DELAY_S = 0.012
_UNKNOWN_ACCURACY = 0xFFFFFFFF

PVT = np.dtype([*TYPES["NAV-PVT"][1].descr, ("headVeh", "<i4"), ("magDec", "<i2"), ("magAcc", "<u2")])
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
    gps_ms = np.round(gps_from_unix(drive.time_s) * 1000).astype(np.int64)
    return (gps_ms % (WEEK_S * 1000)).astype("<u4")


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
    out["hour"], out["min"], out["sec"] = zip(*((c.hour, c.minute, c.second) for c in clock), strict=True)
    out["year"], out["month"], out["day"] = zip(*((c.year, c.month, c.day) for c in clock), strict=True)
    out["nano"] = _scaled(np.round(time_s - whole_s, 3), 1e9)
    out["valid"] = 0x07
    out["tAcc"] = 25


def _att(drive: SimulatedDrive) -> NDArray[Any]:
    imu = drive.inertial
    out = np.zeros(len(imu.roll_rad), TYPES["NAV-ATT"][1])
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
