"""The synthetic sky: orbits that keep their laws, records that agree with each other, honest geometry."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.gnss.earth import EARTH_RATE_RADPS, ecef
from fusion.gnss.orbits.kepler import kepler_states
from fusion.published.canyon.sky import CONSTELLATIONS, look_up, names_of, synthetic_navigation
from fusion.signals import BEIDOU, GALILEO, GPS, LIGHT_MPS, WEEK_S

START = 1_300_000_000.0
HERE = ecef(np.array([1.09]), np.array([49.44]), np.array([60.0]))


def test_satellites_keep_their_distance_and_period() -> None:
    kepler = synthetic_navigation(START, 600.0, np.random.default_rng(1)).kepler
    for system, pattern in CONSTELLATIONS.items():
        rows = np.flatnonzero(kepler.system == system)[:40]
        place, *_ = kepler_states(kepler, rows, np.full(len(rows), START))
        radius = np.linalg.norm(place, axis=1)
        assert np.all(np.abs(radius / pattern.semi_major_m - 1) < 0.011)
        assert np.all(np.abs(np.arcsin(place[:, 2] / radius)) < np.radians(pattern.inclination_deg + 3))


def test_two_records_of_one_satellite_agree() -> None:
    kepler = synthetic_navigation(START, 3600.0, np.random.default_rng(2)).kepler
    first = np.flatnonzero(np.diff(kepler.number) == 0)
    at = kepler.toe_s[first] + 1800.0
    here, _, clock, _ = kepler_states(kepler, first, at)
    there, _, clock_there, _ = kepler_states(kepler, first + 1, at)
    np.testing.assert_allclose(here, there, atol=1e-3)
    np.testing.assert_allclose(clock, clock_there, atol=1e-13)


@pytest.mark.parametrize("before_s", (900.0, -4000.0))
def test_records_agree_across_the_week(before_s: float) -> None:
    start = np.ceil(START / WEEK_S) * WEEK_S - before_s
    kepler = synthetic_navigation(start, 7200.0, np.random.default_rng(3)).kepler
    first = np.flatnonzero(np.diff(kepler.number) == 0)
    here, *_ = kepler_states(kepler, first, kepler.toe_s[first + 1])
    there, *_ = kepler_states(kepler, first + 1, kepler.toe_s[first + 1])
    np.testing.assert_allclose(here, there, atol=1e-3)


def test_light_arrives_when_it_is_received() -> None:
    """In a frame that does not turn, the path at the two moments is as long as light needs."""
    navigation = synthetic_navigation(START, 60.0, np.random.default_rng(4))
    times = START + np.arange(5.0)
    sky = look_up(navigation, times, np.repeat(HERE, 5, axis=0))
    distance = np.linalg.norm(sky.satellite_m - HERE, axis=1)
    flight = distance / LIGHT_MPS

    def inertial(place: np.ndarray, time: np.ndarray) -> np.ndarray:
        angle = EARTH_RATE_RADPS * (time - START)
        x, y, z = place.T
        return np.column_stack(
            [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z]
        )

    received = times[sky.epoch]
    path = inertial(sky.sent_m, received - flight) - inertial(np.repeat(HERE, len(distance), 0), received)
    np.testing.assert_allclose(np.linalg.norm(path, axis=1), distance, atol=2e-3)
    assert len(sky.first) == 6
    assert np.all(sky.elevation_rad >= np.radians(5))


def test_velocity_is_the_rate_of_position() -> None:
    navigation = synthetic_navigation(START, 60.0, np.random.default_rng(5), (GPS,))
    sky = look_up(navigation, START + np.array([0.0, 2.0]), np.repeat(HERE, 2, axis=0))
    half = sky.first[1]
    moved = (sky.sent_m[half:] - sky.sent_m[:half]) / 2.0
    mean = 0.5 * (sky.sent_mps[half:] + sky.sent_mps[:half])
    np.testing.assert_allclose(moved, mean, atol=0.01)


def test_a_sky_has_as_many_satellites_as_a_real_one() -> None:
    navigation = synthetic_navigation(START, 60.0, np.random.default_rng(6))
    sky = look_up(navigation, np.array([START]), HERE)
    for system in (GPS, GALILEO, BEIDOU):
        assert 5 <= np.sum(sky.system == system) <= 12
    names, place = names_of(sky.system, sky.number)
    assert names[0].startswith("G")
    assert len(set(names)) == len(names) == place.max() + 1


def test_a_seed_makes_one_sky() -> None:
    one, same, other = (synthetic_navigation(START, 60.0, np.random.default_rng(s)).kepler for s in (7, 7, 8))
    np.testing.assert_array_equal(one.m0_rad, same.m0_rad)
    assert not np.array_equal(one.m0_rad, other.m0_rad)
