"""Windows of residuals and the components that particles draw."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.published.positioning.jms_gmm import Windows, draw_components, printed, push, sample_of


def empty(satellites: int = 2, room: int = 50) -> Windows:
    zero = np.zeros(satellites, np.int64)
    pairs = np.zeros((satellites, room))
    return Windows(pairs, pairs.copy(), zero, zero.copy(), np.zeros((satellites, 3, 2)))


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(1, 30))
def test_a_window_holds_what_is_not_too_old(seen: list[bool], window_s: int) -> None:
    windows, kept = empty(room=window_s + 1), []
    for t, here in enumerate(seen):
        value = 3.0 * t if here else np.nan
        push(windows, np.array([1]), np.array([value]), float(t), float(t - window_s))
        if here:
            kept = [pair for pair in kept if pair[0] >= t - window_s] + [(t, value)]
        assert sample_of(windows, 1).tolist() == [pair[1] for pair in kept]


def test_components_are_drawn_as_often_as_they_weigh() -> None:
    windows, rng = empty(satellites=1, room=400), np.random.default_rng(0)
    for t in range(400):
        value = rng.normal(0, 1) if t % 4 else rng.normal(50, 2)
        push(windows, np.array([0]), np.array([value]), float(t), -1.0)
    stated = np.array([9.0])
    offset, variance = draw_components(windows, np.array([0]), np.array([False]), stated, 4000, rng)
    far = offset[:, 0] > 25.0
    assert np.mean(far) == pytest.approx(0.25, abs=0.03)
    assert np.unique(offset[far, 0]) == pytest.approx([50.0], abs=0.8)
    assert np.unique(variance[~far, 0]) == pytest.approx([10.0], abs=0.5)
    direct = draw_components(windows, np.array([0]), np.array([True]), stated, 3, rng)
    assert direct[0].tolist() == [[0.0]] * 3 and direct[1].tolist() == [[9.0]] * 3


def test_the_print_takes_the_window_s_moments() -> None:
    windows = empty(satellites=1)
    for t, value in enumerate([1.0, 3.0, 8.0]):
        push(windows, np.array([0]), np.array([value]), float(t), -1.0)
    for direct in (True, False):
        offset, variance = printed(windows, np.array([0]), np.array([direct]))
        assert offset[0, 0] == pytest.approx(4.0)
        assert variance[0, 0] == pytest.approx(26.0 / 3)
