"""From raw signals and navigation data to corrected measurements, for every solver alike.

What is left out is counted by reason, and what a driver can do about it is said in a sentence.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from fusion.arrays import ColumnTable
from fusion.frames import geodetic
from fusion.gnss.clock_jumps import find_clock_jumps
from fusion.gnss.corrections import (
    DEFAULT_KLOBUCHAR,
    klobuchar_delay_m,
    troposphere_delay_m,
    turned_by_earth,
)
from fusion.gnss.differential import corrected, corrections_of
from fusion.gnss.earth import elevation_azimuth
from fusion.gnss.measurements import Measurements
from fusion.gnss.missing_navigation import navigation_warnings
from fusion.gnss.orbits.satellites import SatelliteStates, states_when_sent
from fusion.gnss.rough_places import FEWEST, rough_places
from fusion.messages import say
from fusion.signals import CARRIER_HZ, GPS, LIGHT_MPS, QZSS, SBAS, SYSTEMS, RawGnss, Signals, satellite_name
from fusion.types import Bools, Floats, Ints, Progress

LOWEST_RAD = np.radians(5.0)
"""Satellites below are left out: the atmosphere's models and the ground's reflections are worst there."""
NEAREST_M, FARTHEST_M = 1.0e7, 6.0e7
"""Pseudoranges beyond are impossible: satellites are 19 000 to 42 000 km away, clocks within 30 ms."""
LONGEST_DETOUR_M = 10_000.0
"""No reflected signal that a receiver follows is longer by more; such a pseudorange is a wrong one."""
FEWEST_TO_JUDGE = 3
"""Fewer satellites than this in an epoch cannot tell which of them is wrong."""

_CLOCK_OF = np.arange(len(SYSTEMS))
_CLOCK_OF[[QZSS, SBAS]] = GPS
_CLOCKS = ("GPS", "GLONASS", "Galileo", "BeiDou")

_NO_PLACE = say("gnss.no_place", least=FEWEST)


@dataclass(frozen=True)
class _Sky(ColumnTable):
    """Satellites of all rows as seen from the rough places: angles (n,), places and velocities (n, 3) in the frame of
    reception, and distances (n,)."""

    elevation_rad: Floats
    azimuth_rad: Floats
    position_m: Floats
    velocity_mps: Floats
    distance_m: Floats


def measure(raw: RawGnss, progress: Progress) -> Measurements:
    """Corrected measurements of a log, by its base where it has one; all epochs stay.

    Rows that cannot be used are dropped and counted. Raises ``MalformedLogError`` for a base that is of no use.
    """
    if raw.base is None:
        return _measured(raw, progress)
    measured = _measured(raw, lambda stage, share: progress(stage, 0.5 * share))
    base = _measured(raw.base, lambda stage, share: progress(stage, 0.5 + 0.5 * share))
    return corrected(measured, corrections_of(base, raw.base.place_m))


def _measured(raw: RawGnss, progress: Progress) -> Measurements:
    """What one receiver says.

    Logs that bring their satellites' places need the earth's turn and nothing else. Where no place on earth can be
    found, there are no rows, ``rough_m`` is NaN and a warning says why.
    """
    counts: Counter[str] = Counter()
    signals = _possible(raw, counts)
    brought = signals.brings_satellites
    progress("measurements", 0.1)
    warnings = [] if brought else navigation_warnings(signals, raw.navigation)
    signals, states = _with_satellites(raw, signals, counts)
    progress("measurements", 0.4)
    group, _ = _groups(signals.system)
    pseudorange_m = signals.pseudorange_m + LIGHT_MPS * states.clock_s
    places = rough_places(signals.gps_s, signals.first, group, pseudorange_m, states.position_m)
    progress("measurements", 0.6)
    if not np.isfinite(places).all():
        if len(signals.system) or not warnings:
            warnings.append(_NO_PLACE)
        nothing = np.zeros(len(signals.system), bool)
        signals, states = signals.take_rows(nothing), states.take(nothing)
        group, pseudorange_m = group[:0], pseudorange_m[:0]
    sky = _sky_from(places[signals.epoch], states)
    if not brought:
        pseudorange_m = pseudorange_m - _atmosphere_m(raw, signals, states, sky, places, warnings)
    keep = _usable(signals, sky, group, pseudorange_m, brought, counts)
    sky = sky.take(keep)
    out = _assembled(signals.take_rows(keep), states.take(keep), sky, pseudorange_m[keep], places)
    progress("measurements", 1.0)
    return _finished(out, signals.gps_s, sky.distance_m, counts, warnings)


def _possible(raw: RawGnss, counts: Counter[str]) -> Signals:
    """The rows whose pseudorange can be one; of logs that bring satellites, those that have theirs."""
    signals = raw.signals
    has_range = np.isfinite(signals.pseudorange_m)
    keep = has_range & (signals.pseudorange_m > NEAREST_M) & (signals.pseudorange_m < FARTHEST_M)
    _count(counts, "no pseudorange", ~has_range)
    _count(counts, "impossible pseudorange", has_range & ~keep)
    placed = np.isfinite(signals.position_m).all(axis=1)
    if placed.any() and not len(raw.navigation):
        _count(counts, "no satellite position", keep & ~placed)
        keep &= placed
    return signals.take_rows(keep)


def _with_satellites(raw: RawGnss, signals: Signals, counts: Counter[str]) -> tuple[Signals, SatelliteStates]:
    """The rows whose satellite is known and healthy, with its state."""
    n = len(signals.system)
    if signals.brings_satellites:
        zero, yes = np.zeros(n), np.ones(n, bool)
        carrier_hz = CARRIER_HZ[signals.system]
        brought = SatelliteStates(signals.position_m, signals.velocity_mps, zero, zero, carrier_hz, yes, yes)
        return signals, brought
    received_s = signals.gps_s[signals.epoch]
    states = states_when_sent(
        raw.navigation, signals.system, signals.number, received_s, signals.pseudorange_m
    )
    _count(counts, "no ephemeris", ~states.known)
    _count(counts, "unhealthy", states.known & ~states.healthy)
    keep = states.known & states.healthy
    return signals.take_rows(keep), states.take(keep)


def _groups(system: Ints) -> tuple[Ints, tuple[str, ...]]:
    """Which clock each row shares, (n,), and the clocks' names: GPS first, or else the one with the most rows."""
    clock = _CLOCK_OF[system]
    clocks, rows = np.unique(clock, return_counts=True)
    clocks = clocks[np.lexsort((clocks, -rows, clocks != GPS))]
    place = np.zeros(len(_CLOCKS), np.int64)
    place[clocks] = np.arange(len(clocks))
    return place[clock], tuple(_CLOCKS[c] for c in clocks)


