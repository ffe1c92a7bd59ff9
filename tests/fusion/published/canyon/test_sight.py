"""Rays between fronts: properties that hold for any town, and detours against mirror images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.gnss.reception import BLOCKED, LOS, NLOS
from fusion.published.canyon.fronts import NO_FRONTS, Fronts
from fusion.published.canyon.sight import Sight, trace

ANTENNA = np.array([[0.0, 0.0, 1.5]])
AT_REST = np.zeros((1, 3))


def a_town(seed: int, count: int = 25) -> Fronts:
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-120, 120, (count, 2))
    middle = middle[np.hypot(*middle.T) > 8.0]
    angle, half = rng.uniform(0, np.pi, len(middle)), rng.uniform(2, 7.5, len(middle))
    reach = half[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    tops = rng.uniform(3, 35, len(middle))
    return Fronts(np.column_stack([middle - reach, middle + reach]), tops, np.full(len(middle), 9.0))


def seen(fronts: Fronts, elevation_deg: np.ndarray, azimuth_deg: np.ndarray) -> Sight:
    elevation, azimuth = np.radians(np.atleast_1d(elevation_deg)), np.radians(np.atleast_1d(azimuth_deg))
    epoch = np.zeros(len(elevation), np.int64)
    return trace(fronts, epoch, ANTENNA, AT_REST, elevation.astype(float), azimuth.astype(float))


def two_fronts(left_m: float, right_m: float, left_top: float, right_top: float) -> Fronts:
    """A street from south to north with one long front on either side."""
    ends = [[-left_m, -500.0, -left_m, 500.0], [right_m, -500.0, right_m, 500.0]]
    return Fronts(np.array(ends), np.array([left_top, right_top]), np.full(2, 9.0))


rays = st.tuples(st.floats(3.0, 89.9), st.floats(0.0, 359.9))


@given(st.integers(0, 200), rays)
def test_above_all_roofs_every_ray_is_direct(seed: int, ray: tuple[float, float]) -> None:
    fronts = a_town(seed)
    low = Fronts(fronts.ends_m, np.full(len(fronts), 1.4), fronts.loss_db)
    sight = seen(low, np.array([ray[0]]), np.array([ray[1]]))
    assert sight.state[0] == LOS
    assert sight.front[0] == -1


@given(st.integers(0, 200), rays, st.floats(0.1, 30.0))
def test_higher_houses_open_no_sight(seed: int, ray: tuple[float, float], by_m: float) -> None:
    fronts = a_town(seed)
    before = seen(fronts, np.array([ray[0]]), np.array([ray[1]])).state[0]
    after = seen(replace(fronts, top_m=fronts.top_m + by_m), np.array([ray[0]]), np.array([ray[1]])).state[0]
    assert before == LOS or after != LOS


@given(st.integers(0, 200))
@settings(max_examples=30)
def test_a_detour_is_the_way_to_the_mirror_image(seed: int) -> None:
    fronts = a_town(seed)
    rng = np.random.default_rng(seed)
    elevation, azimuth = rng.uniform(5, 80, 40), rng.uniform(0, 360, 40)
    sight = seen(fronts, elevation, azimuth)
    el, az = np.radians(elevation), np.radians(azimuth)
    far = 2e7 * np.column_stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)])
    for k in np.flatnonzero(sight.front >= 0):
        x0, y0, x1, y1 = fronts.ends_m[sight.front[k]]
        normal = np.array([y1 - y0, x0 - x1, 0.0])
        normal /= np.linalg.norm(normal)
        image = ANTENNA[0] + 2 * np.dot(np.array([x0, y0, 1.5]) - ANTENNA[0], normal) * normal
        longer = np.linalg.norm(far[k] - image) - np.linalg.norm(far[k] - ANTENNA[0])
        np.testing.assert_allclose(sight.detour_m[k], longer, atol=2e-3)  # the satellite is not at infinity
        assert sight.detour_m[k] > 0


@given(st.floats(3.0, 40.0), st.floats(2.0, 70.0), st.floats(181.0, 359.0))
def test_nothing_is_reflected_without_a_front_on_the_other_side(
    away_m: float, elevation: float, azimuth: float
) -> None:
    """The satellite stands in the west, and only the west has a front."""
    one = Fronts(np.array([[-away_m, -500.0, -away_m, 500.0]]), np.array([25.0]), np.array([9.0]))
    sight = seen(one, np.array([elevation]), np.array([azimuth]))
    assert sight.state[0] in {LOS, BLOCKED}
    assert np.isnan(sight.detour_m[0])


def test_states_of_a_street_by_hand() -> None:
    """West front 10 m off and 21.5 high: it hides what is lower than 63.4 degrees; the east front mirrors that."""
    fronts = two_fronts(10.0, 10.0, 21.5, 21.5)
    sight = seen(fronts, np.array([64.0, 63.0, 33.0, 34.5, 20.0]), np.full(5, 270.0))
    assert sight.state.tolist() == [LOS, NLOS, BLOCKED, NLOS, BLOCKED]
    np.testing.assert_allclose(sight.detour_m[1], 2 * 10 * np.cos(np.radians(63.0)), rtol=1e-12)
    assert sight.front[1] == 1
    assert seen(fronts, np.array([90.0]), np.array([0.0])).state[0] == LOS


def test_a_low_front_reflects_nothing_from_below_the_other_roof() -> None:
    fronts = two_fronts(10.0, 10.0, 21.5, 4.0)
    assert seen(fronts, np.array([63.0]), np.array([270.0])).state[0] == BLOCKED


def test_the_rate_is_how_the_detour_changes() -> None:
    fronts = two_fronts(12.0, 9.0, 30.0, 30.0)
    speed = np.array([[1.5, 9.0, 0.2]])
    where = [ANTENNA + speed * dt for dt in (-0.01, 0.0, 0.01)]
    el, az = np.radians(np.array([55.0])), np.radians(np.array([250.0]))
    before, now, after = (trace(fronts, np.zeros(1, np.int64), at, speed, el, az) for at in where)
    rate = (after.detour_m - before.detour_m) / 0.02
    np.testing.assert_allclose(now.detour_mps, rate, rtol=1e-9)
    assert now.front[0] == 1


def test_without_fronts_all_is_direct() -> None:
    sight = seen(NO_FRONTS, np.array([5.0, 50.0]), np.array([10.0, 200.0]))
    assert sight.state.tolist() == [LOS, LOS]
