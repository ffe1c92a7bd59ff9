"""The map of slopes: every road is on it, with the slope of the feature that speaks of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from factor_support import street

from app.map.segment import Segment
from app.map.slope_map import map_segments, slope_map_png
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
    np.testing.assert_array_equal(drawn.lon1_deg, roads.lon1_deg)


def test_any_name_may_stand_in_the_credit(roads: RoadTable, tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    slope_map_png(path, roads, [feature(roads, 1, 4.0, 0.3)], title="x", credit=r"a $\nonsense$ b")
    assert path.read_bytes().startswith(b"\x89PNG")
