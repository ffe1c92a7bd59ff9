"""Which broadcast record is used for a satellite at a time.

The record whose reference time is nearest, within a limit by system. A file of another day has none within the limit,
and gives no satellite rather than a wrong one. Times are absolute GPS seconds, so that weeks may roll over.
"""

from __future__ import annotations

import numpy as np

from fusion.signals import (
    BEIDOU,
    GALILEO,
    GLONASS,
    GPS,
    QZSS,
    SBAS,
    SYSTEMS,
    GlonassEphemerides,
    KeplerEphemerides,
)
from fusion.types import Bools, Floats, Ints

LIMIT_S = np.zeros(len(SYSTEMS))
"""How far from its reference time a record is used, seconds.

GPS, QZSS: half of the four hours that the curve is fitted to (IS-GPS-200 20.3.4.4). Galileo: a batch is valid for four
hours (OS SDD). BeiDou: batches come hourly; two hours bridge one that the file lacks. GLONASS: batches come half-hourly
for 15 minutes each way; 30 bridge one that is lacking, at a cost of metres.
"""
LIMIT_S[[GPS, GALILEO, BEIDOU, QZSS, GLONASS, SBAS]] = 7200.0, 14400.0, 7200.0, 7200.0, 1800.0, 0.0

_SLACK_S = 1.0  # signals of the first second that a record is valid for left their satellite before it

_NAMES = (
    1_000  # more than a system's satellites: a system's number times this plus the satellite's names both
)
_FAR_S = 1e10  # farther apart than any two times, to lay the records of all satellites on one axis


def choose_kepler(eph: KeplerEphemerides, system: Ints, number: Ints, gps_s: Floats) -> Ints:
    """For each row (n,) the index of the record to use, -1 where none is within the limit.

    Of records with one reference time a healthy one comes first, then the one sent last, then by content: the order
    of the file plays no part.
    """
    sent = np.where(np.isfinite(eph.sent_s), eph.sent_s, -np.inf)
    better = (eph.af0_s, eph.issue, eph.group_delay_s, sent, eph.healthy)
    return _nearest(
        eph.system * _NAMES + eph.number, eph.toe_s, better, system * _NAMES + number, gps_s, LIMIT_S[system]
    )


def choose_glonass(eph: GlonassEphemerides, number: Ints, gps_s: Floats) -> Ints:
    """As ``choose_kepler``, for rows of GLONASS."""
    better = (eph.position_m[:, 0], eph.clock_s, eph.healthy)
    return _nearest(eph.number, eph.toe_s, better, number, gps_s, np.full(len(number), LIMIT_S[GLONASS]))


def _nearest(
    name: Ints,
    toe_s: Floats,
    better: tuple[Floats | Ints | Bools, ...],
    satellite: Ints,
    gps_s: Floats,
    limit_s: Floats,
) -> Ints:
    """The record of each wanted name with the nearest time. ``better``: the last key matters most, larger wins."""
    order = np.lexsort((*better, toe_s, name))
    order = order[np.isfinite(toe_s[order])]
    if not len(order):
        return np.full(len(satellite), -1, np.int64)
    axis = name[order] * _FAR_S + toe_s[order]
    best = np.append(np.diff(axis) > 0, True)  # the last of those with one name and time
    order, axis = order[best], axis[best]
    after = np.searchsorted(axis, satellite * _FAR_S + np.nan_to_num(gps_s))
    chosen = np.full(len(satellite), -1, np.int64)
    least = limit_s + _SLACK_S
    for place in (after - 1, after):
        record = order[np.clip(place, 0, len(order) - 1)]
        inside = (place >= 0) & (place < len(order)) & (name[record] == satellite)
        away = np.abs(gps_s - toe_s[record])
        nearer = inside & (away <= least) & ((chosen < 0) | (away < least))
        chosen, least = np.where(nearer, record, chosen), np.where(nearer, away, least)
    return chosen
