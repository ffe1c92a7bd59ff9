"""The rows of the benchmark of dirty logs: what stands beside what, and which kinds there are."""

from __future__ import annotations

import numpy as np
import pytest

import dirty_logs
from accuracy.dirt import KINDS, GrossErrors
from accuracy.scoring import Errors
from accuracy.truth import TrueSlope, Truth

TRUTH: Truth = {(1, 1, 2): TrueSlope(2.0, 20.0, 20.0)}


def errors_of(error: float) -> Errors:
    return Errors.of(TRUTH, {(1, 1, 2): (2.0 + error, 1.0)})


def test_dirty_figures_stand_beside_clean_ones_as_means_over_roads_and_logs() -> None:
    dirty = [[errors_of(1.0), errors_of(3.0)], [errors_of(-1.0), errors_of(-1.0)]]
    clean = [[errors_of(0.5), errors_of(0.5)], [errors_of(0.5), errors_of(0.5)]]
    row = dirty_logs.row_of(dirty, clean)
    assert row["rmse_percent"] == pytest.approx(1.5)
    assert row["rmse_spread"] == pytest.approx(0.5)
    assert row["ratio"] == pytest.approx(3.0)
    assert (row["clean_within_95"], row["within_95"]) == (1.0, 0.75)


def test_logs_that_give_nothing_have_no_ratio() -> None:
    row = dirty_logs.row_of([[Errors.of(TRUTH, {})]], [[errors_of(0.5)]])
    assert row["coverage"] == 0.0
    assert row["ratio"] is None


def test_without_the_real_receiver_its_kinds_are_left_out() -> None:
    one = np.ones(1)
    rows = dirty_logs.kinds_of("", GrossErrors(one, one, one))
    assert list(rows) == [*KINDS, dirty_logs.TOGETHER]
    assert list(rows[dirty_logs.TOGETHER]) == list(KINDS)
    fewer = dirty_logs.kinds_of("", None)
    assert set(rows) - set(fewer) == {"Doppler", "altitude multipath"}
    assert not {"Doppler", "altitude multipath"} & set(fewer[dirty_logs.TOGETHER])
    assert list(dirty_logs.kinds_of("late", None)) == ["late positions", "late sensors"]
    with pytest.raises(SystemExit, match="no dirt holds 'Doppler'"):
        dirty_logs.kinds_of("Doppler", None)
