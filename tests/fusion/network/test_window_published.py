"""The part of a network that is solved again, and what is made of its slopes: pure functions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.combine import Part, combine, published
from fusion.network.window import PUBLISH_RADIUS_M, WINDOW_RADIUS_M, boxes_around, rows_of, window_around
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town

SEGMENT_M = 97.0


def line(n: int) -> RoadTable:
    """A straight road to the north, a segment every 97 m."""
    lat = 49.0 + np.arange(n + 1) * SEGMENT_M / 111_210.0
    k = np.arange(n)
    return RoadTable.from_columns(
        osm_way_id=np.ones(n), from_node=k, to_node=k + 1,
        lon0_deg=np.full(n, 8.0), lat0_deg=lat[:-1], lon1_deg=np.full(n, 8.0), lat1_deg=lat[1:],
        oneway=np.zeros(n), bridge=np.zeros(n, bool), tunnel=np.zeros(n, bool), layer=np.zeros(n),
        highway=["residential"] * n, name=[None] * n,
    )  # fmt: skip


def mask(n: int, *rows: int) -> np.ndarray:
    out = np.zeros(n, bool)
    out[list(rows)] = True
    return out


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_window_reaches_along_the_road(scale: float) -> None:
    n, every = 60, np.ones(60, bool)
    window = window_around(line(n), every, mask(n, 30), every, scale)
    far = np.abs(np.arange(n) - 30) * SEGMENT_M - SEGMENT_M  # from the touched row to where a row begins
    assert window.solved.tolist() == (far <= scale * WINDOW_RADIUS_M).tolist()
    assert window.published.tolist() == (far <= scale * PUBLISH_RADIUS_M).tolist()
    assert not np.any(window.ring & window.published)
    assert np.all(window.solved[window.ring])
    assert window.ring.any()


def test_gaps_join_what_they_lie_between_and_vanish_where_they_join_nothing() -> None:
    n = 12
    driven = mask(n, 0, 1, 4, 5)
    window = window_around(line(n), driven, mask(n, 0), mask(n, 0, 1, 7))
    assert np.flatnonzero(window.solved).tolist() == [0, 1, 2, 3, 4, 5]  # 2 and 3 are a gap of 194 m
    alone = window_around(line(n), mask(n, 0, 1), mask(n, 0), mask(n, 0, 1, 2, 3))
    assert np.flatnonzero(alone.solved).tolist() == [0, 1]
    assert np.flatnonzero(alone.published).tolist() == [0, 1, 2, 3]  # the former gap goes


def test_a_row_that_lost_its_last_pass_is_published_as_unknown() -> None:
    window = window_around(line(4), mask(4, 0), mask(4, 3), mask(4, 0, 3))
    assert not window.solved[3]
    assert window.published[3]


@given(
    ends=st.lists(st.tuples(*[st.floats(-0.02, 0.02)] * 4), min_size=1, max_size=8),
    lat=st.sampled_from([0.0, 48.0, -33.0, 70.0]),
    radius_m=st.floats(50.0, 1500.0),
    seed=st.integers(0, 99),
)
def test_boxes_hold_all_that_is_near_and_do_not_overlap(
    ends: list[tuple[float, float, float, float]], lat: float, radius_m: float, seed: int
) -> None:
    lon0, lat0, lon1, lat1 = np.array(ends).T
    lat0, lat1 = lat0 + lat, lat1 + lat
    boxes = boxes_around(lon0, lat0, lon1, lat1, radius_m)
    # Points within the radius of some point of some line.
    rng = np.random.default_rng(seed)
    which, share = rng.integers(len(ends), size=50), rng.uniform(size=50)
    angle, far = rng.uniform(0, 2 * np.pi, 50), radius_m * np.sqrt(rng.uniform(size=50))
    y = lat0[which] + share * (lat1 - lat0)[which] + np.sin(angle) * far / 111_700.0
    x = lon0[which] + share * (lon1 - lon0)[which]
    x += np.cos(angle) * far / (111_700.0 * np.cos(np.radians(y)))
    inside = (
        (boxes[:, 0, None] <= x) & (x <= boxes[:, 2, None])
        & (boxes[:, 1, None] <= y) & (y <= boxes[:, 3, None])
    )  # fmt: skip
    assert inside.any(axis=0).all()
    for a, b in pairwise(boxes):
        assert b[1] > a[1] or b[0] > a[2]


def test_rows_are_found_by_identity(town: Town) -> None:
    rows = np.flatnonzero(np.arange(len(town.roads)) % 7 == 3)
    assert rows_of(town.roads, town.roads.subset(rows)).tolist() == rows.tolist()
    assert rows_of(town.roads, RoadTable.empty()).tolist() == []


def test_the_networks_slope_is_published_as_it_is() -> None:
    whole = published([Part(1.25, 0.4, 7, 90, network=True)])
    assert (whole.slope_percent, whole.slope_sigma_percent, whole.drives, whole.observations) == (
        1.25, 0.4, 7, 90
    )  # fmt: skip


def test_measurements_are_combined_and_guesses_give_way() -> None:
    network, gap, raw = (
        Part(1.0, 0.5, 7, 90, network=True),
        Part(9.0, 3.0, 0, 0, network=True),
        Part(2.0, 1.0, 1, 5),
    )
    whole = published([network, raw])
    alone = combine(np.array([1.0, 2.0]), np.array([0.5, 1.0]), np.array([90, 5]))
    assert (whole.slope_percent, whole.slope_sigma_percent) == (
        alone.slope_percent,
        alone.slope_sigma_percent,
    )
    assert (whole.drives, whole.observations) == (8, 95)
    assert (published([gap, raw]).slope_percent, published([gap, raw]).drives) == (2.0, 1)
    assert (published([gap]).slope_percent, published([gap]).drives) == (9.0, 0)
