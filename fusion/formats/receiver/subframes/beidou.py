"""BeiDou B1I messages: D1 (satellites in middle and inclined orbits) and D2 (geostationary ones) as ephemerides.

Source: BeiDou SIS ICD, open service signal B1I 3.0, sections 5.2 (D1), 5.3 (D2; subframe 1 alone, in ten pages) and
their figures. Bits are numbered 1 to 300 within a subframe, parity among them. Times are BeiDou's, 14 s behind GPS.
No issue stands in every part, so only parts of one frame are put together.
"""

from __future__ import annotations

import numpy as np

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import bits
from fusion.formats.receiver.subframes.bits import SEMICIRCLE, Layout, Pages, count, signed
from fusion.signals import BEIDOU, BEIDOU_LATE_S, BEIDOU_WEEK_0, WEEK_S, KeplerEphemerides
from fusion.types import Bools, Floats, Ints

PREAMBLE = 0b11100010010
BITS = 300
SUBFRAME_S = 6.0
D2_SUBFRAME_S, PAGE_S = 0.6, 3.0
"""How long a subframe of D2 lasts, and from one page of its subframe 1 to the next."""
NO_HEAD = "BeiDou subframes without preamble, number or time"

HEAD: Layout = {"preamble": count((1, 11)), "subframe": count((16, 3)), "sow": count((19, 8), (31, 12))}
PAGE = count((43, 4))
_ANGLE, _RATE, _HARMONIC = SEMICIRCLE * 2.0**-31, SEMICIRCLE * 2.0**-43, 2.0**-31
D1: dict[int, Layout] = {
    1: {
        "health": count((43, 1)),
        "accuracy_index": count((49, 4)),
        "week": count((61, 13)),
        "toc": count((74, 9), (91, 8), scale=8.0),
        "group_delay_s": signed((99, 10), scale=1e-10),
        "af2_per_s": signed((215, 11), scale=2.0**-66),
        "af0_s": signed((226, 7), (241, 17), scale=2.0**-33),
        "af1": signed((258, 5), (271, 17), scale=2.0**-50),
        "issue": count((288, 5)),
    },
    2: {
        "delta_n_radps": signed((43, 10), (61, 6), scale=_RATE),
        "cuc_rad": signed((67, 16), (91, 2), scale=_HARMONIC),
        "m0_rad": signed((93, 20), (121, 12), scale=_ANGLE),
        "eccentricity": count((133, 10), (151, 22), scale=2.0**-33),
        "cus_rad": signed((181, 18), scale=_HARMONIC),
        "crc_m": signed((199, 4), (211, 14), scale=2.0**-6),
        "crs_m": signed((225, 8), (241, 10), scale=2.0**-6),
        "root_a": count((251, 12), (271, 20), scale=2.0**-19),
        "toe_high": count((291, 2), scale=8.0 * 2**15),
    },
    3: {
        "toe_low": count((43, 10), (61, 5), scale=8.0),
        "i0_rad": signed((66, 17), (91, 15), scale=_ANGLE),
        "cic_rad": signed((106, 7), (121, 11), scale=_HARMONIC),
        "omega_dot_radps": signed((132, 11), (151, 13), scale=_RATE),
        "cis_rad": signed((164, 9), (181, 9), scale=_HARMONIC),
        "i_dot_radps": signed((190, 13), (211, 1), scale=_RATE),
        "omega0_rad": signed((212, 21), (241, 11), scale=_ANGLE),
        "omega_rad": signed((252, 11), (271, 21), scale=_ANGLE),
    },
}
# What two pages share stands here once: its columns follow those of page 1, so that the pages are read side by side.
_P = {page: BITS * (page - 1) for page in range(1, 11)}
D2: Layout = {
    "health": count((47, 1)),
    "accuracy_index": count((61, 4)),
    "week": count((65, 13)),
    "toc": count((78, 5), (91, 12), scale=8.0),
    "group_delay_s": signed((103, 10), scale=1e-10),
    "af0_s": signed((_P[3] + 101, 12), (_P[3] + 121, 12), scale=2.0**-33),
    "af1": signed((_P[3] + 133, 4), (_P[4] + 47, 6), (_P[4] + 61, 12), scale=2.0**-50),
    "af2_per_s": signed((_P[4] + 73, 10), (_P[4] + 91, 1), scale=2.0**-66),
    "issue": count((_P[4] + 92, 5)),
    "delta_n_radps": signed((_P[4] + 97, 16), scale=_RATE),
    "cuc_rad": signed((_P[4] + 121, 14), (_P[5] + 47, 4), scale=_HARMONIC),
    "m0_rad": signed((_P[5] + 51, 2), (_P[5] + 61, 22), (_P[5] + 91, 8), scale=_ANGLE),
    "cus_rad": signed((_P[5] + 99, 14), (_P[5] + 121, 4), scale=_HARMONIC),
    "eccentricity": count((_P[5] + 125, 10), (_P[6] + 47, 6), (_P[6] + 61, 16), scale=2.0**-33),
    "root_a": count((_P[6] + 77, 6), (_P[6] + 91, 22), (_P[6] + 121, 4), scale=2.0**-19),
    "cic_rad": signed((_P[6] + 125, 10), (_P[7] + 47, 6), (_P[7] + 61, 2), scale=_HARMONIC),
    "cis_rad": signed((_P[7] + 63, 18), scale=_HARMONIC),
    "toe": count((_P[7] + 81, 2), (_P[7] + 91, 15), scale=8.0),
    "i0_rad": signed((_P[7] + 106, 7), (_P[7] + 121, 14), (_P[8] + 47, 6), (_P[8] + 61, 5), scale=_ANGLE),
    "crc_m": signed((_P[8] + 66, 17), (_P[8] + 91, 1), scale=2.0**-6),
    "crs_m": signed((_P[8] + 92, 18), scale=2.0**-6),
    "omega_dot_radps": signed((_P[8] + 110, 3), (_P[8] + 121, 16), (_P[9] + 47, 5), scale=_RATE),
    "omega0_rad": signed((_P[9] + 52, 1), (_P[9] + 61, 22), (_P[9] + 91, 9), scale=_ANGLE),
    "omega_rad": signed((_P[9] + 100, 13), (_P[9] + 121, 14), (_P[10] + 47, 5), scale=_ANGLE),
    "i_dot_radps": signed((_P[10] + 52, 1), (_P[10] + 61, 13), scale=_RATE),
}
_D2_PAGES = (1, 3, 4, 5, 6, 7, 8, 9, 10)
"""Page 2 holds the ionosphere."""


