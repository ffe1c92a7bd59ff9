"""GPS and QZSS legacy navigation messages (LNAV): subframes 1 to 3 as ephemerides, page 18 of subframe 4.

Source: IS-GPS-200, section 20.3.3 and figures 20-1; IS-QZSS-PNT for the same on QZSS. Bits are numbered 1 to 300 within
a subframe, parity among them. A receiver that hands on subframes has checked parity and turned inverted words back.
"""

from __future__ import annotations

import numpy as np

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import bits
from fusion.formats.receiver.subframes.bits import SEMICIRCLE, Layout, Pages, count, signed
from fusion.signals import GPS, WEEK_S, KeplerEphemerides
from fusion.types import Ints

PREAMBLE = 0x8B
SUBFRAME_S = 6.0
BITS = 300
NO_HEAD = "GPS or QZSS subframes without preamble, number or time"
IONOSPHERE_PAGE = 56
"""The identity that page 18 of subframe 4 carries."""
_SAME_ISSUE_S = 3600.0
"""Within this an issue number is not used again (IS-GPS-200, section 20.3.4.4: not within six hours)."""

HEAD: Layout = {"preamble": count((1, 8)), "count": count((31, 17)), "subframe": count((50, 3))}
"""``count`` is that of the next subframe, in steps of 6 s."""
PARTS: dict[int, Layout] = {
    1: {
        "week": count((61, 10)),
        "accuracy_index": count((73, 4)),
        "health": count((77, 6)),
        "issue_of_clock": count((83, 2), (211, 8)),
        "group_delay_s": signed((197, 8), scale=2.0**-31),
        "toc": count((219, 16), scale=16.0),
        "af2_per_s": signed((241, 8), scale=2.0**-55),
        "af1": signed((249, 16), scale=2.0**-43),
        "af0_s": signed((271, 22), scale=2.0**-31),
    },
    2: {
        "issue": count((61, 8)),
        "crs_m": signed((69, 16), scale=2.0**-5),
        "delta_n_radps": signed((91, 16), scale=SEMICIRCLE * 2.0**-43),
        "m0_rad": signed((107, 8), (121, 24), scale=SEMICIRCLE * 2.0**-31),
        "cuc_rad": signed((151, 16), scale=2.0**-29),
        "eccentricity": count((167, 8), (181, 24), scale=2.0**-33),
        "cus_rad": signed((211, 16), scale=2.0**-29),
        "root_a": count((227, 8), (241, 24), scale=2.0**-19),
        "toe": count((271, 16), scale=16.0),
    },
    3: {
        "cic_rad": signed((61, 16), scale=2.0**-29),
        "omega0_rad": signed((77, 8), (91, 24), scale=SEMICIRCLE * 2.0**-31),
        "cis_rad": signed((121, 16), scale=2.0**-29),
        "i0_rad": signed((137, 8), (151, 24), scale=SEMICIRCLE * 2.0**-31),
        "crc_m": signed((181, 16), scale=2.0**-5),
        "omega_rad": signed((197, 8), (211, 24), scale=SEMICIRCLE * 2.0**-31),
        "omega_dot_radps": signed((241, 24), scale=SEMICIRCLE * 2.0**-43),
        "issue": count((271, 8)),
        "i_dot_radps": signed((279, 14), scale=SEMICIRCLE * 2.0**-43),
    },
}
IONOSPHERE: Layout = {
    "page": count((63, 6)),
    "alpha0": signed((69, 8), scale=2.0**-30),
    "alpha1": signed((77, 8), scale=2.0**-27),
    "alpha2": signed((91, 8), scale=2.0**-24),
    "alpha3": signed((99, 8), scale=2.0**-24),
    "beta0": signed((107, 8), scale=2.0**11),
    "beta1": signed((121, 8), scale=2.0**14),
    "beta2": signed((129, 8), scale=2.0**16),
    "beta3": signed((137, 8), scale=2.0**16),
}


def read_lnav(pages: Pages, system: int, notes: Notes) -> tuple[KeplerEphemerides, tuple[float, ...] | None]:
    """Ephemerides, and of GPS the last ionosphere (alpha 0..3, beta 0..3) that was sent."""
    head = bits.read(pages.bits, HEAD)
    own_s = np.where(head["count"] * SUBFRAME_S < WEEK_S, (head["count"] - 1) * SUBFRAME_S, np.nan)
    pages, sent_s, subframe = bits.dated(pages, head, PREAMBLE, own_s, NO_HEAD, notes)
    ionosphere = _ionosphere(pages.take(subframe == 4)) if system == GPS else None
    orbit = subframe < 4
    pages, sent_s, subframe = pages.take(orbit), sent_s[orbit], subframe[orbit]
    issue, health = _issue(pages, subframe), bits.numbers(pages.bits, PARTS[1]["health"]) + 1
    status = np.where(subframe == 1, health, 0)
    rows = bits.complete_sets(pages.number, subframe, issue, sent_s, (1, 2, 3), _SAME_ISSUE_S, notes, status)
    values = bits.read_sets(pages.bits, rows, PARTS.values())
    sent_s = sent_s[rows[:, 0]]
    of_week = np.floor(sent_s / WEEK_S) % 1024 == values["week"]
    values["healthy"] = values["health"] == 0
    values["accuracy_m"] = bits.user_range_accuracy_m(values["accuracy_index"])
    return bits.ephemerides(system, pages.number[rows[:, 0]], sent_s, values, of_week, notes), ionosphere


def _issue(pages: Pages, subframe: Ints) -> Ints:
    """The issue that each subframe names: the lower eight bits of IODC in the first, IODE in the others."""
    clock = bits.numbers(pages.bits, PARTS[1]["issue_of_clock"]) & 0xFF
    second, third = (bits.numbers(pages.bits, PARTS[k]["issue"]) for k in (2, 3))
    return np.select([subframe == 1, subframe == 2], [clock, second], third)


def _ionosphere(pages: Pages) -> tuple[float, ...] | None:
    values = bits.read(pages.bits, IONOSPHERE)
    at = np.flatnonzero(values.pop("page") == IONOSPHERE_PAGE)
    if not len(at):
        return None
    last = tuple(float(column[at[-1]]) for column in values.values())
    return last if any(last) else None
