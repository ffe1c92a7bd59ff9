"""Clocks that jump by milliseconds are made continuous; no other change is taken for one, and new clocks are marked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.gnss.clock_jumps import STEP_M, ClockJumps, find_clock_jumps
from fusion.types import Floats

SATELLITES = 8


def found_in(times: Floats, clock_m: Floats, *, seed: int = 0, seen: float = 0.8) -> ClockJumps:
    """Jumps found where satellites with offsets and noise of streets, each seen by chance, show a clock."""
    rng = np.random.default_rng(seed)
    there = rng.random((len(times), SATELLITES)) < seen
    there[:, :4] |= there.sum(axis=1, keepdims=True) < 4
    offset = rng.normal(0.0, 30.0, SATELLITES)
    excess = (
        clock_m[:, None] + offset + rng.normal(0.0, 10.0, there.shape) + rng.exponential(15.0, there.shape)
    )
    first = np.append(0, np.cumsum(there.sum(axis=1)))
    return find_clock_jumps(times, first, np.nonzero(there)[1], excess[there])


@given(
    st.integers(0, 10_000),
    st.dictionaries(st.integers(2, 118), st.sampled_from([-3, -2, -1, 1, 2, 7]), max_size=9),
    st.floats(-900.0, 900.0),
)
def test_jumps_at_any_epochs_are_found_and_taken_off(seed: int, jumps: dict[int, int], drift: float) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.2, 1.0, 1.0, 5.0, 25.0], 120))
    steps = np.zeros(120)
    for epoch, whole in jumps.items():
        steps[epoch:] += whole * STEP_M
    found = found_in(times, drift * times + steps, seed=seed)
    assert found.jumps == len(jumps)
    assert not found.anew.any()
    assert np.allclose(found.step_m, steps, atol=1e-6)


@pytest.mark.parametrize("every_s", [3.0, 7.0, 20.0])
def test_a_sawtooth_is_a_drift_with_jumps(every_s: float) -> None:
    times = np.arange(0.0, 100.0)
    drift = STEP_M / every_s
    saw = drift * times - STEP_M * np.floor(times / every_s)
    found = found_in(times, saw)
    assert not found.anew.any()
    left = np.diff(saw - found.step_m)
    assert np.allclose(left, left[0], atol=1e-3)


@pytest.mark.parametrize("drift", [0.0, 300.0, -2_000.0])
def test_a_drift_is_no_jump(drift: float) -> None:
    times = np.arange(0.0, 600.0)
    found = found_in(times, drift * times + 0.02 * times**2)
    assert found.jumps == 0
    assert not found.anew.any()
    assert np.all(found.step_m == 0.0)


def test_a_restart_is_a_new_clock() -> None:
    times = np.arange(0.0, 60.0)
    clock = np.where(times < 30, 40.0 * times, 1_234_567.0 + 40.0 * times)
    found = found_in(times, clock)
    assert found.jumps == 0
    assert np.flatnonzero(found.anew).tolist() == [30]
    assert found.step_m[-1] == pytest.approx(1_234_567.0, abs=60.0)


def test_after_an_hour_without_signals_milliseconds_are_in_doubt() -> None:
    times = np.append(np.arange(0.0, 60.0), 3_700.0 + np.arange(60.0))
    found = found_in(times, 250.0 * times + np.where(times > 3_000, 3 * STEP_M, 0.0))
    assert np.flatnonzero(found.anew).tolist() == [60]
    left = 250.0 * times + np.where(times > 3_000, 3 * STEP_M, 0.0) - found.step_m
    assert np.abs(np.diff(left))[:59].max() < 300.0
    assert abs(left[60] - left[59] - 250.0 * 3_641.0) < 100.0 * 3_641.0


def test_a_jump_during_a_minute_without_signals_is_known() -> None:
    times = np.append(np.arange(0.0, 60.0), 120.0 + np.arange(60.0))
    steps = np.where(times > 100, -2 * STEP_M, 0.0)
    found = found_in(times, 250.0 * times + steps)
    assert found.jumps == 1
    assert np.allclose(found.step_m, steps)


def test_what_one_satellite_does_is_no_jump_of_the_clock() -> None:
    times = np.arange(0.0, 40.0)
    excess = np.zeros((40, 6))
    excess[20:, 2] += STEP_M
    found = find_clock_jumps(times, np.arange(41) * 6, np.tile(np.arange(6), 40), excess.ravel())
    assert found.jumps == 0
    assert not found.anew.any()
    assert np.all(found.step_m == 0.0)


def test_epochs_without_rows_keep_the_steps_before() -> None:
    counts = np.array([4, 4, 0, 4, 0])
    clock = np.array([0.0, 0.0, 0.0, STEP_M, 0.0])
    rows = np.repeat(np.arange(5), counts)
    found = find_clock_jumps(
        np.arange(5.0), np.append(0, np.cumsum(counts)), np.arange(len(rows)) % 4, clock[rows]
    )
    assert found.step_m.tolist() == [0.0, 0.0, 0.0, STEP_M, STEP_M]
    nothing = find_clock_jumps(np.arange(3.0), np.zeros(4, np.int64), np.empty(0, np.int64), np.empty(0))
    assert nothing.jumps == 0
