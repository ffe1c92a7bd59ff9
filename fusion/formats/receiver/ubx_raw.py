"""RXM-RAWX: pseudoranges, Doppler and C/N0 of every satellite as ``Signals``, read in bulk.

Source: u-blox 8 / M8 receiver description (version 0: no signal number, L1 alone) and F9 interface description
(version 1), UBX-RXM-RAWX, and their tables of GNSS, satellite and signal numbers. SBAS and other bands are left out.
"""

from __future__ import annotations

import numpy as np

from fusion.formats.base import MAX_TIME_S, Data, Notes, Place, is_possible_time
from fusion.formats.receiver.time_tags import Marks
from fusion.formats.receiver.ubx_frames import Frames
from fusion.formats.receiver.ubx_messages import TYPES, Records, gather
from fusion.messages import say
from fusion.signals import (
    BEIDOU,
    CARRIER_HZ,
    GALILEO,
    GLONASS,
    GLONASS_STEP_HZ,
    GPS,
    GPS_EPOCH_S,
    LIGHT_MPS,
    QZSS,
    WEEK_S,
    Signals,
    unix_from_gps,
)
from fusion.types import Bools, Floats, Ints

RAWX = "RXM-RAWX"
SYSTEM_OF = np.full(256, -1, np.int64)
"""The system of each u-blox gnssId; -1 for those that are not read."""
SYSTEM_OF[[0, 2, 3, 5, 6]] = [GPS, GALILEO, BEIDOU, QZSS, GLONASS]
LAST_NUMBER = np.array([32, 32, 36, 63, 10, -1])
"""The highest satellite number by system; an index of -1 meets that of SBAS."""
_L1_SIGNALS = {(GPS, 0), (GALILEO, 0), (GALILEO, 1), (BEIDOU, 0), (BEIDOU, 1), (QZSS, 0), (GLONASS, 0)}
"""(System, signal number): L1 C/A, E1 C and B, B1I D1 and D2, L1OF."""
_IS_L1 = np.zeros((6, 256), bool)
_IS_L1[tuple(zip(*_L1_SIGNALS, strict=True))] = True

MEASUREMENT = np.dtype(
    [("prMes", "<f8"), ("cpMes", "<f8"), ("doMes", "<f4"), ("gnssId", "u1"), ("svId", "u1"), ("sigId", "u1"),
     ("freqId", "u1"), ("locktime", "<u2"), ("cno", "u1"), ("prStdev", "u1"), ("cpStdev", "u1"), ("doStdev", "u1"),
     ("trkStat", "u1"), ("reserved", "u1")]
)  # fmt: skip
LEAP_KNOWN = 1
PSEUDORANGE_VALID = 1
_MOST_M = 1e9
"""Pseudoranges are 2e7 to 4.2e7 m and the receiver's clock; beyond 3 s of it the number is no measurement."""

WRONG_LENGTH = "RXM-RAWX messages whose number of measurements does not fit their length"
NO_WEEK = "RXM-RAWX epochs from before the receiver knew the week"
NO_TIME = "RXM-RAWX epochs at an impossible time"
NOT_VALID = "RXM-RAWX measurements whose pseudorange the receiver calls not valid"
NO_RANGE = "RXM-RAWX measurements with an impossible pseudorange"
NO_SATELLITE = "RXM-RAWX measurements of an impossible satellite or channel"
BACKWARDS = "RXM-RAWX epochs that go back in time"
REPEATED = "RXM-RAWX epochs at the time of another"


def utc_of(records: Records) -> Floats:
    """Unix seconds of the epochs by the receiver's leap seconds where it knows them; NaN without week or time."""
    gps_s = _gps_s(records)
    stated_s = GPS_EPOCH_S + gps_s - records["leapS"]
    return np.where(records["recStat"] & LEAP_KNOWN == 1, stated_s, unix_from_gps(gps_s))


def _gps_s(records: Records) -> Floats:
    tow_s, week = records["rcvTow"].astype(float), records["week"].astype(float)
    gps_s = np.where((week > 0) & (tow_s >= 0) & (tow_s < WEEK_S), week * WEEK_S + tow_s, np.nan)
    return np.where(gps_s + GPS_EPOCH_S < MAX_TIME_S, gps_s, np.nan)


