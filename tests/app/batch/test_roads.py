"""Roads by place hold what the whole file does, and places keep what is near together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.batch.places import cells, place_name, place_of_cell, places, places_met, tiles
from app.batch.roads import PlacedRoads, key_of_roads
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.osm_file import write_osm

LONGITUDES, LATITUDES = st.floats(-180, 180), st.floats(-85, 85)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("roads") / "town.osm"
    write_osm(make_town(1), path)
    return path


def test_the_places_of_a_box_hold_all_roads_that_meet_it(file: Path, tmp_path: Path) -> None:
    whole = read_roads(file)
    placed = PlacedRoads.cut(file, tmp_path / key_of_roads(file))
    west, south, east, north = whole.bounds_deg()
    boxes = np.array([[west, south, 0.5 * (west + east), 0.5 * (south + north)]])
    table, rows = placed.near(boxes)
    for column in RoadTable.columns():
        assert np.array_equal(getattr(table, column), getattr(whole, column)[rows]), column
    assert np.isin(np.flatnonzero(whole.meets(boxes)), rows).all()
    assert len(placed.near(boxes + 1.0)[0]) == 0
    every, all_rows = placed.near(np.array([[west, south, east, north]]))
    assert len(every) == len(whole)
    assert np.array_equal(all_rows, np.arange(len(whole)))


def test_roads_are_cut_once(file: Path, tmp_path: Path) -> None:
    PlacedRoads.cut(file, tmp_path / "roads")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "roads").iterdir()}
    PlacedRoads.cut(tmp_path / "gone.osm", tmp_path / "roads")
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "roads").iterdir()} == before


@given(LONGITUDES, LATITUDES)
def test_a_cell_lies_in_the_place_of_its_position(lon: float, lat: float) -> None:
    lon_deg, lat_deg = np.array([lon]), np.array([lat])
    assert place_of_cell(cells(lon_deg, lat_deg)) == places(lon_deg, lat_deg)
    (column,), (row,) = tiles(lon_deg, lat_deg, 10)
    assert place_name(int(places(lon_deg, lat_deg)[0])) == f"10-{column}-{row}"


@given(LONGITUDES, LATITUDES, st.floats(0, 1), st.floats(0, 1))
def test_a_box_meets_the_places_of_its_corners_and_middle(
    lon: float, lat: float, wide: float, high: float
) -> None:
    east, north = min(lon + wide, 180.0), min(lat + high, 85.0)
    _, met = places_met(*(np.array([v]) for v in (lon, lat, east, north)))
    corners = places(np.array([lon, east, 0.5 * (lon + east)]), np.array([lat, north, 0.5 * (lat + north)]))
    assert set(corners.tolist()) <= set(met.tolist())
    assert len(set(met.tolist())) == len(met)
