"""What the map of slopes shows: every road, with the slope of the segment that speaks of it; widths and arrows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.map.picture.slope_map import (
    ARROW_PERCENT,
    SURE_WIDTH_PT,
    UNSURE_WIDTH_PT,
    arrow_choice,
    line_widths,
    map_segments,
)
from app.map.segment import Segment
from factor_support import street
from fusion.roads.table import RoadTable


@pytest.fixture
def roads() -> RoadTable:
    return street(50.0, 60.0, 70.0, bridge=[False, True, False])


def feature(roads: RoadTable, row: int, slope: float | None, sigma: float | None) -> Segment:
    return Segment(
        id=None,
        osm_way_id=int(roads.osm_way_id[row]),
        from_node=int(roads.from_node[row]),
        to_node=int(roads.to_node[row]),
        length_m=50.0,
        highway="residential",
        name=None,
        oneway=0,
        bridge=False,
        tunnel=False,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        drives=1,
        observations=1,
        dem_slope_percent=None,
        updated_at=None,
        coordinates=(),
    )


def test_roads_take_the_slope_of_their_feature_and_the_others_are_unknown(roads: RoadTable) -> None:
    drawn = map_segments(roads, [feature(roads, 2, -3.0, 0.5), feature(roads, 0, None, None)])
    np.testing.assert_array_equal(drawn.slope_percent, [np.nan, np.nan, -3.0])
    np.testing.assert_array_equal(drawn.slope_sigma_percent, [np.nan, np.nan, 0.5])
    assert drawn.known.tolist() == [False, False, True]
    assert drawn.bridge.tolist() == [False, True, False]
    begins, ends = (roads.lon0_deg, roads.lat0_deg), (roads.lon1_deg, roads.lat1_deg)
    np.testing.assert_array_equal(drawn.ends_deg, np.transpose([begins, ends], (2, 0, 1)))


@given(st.lists(st.floats(0.001, 100) | st.just(float("nan")), min_size=2, max_size=20))
def test_surer_is_never_narrower(sigmas: list[float]) -> None:
    sigma = np.array(sigmas)
    width = line_widths(sigma)
    assert np.all((width >= UNSURE_WIDTH_PT - 1e-9) & (width <= SURE_WIDTH_PT + 1e-9))
    order = np.argsort(np.where(np.isnan(sigma), np.inf, sigma))
    assert np.all(np.diff(width[order]) <= 1e-9)


@given(
    st.lists(
        st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000), st.floats(-20, 20), st.floats(0.01, 10)),
        min_size=1,
        max_size=30,
    )
)
def test_arrows_stand_where_the_sign_is_certain_and_apart(rows: list[tuple[float, ...]]) -> None:
    x, y, slope, sigma = np.array(rows).T
    middle = np.column_stack([x, y])
    chosen = arrow_choice(middle, slope, sigma, 100.0)
    certain = np.abs(slope) > np.maximum(1.96 * sigma, ARROW_PERCENT)
    assert np.all(certain[chosen])
    assert bool(len(chosen)) == bool(certain.any())
    for k, i in enumerate(chosen):
        assert all(np.hypot(*(middle[i] - middle[j])) >= 100 for j in chosen[:k])


def test_an_unknown_sigma_gets_no_arrow() -> None:
    assert not len(arrow_choice(np.zeros((1, 2)), np.array([9.0]), np.array([np.nan]), 10.0))