def epoch_marks(records: Records, offset: Ints) -> Marks:
    """Where in the file which time (UTC) was, by the epochs that have one."""
    utc_s = utc_of(records)
    possible = is_possible_time(utc_s)
    return Marks(offset[possible], utc_s[possible])


def read_signals(
    data: Data, frames: Frames, records: Records, offset: Ints, notes: Notes, place: Place
) -> Signals:
    """The measurements of all epochs; ``records`` and ``offset`` are those of the messages' heads."""
    records, offset = _usable(records, offset, frames, notes, place)
    gps_s = _gps_s(records)
    back = np.flatnonzero(np.diff(gps_s) < 0)
    if len(back):
        example = say("receiver.restarted", place=place(int(offset[back[0] + 1])))
        notes.repaired[BACKWARDS] += len(back)
        notes.warn(say("receiver.backwards", what=BACKWARDS, n=len(back), example=example))
    repeated = len(gps_s) - len(np.unique(gps_s))
    if repeated:
        notes.repaired[REPEATED] += repeated
    count = records["numMeas"].astype(np.int64)
    ordinal = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    head_bytes = 6 + TYPES[RAWX][1].itemsize
    rows = gather(data, np.repeat(offset + head_bytes, count) + MEASUREMENT.itemsize * ordinal, MEASUREMENT)
    signal = np.where(np.repeat(records["version"] == 0, count), 0, rows["sigId"])
    system = SYSTEM_OF[rows["gnssId"]]
    on_l1 = (system >= 0) & _IS_L1[system, signal]
    rows, system, gps_s = rows[on_l1], system[on_l1], np.repeat(gps_s, count)[on_l1]
    good = _sound(rows, system, notes)
    return _assemble(rows[good], system[good], gps_s[good])


def _usable(
    records: Records, offset: Ints, frames: Frames, notes: Notes, place: Place
) -> tuple[Records, Ints]:
    """Complete messages at a possible time; the others are counted."""
    length = frames.length[np.searchsorted(frames.start, offset)]
    complete = length == TYPES[RAWX][1].itemsize + MEASUREMENT.itemsize * records["numMeas"].astype(np.int64)
    faults = (
        (WRONG_LENGTH, ~complete),
        (NO_WEEK, records["week"] == 0),
        (NO_TIME, np.isnan(_gps_s(records))),
    )
    good = notes.sift(
        faults,
        lambda row: say("receiver.week", place=place(int(offset[row])), week=int(records["week"][row])),
        position=True,
    )
    return records[good], offset[good]


def _sound(rows: Records, system: Ints, notes: Notes) -> Bools:
    """Measurements that can be true, counting the others."""
    number, range_m = rows["svId"].astype(np.int64), rows["prMes"]
    numbered = (number > 0) & (number <= LAST_NUMBER[system])
    numbered &= (system != GLONASS) | (rows["freqId"] <= 13)
    possible = (range_m > 0) & (range_m < _MOST_M)
    valid = rows["trkStat"] & PSEUDORANGE_VALID == 1
    return notes.sift(((NO_SATELLITE, ~numbered), (NOT_VALID, ~valid), (NO_RANGE, ~possible)))


def _assemble(rows: Records, system: Ints, gps_s: Floats) -> Signals:
    step = np.where(system == GLONASS, GLONASS_STEP_HZ * (rows["freqId"].astype(float) - 7), 0.0)
    frequency_hz = CARRIER_HZ[system] + step
    doppler_hz = rows["doMes"].astype(float)
    doppler_hz[~(np.abs(doppler_hz) < 1e6)] = np.nan
    cn0 = rows["cno"].astype(float)
    return Signals.assemble(
        gps_s,
        system,
        rows["svId"].astype(np.int64),
        pseudorange_m=rows["prMes"],
        range_rate_mps=-LIGHT_MPS / frequency_hz * doppler_hz,
        cn0_dbhz=np.where(cn0 > 0, cn0, np.nan),
        sigma_m=0.01 * np.exp2((rows["prStdev"] & 0x0F).astype(float)),
        frequency_hz=frequency_hz,
    )