def geostationary(number: Ints) -> Bools:
    """Which satellites send D2 (ICD, table 4-1)."""
    return np.asarray((number <= 5) | (number >= 59))


def read_beidou(pages: Pages, notes: Notes) -> KeplerEphemerides:
    """Ephemerides of subframes of both kinds, by the satellite's orbit."""
    far = geostationary(pages.number)
    return _read_d1(pages.take(~far), notes).joined(_read_d2(pages.take(far), notes))


def _read_d1(pages: Pages, notes: Notes) -> KeplerEphemerides:
    """Ephemerides of subframes 1 to 3."""
    pages, sent_s, subframe = _dated(pages, notes)
    orbit = subframe < 4
    pages, sent_s, subframe = pages.take(orbit), sent_s[orbit], subframe[orbit]
    frame = (sent_s - SUBFRAME_S * (subframe - 1)).astype(np.int64)
    rows = bits.complete_sets(pages.number, subframe, frame, sent_s, (1, 2, 3), 5 * SUBFRAME_S, notes)
    values = bits.read_sets(pages.bits, rows, D1.values())
    values["toe"] = values["toe_high"] + values["toe_low"]
    return _ephemerides(values, pages.number[rows[:, 0]], sent_s[rows[:, 0]], notes)


def _read_d2(pages: Pages, notes: Notes) -> KeplerEphemerides:
    """Ephemerides of the pages of subframe 1."""
    pages, sent_s, subframe = _dated(pages, notes)
    page = bits.numbers(pages.bits, PAGE)
    orbit = (subframe == 1) & np.isin(page, _D2_PAGES)
    pages, sent_s, page = pages.take(orbit), sent_s[orbit], page[orbit]
    frame = (sent_s - PAGE_S * (page - 1)).astype(np.int64)
    rows = bits.complete_sets(pages.number, page, frame, sent_s, _D2_PAGES, 10 * PAGE_S, notes)
    rows = np.insert(rows, 1, rows[:, 0], axis=1)  # in the place of page 2, which nothing is read from
    values = bits.read(pages.bits[rows].reshape(len(rows), 10 * BITS), D2)
    return _ephemerides(values, pages.number[rows[:, 0]], sent_s[rows[:, 0]], notes)


def _dated(pages: Pages, notes: Notes) -> tuple[Pages, Floats, Ints]:
    """The sound subframes, when they were sent (GPS seconds), and which they are."""
    head = bits.read(pages.bits, HEAD)
    own_s = np.where(head["sow"] < WEEK_S, head["sow"] + BEIDOU_LATE_S, np.nan)
    return bits.dated(pages, head, PREAMBLE, own_s, NO_HEAD, notes)


def _ephemerides(values: dict[str, Floats], number: Ints, sent_s: Floats, notes: Notes) -> KeplerEphemerides:
    week = np.floor((sent_s - BEIDOU_LATE_S) / WEEK_S) - BEIDOU_WEEK_0
    values["healthy"] = values["health"] == 0
    values["accuracy_m"] = bits.user_range_accuracy_m(values["accuracy_index"])
    of_week = week % 8192 == values["week"]
    return bits.ephemerides(BEIDOU, number, sent_s, values, of_week, notes, late_s=BEIDOU_LATE_S)
