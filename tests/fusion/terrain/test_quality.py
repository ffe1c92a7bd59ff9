"""The quality layer: which file it is, what its numbers mean, and what becomes of posts that few scenes saw."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import TerrainError
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.plane import PlaneModel
from fusion.terrain.windows import WINDOWS, TinModel
from terrain_support import heights_of

Write = Callable[..., Path]
MakeNetwork = Callable[..., RoadNetwork]
STEP = 1 / 3600
POSTS = Affine(STEP, 0, 8.5, 0, -STEP, 49.0)
SIDE = 40


def slanted() -> np.ndarray:
    """2 m per post east, 1 m per post south."""
    v, u = np.indices((SIDE, SIDE))
    return (100 + 2 * u + v).astype(np.int16)


def place(u: float, v: float) -> tuple[float, float]:
    return 8.5 + u * STEP, 49.0 - v * STEP


def pair_of(
    folder: Path, write_raster: Write, z: np.ndarray, scenes: np.ndarray, name: str = "ASTGTM2_N48E008"
) -> Path:
    write_raster(folder / f"{name}_num.tif", scenes, POSTS)
    return write_raster(folder / f"{name}_dem.tif", z, POSTS)


@pytest.mark.parametrize(
    ("elevations", "quality"),
    [
        ("ASTGTM2_N48E008_dem.tif", "ASTGTM2_N48E008_num.tif"),
        ("ASTGTM2_N48E008_DEM.TIF", "ASTGTM2_N48E008_NUM.TIF"),
        ("astgtm2_n48e008_dem.tif", "astgtm2_n48e008_NUM.TIF"),
        ("N48E008_DEM.tif", "N48E008_num.tif"),
        ("N48E008_dem.tif.gz", "N48E008_num.tif.gz"),
        ("N48E008_dem.tif.gz", "N48E008_num.tif"),
        ("N48E008_dem.tif", "N48E008_num.tif.gz"),
    ],
)
def test_the_quality_layer_is_found_beside_its_elevations(
    tmp_path: Path, write_raster: Write, elevations: str, quality: str
) -> None:
    for name, values in ((elevations, slanted()), (quality, np.full((SIDE, SIDE), 4, np.uint8))):
        written = write_raster(tmp_path / "x.tif", values, POSTS)
        content = written.read_bytes()
        (tmp_path / name).write_bytes(gzip.compress(content, 1) if name.endswith(".gz") else content)
        written.unlink()
    with Dem.open([tmp_path / elevations]) as dem:
        assert dem.without_quality == ()
        assert dem.names == (elevations,)
        assert dem.description.endswith("quality layers of 1")
        assert np.isfinite(dem.filtered(4).heights(*place(5, 5)))
        assert np.isnan(dem.filtered(5).heights(*place(5, 5)))


@pytest.mark.parametrize("names", [("N48E008.tif", "N48E008_num.tif"), ("a_dem.tif", "b_num.tif")])
def test_other_files_are_no_quality_layer(
    tmp_path: Path, write_raster: Write, names: tuple[str, str]
) -> None:
    paths = [write_raster(tmp_path / name, slanted(), POSTS) for name in names]
    with Dem.open(paths[:1]) as dem:
        assert dem.without_quality == (names[0],)
        assert "quality" not in dem.description
        assert dem.filtered(9).heights(*place(5, 5)) == dem.heights(*place(5, 5)) == 115


@pytest.mark.parametrize(
    ("dtype", "stored", "scenes"),
    [
        ("int16", [0, 1, 7, 50, 200, -1, -2, -5, -6, -11], [0, 1, 7, 50, 200, 0, 0, 0, 0, 0]),
        ("uint8", [0, 1, 7, 50, 200, 201, 231, 251, 255], [0, 1, 7, 50, 200, 0, 0, 0, 0]),
        ("float32", [3.0, np.nan, np.inf, -9999.0, 231.0], [3, 0, 0, 0, 0]),
    ],
)
def test_numbers_count_scenes_and_codes_of_fills_count_as_none(
    tmp_path: Path, write_raster: Write, dtype: str, stored: list[float], scenes: list[int]
) -> None:
    numbers = np.full((SIDE, SIDE), 9, dtype)
    numbers[3, : len(stored)] = stored
    with Dem.open([pair_of(tmp_path, write_raster, slanted(), numbers)]) as dem:
        places = place(np.arange(len(stored)), 3)
        for threshold in (1, 2, 7, 8, 51, 200, 201):
            kept = np.isfinite(dem.filtered(threshold).heights(*places))
            assert kept.tolist() == [n >= threshold for n in scenes], threshold
        assert np.isfinite(dem.filtered(0).heights(*places)).all()
        assert np.isfinite(dem.heights(*places)).all()


def test_a_declared_void_of_the_quality_layer_is_no_scene(tmp_path: Path, write_raster: Write) -> None:
    numbers = np.full((SIDE, SIDE), 9, np.uint8)
    numbers[4, 4] = 99
    write_raster(tmp_path / "a_num.tif", numbers, POSTS, nodata=99)
    with Dem.open([write_raster(tmp_path / "a_dem.tif", slanted(), POSTS)]) as dem:
        assert np.isnan(dem.filtered(1).heights(*place(4, 4)))
        assert dem.filtered(1).heights(*place(5, 4)) == 114


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 999), st.integers(1, 9), st.sampled_from(list(WINDOWS)))
def test_rejected_posts_are_voids_in_every_respect(
    tmp_path_factory: pytest.TempPathFactory,
    write_raster: Write,
    make_network: MakeNetwork,
    seed: int,
    threshold: int,
    window: str,
) -> None:
    """The filtered model is the model of a raster in which those posts are declared void."""
    rng = np.random.default_rng(seed)
    z = rng.normal(200, 5, (SIDE, SIDE)).astype(np.float32)
    scenes = rng.integers(-3, 10, (SIDE, SIDE)).astype(np.int16)
    folder = tmp_path_factory.mktemp("pair")
    voided = np.where(scenes >= threshold, z, -9999).astype(np.float32)
    ends = [place(*rng.uniform(3, 36, 2)) for _ in range(2)]
    network = make_network(*ends[0], *ends[1])
    lon, lat = place(*rng.uniform(0, SIDE - 1, (2, 50)))
    with (
        Dem.open([pair_of(folder, write_raster, z, scenes)]) as dem,
        Dem.open([write_raster(folder / "void.tif", voided, POSTS, nodata=-9999)]) as holes,
    ):
        good = dem.filtered(threshold)
        np.testing.assert_array_equal(good.heights(lon, lat), holes.heights(lon, lat))
        models = [WINDOWS[window].model(source, network, 0) for source in (good, holes)]
        assert type(models[0]) is type(models[1])
        if models[0] is not None and models[1] is not None:
            at = network.x0 + np.array([0.0, 10.0]), network.y0 + np.array([0.0, -10.0])
            np.testing.assert_array_equal(heights_of(models[0], *at), heights_of(models[1], *at))
        assert np.isfinite(dem.heights(lon, lat)).all()  # the model itself is as before


@pytest.mark.parametrize("window", ["adjacent", "full", "hollow"])
def test_planes_are_fitted_without_rejected_posts(
    tmp_path: Path, write_raster: Write, make_network: MakeNetwork, window: str
) -> None:
    z, scenes = slanted(), np.full((SIDE, SIDE), 12, np.int16)
    z[11:15, 12], scenes[11:15, 12] = 900, -1  # a wall that was filled in from elsewhere
    network = make_network(*place(10.3, 12.4), *place(16.2, 13.1))
    with Dem.open([pair_of(tmp_path, write_raster, z, scenes)]) as dem:
        spoilt, clean = (WINDOWS[window].model(d, network, 0) for d in (dem, dem.filtered(1)))
        assert isinstance(spoilt, PlaneModel)
        assert isinstance(clean, PlaneModel)
        assert clean.posts < spoilt.posts
        assert clean.height_at(network.x0[0], network.y0[0]) == pytest.approx(100 + 2 * 10.3 + 12.4, abs=0.01)
        assert clean.sigma_m < 0.01
        assert abs(spoilt.height_at(network.x0[0], network.y0[0]) - 133) > 5


@pytest.mark.parametrize("window", list(WINDOWS))
def test_too_few_good_posts_leave_triangles_and_those_at_rejected_posts_are_unknown(
    tmp_path: Path, write_raster: Write, make_network: MakeNetwork, window: str
) -> None:
    scenes = np.zeros((SIDE, SIDE), np.int16)
    scenes[:12] = 5  # good posts lie north of the road, within the reach of triangles only
    network = make_network(*place(20.2, 14.5), *place(22.4, 14.5))
    with Dem.open([pair_of(tmp_path, write_raster, slanted(), scenes)]) as dem:
        model = WINDOWS[window].model(dem.filtered(5), network, 0)
        assert isinstance(model, TinModel)
        here = np.array([network.x0[0], network.x1[0]]), np.array([network.y0[0], network.y1[0]])
        assert np.isnan(heights_of(model, *here)).all()
        north = here[0], here[1] + 4.2 * 30.9
        expected = 100 + 2 * np.array([20.2, 22.4]) + 14.5 - 4.2
        assert heights_of(model, *north) == pytest.approx(expected, abs=0.1)


def test_only_triangles_with_a_rejected_corner_are_unknown(tmp_path: Path, write_raster: Write) -> None:
    scenes = np.full((SIDE, SIDE), 3, np.int16)
    scenes[6, 6] = 2
    with Dem.open([pair_of(tmp_path, write_raster, slanted(), scenes)]) as dem:
        good = dem.filtered(3)
        assert np.isnan(good.heights(*place(6.2, 6.2)))
        assert np.isnan(good.heights(*place(5.8, 5.8)))
        assert good.heights(*place(6.8, 6.8)) == pytest.approx(100 + 3 * 6.8)  # the cell's other triangle
        assert good.heights(*place(7.0, 6.0)) == 120


def test_coarser_rasters_and_overlapping_ones_fill_what_was_rejected(
    tmp_path: Path, write_raster: Write
) -> None:
    scenes = np.full((SIDE, SIDE), 8, np.int16)
    scenes[10:20, 10:20] = -1
    first = pair_of(tmp_path, write_raster, slanted(), scenes)
    coarse = write_raster(
        tmp_path / "coarse.tif",
        np.full((9, 9), 700, np.int16),
        Affine(0.002, 0, 8.498, 0, -0.002, 49.002),
    )
    other = write_raster(tmp_path / "z_other.tif", np.full((SIDE, SIDE), 300, np.int16), POSTS)
    with Dem.open([first, coarse]) as dem:
        assert dem.without_quality == ("coarse.tif",)
        assert dem.filtered(1).heights(*place(15, 15)) == 700
        assert dem.filtered(1).heights(*place(5, 5)) == 115
        patch = dem.filtered(1).posts(*(np.array([w]) for w in place(10.5, 15.5)))
        assert patch is not None
        assert set(patch.z[:, -2:].ravel()) == {700}
        assert 700 not in patch.z[:, 0]
    with Dem.open([first, other]) as dem:
        assert dem.filtered(1).heights(*place(15, 15)) == 300
        assert dem.heights(*place(15, 15)) == 145


def test_a_filtered_model_shares_files_and_keeps_apart_what_it_read(
    tmp_path: Path, write_raster: Write
) -> None:
    scenes = np.arange(SIDE * SIDE).reshape(SIDE, SIDE).astype(np.int16) % 5
    path = pair_of(tmp_path, write_raster, slanted(), scenes)
    with Dem.open([path]) as dem:
        lon, lat = place(*np.meshgrid(np.arange(SIDE), np.arange(SIDE)))
        for threshold in (0, 3, 1, 0, 4, 3):
            known = np.isfinite(dem.filtered(threshold).heights(lon, lat))
            assert known.tolist() == (scenes >= threshold).tolist()
        again = dem.filtered(3).filtered(1)
        assert np.count_nonzero(np.isnan(again.heights(lon, lat))) == np.count_nonzero(scenes < 1)
        with pytest.raises(ValueError, match="negative"):
            dem.filtered(-1)
        view = dem.filtered(2)
    with pytest.raises(ValueError, match="closed"):
        view.heights(*place(1, 1))


def test_the_quality_layer_is_read_only_where_a_threshold_asks_for_it(
    tmp_path: Path, write_raster: Write
) -> None:
    path = pair_of(tmp_path, write_raster, slanted(), np.full((SIDE, SIDE), 9, np.int16))
    with Dem.open([path]) as dem:
        (tmp_path / "ASTGTM2_N48E008_num.tif").unlink()
        assert dem.heights(*place(5, 5)) == 115
        with pytest.raises(TerrainError, match=r"ASTGTM2_N48E008_num\.tif cannot be read"):
            dem.filtered(1).heights(*place(5, 5))


@pytest.mark.parametrize(
    ("shape", "posts", "crs"),
    [
        ((SIDE, SIDE - 1), POSTS, 4326),
        ((SIDE + 1, SIDE), POSTS, 4326),
        ((SIDE, SIDE), Affine(STEP, 0, 8.5 + STEP / 2, 0, -STEP, 49.0), 4326),
        ((SIDE, SIDE), Affine(STEP * 1.001, 0, 8.5, 0, -STEP, 49.0), 4326),
        ((SIDE, SIDE), POSTS, 4258),
    ],
    ids=["narrower", "taller", "half a post off", "drifting", "another datum"],
)
def test_a_quality_layer_on_another_grid_is_refused(
    tmp_path: Path, write_raster: Write, shape: tuple[int, int], posts: Affine, crs: int
) -> None:
    path = write_raster(tmp_path / "a_dem.tif", slanted(), POSTS)
    write_raster(tmp_path / "a_num.tif", np.full(shape, 9, np.int16), posts, crs)
    with pytest.raises(TerrainError, match=r"a_num\.tif does not fit a_dem\.tif.*one delivery"):
        Dem.open([path])


def test_a_quality_layer_that_is_no_raster_is_refused_by_its_name(
    tmp_path: Path, write_raster: Write
) -> None:
    path = write_raster(tmp_path / "a_dem.tif", slanted(), POSTS)
    (tmp_path / "a_num.tif").write_bytes(b"")
    with pytest.raises(TerrainError, match=r"a_num\.tif is empty"):
        Dem.open([path])


@pytest.mark.parametrize("name", ["ASTGTM2_N48E008_num.tif", "ASTGTM2_N48E008_NUM.TIF", "x_num.tif.gz"])
def test_a_quality_layer_alone_is_not_taken_for_elevations(
    tmp_path: Path, write_raster: Write, name: str
) -> None:
    alone = write_raster(tmp_path / "t.tif", np.full((SIDE, SIDE), 9, np.int16), POSTS).rename(
        tmp_path / name
    )
    other = write_raster(tmp_path / "N49E008_dem.tif", slanted(), POSTS)
    for paths in ([alone], [other, alone]):
        with pytest.raises(TerrainError, match="is a quality layer") as caught:
            Dem.open(paths)
        assert name in str(caught.value)
        assert name.lower().replace("num", "dem") in str(caught.value).lower()


def test_a_quality_layer_among_the_rasters_goes_with_its_elevations(
    tmp_path: Path, write_raster: Write
) -> None:
    """A pattern such as ASTGTM2_* names both; one from another folder goes before the one beside."""
    path = pair_of(tmp_path, write_raster, slanted(), np.full((SIDE, SIDE), 9, np.int16))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    better = write_raster(elsewhere / "ASTGTM2_N48E008_num.tif", np.full((SIDE, SIDE), 2, np.uint8), POSTS)
    for paths, kept in (([tmp_path / "ASTGTM2_N48E008_num.tif", path], True), ([path, better], False)):
        with Dem.open(paths) as dem:
            assert dem.names == ("ASTGTM2_N48E008_dem.tif",)
            assert bool(np.isfinite(dem.filtered(5).heights(*place(5, 5)))) is kept
