"""u-center's text dump of UBX messages, laid out as in the thesis's annex B.3 (figures B.3 to B.7)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

from fusion.formats.receiver.ubx_frames import find_frames, fletcher

GPS_EPOCH_S, WEEK_S = 315_964_800, 604_800
_SENSORS = {
    16: ("Accelerometer X", 2**-10), 17: ("Accelerometer Y", 2**-10), 18: ("Accelerometer Z", 2**-10),
    14: ("Gyroscope X", 2**-12), 13: ("Gyroscope Y", 2**-12), 5: ("Gyroscope Z", 2**-12),
    12: ("Gyroscope Temp", 1e-2),
}  # fmt: skip


def ucenter_listing(ubx: bytes, time_s: float, leap_s: int) -> str:
    """The listing of NAV-PVT, NAV-ATT, NAV-EOE and ESF-MEAS messages, dated by one NAV-TIMEGPS at ``time_s``."""
    week, second = divmod(round(time_s) - GPS_EPOCH_S + leap_s, WEEK_S)
    blocks = [f"NAV-TIMEGPS {second * 1000} 0 {week} {leap_s} 7"]
    frames = find_frames(ubx)
    for start, length, kind in zip(frames.start, frames.length, frames.kind, strict=True):
        payload = ubx[start + 6 : start + 6 + length]
        lines = {0x0107: _pvt, 0x0105: _att, 0x0161: _eoe, 0x1002: _meas}[int(kind)](payload)
        name = {0x0107: "NAV-PVT", 0x0105: "NAV-ATT", 0x0161: "NAV-EOE", 0x1002: "ESF-MEAS"}[int(kind)]
        sums = " ".join(f"{b:02X}" for b in fletcher(ubx[start + 2 : start + 6 + length]))
        head = f"{kind >> 8:02X} {kind & 255:02X} {name:<10} - {sums} : {sums} {length + 8}"
        blocks.append("\r\n".join([head, *lines]))
    return "\r\n-----\r\n".join(["", *blocks, ""])


def _pvt(payload: bytes) -> Iterator[str]:
    itow, nano, fix, satellites = (
        *struct.unpack_from("<I", payload, 0), *struct.unpack_from("<i", payload, 16), payload[20], payload[23]
    )  # fmt: skip
    place, motion = struct.unpack_from("<4i2I", payload, 24), struct.unpack_from("<5i2I", payload, 48)
    yield f"NAV-PVT {itow} {nano:10d} {fix}"
    yield "    " + " ".join(f"{value:10d}" for value in place)
    yield "    " + " ".join(f"{value:8d}" for value in motion)
    yield f"    {struct.unpack_from('<H', payload, 76)[0] / 100:.2f} {satellites}"
    yield f"TOW:{itow / 1e3 + nano * 1e-9:.9f}"
    yield "3-D Fix" if fix == 3 else "No Fix"
    yield f"LLH: {place[0] * 1e-7:12.7f} {place[1] * 1e-7:12.7f} {place[2] / 1e3:9.3f} {place[3] / 1e3:9.3f}"


def _att(payload: bytes) -> Iterator[str]:
    itow, version = struct.unpack_from("<IB", payload)
    angles, accuracies = struct.unpack_from("<3i", payload, 8), struct.unpack_from("<3I", payload, 20)
    yield f"NAV-ATT {itow} {version}"
    yield "    " + " ".join(f"{value:9d}" for value in angles)
    yield "    " + " ".join(f"{value:9d}" for value in accuracies)
    yield f"TOW:{itow / 1e3:.3f}"
    yield "    " + " ".join(f"{value * 1e-5:10.5f}" for value in angles)


def _eoe(payload: bytes) -> Iterator[str]:
    yield f"NAV-EOE {struct.unpack('<I', payload)[0]}"


def _meas(payload: bytes) -> Iterator[str]:
    tag, flags, sensor = struct.unpack_from("<IHH", payload)
    yield f"ESF-MEAS {tag:12d} TTAG: {tag / 1e3:9.3f} FLAGS:{flags:04X} ID:{sensor:04X}"
    yield "Time Mark Signal : None"
    yield "Time Mark Edge  : Rising"
    yield ""
    for (word,) in struct.iter_unpack("<I", payload[8:]):
        name, scale = _SENSORS[word >> 24 & 63]
        value = word & 0xFFFFFF
        yield f"    {word >> 24 & 63} {name:<18} {value:06X} {(value - (value >> 23 << 24)) * scale:10.3f}"
    yield ""
    yield f"    {tag} {tag / 1e3:9.3f} timetag  (Sensor Time Tag)"
