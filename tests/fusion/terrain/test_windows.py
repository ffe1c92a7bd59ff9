"""The contract of every DEM window, the posts that each takes, and slopes from heights at both ends."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from fusion.frames import LocalProjection
from fusion.roads.network import RoadNetwork
from fusion.roads.osm import read_roads
from fusion.terrain.dem import Dem
from fusion.terrain.plane import PlaneModel, plane_through
from fusion.terrain.windows import WINDOWS, TinModel, dem_slopes
from terrain_support import heights_of, posts_deg

Write = Callable[..., Path]
MakeNetwork = Callable[..., RoadNetwork]
POSTS = Affine(0.001, 0, 8.4, 0, -0.001, 49.1)
EVERY = pytest.mark.parametrize("name", list(WINDOWS))
PLANES = pytest.mark.parametrize("name", ["adjacent", "full", "hollow"])
GRID = st.floats(2, 7).map(lambda w: round(w, 3))


@pytest.fixture(scope="module")
def network(make_network: MakeNetwork) -> RoadNetwork:
    """A short, a long, a north-south, an east-west segment; one over the voids; one off the raster."""
    return make_network(
        [8.4501, 8.45, 8.4605, 8.47, 8.4802, 9.3],
        [49.0501, 49.06, 49.03, 49.0402, 49.0302, 49.0],
        [8.4503, 8.459, 8.4605, 8.4751, 8.4808, 9.31],
        [49.0503, 49.05, 49.0341, 49.0402, 49.0308, 49.0],
    )


def slanted(rows: int = 200, columns: int = 200) -> np.ndarray:
    """5 m per post east, 3 m per post south."""
    v, u = np.indices((rows, columns))
    return 300 + 5.0 * u + 3.0 * v


def truth(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    return 300 + 5.0 * (lon - 8.4) / 0.001 + 3.0 * (49.1 - lat) / 0.001


@pytest.fixture(scope="module")
def plane_dem(tmp_path_factory: pytest.TempPathFactory, write_raster: Write) -> Dem:
    z = slanted()
    z[65:75, 75:85] = np.nan
    return Dem.open([write_raster(tmp_path_factory.mktemp("plane") / "a.tif", z, POSTS)])


def test_names_and_descriptions() -> None:
    assert list(WINDOWS) == ["tin", "adjacent", "full", "hollow"]
    for name, window in WINDOWS.items():
        assert window.name == name
        assert window.description


@EVERY
@pytest.mark.parametrize("segment", range(4))
def test_every_window_knows_a_plane(plane_dem: Dem, network: RoadNetwork, name: str, segment: int) -> None:
    model = WINDOWS[name].model(plane_dem, network, segment)
    assert model is not None
    share = np.linspace(0, 1, 7)[:, None] + np.zeros(2)
    # along the segment, and 40 m beside it
    beside = np.array([0.0, 40.0])
    heading = network.heading_rad[segment]
    x = network.x0[segment] + share * (network.x1 - network.x0)[segment] - beside * np.sin(heading)
    y = network.y0[segment] + share * (network.y1 - network.y0)[segment] + beside * np.cos(heading)
    heights = heights_of(model, x, y)
    assert heights.shape == x.shape
    assert heights == pytest.approx(truth(*network.projection.to_lonlat(x, y)), abs=5e-3)


@EVERY
def test_every_window_is_none_off_the_raster(plane_dem: Dem, network: RoadNetwork, name: str) -> None:
    assert WINDOWS[name].model(plane_dem, network, 5) is None


@EVERY
def test_no_window_invents_heights_over_voids(plane_dem: Dem, network: RoadNetwork, name: str) -> None:
    """All posts of the small window are void: unknown, or what posts farther off say, never 0."""
    model = WINDOWS[name].model(plane_dem, network, 4)
    if model is not None:
        assert np.isnan(model.height_at(network.x0[4], network.y0[4]))


@EVERY
def test_positions_that_are_unknown_have_no_height(plane_dem: Dem, network: RoadNetwork, name: str) -> None:
    model = WINDOWS[name].model(plane_dem, network, 0)
    assert model is not None
    assert np.isnan(model.height_at(np.nan, 0.0))


@PLANES
def test_planes_are_one_plane_for_the_whole_segment(
    tmp_path: Path, write_raster: Write, network: RoadNetwork, name: str
) -> None:
    z = slanted() + np.random.default_rng(0).normal(size=(200, 200))
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS)]) as dem:
        plane = WINDOWS[name].model(dem, network, 1)
        assert isinstance(plane, PlaneModel)
        assert 0.2 < plane.sigma_m < 3
        x, y = network.x0[1] + np.arange(3) * 100.0, network.y0[1] + np.arange(3) * -70.0
        expected = plane.c + plane.a * (x - plane.x0) + plane.b * (y - plane.y0)
        assert heights_of(plane, x, y) == pytest.approx(expected)


@PLANES
def test_voids_are_left_out_of_the_fit(
    tmp_path: Path, write_raster: Write, network: RoadNetwork, name: str
) -> None:
    z = slanted()
    z[::2, ::3] = -32768
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS, nodata=-32768)]) as dem:
        plane = WINDOWS[name].model(dem, network, 1)
        assert isinstance(plane, PlaneModel)
        expected = truth(network.table.lon0_deg[1], network.table.lat0_deg[1])
        assert plane.height_at(network.x0[1], network.y0[1]) == pytest.approx(expected, abs=5e-3)


@PLANES
def test_posts_that_make_no_plane_fall_back_to_triangles(
    tmp_path: Path, write_raster: Write, make_network: MakeNetwork, name: str
) -> None:
    row = np.full((9, 9), np.nan)
    row[4] = 100 + 10 * np.arange(9)
    posts = Affine(0.001, 0, 8.5, 0, -0.001, 49.004)
    network = make_network([8.5035], [49.0], [8.5045], [49.0])
    with Dem.open([write_raster(tmp_path / "a.tif", row, posts)]) as dem:
        model = WINDOWS[name].model(dem, network, 0)
        assert isinstance(model, TinModel)


def test_the_tin_is_the_surface_of_the_elevation_model(
    tmp_path: Path, write_raster: Write, make_network: MakeNetwork
) -> None:
    """Also over 12 km, where meridians bend by metres in the plane."""
    network = make_network([8.405, 8.45], [48.92, 49.06], [8.55, 8.459], [49.03, 49.05])
    z = slanted() + np.random.default_rng(0).normal(scale=10, size=(200, 200))
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS)]) as dem:
        share = np.random.default_rng(1).random(200)
        for segment in range(2):
            model = WINDOWS["tin"].model(dem, network, segment)
            assert model is not None
            x = network.x0[segment] + share * (network.x1 - network.x0)[segment] + 100
            y = network.y0[segment] + share * (network.y1 - network.y0)[segment] - 100
            expected = dem.heights(*network.projection.to_lonlat(x, y))
            assert heights_of(model, x, y) == pytest.approx(expected, abs=1e-4)


def chosen(name: str, u: list[float], v: list[float]) -> np.ndarray:
    window = WINDOWS[name]
    assert window.select is not None
    return window.select((10, 11), np.array(u), np.array(v))


@given(GRID, GRID, GRID, GRID)
def test_adjacent_takes_the_corners_of_the_cells_that_the_segment_crosses(
    u0: float, v0: float, u1: float, v1: float
) -> None:
    marked = chosen("adjacent", [u0, u1], [v0, v1])
    segment = shapely.LineString([(u0, v0), (u1, v1)])
    must, may = np.zeros((10, 11), bool), np.zeros((10, 11), bool)
    for row in range(9):
        for column in range(10):
            corners = slice(row, row + 2), slice(column, column + 2)
            may[corners] |= segment.distance(shapely.box(column, row, column + 1, row + 1)) < 1e-9
            inner = shapely.box(column + 1e-9, row + 1e-9, column + 1 - 1e-9, row + 1 - 1e-9)
            must[corners] |= segment.intersects(inner)
    assert np.all(marked[must])
    assert np.all(may[marked])
    assert marked.sum() >= 4


@given(GRID, GRID, GRID, GRID)
def test_hollow_is_the_border_of_full_and_both_surround_the_segment(
    u0: float, v0: float, u1: float, v1: float
) -> None:
    full, hollow = chosen("full", [u0, u1], [v0, v1]), chosen("hollow", [u0, u1], [v0, v1])
    rows, columns = np.nonzero(full)
    top, bottom, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    assert full[top : bottom + 1, left : right + 1].all()
    assert full.sum() == (bottom - top + 1) * (right - left + 1)
    assert left < min(u0, u1)
    assert max(u0, u1) < right
    assert top < min(v0, v1)
    assert max(v0, v1) < bottom
    assert (bottom - top, right - left) <= (np.ptp([v0, v1]) + 4, np.ptp([u0, u1]) + 4)
    border = full.copy()
    border[top + 1 : bottom, left + 1 : right] = False
    assert hollow.tolist() == border.tolist()
    assert np.all(full[chosen("adjacent", [u0, u1], [v0, v1])])


def test_windows_are_sized_by_the_posting(
    tmp_path: Path, write_raster: Write, make_network: MakeNetwork
) -> None:
    """The same 200 m of road: few posts of a coarse raster, many of a fine one."""
    network = make_network([8.4999], [49.0], [8.5026], [49.0001])
    posts = []
    for k, step in enumerate((0.001, 0.0001)):
        size = int(0.02 / step)
        grid = Affine(step, 0, 8.49, 0, -step, 49.01)
        with Dem.open([write_raster(tmp_path / f"{k}.tif", slanted(size, size), grid)]) as dem:
            model = WINDOWS["adjacent"].model(dem, network, 0)
            assert isinstance(model, PlaneModel)
            posts.append(model.posts)
    assert 6 <= posts[0] <= 12
    assert 54 <= posts[1] <= 70


@EVERY
def test_segments_near_each_other_share_one_map_of_the_posts(
    plane_dem: Dem, make_network: MakeNetwork, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A projection a segment would take several times as long as all the rest."""
    lon, lat = (w.ravel() for w in np.meshgrid(8.4805 + np.arange(10) / 500, 49.0 + np.arange(10) / 500))
    network = make_network(lon, lat, lon + 0.001, lat + 0.0005)
    projected: list[int] = []
    to_xy = LocalProjection.to_xy

    def counted(plane: LocalProjection, *places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        projected.append(len(places[0]))
        return to_xy(plane, *places)

    monkeypatch.setattr(LocalProjection, "to_xy", counted)
    assert all(WINDOWS[name].model(plane_dem, network, segment) is not None for segment in range(100))
    assert len(projected) <= 4


@pytest.mark.parametrize("size_deg", [0.0008, 0.03, 0.12])
@pytest.mark.parametrize("crs", [4326, 25832])
def test_planes_are_fitted_where_the_projection_puts_the_posts(
    tmp_path: Path, write_raster: Write, make_network: MakeNetwork, crs: int, size_deg: float
) -> None:
    """Short and long segments against a fit over posts that were projected one by one."""
    posts = POSTS if crs == 4326 else Affine(70, 0, 449_000, 0, -110, 5_438_800)
    z = slanted() + np.random.default_rng(0).normal(scale=10, size=(200, 200))
    network = make_network([8.43], [48.93], [8.43 + size_deg], [48.93 + size_deg])
    ends = [
        np.append(getattr(network.table, f"{w}0_deg"), getattr(network.table, f"{w}1_deg"))
        for w in ("lon", "lat")
    ]
    with Dem.open([write_raster(tmp_path / "a.tif", z, posts, crs)]) as dem:
        model = WINDOWS["full"].model(dem, network, 0)
        patch = dem.posts(*ends, margin_posts=1)
        assert patch is not None
        x, y = network.projection.to_xy(*posts_deg(patch))
        known = np.isfinite(patch.z)
        expected = plane_through(x[known], y[known], patch.z[known])
        assert isinstance(model, PlaneModel)
        assert (model.posts, model.sigma_m) == (expected.posts, pytest.approx(expected.sigma_m, rel=1e-9))
        at = network.x0[0], network.y0[0]
        assert model.height_at(*at) == pytest.approx(expected.height_at(*at), abs=1e-6)


def test_dem_slopes_follow_the_direction_of_the_segment(plane_dem: Dem, network: RoadNetwork) -> None:
    table = network.table
    slopes = dem_slopes(plane_dem, table)
    rise = truth(table.lon1_deg, table.lat1_deg) - truth(table.lon0_deg, table.lat0_deg)
    assert slopes[:4] == pytest.approx(100 * rise[:4] / table.length_m[:4], abs=1e-6)
    assert slopes[3] > 0  # eastward is up
    assert slopes[2] < 0  # northward is down
    assert np.isnan(slopes[4:]).all()


def test_dem_slopes_of_segments_without_length_are_unknown(plane_dem: Dem, make_network: MakeNetwork) -> None:
    assert np.isnan(dem_slopes(plane_dem, make_network([8.45], [49.0], [8.45], [49.0]).table)).all()


def test_real_terrain(shared_data: Path) -> None:
    folder = shared_data / "karlsruhe"
    network = RoadNetwork.project(read_roads(folder / "roads_09_10.osm"))
    with Dem.open([folder / "N49E008.hgt", folder / "N48E008.hgt"]) as dem:
        assert np.isfinite(dem_slopes(dem, network.table)).all()
        for name, window in WINDOWS.items():
            for segment in range(0, len(network), 40):
                model = window.model(dem, network, segment)
                assert model is not None, name
                assert 100 < model.height_at(network.x0[segment], network.y0[segment]) < 400
