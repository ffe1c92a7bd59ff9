"""Positions of receivers before NAV-PVT (u-blox 4 to 7): several messages an epoch, put together as if they were one.

NAV-POSLLH has the position, NAV-VELNED the velocity, NAV-SOL or NAV-STATUS whether there is a fix, NAV-SOL the week of
the GPS. What belongs together has the same time of week and stands side by side in the stream.

Source: u-blox 6 receiver description including protocol specification (GPS.G6-SW-10018).
"""

from __future__ import annotations

import numpy as np

from fusion.formats.base import MAX_TIME_S
from fusion.formats.receiver.ubx_messages import TYPES, Records
from fusion.signals import GPS_EPOCH_S, WEEK_S, unix_from_gps
from fusion.types import Floats, Ints

POSITION, VELOCITY, SOLUTION, STATUS = "NAV-POSLLH", "NAV-VELNED", "NAV-SOL", "NAV-STATUS"
NO_POSITIONS = (VELOCITY, SOLUTION, STATUS)
"""Of no use without the first."""
FIX_3D, FIX_OK = 3, 1
WEEK_AND_TIME_SET = 0x0C
WORST_UNSTATED_MM = 1_000_000
"""Where no message says whether there is a fix, positions that are good to a kilometre at best are none."""

Messages = dict[str, tuple[Records, Ints]]

_FLOATS = ("velN", "velE", "velD", "sAcc")
_EPOCH = np.dtype([
    (name, "<f8" if name in _FLOATS else TYPES["NAV-PVT"][1].fields[name][0])  # type: ignore[index]
    for name in TYPES["NAV-PVT"][1].names or ()
])  # fmt: skip
"""NAV-PVT with velocities that may be unknown (NaN)."""


def epochs(messages: Messages) -> tuple[Records, Ints] | None:
    """Records with the fields and units of NAV-PVT, without a date, and byte offsets; None where there are none."""
    if POSITION not in messages:
        return None
    place, offset = messages[POSITION]
    out = np.zeros(len(place), _EPOCH)
    for name in ("iTOW", "lon", "lat", "height", "hMSL", "hAcc", "vAcc"):
        out[name] = place[name]
    for name in _FLOATS:
        out[name] = np.nan
    out["fixType"] = np.where(place["hAcc"] < WORST_UNSTATED_MM, FIX_3D, 0)
    out["flags"] = FIX_OK
    for name in (STATUS, SOLUTION):  # where both are there, the latter counts
        if name in messages:
            here, there = _same_epoch(place["iTOW"], offset, *messages[name])
            records = messages[name][0]
            out["fixType"][here] = records["gpsFix"][there]
            out["flags"][here] = records["flags"][there] & FIX_OK
    if VELOCITY in messages:
        here, there = _same_epoch(place["iTOW"], offset, *messages[VELOCITY])
        records = messages[VELOCITY][0]
        for name in _FLOATS:
            out[name][here] = records[name][there] * 10.0  # cm/s
    return out, offset


def _same_epoch(itow: Ints, offset: Ints, records: Records, at: Ints) -> tuple[Ints, Ints]:
    """(which positions have, which of the records is) the record of the same epoch, just before or behind."""
    behind = np.searchsorted(at, offset)
    row = np.full(len(itow), -1)
    for candidate in (behind, behind - 1):
        k = np.clip(candidate, 0, len(at) - 1)
        row = np.where((row < 0) & (records["iTOW"][k] == itow), k, row)
    here = np.flatnonzero(row >= 0)
    return here, row[here]


def week_utc_seconds(records: Records) -> Floats:
    """Unix seconds of NAV-SOL by its week and the leap seconds of that date; NaN where week or time are not set."""
    gps_s = records["week"] * WEEK_S + records["iTOW"] * 1e-3
    time_set = (records["flags"] & WEEK_AND_TIME_SET == WEEK_AND_TIME_SET) & (records["week"] > 0)
    return np.where(time_set & (gps_s + GPS_EPOCH_S < MAX_TIME_S), unix_from_gps(gps_s), np.nan)
