"""Tables of a calibration: shares, ranks and levels are what they say."""

from __future__ import annotations

import numpy as np
import pytest

from accuracy import calibration_tables
from accuracy.calibration_tables import Cell, Draw, Ratio


def draw_of(rng: np.random.Generator, scale: float, count: int = 400) -> Draw:
    return Draw(np.full(count, 50.0), np.zeros(count), scale * rng.normal(size=count), np.ones(count), 0)


def test_cells_are_marked_by_their_share() -> None:
    rng = np.random.default_rng(1)
    rows = {
        scale: calibration_tables.cell_rows(Cell("all", 3), [draw_of(rng, scale, 4000)])
        for scale in (0.7, 1.0, 1.4)
    }
    assert [rows[s][0]["mark"] for s in rows] == ["high", "", "low"]
    assert [row["length"] for row in rows[1.0]] == ["40 to 100 m", "all"]
    assert rows[1.4][0]["z_rms"] == pytest.approx(1.4, rel=0.05)
    few = calibration_tables.cell_rows(Cell("all", 3), [draw_of(rng, 3.0, 200)])
    assert few[0]["mark"] == ""


def test_ranks_are_uniform_where_sigmas_are_true() -> None:
    rng = np.random.default_rng(2)
    assert calibration_tables.uniformity(draw_of(rng, 1.0, 4000).z)[1] > 0.01
    assert calibration_tables.uniformity(draw_of(rng, 1.4, 4000).z)[1] < 1e-6
    rows = calibration_tables.rank_rows(
        {Cell("all", 1): [draw_of(rng, 1.0)], Cell("all", 3): [draw_of(rng, 1.0)] * 2}
    )
    assert [(r["drives"], r["slopes"], r["draws"]) for r in rows] == [
        ("all", 1200, 3),
        ("1", 400, 1),
        ("3", 800, 2),
        ("all", 1200, 3),
    ]


def test_learned_levels_are_geometric_means() -> None:
    ratios = [Ratio("all", "pitch (t), 1 Hz", v) for v in (0.5, 2.0)] + [Ratio("all", "roughness, 1 Hz", 3.0)]
    rows = calibration_tables.level_rows(ratios, ["all"])
    assert rows == [
        {"level": "roughness, 1 Hz", "drives": 1, "all": "3.00 x1.00"},
        {"level": "pitch (t), 1 Hz", "drives": 2, "all": "1.00 x2.00"},
    ]


def test_the_scale_of_gaussian_noise_is_below_its_sigma() -> None:
    assert 0.8 < calibration_tables.gaussian_scale(5.0) < 0.95
    assert calibration_tables.gaussian_scale(1e6) == pytest.approx(1.0, abs=1e-4)
