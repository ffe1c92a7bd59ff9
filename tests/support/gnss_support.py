"""Skies for tests: measured navigation files where they are there, and a synthetic one without any file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusion.gnss.corrections import turned_by_earth
from fusion.gnss.earth import ecef, elevation_azimuth
from fusion.gnss.orbits.satellites import states_at
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, LIGHT_MPS, Navigation, RawGnss, Signals
from fusion.types import Floats
from satellites.library import glonass_table, kepler_table
from source_tree import REPOSITORY

GNSS_DATA = REPOSITORY.parent / "shared" / "data" / "gnss"
TOE_S = 1_300_000_000.0 - 1_300_000_000.0 % 7200.0
BERLIN_M = ecef(np.array([13.4]), np.array([52.5]), np.array([80.0]))[0]
ROOT_AXES = {GPS: 5153.7, GALILEO: 5440.6, BEIDOU: 5282.6}
PLANES, SATELLITES = 6, 4
"""Of each system, evenly spread."""


def gnss_file(name: str) -> Path:
    """A measured file; the test is left out where it is absent."""
    path = GNSS_DATA / name
    if not path.exists():
        pytest.skip(f"no measured data at {path}")
    return path


def kepler_row_of(
    system: int,
    number: int,
    *,
    root_a: float = 5153.7,
    eccentricity: float = 0.005,
    toe_s: float = TOE_S,
    plain: bool = False,
) -> dict[str, Any]:
    """A satellite of an even sky; ``plain`` without any correction to Kepler's ellipse."""
    plane, place = (number - 1) % PLANES, (number - 1) // PLANES
    waves = 0.0 if plain else 1.0
    return {
        "system": system, "number": number, "toe_s": toe_s, "toc_s": toe_s, "sent_s": toe_s - 3600.0,
        "healthy": True, "accuracy_m": 2.0, "issue": 1, "root_a": root_a, "eccentricity": eccentricity,
        "m0_rad": np.pi / 2 * place + 0.4 * plane + 0.3 * system, "delta_n_radps": waves * 4.5e-9,
        "omega0_rad": np.pi / 3 * plane + 0.2 * system, "omega_rad": 0.0,
        "omega_dot_radps": -waves * 8e-9, "i0_rad": 0.96, "i_dot_radps": waves * 2e-10, "cuc_rad": waves * 3e-6,
        "cus_rad": waves * 8e-6, "crc_m": waves * 220.0, "crs_m": waves * 60.0, "cic_rad": waves * 1e-7,
        "cis_rad": -waves * 9e-8, "af0_s": 1e-5 * number, "af1": 1e-12 * number, "af2_per_s": 0.0,
        "group_delay_s": 0.0,
    }  # fmt: skip


def glonass_row_of(number: int, toe_s: float = TOE_S) -> dict[str, Any]:
    """A GLONASS satellite on a round orbit of 25 508 km, inclined by 64.8 degrees."""
    radius, tilt = 25_508e3, np.radians(64.8)
    node, along = 2.1 * (number - 1) // 8 + 0.3, np.pi / 4 * (number - 1)
    speed = np.sqrt(3.986004418e14 / radius)
    out = np.array([np.cos(node), np.sin(node), 0.0])
    up = np.array([-np.sin(node) * np.cos(tilt), np.cos(node) * np.cos(tilt), np.sin(tilt)])
    place = radius * (np.cos(along) * out + np.sin(along) * up)
    moves = speed * (np.cos(along) * up - np.sin(along) * out)
    return {
        "number": number, "channel": number % 13 - 7, "toe_s": toe_s, "healthy": True, "clock_s": 2e-5,
        "clock_rate": 1e-12, "position_m": place, "velocity_mps": moves - np.cross([0.0, 0.0, 7.292115e-5], place),
        "acceleration_mps2": [1e-6, -2e-6, 1e-6],
    }  # fmt: skip


def even_sky(*systems: int, toe_s: float = TOE_S) -> Navigation:
    """24 satellites of each system, without an ionosphere's coefficients."""
    rows = [
        kepler_row_of(system, number, root_a=ROOT_AXES[system], toe_s=toe_s)
        for system in systems
        if system != GLONASS
        for number in range(7, 7 + PLANES * SATELLITES)  # BeiDou's geostationary ones left out
    ]
    moving = [glonass_row_of(number, toe_s) for number in range(1, 25)] if GLONASS in systems else []
    return Navigation(kepler_table(rows), glonass_table(moving))


def measured(
    navigation: Navigation,
    gps_s: Floats,
    user_m: Floats,
    clock_m: Floats,
    *,
    bias_m: dict[int, float] | None = None,
    lowest_rad: float = 0.0,
) -> RawGnss:
    """What a receiver at ``user_m`` (m, 3), whose clock is ahead by ``clock_m`` (m,), measures without an atmosphere.

    Its time tags ``gps_s`` (m,) are by its own clock. ``bias_m`` by system is added. Range rates are those of a user
    at rest and a clock without drift.
    """
    eph, moving = navigation.kepler, navigation.glonass
    system = np.concatenate([eph.system, np.full(len(moving), GLONASS)])
    number = np.concatenate([eph.number, moving.number])
    parts: dict[str, list[Any]] = {
        name: [] for name in ("gps_s", "system", "number", "range", "rate", "carrier")
    }
    for tag, place, clock in zip(gps_s, user_m, clock_m, strict=True):
        true_s = tag - clock / LIGHT_MPS
        flight_s = np.full(len(system), 0.075)
        for _ in range(6):
            sky = states_at(navigation, system, number, true_s - flight_s)
            there = turned_by_earth(sky.position_m, flight_s)
            far = np.linalg.norm(there - place, axis=1)
            flight_s = far / LIGHT_MPS
        elevation, _ = elevation_azimuth(place, there)
        seen = elevation > lowest_rad
        moves = np.sum(turned_by_earth(sky.velocity_mps, flight_s) * (there - place), axis=1) / far
        bias = np.array([(bias_m or {}).get(int(s), 0.0) for s in system])
        columns = (
            np.full(len(system), tag), system, number, far + clock + bias - LIGHT_MPS * sky.clock_s,
            moves - LIGHT_MPS * sky.clock_rate, sky.carrier_hz,
        )  # fmt: skip
        for name, column in zip(parts, columns, strict=True):
            parts[name].append(column[seen])
    whole = {name: np.concatenate(column) for name, column in parts.items()}
    signals = Signals.assemble(
        whole["gps_s"], whole["system"], whole["number"], pseudorange_m=whole["range"],
        range_rate_mps=whole["rate"], frequency_hz=whole["carrier"], cn0_dbhz=np.full(len(whole["range"]), 45.0),
    )  # fmt: skip
    return RawGnss(signals, navigation)


def with_clock_steps(raw: RawGnss, steps_m: Floats) -> RawGnss:
    """The same with ``steps_m`` (m,) added to all pseudoranges of an epoch; time tags as they were."""
    signals = raw.signals
    stepped = replace(signals, pseudorange_m=signals.pseudorange_m + steps_m[signals.epoch])
    return replace(raw, signals=stepped)