def _sky_from(place_m: Floats, states: SatelliteStates) -> _Sky:
    flight_s = np.linalg.norm(states.position_m - place_m, axis=1) / LIGHT_MPS
    position = turned_by_earth(states.position_m, flight_s)
    if not len(position):
        return _Sky(flight_s, flight_s, position, position, flight_s)
    elevation, azimuth = elevation_azimuth(place_m, position)
    return _Sky(
        elevation,
        azimuth,
        position,
        turned_by_earth(states.velocity_mps, flight_s),
        np.linalg.norm(position - place_m, axis=1),
    )


def _atmosphere_m(
    raw: RawGnss,
    signals: Signals,
    states: SatelliteStates,
    sky: _Sky,
    places: Floats,
    warnings: list[str],
) -> Floats:
    """What the air adds to each pseudorange, (n,). Below the mask the models are asked at the mask."""
    if not len(signals.system):
        return np.empty(0)
    if raw.navigation.klobuchar is None:
        warnings.append(say("gnss.no_ionosphere"))
    lon_deg, lat_deg, height_m = geodetic(places)
    row = signals.epoch
    lat, gps_s = np.radians(lat_deg)[row], signals.gps_s[row]
    elevation = np.maximum(sky.elevation_rad, LOWEST_RAD)
    carrier_hz = np.where(np.isfinite(signals.frequency_hz), signals.frequency_hz, states.carrier_hz)
    ionosphere = klobuchar_delay_m(
        raw.navigation.klobuchar or DEFAULT_KLOBUCHAR,
        gps_s,
        lat,
        np.radians(lon_deg)[row],
        elevation,
        sky.azimuth_rad,
        carrier_hz,
    )
    return ionosphere + troposphere_delay_m(gps_s, lat, height_m[row], elevation)


