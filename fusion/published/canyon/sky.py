"""A synthetic sky: Walker constellations as broadcast records, and where their satellites are at a moment.

The records have the form of real ones, so that what is simulated can be written to files and run through the whole
chain. They hold plain ellipses: no harmonic terms, one clock polynomial a satellite.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from fusion.frames import wrap_angle
from fusion.gnss.corrections import turned_by_earth
from fusion.gnss.earth import elevation_azimuth
from fusion.gnss.orbits.kepler import MU_M3PS2, RATE_RADPS
from fusion.gnss.orbits.satellites import states_at
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    GALILEO,
    GLONASS,
    GPS,
    LIGHT_MPS,
    WEEK_S,
    KeplerEphemerides,
    Navigation,
    satellite_name,
)
from fusion.types import Floats, Ints

_EVERY_S = 3600.0
"""Time between two records of a satellite: less than the validity of any system's."""
_FIRST_NUMBER = {BEIDOU: 19}
"""BeiDou's medium orbits begin with C19; lower numbers are geostationary or inclined, with rules of their own."""
_COARSE_S, _MARGIN_RAD = 300.0, np.radians(5.0)
"""Satellites that are lower than this under the mask at such times are left out: they climb 0.5 degrees a minute."""
_KLOBUCHAR = (1.2e-8, 1.5e-8, -6.0e-8, -6.0e-8, 9.0e4, 6.6e4, -1.3e5, -2.0e5)
"""An ionosphere of an ordinary day: 5 ns at night, about 20 ns at noon, at the zenith."""
LOWEST_RAD = np.radians(5.0)
"""Satellites lower than this are not tracked."""


class Walker(NamedTuple):
    """A Walker delta pattern: ``satellites`` in ``planes``, ``phasing`` steps of 360° / satellites between them."""

    satellites: int
    planes: int
    phasing: int
    inclination_deg: float
    semi_major_m: float


CONSTELLATIONS = {
    GPS: Walker(24, 6, 1, 55.0, 26_559_800.0),
    GALILEO: Walker(24, 3, 1, 56.0, 29_600_000.0),
    BEIDOU: Walker(24, 3, 1, 55.0, 27_906_000.0),
}
"""As published by the operators; GPS's real planes are spaced less evenly. Of BeiDou the medium orbits."""


@dataclass(frozen=True)
class Sky:
    """Satellites seen by an antenna, flat rows in m epochs: ``first`` (m + 1,), other columns (n,) or (n, 3).

    ``satellite_m`` and ``satellite_mps`` are ECEF at transmission, in the frame of the moment of reception;
    ``sent_m`` and ``sent_mps`` in that of transmission. ``clock_s`` is what a single-frequency user takes off the
    satellite's clock (group delay included), ``clock_drift`` its
    rate.
    """

    first: Ints
    system: Ints
    number: Ints
    satellite_m: Floats
    satellite_mps: Floats
    sent_m: Floats
    sent_mps: Floats
    clock_s: Floats
    clock_drift: Floats
    carrier_hz: Floats
    elevation_rad: Floats
    azimuth_rad: Floats

    @property
    def epoch(self) -> Ints:
        """The epoch of each row, (n,)."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))


def synthetic_navigation(
    start_gps_s: float,
    duration_s: float,
    rng: np.random.Generator,
    systems: tuple[int, ...] = (GPS, GALILEO, BEIDOU),
) -> Navigation:
    """Broadcast records from an hour before the start to an hour after the end, of all satellites of the systems.

    Each system's pattern is turned by a random angle, clocks and small eccentricities are drawn.
    """
    toes = np.arange(
        np.floor(start_gps_s / _EVERY_S - 1) * _EVERY_S, start_gps_s + duration_s + _EVERY_S, _EVERY_S
    )
    kepler = KeplerEphemerides.empty()
    for system in systems:
        # Full hours of the system's own time: messages state no others.
        late_s = BEIDOU_LATE_S if system == BEIDOU else 0.0
        kepler = kepler.joined(_records(system, toes + late_s, rng))
    return Navigation(kepler, klobuchar=_KLOBUCHAR)


def _records(system: int, toes: Floats, rng: np.random.Generator) -> KeplerEphemerides:
    """All records of a system, sorted by satellite, then by time."""
    pattern = CONSTELLATIONS[system]
    count, per_plane = pattern.satellites, pattern.satellites // pattern.planes
    plane, slot = np.divmod(np.arange(count), per_plane)
    node = rng.uniform(0, 2 * np.pi) + 2 * np.pi * plane / pattern.planes
    latitude = rng.uniform(0, 2 * np.pi) + 2 * np.pi * (slot / per_plane + pattern.phasing * plane / count)
    perigee = rng.uniform(-np.pi, np.pi, count)
    node_rate = -8e-9  # rad/s, of the precession by the earth's flattening
    drawn = {
        "eccentricity": rng.uniform(1e-4, 0.01, count) if system == GPS else rng.uniform(1e-5, 5e-4, count),
        "af0_s": rng.uniform(-4e-4, 4e-4, count),
        "af1": rng.normal(0, 3e-12, count),
        "group_delay_s": rng.normal(0, 5e-9, count),
        "i0_rad": np.radians(pattern.inclination_deg + rng.normal(0, 0.5, count)),
    }
    motion = np.sqrt(MU_M3PS2[system] / pattern.semi_major_m**3)
    who, when = np.repeat(np.arange(count), len(toes)), np.tile(toes, count)
    since = when - toes[0]
    # The node is stated at the beginning of the week, in that week's turn of the earth.
    node_then = node[who] + (node_rate - RATE_RADPS[system]) * since
    columns = {name: values[who] for name, values in drawn.items()}
    columns["af0_s"] = columns["af0_s"] + columns["af1"] * since
    columns |= {
        "system": np.full(len(who), system),
        "number": who + _FIRST_NUMBER.get(system, 1),
        "toe_s": when,
        "toc_s": when,
        "sent_s": when - 1800.0,
        "healthy": np.ones(len(who), bool),
        "accuracy_m": np.full(len(who), 2.0),
        "issue": np.round(since / _EVERY_S).astype(np.int64) % 256,
        "root_a": np.full(len(who), np.sqrt(pattern.semi_major_m)),
        "m0_rad": wrap_angle(latitude[who] - perigee[who] + motion * since),
        "omega0_rad": wrap_angle(node_then + RATE_RADPS[system] * _week_second(system, when)),
        "omega_rad": perigee[who],
        "omega_dot_radps": np.full(len(who), node_rate),
    }
    zero = np.zeros(len(who))
    return KeplerEphemerides(**{s.name: columns.get(s.name, zero) for s in fields(KeplerEphemerides)})


def _week_second(system: int, gps_s: Floats) -> Floats:
    """Seconds of the system's own week."""
    return np.asarray(np.remainder(gps_s - (BEIDOU_LATE_S if system == BEIDOU else 0.0), WEEK_S))


