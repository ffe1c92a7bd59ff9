"""The rows of the benchmark of accuracy: which baseline counts, what stands beside the tested method."""

from __future__ import annotations

import pytest

import slope_accuracy
from accuracy.scoring import Errors
from accuracy.sequences import NOISE_FREE
from accuracy.truth import TrueSlope, Truth

TRUTH: Truth = {(1, 1, 2): TrueSlope(2.0, 20.0, 20.0)}


def errors_of(error: float) -> Errors:
    return Errors.of(TRUTH, {(1, 1, 2): (2.0 + error, 1.0)})


def test_figures_without_noise_stand_beside_the_tested_method_only() -> None:
    found = {
        "profile": [[errors_of(0.5), errors_of(-0.7)]],
        "raw": [[errors_of(3.0), Errors.of(TRUTH, {})]],
        "dem": [[Errors.of(TRUTH, {})]],
        NOISE_FREE: [[errors_of(0.2)]],
    }
    tested, raw = slope_accuracy.summarise("09", found)
    assert (tested["method"], raw["method"]) == ("profile", "raw")  # what yielded nothing is left out
    assert tested["rmse_percent"] == pytest.approx(0.6)
    assert tested["noise_free_rmse_percent"] == pytest.approx(0.2)
    assert tested["by_length"][0]["noise_free_rmse_percent"] == pytest.approx(0.2)
    assert raw["coverage"] == 0.5
    assert "by_length" not in raw


def test_the_ratio_is_to_the_dem_else_to_raw_altitudes() -> None:
    rows = [
        {"sequence": s, "method": m, "rmse_percent": r}
        for s, m, r in (("09", "profile", 0.5), ("09", "raw", 2.0), ("09", "dem", 5.0), ("x", "raw", 4.0))
    ]
    base = slope_accuracy.base_of(rows)
    assert base == {"09": 5.0, "x": 4.0}
    assert slope_accuracy.ratio(rows[0], base) == pytest.approx(0.1)
    assert slope_accuracy.ratio(rows[0], {}) is None
