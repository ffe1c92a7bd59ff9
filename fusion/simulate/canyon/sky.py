"""A synthetic sky: Walker constellations as broadcast records, and where their satellites are at a moment.

The records have the form of real ones, so that what is simulated can be written to files and run through the whole
chain. They hold plain ellipses: no harmonic terms, one clock polynomial a satellite.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from fusion.gnss.earth import EARTH_RATE_RADPS, elevation_azimuth
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    GALILEO,
    GPS,
    LIGHT_MPS,
    WEEK_S,
    KeplerEphemerides,
    Navigation,
    satellite_name,
)
from fusion.types import Floats, Ints

_MU = {GPS: 3.986005e14, GALILEO: 3.986004418e14, BEIDOU: 3.986004418e14}
"""Gravity of the earth, m3/s2, by the system's interface document: IS-GPS-200, Galileo OS SIS ICD, BDS-SIS-ICD."""
_TURN_RADPS = {GPS: EARTH_RATE_RADPS, GALILEO: EARTH_RATE_RADPS, BEIDOU: 7.2921150e-5}
"""Rotation of the earth by the same documents."""
_EVERY_S = 3600.0
"""Time between two records of a satellite: less than the validity of any system's."""
_STEP_S = 0.5
"""Half the step of the differences that velocities are; their error is under 1e-5 m/s."""
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
    satellite's clock (group delay included), ``clock_drift`` its rate.
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
        kepler = kepler.joined(_records(system, toes, rng))
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
    motion = np.sqrt(_MU[system] / pattern.semi_major_m**3)
    who, when = np.repeat(np.arange(count), len(toes)), np.tile(toes, count)
    since = when - toes[0]
    # The node is stated at the beginning of the week, in that week's turn of the earth.
    node_then = node[who] + (node_rate - _TURN_RADPS[system]) * since
    columns = {name: values[who] for name, values in drawn.items()}
    columns["af0_s"] = columns["af0_s"] + columns["af1"] * since
    columns |= {
        "system": np.full(len(who), system),
        "number": who + 1,
        "toe_s": when,
        "toc_s": when,
        "sent_s": when - 1800.0,
        "healthy": np.ones(len(who), bool),
        "accuracy_m": np.full(len(who), 2.0),
        "issue": np.round(since / _EVERY_S).astype(np.int64) % 256,
        "root_a": np.full(len(who), np.sqrt(pattern.semi_major_m)),
        "m0_rad": _wrapped(latitude[who] - perigee[who] + motion * since),
        "omega0_rad": _wrapped(node_then + _TURN_RADPS[system] * _week_second(system, when)),
        "omega_rad": perigee[who],
        "omega_dot_radps": np.full(len(who), node_rate),
    }
    zero = np.zeros(len(who))
    return KeplerEphemerides(**{s.name: columns.get(s.name, zero) for s in fields(KeplerEphemerides)})