def look_up(navigation: Navigation, gps_s: Floats, antenna_m: Floats) -> Sky:
    """All satellites above ``LOWEST_RAD`` at times of reception (m,) and antenna places (m, 3), ECEF.

    A satellite without a valid record at a time is not there.
    """
    kepler, glonass = navigation.kepler, navigation.glonass
    pairs = {*zip(kepler.system.tolist(), kepler.number.tolist(), strict=True)}
    pairs |= {(GLONASS, n) for n in glonass.number.tolist()}
    system, number = np.array(sorted(pairs), np.int64).reshape(-1, 2).T
    coarse = np.unique(np.append(np.arange(0, len(gps_s), _coarse_step(gps_s)), len(gps_s) - 1))
    likely = _ever_up(navigation, system, number, gps_s[coarse], antenna_m[coarse], LOWEST_RAD - _MARGIN_RAD)
    system, number = system[likely], number[likely]
    epoch = np.repeat(np.arange(len(gps_s)), len(system))
    system, number = np.tile(system, len(gps_s)), np.tile(number, len(gps_s))
    antenna, received_s = antenna_m[epoch], gps_s[epoch]
    flight_s = np.full(len(epoch), 0.075)
    for _ in range(3):  # each round makes the error 1e-5 of what it was, beginning with 0.02 s
        states = states_at(navigation, system, number, received_s - flight_s)
        place = turned_by_earth(states.position_m, flight_s)
        flight_s = np.linalg.norm(place - antenna, axis=1) / LIGHT_MPS
    elevation, azimuth = elevation_azimuth(antenna, place)
    up = states.known & (np.nan_to_num(elevation, nan=-np.pi) >= LOWEST_RAD)
    return Sky(
        first=np.append(0, np.cumsum(np.bincount(epoch[up], minlength=len(gps_s)))),
        system=system[up],
        number=number[up],
        satellite_m=place[up],
        satellite_mps=turned_by_earth(states.velocity_mps, flight_s)[up],
        sent_m=states.position_m[up],
        sent_mps=states.velocity_mps[up],
        clock_s=states.clock_s[up],
        clock_drift=states.clock_rate[up],
        carrier_hz=states.carrier_hz[up],
        elevation_rad=elevation[up],
        azimuth_rad=azimuth[up],
    )


def _coarse_step(gps_s: Floats) -> int:
    interval_s = float(np.median(np.diff(gps_s))) if len(gps_s) > 1 else _COARSE_S
    return max(1, int(_COARSE_S / interval_s))


def _ever_up(
    navigation: Navigation, system: Ints, number: Ints, gps_s: Floats, antenna_m: Floats, lowest_rad: float
) -> Ints:
    """Which of the satellites (s,) stand above an elevation at any of the times."""
    m, count = len(gps_s), len(system)
    states = states_at(navigation, np.tile(system, m), np.tile(number, m), np.repeat(gps_s, count))
    elevation, _ = elevation_azimuth(np.repeat(antenna_m, count, axis=0), states.position_m)
    up = states.known & (np.nan_to_num(elevation, nan=-np.pi) >= LOWEST_RAD)
    return np.flatnonzero(up.reshape(m, count).any(axis=0))


def names_of(system: Ints, number: Ints) -> tuple[tuple[str, ...], Ints]:
    """The satellites' names in order of system and number, and each row's place among them."""
    pairs, place = np.unique(np.column_stack([system, number]), axis=0, return_inverse=True)
    return tuple(satellite_name(int(s), int(n)) for s, n in pairs), np.asarray(place, np.int64).ravel()
