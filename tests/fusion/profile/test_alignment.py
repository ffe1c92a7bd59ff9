"""The lag of inertial data and the yaw of their sensor are found where they are, and nothing where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.profile.blocks import NOTHING, Estimate
from fusion.profile.inertia import (
    BLOCK_S,
    LONGEST_LAG_S,
    MIN_SPEED_MPS,
    Signal,
    changes_of,
    mount_yaw,
    time_lag,
)
from inertia_support import START_S, Ride, ride

SEEDS = st.integers(0, 1000)


def lag_of(one: Ride) -> Estimate:
    changes = one.changes()
    return time_lag(changes, one.cues(changes))


def yaw_of(one: Ride) -> Estimate:
    """In degrees."""
    value, sigma = mount_yaw(one.changes(), *one.forces())
    return Estimate(float(np.degrees(value)), float(np.degrees(sigma)))


@given(SEEDS, st.floats(-0.5, 0.5))
@settings(max_examples=15)
def test_a_lag_is_found_to_20_ms(seed: int, lag_s: float) -> None:
    found = lag_of(ride(seed, lag_s=lag_s))
    assert found.value == pytest.approx(lag_s, abs=0.02)
    assert found.sigma < 0.015


@given(SEEDS, st.floats(-0.4, 0.4))
@settings(max_examples=8)
def test_samples_once_a_second_show_it_too(seed: int, lag_s: float) -> None:
    found = lag_of(ride(seed, lag_s=lag_s, inertial_hz=1.0, duration_s=1200.0))
    assert found.value == pytest.approx(lag_s, abs=0.06)


@pytest.mark.slow
@given(SEEDS, st.floats(-20, 20))
@settings(max_examples=15)
def test_a_yaw_is_found_to_half_a_degree(seed: int, yaw_deg: float) -> None:
    """Squat, roll and hills beside it."""
    found = yaw_of(ride(seed, yaw_deg=yaw_deg, duration_s=1200.0))
    assert found.value == pytest.approx(yaw_deg, abs=max(0.5, 3.5 * found.sigma))
    assert found.sigma < 0.35


@pytest.mark.slow
@pytest.mark.parametrize(
    ("estimate", "lag_s", "yaw_deg", "true"), [(lag_of, 0.1, 3.0, 0.1), (yaw_of, 0.0, 3.0, 3.0)]
)
def test_sigmas_are_those_of_the_errors(
    estimate: Callable[[Ride], Estimate], lag_s: float, yaw_deg: float, true: float
) -> None:
    rides = [ride(n, lag_s=lag_s, yaw_deg=yaw_deg, duration_s=300.0, noise=2.0) for n in range(60)]
    found = np.array([estimate(one) for one in rides])
    z = (found[:, 0] - true) / found[:, 1]
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.4


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_wrong() -> None:
    """Of sixty rides at most one has a lag or a yaw that would be set right."""
    rides = [ride(seed, duration_s=240.0) for seed in range(60)]
    assert sum(lag_of(r).with_floor(0.01).worth(0.2) != 0 for r in rides) <= 1
    assert sum(yaw_of(r).with_floor(0.25).worth(5.0, 4.0) != 0 for r in rides) <= 1


def with_faults(one: Ride, rng: np.random.Generator) -> Ride:
    """Holes of GNSS and of the inertial sensor, kerbs, and velocities that are far off."""
    north, forward, left = one.north_mps.copy(), one.forward_mps2.copy(), one.left_mps2.copy()
    north[200:260] = np.nan
    north[rng.choice(len(north), 12)] += rng.normal(size=12) * 8
    for force in (forward, left):
        force[rng.choice(len(force), 60)] += 8 * rng.normal(size=60)
    keep = np.ones(len(forward), bool)
    for start in rng.choice(len(forward), 8):
        keep[start : start + 70] = False
    samples = {
        name: value[keep]
        for name, value in (
            ("inertial_s", one.inertial_s),
            ("forward_mps2", forward),
            ("left_mps2", left),
            ("turning_radps", one.turning_radps),
        )
    }
    return replace(one, north_mps=north, **samples)


@pytest.mark.slow
def test_holes_and_wild_values_do_little_harm() -> None:
    """A law of chance: of two hundred such rides one had a yaw that was more than four sigmas off."""
    off = 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        lag_s, yaw_deg = rng.uniform(-0.4, 0.4), rng.uniform(-10, 10)
        found = lag_of(with_faults(ride(seed, lag_s=lag_s), rng))
        assert found.value == pytest.approx(lag_s, abs=max(0.03, 4 * found.sigma))
        assert found.sigma < 0.05
        found = yaw_of(with_faults(ride(seed, yaw_deg=yaw_deg), rng))
        off += abs(found.value - yaw_deg) > max(1.0, 4 * found.sigma)
    assert off <= 1


def test_a_lag_beyond_the_search_is_no_lag() -> None:
    assert lag_of(ride(0, lag_s=LONGEST_LAG_S + 0.4)) == NOTHING


def test_signals_that_contradict_each_other_are_not_sure() -> None:
    early, late = ride(0, lag_s=-0.3), ride(0, lag_s=0.3)
    assert lag_of(replace(early, turning_radps=late.turning_radps)).sigma > 0.1


def test_a_short_or_slow_ride_says_nothing() -> None:
    short = ride(0, lag_s=0.3, duration_s=4 * BLOCK_S)
    slow = ride(0, lag_s=0.3)
    slow = replace(slow, north_mps=0.1 * slow.north_mps, east_mps=0.1 * slow.east_mps)
    for one in (short, slow):
        assert lag_of(one) == NOTHING
        assert yaw_of(one).sigma == np.inf


def test_without_samples_there_is_nothing() -> None:
    none = np.empty(0)
    changes = changes_of(none, none, none, none)
    assert len(changes) == 0
    assert time_lag(changes, []) == NOTHING
    assert mount_yaw(ride(0).changes(), Signal(none, none), Signal(none, none)) == NOTHING


def test_changes_stop_at_holes_and_where_the_vehicle_is_slow() -> None:
    time = START_S + np.arange(60.0)
    speed = np.where(np.arange(60) < 30, 10.0, 1.0)
    time[10:] += 20
    changes = changes_of(time, np.zeros(60), speed, np.full(60, np.nan))
    assert np.all(changes.end_s - changes.begin_s == pytest.approx(1.0))
    assert np.all(changes.speed_mps > MIN_SPEED_MPS)
    assert len(changes) == 28
    assert np.all(changes.gravity_mps == 0)
