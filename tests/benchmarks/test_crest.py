"""The crest: its true slope and heights, and where a drive over a part of it ends."""

from __future__ import annotations

import numpy as np
import pytest

import crest
from fusion.simulate.scene.town import Town


@pytest.fixture(scope="module")
def town() -> Town:
    return crest.make_crest(400.0, 0.06)


def test_the_crest_is_a_parabola_whose_slope_is_none(town: Town) -> None:
    assert town.roads.length_m[crest.CREST] == pytest.approx(400.0, rel=1e-4)
    assert town.true_slope_percent == pytest.approx([6.0, 0.0, -6.0], abs=1e-9)
    share = np.linspace(0.0, 1.0, 9)
    rise = town.road_height(np.full(9, crest.CREST), share) - town.node_height_m[1]
    assert rise == pytest.approx(0.06 * 400 * share * (1 - share))


def test_a_drive_over_a_part_ends_there(town: Town) -> None:
    whole = crest.drive_over(town, 1, "perfect", None)
    part = crest.drive_over(town, 1, "perfect", 100.0)
    count = len(part["time_s"])
    assert np.array_equal(part["lat_deg"], whole["lat_deg"][:count])
    east, _ = town.projection.to_xy(part["lon_deg"], part["lat_deg"])
    ends_m = crest.APPROACH_M + 100.0
    assert ends_m - 20.0 < east.max() <= ends_m
    assert town.projection.to_xy(whole["lon_deg"], whole["lat_deg"])[0].max() > 650.0
