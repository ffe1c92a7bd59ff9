"""Fronts: on both sides, as far away and as high as their class says, never in a road."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fusion.published.canyon.fronts import (
    STREETS,
    Fronts,
    fronts_along,
    fronts_of_town,
)
from fusion.published.canyon.ride import Route
from fusion.simulate.scene.town import Town
from published.positioning.rouen import fronts_of_route, winding_route

LINE = np.column_stack([np.arange(0.0, 2001.0), np.zeros(2001), np.full(2001, 100.0)])
STRAIGHT = Route(LINE)


@pytest.mark.parametrize("name", [n for n in STREETS if n != "open"])
def test_a_straight_street_is_as_its_class_says(name: str) -> None:
    kind = STREETS[name]
    fronts = fronts_along(STRAIGHT, kind, np.random.default_rng(1))
    aside = fronts.ends_m[:, [1, 3]]
    np.testing.assert_allclose(aside[:, 0], aside[:, 1], atol=1e-9)
    width = aside.max() - aside.min()
    assert kind.width_m[0] <= width <= kind.width_m[1]
    assert np.sum(aside[:, 0] > 0) > 5
    assert np.sum(aside[:, 0] < 0) > 5
    height = fronts.top_m - 100.0
    assert abs(height.mean() / kind.height_m - 1) < 4 * kind.height_spread / np.sqrt(len(fronts))
    built = np.abs(fronts.ends_m[:, 2] - fronts.ends_m[:, 0]).sum() / 2 / 2000
    assert abs(built - kind.block_m / (kind.block_m + kind.gap_m)) < 0.12
    assert fronts.loss_db.min() >= 3.0


def test_open_country_has_none() -> None:
    assert len(fronts_along(STRAIGHT, STREETS["open"], np.random.default_rng(1))) == 0
    assert len(fronts_of_route(STRAIGHT, np.random.default_rng(1), {"open": 1.0})) == 0


def test_no_front_stands_in_the_route() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        route = winding_route(3000.0, rng)
        fronts = fronts_of_route(route, rng)
        assert len(fronts) > 40
        assert _nearest(fronts, route.points_m[:, :2]) > 2.0


def test_no_front_stands_in_a_street_of_a_town(town: Town) -> None:
    fronts = fronts_of_town(town, np.random.default_rng(3))
    nodes = np.column_stack([town.node_x_m, town.node_y_m])
    assert len(fronts) > len(town.roads)
    share = np.linspace(0, 1, 60)[:, None]
    lines = np.concatenate(
        [nodes[a] * (1 - share) + nodes[b] * share for a, b in zip(town.start, town.end, strict=True)]
    )
    assert _nearest(fronts, lines) > 1.9
    ground = town.height(fronts.ends_m[:, 0], fronts.ends_m[:, 1])
    assert np.quantile(fronts.top_m - ground, 0.05) > 0.0


def test_a_front_across_a_road_goes() -> None:
    across = Fronts(
        np.array([[50.0, -5.0, 50.0, 5.0], [40.0, 6.0, 60.0, 6.0]]), np.full(2, 110.0), np.full(2, 9.0)
    )
    kept = across.clear_of(LINE[:, :2])
    np.testing.assert_array_equal(kept.ends_m, across.ends_m[1:])


def _nearest(fronts: Fronts, road: np.ndarray) -> float:
    share = np.linspace(0, 1, 30)[:, None, None]
    points = fronts.ends_m[:, :2] * (1 - share) + fronts.ends_m[:, 2:] * share
    return float(cKDTree(road).query(points.reshape(-1, 2))[0].min())
