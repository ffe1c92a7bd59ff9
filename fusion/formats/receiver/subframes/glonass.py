"""GLONASS navigation messages: strings 1 to 4 of a frame as states of satellites.

Source: GLONASS ICD 5.1 (L1, L2), sections 4.4 (contents), 4.7 (the Hamming code) and table 4.5. The document numbers
the 85 bits of a string from the last one sent, 85 being the first; here bit b is column 86 - b. The number of the
frame follows them, as receivers add it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import DAY_S, Notes
from fusion.formats.receiver.subframes import bits
from fusion.formats.receiver.subframes.bits import Bits, Field, Layout, Pages, count, magnitude
from fusion.signals import GLONASS_AHEAD_S, GlonassEphemerides, gps_from_unix, unix_from_gps
from fusion.types import Bools, Floats

STRING_BITS = 85
BITS = 128
WRONG_CODE = "GLONASS strings with a wrong checksum"
OTHER_SLOT = "GLONASS strings of another satellite than the receiver says"
_SAME_FRAME_S = 15.0
"""Strings 1 to 4 of a frame come within 8 s, those of two frames at least 24 s apart."""
QUARTER_S = 900.0
_FOUR_YEARS_DAYS = 1461
_DAY_0 = 9496
"""1996-01-01 in days since 1970: the first of the four-year intervals begins there."""


def _count(high: int, low: int, scale: float = 1.0) -> Field:
    """A count in bits ``high`` to ``low`` of the document."""
    return count((STRING_BITS + 1 - high, high - low + 1), scale=scale)


def _magnitude(high: int, low: int, scale: float) -> Field:
    return magnitude((STRING_BITS + 1 - high, high - low + 1), scale=scale)


def _axis() -> dict[str, Field]:
    """One axis: m/s, m/s2 and m."""
    return {
        "velocity": _magnitude(64, 41, 1e3 * 2.0**-20),
        "acceleration": _magnitude(40, 36, 1e3 * 2.0**-30),
        "position": _magnitude(35, 9, 1e3 * 2.0**-11),
    }


STRING = _count(84, 81)
FRAME = count((97, 32))
PARTS: dict[int, Layout] = {
    1: {"hour": _count(76, 72), "minute": _count(71, 66), "half": _count(65, 65), **_axis()},
    2: {"unhealthy": _count(80, 80), "quarter": _count(76, 70), **_axis()},
    3: {"clock_rate": _magnitude(79, 69, 2.0**-40), "unhealthy_too": _count(65, 65), **_axis()},
    4: {"delay": _magnitude(80, 59, 2.0**-30), "day": _count(26, 16), "slot": _count(15, 11)},
}


def read_strings(pages: Pages, notes: Notes) -> GlonassEphemerides:
    """States of strings (n, 128 bits): 85, padding to 96, and the frame's number."""
    wrong = (check_bits(pages.bits) != pages.bits[:, 77:85]).any(axis=1)
    pages = pages.take(notes.sift(((WRONG_CODE, wrong),)))
    string = bits.numbers(pages.bits, STRING)
    orbit = (string > 0) & (string < 5)
    pages, string = pages.take(orbit), string[orbit]
    frame = bits.numbers(pages.bits, FRAME)
    rows = bits.complete_sets(pages.number, string, frame, pages.near_s, (1, 2, 3, 4), _SAME_FRAME_S, notes)
    values = [bits.read(pages.bits[rows[:, k]], layout) for k, layout in enumerate(PARTS.values())]
    number, near_s = pages.number[rows[:, 0]], pages.near_s[rows[:, 0]]
    moscow_s, fits = _moscow(values, near_s, notes)
    slot = values[3]["slot"]
    same = (slot == number) | (slot == 0)  # satellites of the first generation send none
    notes.skip(OTHER_SLOT, int(np.count_nonzero(fits & ~same)))
    columns = {
        "number": number,
        "channel": pages.channel[rows[:, 0]],
        "toe_s": gps_from_unix(moscow_s - GLONASS_AHEAD_S),
        "healthy": (values[1]["unhealthy"] == 0) & (values[2]["unhealthy_too"] == 0),
        "clock_s": -values[3]["delay"],
        "clock_rate": values[2]["clock_rate"],
        **{
            f"{name}_{unit}": np.column_stack([axis[name] for axis in values[:3]])
            for name, unit in (("position", "m"), ("velocity", "mps"), ("acceleration", "mps2"))
        },
    }
    keep = np.flatnonzero(fits & same)
    states = np.column_stack(list(columns.values()))[keep]
    keep = keep[np.sort(np.unique(states, axis=0, return_index=True)[1])]  # each frame repeats the one before
    return GlonassEphemerides(**{name: column[keep] for name, column in columns.items()})


def _moscow(values: list[dict[str, Floats]], near_s: Floats, notes: Notes) -> tuple[Floats, Bools]:
    """The states' times in Moscow's Unix seconds, and which of them agree with the epochs and with their own date."""
    moscow_s = unix_from_gps(near_s) + GLONASS_AHEAD_S
    clock_s = 3600 * values[0]["hour"] + 60 * values[0]["minute"] + 30 * values[0]["half"]
    fits = bits.in_time(bits.nearest(moscow_s, clock_s, DAY_S), moscow_s, notes)
    state_s = bits.nearest(moscow_s, QUARTER_S * values[1]["quarter"], DAY_S)
    of_day = (values[3]["day"] == day_of_four_years(state_s)) & (values[1]["quarter"] < 96)
    notes.skip(bits.NOT_THEN, int(np.count_nonzero(fits & ~of_day)))
    return state_s, np.asarray(fits & of_day)


def day_of_four_years(moscow_s: Floats) -> Floats:
    """The number of the day within its four years, 1 to 1461, of Moscow's Unix seconds."""
    return np.asarray((np.floor(moscow_s / DAY_S) - _DAY_0) % _FOUR_YEARS_DAYS + 1)


@cache
def _checks() -> NDArray[np.int64]:
    """Which of bits 85 to 9 each of the check bits 1 to 7 adds up, (77, 7): the Hamming code of section 4.7.

    Bit 9 and the following ones take the places 3, 5, 6, 7, 9 ... that are no power of two.
    """
    places = np.array([p for p in range(3, 85) if p & (p - 1)])
    return (places[::-1, None] >> np.arange(7) & 1).astype(np.int64)


def check_bits(bits: Bits) -> Bits:
    """Check bits 8 to 1 (n, 8) of strings whose bits 85 to 9 stand in the first 77 columns."""
    data = bits[:, :77].astype(np.int64)
    seven = (data @ _checks() & 1)[:, ::-1]
    parity = (data.sum(axis=1) + seven.sum(axis=1)) & 1
    return np.column_stack([parity, seven]).astype(np.uint8)
