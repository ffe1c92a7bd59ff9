"""When resampling is due: every trigger, and the two measures that they look at."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.errors import UnknownNameError
from fusion.filters.triggers import TRIGGERS, Trigger
from weight_support import effective_number, entropy

weights = st.lists(st.floats(0, 1), min_size=1, max_size=40).filter(lambda w: sum(w) > 1e-6)


def due(trigger: Trigger, w: np.ndarray) -> bool:
    return trigger.due(effective_number(w), entropy(w), len(w), trigger.default_threshold)


@given(weights=weights)
def test_both_measures_keep_to_their_ranges(weights: list[float]) -> None:
    w = np.array(weights) / np.sum(weights)
    assert 1 - 1e-9 <= effective_number(w) <= len(w) + 1e-9
    assert -1e-9 <= entropy(w) <= math.log(len(w)) + 1e-9


def test_both_measures_at_their_ends() -> None:
    equal, alone = np.full(50, 1 / 50), np.eye(50)[17]
    assert (effective_number(equal), entropy(equal)) == pytest.approx((50.0, 0.0))
    assert (effective_number(alone), entropy(alone)) == pytest.approx((1.0, math.log(50)))
    half = np.array([0.5, 0.5, 0.0, 0.0])
    assert (effective_number(half), entropy(half)) == pytest.approx((2.0, math.log(2)))


@pytest.mark.parametrize("name", list(TRIGGERS))
def test_every_trigger_keeps_the_contract(name: str) -> None:
    trigger = TRIGGERS[name]
    assert trigger.name == name
    assert trigger.description.endswith(".")
    equal, alone = np.full(50, 1 / 50), np.eye(50)[17]
    assert due(trigger, equal) is False
    assert due(trigger, alone) is (name != "never")
    assert due(trigger, np.ones(1)) is False


def test_thresholds_work_as_the_thesis_says() -> None:
    n_eff, by_entropy = TRIGGERS["n_eff"].due, TRIGGERS["entropy"].due
    assert n_eff(66.0, 0.0, 100, 2 / 3)
    assert not n_eff(67.0, 0.0, 100, 2 / 3)
    assert by_entropy(100.0, 0.21, 100, 0.2)
    assert not by_entropy(1.0, 0.19, 100, 0.2)
    assert not TRIGGERS["never"].due(1.0, math.log(100), 100, 0.0)


def test_the_default_of_the_entropy_is_where_two_thirds_are_effective() -> None:
    """Of log-normal weights with variance s^2: N_eff = N exp(-s^2) and S_w = s^2 / 2."""
    spread = math.sqrt(-math.log(TRIGGERS["n_eff"].default_threshold))
    w = np.exp(spread * np.random.default_rng(1).normal(size=1_000_000))
    w /= w.sum()
    assert effective_number(w) / len(w) == pytest.approx(2 / 3, abs=0.01)
    assert entropy(w) == pytest.approx(TRIGGERS["entropy"].default_threshold, abs=0.01)


def test_an_unknown_trigger_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="n_eff, entropy, never"):
        TRIGGERS["sometimes"]
