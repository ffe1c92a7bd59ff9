"""An elevation model that stands out from itself is named, and an ordinary one is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factor_support import Sensors, street
from fusion.network.adjust import adjust
from fusion.network.terrain import Terrain, displaced
from street_support import height_at, knots_m, ride

STREET = street(*[60.0] * 40)
ORDINARY = Sensors(0.03, altitude_m=0.5)


@given(
    level_m=st.floats(-100, 100), off_m=st.floats(20, 200), high=st.booleans(), seed=st.integers(0, 2**32 - 1)
)
def test_what_stands_out_is_named_whatever_the_datum(
    level_m: float, off_m: float, high: bool, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    wrong = np.arange(100) < 30
    off_m = off_m if high else -off_m
    noise_m = np.clip(rng.normal(size=100), -3, 3)  # one of four metres stands out of 20 no more than of 15
    found = displaced(level_m + np.where(wrong, off_m, 0.0) + noise_m, np.full(100, 20.0))
    assert found is not None
    assert np.array_equal(found.where, wrong)
    assert found.off_m == pytest.approx(off_m, abs=1.3)
    assert found.length_m == pytest.approx(600)
    assert ("high" if high else "low") in found.said(49.0, 8.5)


@given(sigma_m=st.floats(0.1, 10), seed=st.integers(0, 2**32 - 1))
def test_ordinary_errors_are_not(sigma_m: float, seed: int) -> None:
    """Those of a coarse model hang together over hundreds of metres."""
    rng, error = np.random.default_rng(seed), np.zeros(200)
    for k in range(1, len(error)):
        error[k] = 0.94 * error[k - 1] + sigma_m * np.sqrt(1 - 0.94**2) * rng.normal()
    if np.abs(error - np.median(error)).max() > 4 * 1.4826 * np.median(np.abs(error - np.median(error))):
        return
    assert displaced(error, np.full(len(error), 20.0)) is None


def test_a_cutting_is_not() -> None:
    above = np.where(np.arange(100) < 4, 20.0, 0.0)
    assert displaced(above, np.full(100, 20.0)) is None
    assert displaced(np.empty(0), np.empty(0)) is None


def test_the_network_names_a_segment() -> None:
    at = knots_m(STREET)
    model = height_at(at) + 48 + np.where((at > 1000) & (at < 1500), 30.0, 0.0)
    found = adjust(STREET, {0: ride(STREET, ORDINARY, 1)}, Terrain(model)).model
    assert found is not None
    (said,) = found.remarks(STREET)
    assert said.startswith("The elevation model is about ")
    assert found.displaced is not None
    row, worst = found.displaced
    assert worst.off_m == pytest.approx(30, abs=2)
    assert worst.length_m == pytest.approx(500, abs=60)
    assert 950 < 60.0 * row < 1500
    assert f"{STREET.lat0_deg[row]:.5f}, {STREET.lon0_deg[row]:.5f}" in said


def test_drives_on_two_datums_are_not_a_wrong_model() -> None:
    """An ellipsoid is 48 m above the sea: roads that do not hang together have no common level."""
    parts = {0: ride(STREET, ORDINARY, 1, range(18)), 1: ride(STREET, ORDINARY, 2, range(22, 40))}
    lifted = height_at(knots_m(STREET)) + np.where(knots_m(STREET) > 1200, 48.0, 0.0)
    found = adjust(STREET, parts, Terrain(lifted)).model
    assert found is not None
    assert found.remarks(STREET) == []


def test_a_model_that_is_off_where_nobody_drove_bends_no_road() -> None:
    """Behind the edge its heights would pull all roads that they hang on."""
    at, changed = knots_m(STREET), []
    for seed in range(3):
        drives = {0: ride(STREET, ORDINARY, seed, range(30))}
        right, wrong = (
            adjust(STREET, drives, Terrain(height_at(at) + up))
            for up in (0.0, np.where(at > 2000, 30.0, 0.0))
        )
        changed.append((wrong.slope_percent - right.slope_percent)[:30] / right.slope_sigma_percent[:30])
    assert np.abs(changed).max() < 0.2
