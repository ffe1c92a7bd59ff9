"""The library's front door, and what drives solved together look like as tables."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely

import fusion
from fusion.methods.base import DriveResult
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.simulate.demonstration import Demonstration, write_all

Ran = tuple[RoadNetwork, DriveResult]

LOADED = """
import sys, fusion
offered = set(dir(fusion))
heavy = {"numpy", "scipy", "numba", "geopandas", "pandas", "rasterio", "osmium", "fusion.types"} & set(sys.modules)
fusion.read_roads
loaded = ["fusion.roads.osm" in sys.modules, "fusion.pipeline" in sys.modules]
print(sorted(heavy), offered >= {"read_log", "solve", "Dem"}, *loaded)
"""


def test_the_door_is_light_and_loads_what_is_asked_for() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[0] == "[] True True False"


@pytest.mark.parametrize("name", fusion.HOMES)
def test_every_name_is_what_its_home_calls_so(name: str) -> None:
    found = getattr(fusion, name)
    assert found.__module__.startswith("fusion.")
    assert found.__doc__


def test_another_name_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match=r"fusion.*read_everything"):
        fusion.read_everything  # type: ignore[attr-defined]  # noqa: B018


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("town"), 2, seed=1, duration_s=60.0)


@pytest.fixture(scope="module")
def roads(bundle: Demonstration) -> RoadTable:
    return fusion.read_roads(bundle.osm)


@pytest.fixture(scope="module")
def drives(bundle: Demonstration, roads: RoadTable) -> list[Ran]:
    return [fusion.run_drive(fusion.read_log(path), roads, None) for path in bundle.drives]


def test_drives_are_solved_together_in_any_order(roads: RoadTable, drives: list[Ran]) -> None:
    one, other = (fusion.segments_frame(fusion.solve(some, roads)) for some in (drives, drives[::-1]))
    assert len(one) > 10
    assert (one.slope_sigma_percent > 0).all()
    assert one.drives.isin([1, 2]).all()
    assert one.equals(other)
    twice = fusion.solve([*drives, drives[0]], roads)
    assert len(twice.duplicates) == 1, "a duplicate drive counts once"
    assert fusion.segments_frame(twice).equals(one)


def test_segments_lie_where_their_roads_lie(roads: RoadTable, drives: list[Ran]) -> None:
    solution = fusion.solve(drives, roads)
    frame = fusion.segments_frame(solution)
    assert frame.crs.to_epsg() == 4326
    assert frame.attrs["height_datum"] == solution.height_datum == "mean sea level as the receivers logged it"
    ends = shapely.get_coordinates(frame.geometry.to_numpy()).reshape(-1, 4)
    table = solution.roads
    columns = (table.lon0_deg, table.lat0_deg, table.lon1_deg, table.lat1_deg)
    np.testing.assert_array_equal(ends, np.column_stack(columns))
    assert frame.dem_slope_percent.isna().all(), "unknown without an elevation model, not 0"
    rise = frame.height_to_m - frame.height_from_m
    assert (100 * rise / frame.length_m - frame.slope_percent).abs().max() < 1
    assert frame.slope_percent.abs().max() > 3


def test_gaps_are_for_who_asks(roads: RoadTable, drives: list[Ran]) -> None:
    plain, asked = (fusion.segments_frame(fusion.solve(drives, roads, gaps=gaps)) for gaps in (False, True))
    assert (asked.drives == 0).sum() == len(asked) - len(plain)


def test_a_method_that_yields_slopes_only_is_combined(bundle: Demonstration, roads: RoadTable) -> None:
    raw = [fusion.run_drive(fusion.read_log(path), roads, None, method="raw") for path in bundle.drives]
    frame = fusion.segments_frame(fusion.solve(raw, roads))
    known = {s.segment: s for s in raw[0][1].slopes}
    assert len(frame) >= len(known) > 3
    assert frame.height_from_m.isna().all()


def test_other_roads_are_refused(roads: RoadTable, drives: list[Ran]) -> None:
    with pytest.raises(KeyError):
        fusion.solve(drives, roads.subset(np.arange(3)))


def test_nothing_is_a_frame_too(roads: RoadTable) -> None:
    frame = fusion.segments_frame(fusion.solve([], roads))
    assert len(frame) == 0
    assert frame.crs.to_epsg() == 4326
    assert frame.attrs["height_datum"] is None


def test_a_track_says_when_where_and_on_which_road(drives: list[Ran]) -> None:
    network, result = drives[0]
    track = result.track
    lost = replace(track, segment=np.where(np.arange(len(track)) == 5, -1, track.segment))
    lost = replace(lost, lon_deg=np.where(np.arange(len(track)) == 7, np.nan, track.lon_deg))
    frame = fusion.track_frame(replace(result, track=lost), network)
    assert len(frame) == len(track)
    assert frame.attrs["height_datum"] == "mean sea level as the receivers logged it"
    assert str(frame.time.dtype).endswith("UTC]")
    np.testing.assert_allclose(
        frame.time.astype("datetime64[ms, UTC]").astype("int64") / 1000, track.time_s, atol=6e-4
    )
    assert frame.geometry.isna().to_numpy().nonzero()[0].tolist() == [7]
    off = frame.osm_way_id.isna().to_numpy()
    assert off[5]
    assert frame.distance_m.isna()[5]
    on = ~off
    assert frame.osm_way_id[on].tolist() == network.table.osm_way_id[lost.segment[on]].tolist()
    assert frame.to_node[on].tolist() == network.table.to_node[lost.segment[on]].tolist()
    np.testing.assert_allclose(frame.grade_percent, 100 * np.tan(track.pitch_rad))
