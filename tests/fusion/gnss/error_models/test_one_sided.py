"""The one-sided model: its constants, what it takes unknown strengths for, its second moment."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.gnss.error_models.likelihood import UNKNOWN_CN0_DBHZ
from fusion.gnss.error_models.one_sided import OneSidedModel


def test_half_are_reflected_at_forty() -> None:
    assert OneSidedModel().reflected(np.array([40.0, 43.0]))[0] == pytest.approx(0.5)
    assert OneSidedModel().reflected(np.array([43.0]))[0] == pytest.approx(1 / (1 + np.e))


@given(st.floats(10, 60))
def test_the_second_moment_is_the_law_s(cn0_dbhz: float) -> None:
    law = OneSidedModel().at(cn0_dbhz)
    second = OneSidedModel().second_moment_m2(np.array([cn0_dbhz]))[0]
    assert second == pytest.approx(law.variance + law.mean**2)


def test_an_unknown_strength_counts_as_weak() -> None:
    model = OneSidedModel()
    assert model.at(np.nan).mean == model.at(UNKNOWN_CN0_DBHZ).mean
    assert model.second_moment_m2(np.array([np.nan])) == model.second_moment_m2(np.array([UNKNOWN_CN0_DBHZ]))


@given(st.floats(20, 50), st.floats(0.1, 50))
def test_long_delays_are_likelier_than_early_arrivals(cn0_dbhz: float, error_m: float) -> None:
    law = OneSidedModel().at(cn0_dbhz)
    assert law.log_density(np.array([error_m]))[0] > law.log_density(np.array([-error_m]))[0]