def _usable(
    signals: Signals, sky: _Sky, group: Ints, pseudorange_m: Floats, brought: bool, counts: Counter[str]
) -> Bools:
    """Rows above the mask (those of logs that bring their satellites all are) and near what their epoch says."""
    above = (sky.elevation_rad >= LOWEST_RAD) | brought
    _count(counts, "below the mask", ~above)
    excess, epoch = pseudorange_m - sky.distance_m, signals.epoch
    beside = excess - _medians(excess, epoch, len(signals))[epoch]
    bias = np.clip(_medians(beside, group, group.max(initial=0) + 1), -LONGEST_DETOUR_M, LONGEST_DETOUR_M)
    beside = np.abs(
        beside - bias[group]
    )  # systems' times agree to a microsecond; wrong letters make wrong systems
    wrong = above & (beside > LONGEST_DETOUR_M) & (np.diff(signals.first)[epoch] >= FEWEST_TO_JUDGE)
    _count(counts, "impossible pseudorange", wrong)
    return np.asarray(above & ~wrong)


def _assembled(
    signals: Signals, states: SatelliteStates, sky: _Sky, pseudorange_m: Floats, places: Floats
) -> Measurements:
    group, groups = _groups(signals.system)
    names, satellite = np.unique(
        np.column_stack([signals.system, signals.number]), axis=0, return_inverse=True
    )
    rate = signals.range_rate_mps + LIGHT_MPS * states.clock_rate
    moving = np.isfinite(sky.velocity_mps).all(
        axis=1
    )  # without the satellite's own, a range rate says nothing
    return Measurements(
        time_s=signals.time_s,
        first=signals.first,
        satellite=satellite.reshape(-1).astype(np.int64),
        group=group,
        pseudorange_m=pseudorange_m,
        range_rate_mps=np.where(moving, rate, np.nan),
        cn0_dbhz=signals.cn0_dbhz,
        sigma_m=signals.sigma_m,
        elevation_rad=sky.elevation_rad,
        azimuth_rad=sky.azimuth_rad,
        satellite_m=sky.position_m,
        satellite_mps=sky.velocity_mps,
        names=tuple(satellite_name(int(system), int(number)) for system, number in names),
        groups=groups,
        rough_m=np.median(places, axis=0) if len(places) else np.full(3, np.nan),
    )


def _finished(
    out: Measurements, gps_s: Floats, distance_m: Floats, counts: Counter[str], warnings: list[str]
) -> Measurements:
    """With a clock that does not jump, and with what was counted and is to be said."""
    jumps = find_clock_jumps(gps_s, out.first, out.satellite, out.pseudorange_m - distance_m)
    _count(counts, "clock jumps repaired", jumps.jumps)
    _count(counts, "clock begins anew", jumps.anew)
    few = int(np.count_nonzero(np.diff(out.first) < FEWEST))
    if few and len(out.satellite):
        warnings.append(say("gnss.few_satellites", n=few, all=len(out)))
    return replace(
        out,
        pseudorange_m=out.pseudorange_m - jumps.step_m[out.epoch],
        clock_anew=jumps.anew,
        warnings=tuple(warnings),
        counts=dict(counts),
    )


def _medians(values: Floats, label: Ints, labels: int) -> Floats:
    """The (lower) median of the values of each label, NaN where there are none."""
    order = np.lexsort((values, label))
    counts = np.bincount(label, minlength=labels)
    middle = np.cumsum(counts) - counts + np.maximum(counts - 1, 0) // 2
    out = np.full(labels, np.nan)
    out[counts > 0] = values[order][middle[counts > 0]]
    return out


def _count(counts: Counter[str], what: str, rows: Bools | int) -> None:
    number = int(np.count_nonzero(rows)) if isinstance(rows, np.ndarray) else rows
    if number:
        counts[what] += number
