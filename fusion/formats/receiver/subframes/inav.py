"""Galileo I/NAV messages: word types 1 to 5 of nominal pages as ephemerides.

Source: Galileo OS SIS ICD 2.1, sections 4.3.2 (pages, CRC) and 4.3.5 (words), 5.1.9.1 (week 0 began in GPS week 1024),
5.1.12 (SISA). A page comes in two halves of 120 bits, each followed here by eight bits of padding.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import bits
from fusion.formats.receiver.subframes.bits import SEMICIRCLE, Bits, Layout, Pages, count, numbers, signed
from fusion.signals import GALILEO, WEEK_S, KeplerEphemerides
from fusion.types import Bools, Floats, Ints

BITS, WORD_BITS = 256, 128
WEEK_0 = 1024
"""GPS week of Galileo week 0."""
WRONG_CRC = "Galileo pages with a wrong checksum"
NO_PAGE = "Galileo pages that are no nominal pair of halves"
_SAME_ISSUE_S = 3600.0
_CRC_POLYNOMIAL = 0x1864CFB
_COVERED = [*range(114), *range(128, 210)]
"""Columns that the CRC is taken of: the halves without tail, the second up to the CRC."""
_CRC = count((211, 24))
_WORD = [*range(2, 114), *range(130, 146)]
"""Columns of the word's 128 bits."""
_HALVES = {
    "even": count((1, 1)),
    "even_alert": count((2, 1)),
    "odd": count((129, 1)),
    "odd_alert": count((130, 1)),
}

KIND = count((1, 6))
_ISSUE = count((7, 10))
PARTS: dict[int, Layout] = {
    1: {
        "issue": _ISSUE,
        "toe": count((17, 14), scale=60.0),
        "m0_rad": signed((31, 32), scale=SEMICIRCLE * 2.0**-31),
        "eccentricity": count((63, 32), scale=2.0**-33),
        "root_a": count((95, 32), scale=2.0**-19),
    },
    2: {
        "issue": _ISSUE,
        "omega0_rad": signed((17, 32), scale=SEMICIRCLE * 2.0**-31),
        "i0_rad": signed((49, 32), scale=SEMICIRCLE * 2.0**-31),
        "omega_rad": signed((81, 32), scale=SEMICIRCLE * 2.0**-31),
        "i_dot_radps": signed((113, 14), scale=SEMICIRCLE * 2.0**-43),
    },
    3: {
        "issue": _ISSUE,
        "omega_dot_radps": signed((17, 24), scale=SEMICIRCLE * 2.0**-43),
        "delta_n_radps": signed((41, 16), scale=SEMICIRCLE * 2.0**-43),
        "cuc_rad": signed((57, 16), scale=2.0**-29),
        "cus_rad": signed((73, 16), scale=2.0**-29),
        "crc_m": signed((89, 16), scale=2.0**-5),
        "crs_m": signed((105, 16), scale=2.0**-5),
        "accuracy_index": count((121, 8)),
    },
    4: {
        "issue": _ISSUE,
        "satellite": count((17, 6)),
        "cic_rad": signed((23, 16), scale=2.0**-29),
        "cis_rad": signed((39, 16), scale=2.0**-29),
        "toc": count((55, 14), scale=60.0),
        "af0_s": signed((69, 31), scale=2.0**-34),
        "af1": signed((100, 21), scale=2.0**-46),
        "af2_per_s": signed((121, 6), scale=2.0**-59),
    },
    5: {
        "group_delay_s": signed((58, 10), scale=2.0**-32),
        "health": count((70, 2)),
        "invalid": count((73, 1)),
        "week": count((74, 12)),
        "tow": count((86, 20)),
    },
}
"""Of word 5, the E1/E5b delay, and health and validity of E1-B."""


