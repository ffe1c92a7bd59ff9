"""The calibration: a road goes through it whole."""

from __future__ import annotations

import numpy as np
import pytest

import calibration
from accuracy.calibration_tables import Cell


@pytest.mark.slow
def test_a_road_goes_through_the_whole() -> None:
    draws, ratios = calibration.run_seed(1, 8, [1, 3], ["all", "altitude only"])
    assert {cell: len(of_cell) for cell, of_cell in draws.items()} == {
        Cell("all", 1): 3,
        Cell("all", 3): 1,
        Cell("altitude only", 1): 3,
        Cell("altitude only", 3): 1,
    }
    assert all(np.isfinite(d.z).all() for of_cell in draws.values() for d in of_cell)
    assert {r.level.split(",")[0] for r in ratios if r.sensors == "altitude only"} == {
        "roughness",
        "altitude_m",
        "drift",
    }
