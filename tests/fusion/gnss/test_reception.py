"""Reception states: thresholds, and the chain against a plain recount and against its law."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from fusion.gnss.reception import (
    BLOCKED,
    LOS,
    NLOS,
    open_sky_dbhz,
    smoothed,
    states_by_epoch,
    states_by_threshold,
)
from gnss_scene import scene

STATES = npst.arrays(np.int64, st.integers(1, 60), elements=st.integers(0, 2))


def transitions(states: np.ndarray, pseudo_count: float) -> np.ndarray:
    """The matrix (3, 3) of P(next = y | now = x), rows x, counted over states (t,) with ``pseudo_count`` added."""
    counts = np.full((3, 3), pseudo_count)
    for x, y in pairwise(states):
        counts[x, y] += 1.0
    return np.asarray(counts / counts.sum(axis=1, keepdims=True))


def test_the_threshold_itself_is_line_of_sight_and_nothing_is_blocked() -> None:
    states = states_by_threshold(np.array([np.nan, 39.99, 40.0, 55.0]), 40.0)
    assert states.tolist() == [BLOCKED, NLOS, LOS, LOS]


def test_the_line_of_the_open_sky_goes_through_the_print() -> None:
    degrees = np.array([0.0, 18.0, 59.0, 90.0])
    assert open_sky_dbhz(np.radians(degrees)) == pytest.approx([41.25, 42.32, 48.95, 49.7])


def test_states_by_epoch_are_blocked_where_nothing_is_measured() -> None:
    drawn = scene(epochs=5)
    states = states_by_epoch(drawn.measured, 40.0)
    counts = np.bincount(drawn.measured.epoch, minlength=5)
    assert (states != BLOCKED).sum(axis=1).tolist() == counts.tolist()


def test_a_pseudorange_without_strength_is_taken_for_reflected() -> None:
    drawn = scene(epochs=3, cn0_dbhz=np.nan)
    assert set(np.unique(states_by_epoch(drawn.measured, None))) <= {BLOCKED, NLOS}


@given(STATES, st.floats(0.5, 30.0), st.floats(0.01, 5.0))
def test_the_chain_is_the_plain_recount(states: np.ndarray, window_s: float, pseudo: float) -> None:
    time_s = np.arange(len(states), dtype=float)
    chain = smoothed(states, time_s, window_s, pseudo)
    first = states[time_s < window_s]
    share = np.array([np.mean(first == x) for x in range(3)])
    for t in range(len(states)):
        inside = states[(time_s <= t) & (time_s >= t - window_s)]
        share = transitions(inside, pseudo).T @ share
        assert chain.probability[t] == pytest.approx(share, abs=1e-12)
        assert share[chain.state[t]] == pytest.approx(share.max(), rel=1e-9)


@given(STATES)
def test_probabilities_stay_such(states: np.ndarray) -> None:
    chain = smoothed(states, np.arange(len(states)) * 0.2)
    assert np.all(chain.probability >= 0)
    assert chain.probability.sum(axis=1) == pytest.approx(np.ones(len(states)))


def test_one_weak_epoch_does_not_change_the_most_probable_state() -> None:
    states = np.full(60, LOS)
    states[45] = NLOS
    assert np.all(smoothed(states, np.arange(60.0)).state == LOS)