def read_inav(pages: Pages, notes: Notes) -> KeplerEphemerides:
    """Ephemerides of pages (n, 256 bits)."""
    pages = pages.take(_sound(pages.bits, notes))
    pages = Pages(pages.number, pages.bits[:, _WORD], pages.near_s, pages.channel)
    kind = numbers(pages.bits, KIND)
    orbit = (kind > 0) & (kind < 6)
    orbit &= (kind != 4) | (numbers(pages.bits, PARTS[4]["satellite"]) == pages.number)
    pages, kind = pages.take(orbit), kind[orbit]
    tow = numbers(pages.bits, PARTS[5]["tow"])
    sent_s = np.where(kind == 5, bits.nearest(pages.near_s, tow.astype(float), WEEK_S), pages.near_s)
    fits = bits.in_time(sent_s, pages.near_s, notes) & ((kind != 5) | (tow < WEEK_S))
    pages, kind, sent_s = pages.take(fits), kind[fits], sent_s[fits]
    health, invalid = (numbers(pages.bits, PARTS[5][name]) for name in ("health", "invalid"))
    status = np.where(kind == 5, 1 + 2 * health + invalid, 0)
    issue = np.where(kind == 5, -1, numbers(pages.bits, _ISSUE))
    rows = bits.complete_sets(pages.number, kind, issue, sent_s, tuple(PARTS), _SAME_ISSUE_S, notes, status)
    return _ephemerides(pages, rows, sent_s[rows[:, 4]], notes)


def _sound(pages: Bits, notes: Notes) -> Bools:
    """Which pages are a nominal pair of halves with the right CRC; the others are counted."""
    half = {name: numbers(pages, field) for name, field in _HALVES.items()}
    alert = (half["even_alert"] == 1) | (half["odd_alert"] == 1)
    pair = (half["even"] == 0) & (half["odd"] == 1) & ~alert
    return notes.sift(((NO_PAGE, ~pair), (WRONG_CRC, crc_24q(pages) != numbers(pages, _CRC))))


def crc_24q(pages: Bits) -> Ints:
    """The checksum of pages (n, 256): a sum modulo 2 of what each bit adds to it."""
    odd = (pages[:, _COVERED].astype(np.float32) @ _crc_of_each_bit()).astype(np.int64) & 1
    return np.asarray(odd @ (1 << np.arange(23, -1, -1)))


def pages_of(words: Bits) -> Bits:
    """Nominal pages (n, 256) that carry words (n, 128), checksum and all."""
    pages = np.zeros((len(words), BITS), np.uint8)
    pages[:, _WORD] = words
    bits.write(pages, {"half": _HALVES["odd"]}, {"half": np.ones(len(words))})
    bits.write(pages, {"crc": _CRC}, {"crc": crc_24q(pages).astype(float)})
    return pages


@cache
def _crc_of_each_bit() -> NDArray[np.float32]:
    """The CRC of a page of which one bit is set, for each bit that is covered: (196, 24)."""
    value, rows = _CRC_POLYNOMIAL & 0xFFFFFF, []  # the last bit's: x^24 modulo the polynomial
    for _ in _COVERED:
        rows.append([value >> k & 1 for k in range(23, -1, -1)])
        value <<= 1
        if value >> 24:
            value ^= _CRC_POLYNOMIAL
    return np.array(rows[::-1], np.float32)


def _ephemerides(pages: Pages, rows: Ints, sent_s: Floats, notes: Notes) -> KeplerEphemerides:
    values = bits.read_sets(pages.bits, rows, PARTS.values())
    of_week = (np.floor(sent_s / WEEK_S) - WEEK_0) % 4096 == values["week"]
    values["healthy"] = (values["health"] == 0) & (values["invalid"] == 0)
    values["accuracy_m"] = signal_accuracy_m(values["accuracy_index"])
    return bits.ephemerides(GALILEO, pages.number[rows[:, 0]], sent_s, values, of_week, notes)


def signal_accuracy_m(index: Floats) -> Floats:
    """Metres of a SISA index (n,); NaN where it makes no prediction (255) or is spare."""
    steps = [index < 50, index < 75, index < 100, index < 126]
    metres = [index * 0.01, 0.5 + (index - 50) * 0.02, 1 + (index - 75) * 0.04, 2 + (index - 100) * 0.16]
    return np.select(steps, metres, np.nan)
