"""Boxes along a log: all that is near it is in one, and not the land that it spans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from fusion.roads.table import LONGEST_GAP_M, STRETCH_M, boxes_along

WGS84 = Geod(ellps="WGS84")
LATITUDES = st.floats(-70, 70)
MARGIN_M = 250.0


def inside(boxes: np.ndarray, lon: float, lat: float) -> bool:
    west, south, east, north = boxes.T
    return bool(np.any((west <= lon) & (lon <= east) & (south <= lat) & (lat <= north)))


@given(
    lat=LATITUDES,
    steps=st.lists(st.tuples(st.floats(0, 360), st.floats(0, 3000)), min_size=1, max_size=30),
    data=st.data(),
)
def test_what_is_near_a_position_or_the_way_to_the_next_is_inside(
    lat: float, steps: list[tuple[float, float]], data: st.DataObject
) -> None:
    places = [(8.0, lat)]
    for azimuth, distance_m in steps:
        places.append(WGS84.fwd(*places[-1], azimuth, distance_m)[:2])
    lon, north = np.array(places).T
    boxes = boxes_along(lon, north, MARGIN_M)
    k = data.draw(st.integers(0, len(steps) - 1))
    share = data.draw(st.floats(0, 1))
    on_way = (lon[k] + share * (lon[k + 1] - lon[k]), north[k] + share * (north[k + 1] - north[k]))
    beside = WGS84.fwd(*on_way, data.draw(st.floats(0, 360)), 0.98 * MARGIN_M)
    assert inside(boxes, *beside[:2])


def test_a_diagonal_trip_costs_its_length_and_not_the_land_it_spans() -> None:
    share = np.linspace(0, 1, 4000)
    boxes = boxes_along(8.0 + share, 49.0 + 0.7 * share, MARGIN_M)  # some 107 km
    area = np.sum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]))
    assert 107_000 / STRETCH_M < len(boxes) < 1.2 * 107_000 / STRETCH_M
    assert area < 0.05 * 0.7


@pytest.mark.parametrize(("apart_m", "bridged"), [(0.5 * LONGEST_GAP_M, True), (1.5 * LONGEST_GAP_M, False)])
def test_gaps_are_bridged_as_far_as_a_way_can_be_found(apart_m: float, bridged: bool) -> None:
    lon, lat, _ = WGS84.fwd(8.0, 49.0, 90.0, apart_m)
    boxes = boxes_along(np.array([8.0, lon, np.nan]), np.array([49.0, lat, 49.0]), MARGIN_M)
    middle = WGS84.fwd(8.0, 49.0, 90.0, apart_m / 2)
    assert inside(boxes, *middle[:2]) == bridged
    assert inside(boxes, 8.0, 49.0)
    assert inside(boxes, lon, lat)
    # And beside the way, where the road may make a turn.
    beside = WGS84.fwd(*middle[:2], 0.0, 0.4 * apart_m)
    assert inside(boxes, *beside[:2]) == bridged


def test_no_position_no_box() -> None:
    assert boxes_along(np.array([np.nan]), np.array([49.0]), MARGIN_M).shape == (0, 4)
