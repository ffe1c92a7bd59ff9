"""Raw signals and ephemerides as the bytes of a u-blox F9: RXM-RAWX (version 1), and RXM-SFRBX as satellites send them.

Every satellite that is measured sends its whole ephemeris in each frame of 30 s, the one whose reference time is
nearest. What a receiver only states in steps is rounded: C/N0 to 1 dB-Hz, the sigma to a power of two of 1 cm.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fusion.formats.receiver.ubx_messages import TYPES
from fusion.formats.receiver.ubx_raw import (
    GLONASS_STEP_HZ,
    L1_HZ,
    LEAP_KNOWN,
    MEASUREMENT,
    PSEUDORANGE_VALID,
    RAWX,
    SYSTEM_OF,
)
from fusion.formats.receiver.ubx_subframes import SFRBX
from fusion.signals import GLONASS, GPS_EPOCH_S, LIGHT_MPS, WEEK_S, RawGnss, Signals, unix_from_gps
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
    channel = np.round((signals.frequency_hz - L1_HZ[GLONASS]) / GLONASS_STEP_HZ)
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
