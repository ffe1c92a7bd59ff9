"""RXM-SFRBX: navigation messages as the receiver hands them on, sorted by kind and read as ephemerides.

Source: u-blox 8 / M8 receiver description and F9 interface description, UBX-RXM-SFRBX; F9 integration manual,
"Navigation data subframes": words of 30 bits stand in the lower bits of 32, those of Galileo and GLONASS fill them from
the top. The receiver hands on only what passed its parity checks.
"""

from __future__ import annotations

import numpy as np

from fusion.formats.base import Notes, Place
from fusion.formats.receiver.subframes import beidou, glonass, inav, lnav
from fusion.formats.receiver.subframes.bits import Pages, bits_of
from fusion.formats.receiver.time_tags import Marks, nearest_offset
from fusion.formats.receiver.ubx_messages import Records, gather
from fusion.formats.receiver.ubx_navigation import Stream, utc_evidence
from fusion.formats.receiver.ubx_raw import LAST_NUMBER, RAWX, SYSTEM_OF, read_signals
from fusion.signals import (
    BEIDOU,
    GALILEO,
    GLONASS,
    GPS,
    QZSS,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
    RawGnss,
    Signals,
    gps_from_unix,
)
from fusion.types import Bools, Ints

SFRBX = "RXM-SFRBX"
WRONG_LENGTH = "RXM-SFRBX messages whose number of words does not fit their length"
UNKNOWN_SATELLITE = "RXM-SFRBX messages of an unknown satellite"
IMPOSSIBLE = "broadcast ephemerides with impossible values"
NO_EPOCH = "RXM-SFRBX messages without any epoch that tells the week"
_WORDS = {GPS: 10, QZSS: 10, GALILEO: 8, BEIDOU: 10, GLONASS: 4}
_FEWEST_WORDS = [_WORDS.get(system, 0) for system in range(6)] + [0]
"""By system; the last for those that are not read."""
_SIGNALS = {GPS: (0,), QZSS: (0,), GALILEO: (0, 1), BEIDOU: (0, 1, 2, 3), GLONASS: (0, 2)}
"""Signal numbers whose messages are of the kinds read here: L1 C/A, E1, B1I and B2I, L1 and L2."""
_ROOT_A = (4000.0, 8000.0)
"""m^0.5: orbits between 16,000 and 64,000 km; navigation satellites have 25,500 to 42,200 km."""
_MOST_ECCENTRIC = 0.3
"""QZSS has 0.1, two Galileo satellites in a wrong orbit 0.16."""
_GLONASS_RADIUS_M = (2.4e7, 2.7e7)


def read_raw(stream: Stream, notes: Notes, place: Place) -> RawGnss | None:
    """Measurements and ephemerides of a stream; None where it has neither."""
    signals, navigation = Signals.empty(), Navigation()
    if RAWX in stream.messages:
        signals = read_signals(stream.data, stream.frames, *stream.messages[RAWX], notes, place)
    if SFRBX in stream.messages:
        evidence = utc_evidence(stream)
        sure = evidence.take(evidence.trust > 1)
        sure = sure.take(np.argsort(sure.offset, kind="stable"))
        navigation = read_subframes(stream, Marks(sure.offset, sure.utc_s), notes)
    return RawGnss(signals, navigation) if len(signals) or len(navigation) else None


def read_subframes(stream: Stream, marks: Marks, notes: Notes) -> Navigation:
    """What all RXM-SFRBX messages say; ``marks`` (UTC) tell about when each was sent, and so which week it was."""
    records, offset = stream.messages[SFRBX]
    if not len(marks.time_s):
        notes.skip(NO_EPOCH, len(records))
        return Navigation()
    readable = _readable(stream, records, offset, notes)
    records, offset = records[readable], offset[readable]
    system, number = SYSTEM_OF[records["gnssId"]], records["svId"].astype(np.int64)
    near_s = gps_from_unix(marks.time_s[nearest_offset(marks.offset, offset)])

    def pages(kind: int) -> Pages:
        mine = (system == kind) & np.isin(records["sigId"], _SIGNALS[kind])
        words = np.dtype([("word", "<u4", (_WORDS[kind],))])
        content = gather(stream.data, offset[mine] + 6 + records.itemsize, words)["word"]
        used = 32 if kind in (GALILEO, GLONASS) else 30
        channel = records["freqId"][mine].astype(np.int64) - 7
        return Pages(number[mine], bits_of(content, used), near_s[mine], channel)

    gps, klobuchar = lnav.read_lnav(pages(GPS), GPS, notes)
    kepler = gps.joined(lnav.read_lnav(pages(QZSS), QZSS, notes)[0])
    kepler = kepler.joined(inav.read_inav(pages(GALILEO), notes))
    kepler = kepler.joined(beidou.read_beidou(pages(BEIDOU), notes))
    states = _possible(glonass.read_strings(pages(GLONASS), notes), notes)
    return Navigation(_sound_and_once(kepler, notes), states, klobuchar)


def _readable(stream: Stream, records: Records, offset: Ints, notes: Notes) -> Bools:
    """Which messages are whole, and of a satellite whose system is read here; wrong ones are counted."""
    words = records["numWords"].astype(np.int64)
    length = stream.frames.length[np.searchsorted(stream.frames.start, offset)]
    system, number = SYSTEM_OF[records["gnssId"]], records["svId"].astype(np.int64)
    complete = (length == records.itemsize + 4 * words) & (words >= np.array(_FEWEST_WORDS)[system])
    numbered = (number > 0) & (number <= LAST_NUMBER[system])
    faults = ((WRONG_LENGTH, ~complete), (UNKNOWN_SATELLITE, (system >= 0) & ~numbered))
    return np.asarray(notes.sift(faults) & (system >= 0))


def _possible(states: GlonassEphemerides, notes: Notes) -> GlonassEphemerides:
    apart = np.linalg.norm(states.position_m, axis=1)
    possible = (apart > _GLONASS_RADIUS_M[0]) & (apart < _GLONASS_RADIUS_M[1])
    possible &= (states.channel >= -7) & (states.channel <= 6)
    return states.take(notes.sift(((IMPOSSIBLE, ~possible),)))


def _sound_and_once(kepler: KeplerEphemerides, notes: Notes) -> KeplerEphemerides:
    """The possible orbits, each the first time that it was sent, in the order of sending."""
    possible = (kepler.root_a > _ROOT_A[0]) & (kepler.root_a < _ROOT_A[1])
    possible &= kepler.eccentricity < _MOST_ECCENTRIC
    kepler = kepler.take(notes.sift(((IMPOSSIBLE, ~possible),)))
    kepler = kepler.take(np.argsort(kepler.sent_s, kind="stable"))
    columns = [column for name, column in vars(kepler).items() if name != "sent_s"]
    table = np.column_stack([np.nan_to_num(column.astype(float)) for column in columns])
    return kepler.take(np.sort(np.unique(table, axis=0, return_index=True)[1]))
