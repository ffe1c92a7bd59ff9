"""The normal of a window against numpy's moments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.gnss.error_models.base import Series
from fusion.gnss.error_models.gaussian import GaussianModel


@given(st.lists(st.floats(-500, 500), min_size=1, max_size=80), st.floats(0.5, 50))
def test_moments_are_those_of_the_window(values: list[float], window_s: float) -> None:
    error_m, time_s = np.array(values), np.arange(len(values), dtype=float)
    part = Series(time_s, error_m, np.ones(len(values), int), np.full(len(values), 45.0))
    model = GaussianModel(window_s=window_s)
    mean, variance = model.track(part, 0)
    for t in range(len(values)):
        inside = error_m[(time_s >= t - window_s) & (time_s <= t)]
        assert mean[t] == pytest.approx(inside.mean(), abs=1e-6)
        assert variance[t] == pytest.approx(max(inside.var(), model.floor_m2), abs=1e-5)
