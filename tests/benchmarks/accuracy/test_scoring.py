"""Scores of known errors: what is weighted by what, where classes of length begin, what a table shows as unknown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from accuracy.scoring import Errors, by_length, figures, length_classes, text_table
from accuracy.sequences import Slopes
from accuracy.truth import TrueSlope, Truth

TRUTH: Truth = {
    (1, 1, 2): TrueSlope(2.0, 10.0, 10.0),
    (1, 2, 3): TrueSlope(-4.0, 30.0, 30.0),
    (1, 3, 4): TrueSlope(0.5, 50.0, 100.0),
    (2, 4, 5): TrueSlope(6.0, 200.0, 200.0),
}
GOT: Slopes = {(1, 1, 2): (1.0, 0.5), (1, 2, 3): (1.0, 5.0), (1, 3, 4): (-0.5, 1.0), (9, 9, 9): (3.0, 1.0)}


@pytest.fixture
def errors() -> Errors:
    return Errors.of(TRUTH, GOT)


def test_scores_of_known_errors(errors: Errors) -> None:
    assert errors.error_percent.tolist() == [-1.0, 5.0, -1.0]
    assert errors.coverage == 0.75
    assert errors.rmse == pytest.approx(3.0)
    assert errors.weighted_rmse == pytest.approx(math.sqrt((10 + 25 * 30 + 100) / 140))
    assert errors.within_95 == pytest.approx(2 / 3)
    assert errors.z_rms == pytest.approx(math.sqrt((4 + 1 + 1) / 3))
    assert errors.wrong_sign == pytest.approx(
        1 / 3
    )  # the slope of half a percent is too flat to have a wrong sign
    assert errors.driven_share.tolist() == [1.0, 1.0, 0.5]


def test_the_sigma_of_the_truth_counts_beside_the_stated_one() -> None:
    truth = {**TRUTH, (1, 2, 3): TrueSlope(-4.0, 30.0, 30.0, 2, 1.2), (1, 1, 2): TrueSlope(2.0, 9.5, 10.0)}
    errors = Errors.of(truth, {(1, 1, 2): (3.0, 0.5), (1, 2, 3): (-1.5, 0.5), (1, 3, 4): (9.0, 1.0)})
    assert errors.z.tolist() == pytest.approx([2.0, 2.5 / 1.3, 8.5])
    assert errors.within_95 == pytest.approx(1 / 3)
    row = figures([[errors]])
    assert row is not None
    # Of the three, one was passed twice, and of one the truth knows a half.
    assert (row["whole_segments"], row["whole_within_95"]) == (1, 0.0)
    assert row["whole_z_rms"] == pytest.approx(2.0)
    assert row["whole_rmse_percent"] == pytest.approx(1.0)


def test_nothing_found_is_no_error() -> None:
    nothing = Errors.of(TRUTH, {})
    assert len(nothing) == 0
    assert nothing.coverage == 0.0
    assert by_length(nothing) == []
    assert figures([[nothing]]) is None


def test_pooled_errors_count_every_log(errors: Errors) -> None:
    twice = Errors.pooled([errors, errors])
    assert len(twice) == 6
    assert twice.coverage == errors.coverage
    assert twice.rmse == pytest.approx(errors.rmse)


def test_figures_are_means_over_roads_then_logs_but_shares_are_pooled(errors: Errors) -> None:
    exact = Errors.of(TRUTH, {(2, 4, 5): (6.0, 1.0)})
    row = figures([[errors, exact], [errors, errors]])
    assert row is not None
    assert row["rmse_percent"] == pytest.approx(np.mean([1.5, 3.0]))
    assert row["rmse_spread"] == pytest.approx(0.75)
    assert row["coverage"] == pytest.approx(np.mean([0.75, 0.25, 0.75, 0.75]))
    assert row["within_95"] == pytest.approx(7 / 10)
    assert row["segments"] == 10


def test_a_log_without_slopes_counts_for_coverage_only(errors: Errors) -> None:
    row = figures([[errors], [Errors.of(TRUTH, {})]])
    assert row is not None
    assert row["rmse_percent"] == pytest.approx(3.0)
    assert row["coverage"] == pytest.approx(0.375)


def test_each_length_is_in_one_class() -> None:
    length = np.array([0.0, 14.99, 15.0, 39.0, 40.0, 99.9, 100.0, 5000.0])
    classes = length_classes(length)
    assert [name for name, _ in classes] == ["below 15 m", "15 to 40 m", "40 to 100 m", "above 100 m"]
    assert [np.flatnonzero(inside).tolist() for _, inside in classes] == [[0, 1], [2, 3], [4, 5], [6, 7]]


def test_figures_by_length_stand_beside_those_without_noise(errors: Errors) -> None:
    clean = Errors.of(TRUTH, {(1, 2, 3): (-4.5, 1.0)})
    rows = {row["length"]: row for row in by_length(errors, clean)}
    assert list(rows) == ["below 15 m", "15 to 40 m", "above 100 m", "driven in part"]
    assert rows["15 to 40 m"]["rmse_percent"] == pytest.approx(5.0)
    assert rows["15 to 40 m"]["noise_free_rmse_percent"] == pytest.approx(0.5)
    assert rows["below 15 m"]["noise_free_rmse_percent"] is None
    assert rows["driven in part"]["segments"] == 1


def test_a_table_shows_a_dash_for_what_is_unknown() -> None:
    columns = {"name": ("name", ""), "a": ("A %", ".1f"), "b": ("B", ".0%")}
    rows = [{"name": "x", "a": 12.345, "b": None}, {"name": "longer", "a": math.nan, "b": 0.5}, {"name": "y"}]
    assert text_table(rows, columns).splitlines() == [
        "name     A %    B",
        "x       12.3    -",
        "longer     -  50%",
        "y          -    -",
    ]
