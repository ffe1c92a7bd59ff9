"""The UBX messages that are read, as numpy structured types, and decoding in bulk.

Sources: u-blox 6 and u-blox 8 / M8 receiver descriptions; F9 interface description; spec 1 section 9. A later message
is one more entry.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import Data
from fusion.formats.receiver.ubx_frames import Frames
from fusion.types import Ints

Records = NDArray[np.void]

_UTC = [("year", "<u2"), *((name, "u1") for name in ("month", "day", "hour", "min", "sec", "valid"))]
_PLACE = [("lon", "<i4"), ("lat", "<i4"), ("height", "<i4"), ("hMSL", "<i4")]
_ATTITUDE = [
    ("iTOW", "<u4"), ("version", "u1"), ("reserved", "V3"),
    ("roll", "<i4"), ("pitch", "<i4"), ("heading", "<i4"),
    ("accRoll", "<u4"), ("accPitch", "<u4"), ("accHeading", "<u4"),
]  # fmt: skip
_DYNAMICS = [
    ("valid", "<u4"), ("reserved", "V4"), ("iTOW", "<u4"),
    ("xAngRate", "<i4"), ("yAngRate", "<i4"), ("zAngRate", "<i4"),
    ("xAccel", "<i4"), ("yAccel", "<i4"), ("zAccel", "<i4"),
]  # fmt: skip

# kind (256 * class + id) -> the leading part of the payload; newer receivers append fields
TYPES: dict[str, tuple[int, np.dtype[Any]]] = {
    "NAV-PVT": (0x0107, np.dtype([
        ("iTOW", "<u4"), *_UTC, ("tAcc", "<u4"), ("nano", "<i4"),
        ("fixType", "u1"), ("flags", "u1"), ("flags2", "u1"), ("numSV", "u1"), *_PLACE,
        ("hAcc", "<u4"), ("vAcc", "<u4"), ("velN", "<i4"), ("velE", "<i4"), ("velD", "<i4"),
        ("gSpeed", "<i4"), ("headMot", "<i4"), ("sAcc", "<u4"), ("headAcc", "<u4"), ("pDOP", "<u2"),
        ("flags3", "<u2"), ("reserved", "V4"),
    ])),
    "NAV-POSLLH": (0x0102, np.dtype([("iTOW", "<u4"), *_PLACE, ("hAcc", "<u4"), ("vAcc", "<u4")])),
    "NAV-STATUS": (0x0103, np.dtype([
        ("iTOW", "<u4"), ("gpsFix", "u1"), ("flags", "u1"), ("fixStat", "u1"), ("flags2", "u1"),
        ("ttff", "<u4"), ("msss", "<u4"),
    ])),
    "NAV-SOL": (0x0106, np.dtype([
        ("iTOW", "<u4"), ("fTOW", "<i4"), ("week", "<i2"), ("gpsFix", "u1"), ("flags", "u1"), ("ecef", "<i4", (3,)),
        ("pAcc", "<u4"), ("ecefV", "<i4", (3,)), ("sAcc", "<u4"), ("pDOP", "<u2"), ("reserved", "u1"),
        ("numSV", "u1"), ("reserved2", "V4"),
    ])),
    "NAV-VELNED": (0x0112, np.dtype([
        ("iTOW", "<u4"), ("velN", "<i4"), ("velE", "<i4"), ("velD", "<i4"), ("speed", "<u4"), ("gSpeed", "<u4"),
        ("heading", "<i4"), ("sAcc", "<u4"), ("cAcc", "<u4"),
    ])),
    "NAV-ATT": (0x0105, np.dtype(_ATTITUDE)),
    "NAV-EOE": (0x0161, np.dtype([("iTOW", "<u4")])),
    "NAV-TIMEUTC": (0x0121, np.dtype([
        ("iTOW", "<u4"), ("tAcc", "<u4"), ("nano", "<i4"), *_UTC,
    ])),
    "NAV-TIMEGPS": (0x0120, np.dtype([
        ("iTOW", "<u4"), ("fTOW", "<i4"), ("week", "<i2"), ("leapS", "i1"), ("valid", "u1"), ("tAcc", "<u4"),
    ])),
    "HNR-PVT": (0x2800, np.dtype([
        ("iTOW", "<u4"), *_UTC, ("nano", "<i4"), ("fixType", "u1"), ("flags", "u1"), ("reserved", "V2"),
        *_PLACE, ("gSpeed", "<i4"), ("speed", "<i4"), ("headMot", "<i4"), ("headVeh", "<i4"),
        ("hAcc", "<u4"), ("vAcc", "<u4"), ("sAcc", "<u4"), ("headAcc", "<u4"), ("reserved2", "V4"),
    ])),
    "HNR-ATT": (0x2801, np.dtype(_ATTITUDE)),
    "HNR-INS": (0x2802, np.dtype(_DYNAMICS)),
    "RXM-RAWX": (0x0215, np.dtype([
        ("rcvTow", "<f8"), ("week", "<u2"), ("leapS", "i1"), ("numMeas", "u1"), ("recStat", "u1"),
        ("version", "u1"), ("reserved", "V2"),
    ])),
    "RXM-SFRBX": (0x0213, np.dtype([
        ("gnssId", "u1"), ("svId", "u1"), ("sigId", "u1"), ("freqId", "u1"), ("numWords", "u1"),
        ("chn", "u1"), ("version", "u1"), ("reserved", "u1"),
    ])),
}  # fmt: skip

ESF_MEAS = 0x1002
ESF_RAW = 0x1003
ESF_STATUS = 0x1010

_NAMES = {kind: name for name, (kind, _) in TYPES.items()}
_NAMES |= {
    ESF_MEAS: "ESF-MEAS",
    ESF_RAW: "ESF-RAW",
    ESF_STATUS: "ESF-STATUS",
    0x0135: "NAV-SAT",
    0x1015: "ESF-INS",
}


def kind_name(kind: int) -> str:
    """``NAV-PVT`` for 0x0107; class and id in hexadecimal for messages without a name here."""
    return _NAMES.get(kind, f"{kind >> 8:02X}-{kind & 255:02X}")


def decode(data: Data, frames: Frames, name: str) -> tuple[Records, Ints, int]:
    """All messages of one type: records (n,), byte offsets (n,), and how many were too short to read."""
    kind, dtype = TYPES[name]
    mine = frames.kind == kind
    complete = mine & (frames.length >= dtype.itemsize)
    start = frames.start[complete]
    return gather(data, start + 6, dtype), start, int(np.count_nonzero(mine) - len(start))


def gather(data: Data, offset: Ints, dtype: np.dtype[Any]) -> Records:
    """Records of one structured type from scattered byte offsets."""
    buf = np.frombuffer(data, np.uint8)
    raw = np.empty((len(offset), dtype.itemsize), np.uint8)
    for at in range(0, len(offset), 1 << 16):  # in pieces: the index array is eight times the data
        part = offset[at : at + (1 << 16)]
        raw[at : at + (1 << 16)] = buf[part[:, None] + np.arange(dtype.itemsize)]
    return raw.reshape(-1).view(dtype)


# 24 data bits of an ESF word: type -> (column, scale to SI)
DEG = np.pi / 180
ESF_DATA: dict[int, tuple[str, float]] = {
    16: ("acc_x_mps2", 2.0**-10),
    17: ("acc_y_mps2", 2.0**-10),
    18: ("acc_z_mps2", 2.0**-10),
    14: ("gyr_x_radps", 2.0**-12 * DEG),
    13: ("gyr_y_radps", 2.0**-12 * DEG),
    5: ("gyr_z_radps", 2.0**-12 * DEG),
    12: ("temperature_c", 1e-2),
    11: ("speed_mps", 1e-3),
}
WHEEL_TICKS = (6, 7, 8, 9, 10)


def signed_24(word: Ints) -> Ints:
    """The low 24 bits as a signed number: 0xFFFD7D is -643."""
    return ((word & 0xFFFFFF) ^ 0x800000) - 0x800000