def _wrapped(angle: Floats) -> Floats:
    return np.asarray(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


def _week_second(system: int, gps_s: Floats) -> Floats:
    """Seconds of the system's own week."""
    return np.asarray(np.remainder(gps_s - (BEIDOU_LATE_S if system == BEIDOU else 0.0), WEEK_S))


def look_up(navigation: Navigation, gps_s: Floats, antenna_m: Floats, lowest_rad: float = LOWEST_RAD) -> Sky:
    """All satellites above ``lowest_rad`` at times of reception (m,) and antenna places (m, 3), ECEF.

    Each satellite's record nearest in time is taken. Only Kepler records are used.
    """
    kepler = navigation.kepler
    parts = [
        _seen(kepler, rows, gps_s, antenna_m, lowest_rad)
        for rows in (
            np.flatnonzero((kepler.system == s) & (kepler.number == n))
            for s, n in sorted(set(zip(kepler.system.tolist(), kepler.number.tolist(), strict=True)))
        )
    ]
    names = [s.name for s in fields(Sky) if s.name != "first"]
    epoch = np.concatenate([np.empty(0, np.int64), *(p["epoch"] for p in parts)])
    order = np.argsort(epoch, kind="stable")
    columns = {name: np.concatenate([p[name] for p in parts])[order] for name in names}
    counts = np.bincount(epoch, minlength=len(gps_s))
    return Sky(first=np.append(0, np.cumsum(counts)), **columns)


def _seen(
    kepler: KeplerEphemerides, rows: Ints, gps_s: Floats, antenna_m: Floats, lowest_rad: float
) -> dict[str, Floats]:
    """One satellite's rows of ``Sky``, with the epoch of each."""
    record = rows[np.argmin(np.abs(gps_s[:, None] - kepler.toe_s[rows]), axis=1)]
    flight_s = np.full(len(gps_s), 0.075)
    for _ in range(3):  # each round makes the error 1e-5 of what it was
        place = _turned(orbit(kepler, record, gps_s - flight_s)[0], flight_s)
        flight_s = np.linalg.norm(place - antenna_m, axis=1) / LIGHT_MPS
    elevation, azimuth = elevation_azimuth(antenna_m, place)
    up = np.flatnonzero(elevation >= lowest_rad)
    record, flight_s, sent_s = record[up], flight_s[up], (gps_s - flight_s)[up]
    (after, clock_after), (before, clock_before) = (
        orbit(kepler, record, sent_s + step) for step in (_STEP_S, -_STEP_S)
    )
    sent_m, clock_s = orbit(kepler, record, sent_s)
    sent_mps = (after - before) / (2 * _STEP_S)
    return {
        "epoch": up,
        "system": kepler.system[record],
        "number": kepler.number[record],
        "satellite_m": _turned(sent_m, flight_s),
        "satellite_mps": _turned(sent_mps, flight_s),
        "sent_m": sent_m,
        "sent_mps": sent_mps,
        "clock_s": clock_s,
        "clock_drift": (clock_after - clock_before) / (2 * _STEP_S),
        "elevation_rad": elevation[up],
        "azimuth_rad": azimuth[up],
    }


def _turned(vector: Floats, flight_s: Floats) -> Floats:
    """ECEF vectors (n, 3) in the frame that the earth's rotation has reached ``flight_s`` later."""
    angle = EARTH_RATE_RADPS * flight_s
    x, y, z = vector.T
    return np.column_stack([x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle), z])


def orbit(kepler: KeplerEphemerides, record: Ints, gps_s: Floats) -> tuple[Floats, Floats]:
    """ECEF positions (n, 3) in the frame of ``gps_s`` (n,), and the clocks' offsets in seconds, group delay taken off.

    Source: IS-GPS-200, tables 20-IV and 30-II, without the harmonic terms, which synthetic records do not have.
    """
    k = kepler
    mu = np.array([_MU.get(s, _MU[GPS]) for s in range(6)])[k.system[record]]
    turn = np.array([_TURN_RADPS.get(s, EARTH_RATE_RADPS) for s in range(6)])[k.system[record]]
    since = gps_s - k.toe_s[record]
    axis, e = k.root_a[record] ** 2, k.eccentricity[record]
    mean = k.m0_rad[record] + (np.sqrt(mu / axis**3) + k.delta_n_radps[record]) * since
    anomaly = mean
    for _ in range(8):  # for e < 0.02 each round adds two digits or more
        anomaly = mean + e * np.sin(anomaly)
    along = axis * (np.cos(anomaly) - e)
    across = axis * np.sqrt(1 - e**2) * np.sin(anomaly)
    argument = np.arctan2(across, along) + k.omega_rad[record]
    radius = np.hypot(along, across)
    tilt = k.i0_rad[record] + k.i_dot_radps[record] * since
    late = np.where(k.system[record] == BEIDOU, BEIDOU_LATE_S, 0.0)
    node = (
        k.omega0_rad[record]
        + (k.omega_dot_radps[record] - turn) * since
        - turn * np.remainder(k.toe_s[record] - late, WEEK_S)
    )
    x, y = radius * np.cos(argument), radius * np.sin(argument)
    place = np.column_stack(
        [
            x * np.cos(node) - y * np.cos(tilt) * np.sin(node),
            x * np.sin(node) + y * np.cos(tilt) * np.cos(node),
            y * np.sin(tilt),
        ]
    )
    clock_since = gps_s - k.toc_s[record]
    relativity = -2 * np.sqrt(mu) / LIGHT_MPS**2 * e * k.root_a[record] * np.sin(anomaly)
    clock = k.af0_s[record] + (k.af1[record] + k.af2_per_s[record] * clock_since) * clock_since
    return place, clock + relativity - k.group_delay_s[record]


def names_of(system: Ints, number: Ints) -> tuple[tuple[str, ...], Ints]:
    """The satellites' names in order of system and number, and each row's place among them."""
    pairs, place = np.unique(np.column_stack([system, number]), axis=0, return_inverse=True)
    return tuple(satellite_name(int(s), int(n)) for s, n in pairs), np.asarray(place, np.int64).ravel()
