"""The limit: how bound, floor and Versant's errors are put together, over sets and over roads."""

from __future__ import annotations

import math

import numpy as np
import pytest

import limit
from accuracy.scoring import Errors
from accuracy.truth import TrueSlope, Truth

TRUTH: Truth = {(1, 1, 2): TrueSlope(2.0, 20.0, 20.0), (1, 2, 3): TrueSlope(-1.0, 30.0, 30.0)}


def errors(first: float, second: float) -> Errors:
    return Errors.of(TRUTH, {(1, 1, 2): (2.0 + first, 1.0), (1, 2, 3): (-1.0 + second, 1.0)})


def score(mine: float, bound: float | None) -> limit.SetScore:
    """A set in which Versant errs by ``mine``, the bound by ``bound`` and Versant without noise by 0.4."""
    of = None if bound is None else {"q": bound, "q/4": 2 * bound, "4q": bound / 2, "sigma": bound}
    arrays = None if of is None else {name: np.array([v, -v]) for name, v in of.items()}
    return limit.SetScore(errors(mine, -mine), errors(0.4, 0.4), arrays)


def test_bound_and_floor_add_up_as_independent_errors() -> None:
    row = limit.row_of([score(1.0, 0.2), score(2.0, 0.4)])
    assert row["bound_percent"] == pytest.approx(0.3)
    assert row["together_percent"] == pytest.approx(0.5)
    assert row["rmse_percent"] == pytest.approx(1.5)
    assert row["ratio"] == pytest.approx(3.0)
    assert row["bound_range"] == "(0.600, 0.150)"
    assert row["within_95"] == 0.5
    assert row["z_rms"] == pytest.approx(math.sqrt(2.5))


def test_without_a_bound_there_is_no_ratio() -> None:
    row = limit.row_of([score(1.0, None)])
    assert row["floor_percent"] == pytest.approx(0.4)
    assert "ratio" not in row
    assert "bound_percent" not in row


def test_roads_are_pooled_by_their_segments() -> None:
    one = limit.SetScore(errors(3.0, 3.0).take(np.array([True, False])), errors(0, 0), {"q": np.array([3.0])})
    other = limit.SetScore(errors(1.0, 1.0), errors(0, 0), {"q": np.array([1.0, 1.0])})
    both = limit.pooled([one, other])
    assert both.versant.rmse == pytest.approx(math.sqrt(11 / 3))
    assert both.bound is not None
    assert both.bound["q"].tolist() == [3.0, 1.0, 1.0]
    assert limit.pooled([one, score(1.0, None)]).bound is None


def test_segments_of_which_the_truth_knows_a_part_can_be_left_out() -> None:
    truth = {**TRUTH, (1, 1, 2): TrueSlope(2.0, 10.0, 20.0)}
    mine = Errors.of(truth, {(1, 1, 2): (9.0, 1.0), (1, 2, 3): (-0.5, 1.0)})
    clean = Errors.of(truth, {(1, 2, 3): (-0.9, 1.0)})
    whole = limit.SetScore(mine, clean, {"q": np.array([7.0, 0.2])}).whole()
    assert (whole.versant.rmse, whole.floor.rmse) == pytest.approx((0.5, 0.1))
    assert whole.bound is not None
    assert whole.bound["q"].tolist() == [0.2]


def test_sets_have_no_drive_in_common() -> None:
    seeds = [limit.seed_of(number, drive) for number in range(3) for drive in range(40)]
    assert len(set(seeds)) == 120
    assert seeds[0] == 1000
    assert limit.seed_of(2, 7) == 1207
