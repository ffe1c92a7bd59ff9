"""States of satellites of all systems, as single-frequency users of the L1 band need them.

The record is used whose reference time is nearest, within a limit by system. A file of another day has none within the
limit, and gives no satellite rather than a wrong one. Times are absolute GPS seconds, so that weeks may roll over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.arrays import ColumnTable
from fusion.gnss.orbits.glonass import glonass_clock_s, glonass_states
from fusion.gnss.orbits.kepler import kepler_clock_s, kepler_states
from fusion.signals import (
    BEIDOU,
    CARRIER_HZ,
    GALILEO,
    GLONASS,
    GLONASS_STEP_HZ,
    GPS,
    LIGHT_MPS,
    QZSS,
    SBAS,
    SYSTEMS,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
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


@dataclass(frozen=True)
class SatelliteStates(ColumnTable):
    """Satellites at their time of transmission, one row a signal; NaN where no record is known.

    ``position_m`` and ``velocity_mps`` (n, 3) in ECEF of that moment; ``clock_s`` (n,) is the clock's lead with
    relativity and less the group delay of the L1 band, ``clock_rate`` its rate without unit; ``carrier_hz`` the
    nominal carrier. ``known`` says that there is a record, ``healthy`` that it calls the satellite so.
    """

    position_m: Floats
    velocity_mps: Floats
    clock_s: Floats
    clock_rate: Floats
    carrier_hz: Floats
    known: Bools
    healthy: Bools


@dataclass(frozen=True)
class Records:
    """Which record each row uses, (n,): an index into its kind's table, -1 for none."""

    kepler: Ints
    glonass: Ints

    @classmethod
    def choose(cls, navigation: Navigation, system: Ints, number: Ints, gps_s: Floats) -> Records:
        """The nearest valid records, see ``selection``."""
        kepler = choose_kepler(navigation.kepler, system, number, gps_s)
        glonass = np.full(len(system), -1, np.int64)
        rows = np.flatnonzero(system == GLONASS)
        glonass[rows] = choose_glonass(navigation.glonass, number[rows], gps_s[rows])
        return cls(kepler, glonass)


def states_at(navigation: Navigation, system: Ints, number: Ints, gps_s: Floats) -> SatelliteStates:
    """States of satellites (n,) at true GPS seconds (n,)."""
    return _states(navigation, Records.choose(navigation, system, number, gps_s), system, gps_s)


def states_when_sent(
    navigation: Navigation, system: Ints, number: Ints, received_s: Floats, pseudorange_m: Floats
) -> SatelliteStates:
    """States when signals left their satellites, which a receiver at its own time ``received_s`` (n,) measured.

    The time of the satellite's clock is the tag less the pseudorange's time of flight, whatever the receiver's clock
    says: its error is in both. The satellite's clock then gives the true time. One step is enough: the lead changes by
    less than 1e-13 s over itself, and relativity and group delay move a satellite by less than a millimetre.
    """
    clock_says = received_s - pseudorange_m / LIGHT_MPS
    chosen = Records.choose(navigation, system, number, clock_says)
    lead = np.zeros(len(system))
    rows = np.flatnonzero(chosen.kepler >= 0)
    lead[rows] = kepler_clock_s(navigation.kepler, chosen.kepler[rows], clock_says[rows])
    rows = np.flatnonzero(chosen.glonass >= 0)
    lead[rows] = glonass_clock_s(navigation.glonass, chosen.glonass[rows], clock_says[rows])
    return _states(navigation, chosen, system, clock_says - lead)


def _states(navigation: Navigation, chosen: Records, system: Ints, gps_s: Floats) -> SatelliteStates:
    n = len(system)
    position, velocity = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    clock, rate, carrier = np.full(n, np.nan), np.full(n, np.nan), CARRIER_HZ[system]
    healthy = np.zeros(n, bool)
    rows = np.flatnonzero(chosen.kepler >= 0)
    if len(rows):
        eph, record = navigation.kepler, chosen.kepler[rows]
        position[rows], velocity[rows], clock[rows], rate[rows] = kepler_states(eph, record, gps_s[rows])
        clock[rows] -= np.nan_to_num(eph.group_delay_s[record])
        healthy[rows] = eph.healthy[record]
    rows = np.flatnonzero(chosen.glonass >= 0)
    if len(rows):
        moving, record = navigation.glonass, chosen.glonass[rows]
        position[rows], velocity[rows], clock[rows], rate[rows] = glonass_states(moving, record, gps_s[rows])
        carrier[rows] += GLONASS_STEP_HZ * moving.channel[record]
        healthy[rows] = moving.healthy[record]
    has_orbit = np.isfinite(position).all(axis=1) & np.isfinite(clock)
    return SatelliteStates(position, velocity, clock, rate, carrier, has_orbit, healthy)
