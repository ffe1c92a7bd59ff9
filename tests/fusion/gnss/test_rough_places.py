"""Places from nothing: anywhere on earth, with reflected and wrong signals, and none where there can be none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.gnss.earth import ecef
from fusion.gnss.orbits.satellites import states_when_sent
from fusion.gnss.rough_places import rough_places, solve_place
from fusion.signals import GALILEO, GPS, LIGHT_MPS
from fusion.types import Floats, Ints
from gnss_support import TOE_S, even_sky, measured

SKY = even_sky(GPS, GALILEO)


def seen_from(place: Floats, gps_s: Floats, clock_m: float = 2e4) -> tuple[Ints, Floats, Floats, Ints]:
    """First rows, pseudoranges free of satellite clocks, satellites, and groups."""
    places = np.broadcast_to(place, (len(gps_s), 3))
    signals = measured(
        SKY, gps_s, places, np.full(len(gps_s), clock_m), bias_m={GALILEO: 60.0}, lowest_rad=0.1
    ).signals
    states = states_when_sent(
        SKY, signals.system, signals.number, signals.gps_s[signals.epoch], signals.pseudorange_m
    )
    free = signals.pseudorange_m + LIGHT_MPS * states.clock_s
    return signals.first, free, states.position_m, (signals.system == GALILEO).astype(np.int64)


@settings(deadline=None, max_examples=40)
@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.floats(-400.0, 9_000.0), st.floats(-3e6, 3e6))
def test_a_place_anywhere_on_earth_with_any_clock(
    lat: float, lon: float, height: float, clock: float
) -> None:
    place = ecef(np.array([lon]), np.array([lat]), np.array([height]))[0]
    _, pseudorange, satellite, group = seen_from(place, np.array([TOE_S + 900.0]), clock)
    found = solve_place(pseudorange, satellite, group)
    assert found is not None
    assert np.linalg.norm(found - place) < 1.0


PLACE = ecef(np.array([114.2]), np.array([22.3]), np.array([20.0]))[0]


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=40)
def test_reflected_and_wrong_signals_do_not_carry_it_away(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, pseudorange, satellite, group = seen_from(PLACE, np.array([TOE_S]))
    late = rng.choice(len(group), len(group) // 3, replace=False)
    pseudorange[late] += rng.exponential(80.0, len(late))
    pseudorange[late[0]] += rng.choice([-3e5, 3e6])
    found = solve_place(pseudorange, satellite, group)
    assert found is not None
    assert np.linalg.norm(found - PLACE) < 300.0


def test_too_few_or_nonsense_give_none() -> None:
    _, pseudorange, satellite, group = seen_from(PLACE, np.array([TOE_S]))
    assert solve_place(pseudorange[:3], satellite[:3], group[:3]) is None
    nonsense = np.random.default_rng(1).uniform(2e7, 4e7, len(group))
    assert solve_place(nonsense, satellite, group) is None


def test_a_single_satellite_of_another_system_does_no_harm() -> None:
    _, pseudorange, satellite, group = seen_from(PLACE, np.array([TOE_S]))
    some = np.append(np.flatnonzero(group == 0), np.flatnonzero(group == 1)[0])
    found = solve_place(pseudorange[some], satellite[some], group[some])
    assert found is not None
    assert np.linalg.norm(found - PLACE) < 100.0


def test_places_between_are_interpolated_and_wild_ones_left_out() -> None:
    gps_s = TOE_S + np.arange(0.0, 600.0, 20.0)
    first, pseudorange, satellite, group = seen_from(PLACE, gps_s)
    other = seen_from(ecef(np.array([13.4]), np.array([52.5]), np.array([50.0]))[0], gps_s[9:12])
    rows = slice(first[9], first[12])
    keep = np.ones(len(group), bool)
    keep[rows] = False
    counts = np.diff(first)
    counts[9:12] = np.diff(other[0])
    joined = [np.concatenate([own[: rows.start], new, own[rows.stop :]]) for own, new in
              zip((pseudorange, satellite, group), other[1:], strict=True)]  # fmt: skip
    places = rough_places(gps_s, np.append(0, np.cumsum(counts)), joined[2], joined[0], joined[1])
    assert np.linalg.norm(places - PLACE, axis=1).max() < 10.0


@pytest.mark.parametrize("rows", [0, 3])
def test_without_satellites_there_is_no_place(rows: int) -> None:
    places = rough_places(
        np.array([TOE_S]),
        np.array([0, rows]),
        np.zeros(rows, np.int64),
        np.full(rows, 2e7),
        np.ones((rows, 3)),
    )
    assert np.isnan(places).all()
