"""The elevation model: where posts lie, how tiles join, what is unknown."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from fusion.terrain.dem import Dem
from terrain_support import POSTS, at_posts, hills

Write = Callable[..., Path]


@pytest.mark.parametrize("meaning", ["Area", "Point"])
def test_posts_are_the_centres_of_pixels(tmp_path: Path, write_raster: Write, meaning: str) -> None:
    z = hills(20, 30)
    path = write_raster(tmp_path / "a.tif", z, POSTS, AREA_OR_POINT=meaning)
    with Dem.open([path]) as dem:
        assert dem.heights(*at_posts(POSTS, 20, 30)).tolist() == z.tolist()


@pytest.mark.parametrize(
    "posts", [POSTS, Affine(0.001, 0.0003, 8, -0.0002, -0.001, 49), Affine(0.001, 0, 8, 0, 0.001, 48)]
)
def test_any_affine_grid(tmp_path: Path, write_raster: Write, posts: Affine) -> None:
    """North up, rotated, and south up."""
    z = hills(12, 9)
    with Dem.open([write_raster(tmp_path / "a.tif", z, posts)]) as dem:
        lon, lat = at_posts(posts, 12, 9)
        assert dem.heights(lon, lat) == pytest.approx(z, abs=1e-6)
        middle = (lon[:-1, :-1] + lon[1:, 1:]) / 2, (lat[:-1, :-1] + lat[1:, 1:]) / 2
        assert dem.heights(*middle) == pytest.approx((z[:-1, 1:] + z[1:, :-1]) / 2, abs=1e-6)


@pytest.fixture(scope="module")
def slanted(tmp_path_factory: pytest.TempPathFactory, write_raster: Write) -> Dem:
    """z = 100 + 300 (lon - 8) - 500 (lat - 49) over several blocks, from four tiles that share no post."""
    folder = tmp_path_factory.mktemp("slanted")
    lon, lat = at_posts(POSTS, 700, 600)
    z = 100 + 300 * (lon - 8) - 500 * (lat - 49)
    paths = []
    for k, (r, c) in enumerate([(0, 0), (0, 250), (310, 0), (310, 250)]):
        part = z[r : r + 310 if r == 0 else None, c : c + 250 if c == 0 else None]
        paths.append(
            write_raster(
                folder / f"{k}.tif", part, Affine(0.001, 0, 8 + 0.001 * c, 0, -0.001, 49 - 0.001 * r)
            )
        )
    return Dem.open(paths)


@given(st.floats(0, 599), st.floats(0, 699))
def test_a_plane_is_exact_across_blocks_and_tiles(slanted: Dem, u: float, v: float) -> None:
    lon, lat = 8 + 0.001 * u, 49 - 0.001 * v
    assert slanted.heights(lon, lat) == pytest.approx(100 + 300 * (lon - 8) - 500 * (lat - 49), abs=1e-6)


def test_no_gap_between_blocks(slanted: Dem) -> None:
    lon, lat = 8 + 0.001 * np.linspace(254, 258, 81)[:, None], 49 - 0.001 * np.linspace(254, 258, 81)
    assert slanted.heights(lon, lat) == pytest.approx(100 + 300 * (lon - 8) - 500 * (lat - 49), abs=1e-6)


def test_rasters_off_each_others_grid_keep_their_own_posts(tmp_path: Path, write_raster: Write) -> None:
    south = Affine(0.001, 0, 8.0, 0, -0.001, 48.9796)  # 20.4 posts below
    a, b = hills(20, 30), hills(20, 30, seed=1)
    paths = [write_raster(tmp_path / "a.tif", a, POSTS), write_raster(tmp_path / "b.tif", b, south)]
    with Dem.open(paths) as dem:
        assert dem.heights(*at_posts(POSTS, 20, 30)).tolist() == a.tolist()
        assert dem.heights(*at_posts(south, 20, 30)) == pytest.approx(b, abs=1e-6)


@given(st.floats(7, 10), st.floats(47, 50))
def test_is_unknown_off_the_posts(slanted: Dem, lon: float, lat: float) -> None:
    u, v = (lon - 8) / 0.001, (49 - lat) / 0.001
    inside = 0 <= u <= 599 and 0 <= v <= 699
    near_edge = min(abs(u), abs(u - 599), abs(v), abs(v - 699)) < 1e-5
    assert near_edge or bool(np.isfinite(slanted.heights(lon, lat))) == inside


def test_shapes_broadcast(slanted: Dem) -> None:
    assert slanted.heights(np.full((2, 3), 8.1), 48.9).shape == (2, 3)
    assert slanted.heights(8.1, 48.9).shape == ()
    assert np.isnan(slanted.heights([np.nan, 8.1, np.inf], [48.9, np.nan, 48.9])).all()


def test_a_projected_raster(tmp_path: Path, write_raster: Write) -> None:
    posts = Affine(10, 0, 450_000, 0, -20, 5_430_000)
    x, y = at_posts(posts, 40, 50)
    path = write_raster(
        tmp_path / "utm.tif", 100 + 0.1 * (x - 450_000) + 0.05 * (y - 5_430_000), posts, 25832
    )
    to_lonlat = Transformer.from_crs(25832, 4326, always_xy=True)
    lon, lat = to_lonlat.transform([450_123.0, 450_490.0], [5_429_777.0, 5_429_220.0])
    with Dem.open([path]) as dem:
        assert dem.heights(lon, lat) == pytest.approx([100 + 12.3 - 11.15, 100 + 49 - 39], abs=1e-4)
        assert dem.datum == "unknown"


@pytest.mark.slow
@pytest.mark.parametrize("side", [1201, 3601])
def test_hgt_tiles_join_at_their_shared_edges(tmp_path: Path, write_hgt: Write, side: int) -> None:
    steps = side - 1
    z = np.random.default_rng(3).integers(0, 900, (side, side))
    east = np.random.default_rng(4).integers(0, 900, (side, side))
    north = np.random.default_rng(5).integers(0, 900, (side, side))
    east[:, 0], north[-1] = z[:, -1], z[0]
    names = {"N48E008.hgt": z, "N48E009.hgt": east, "N49E008.hgt": north}
    with Dem.open([write_hgt(tmp_path / name, tile) for name, tile in names.items()]) as dem:
        k = np.arange(side)
        assert dem.datum == "EGM96"
        assert dem.heights(8 + k / steps, 48.0).tolist() == z[-1].tolist()
        assert dem.heights(8 + k / steps, 49.0).tolist() == z[0].tolist()
        assert dem.heights(8.0, 49 - k / steps).tolist() == z[:, 0].tolist()
        assert dem.heights(9.0, 49 - k / steps).tolist() == z[:, -1].tolist()
        assert dem.heights(9 + 1 / steps, 49 - k / steps).tolist() == east[:, 1].tolist()
        assert dem.heights(8 + k / steps, 49 + 1 / steps).tolist() == north[-2].tolist()
        across = dem.heights(9 + np.array([-0.5, 0.5]) / steps, 48.5)
        row = steps // 2
        expected = [(z[row, -2] + z[row, -1]) / 2, (z[row, -1] + east[row, 1]) / 2]
        assert across == pytest.approx(expected, abs=1e-6)


def test_the_finest_raster_counts_and_coarser_ones_fill(
    tmp_path: Path, write_raster: Write, write_hgt: Write
) -> None:
    fine = np.full((101, 101), 10, np.int16)
    fine[40:60, 40:60] = -32768
    posts = Affine(1 / 3600, 0, 8.5, 0, -1 / 3600, 48.5)
    paths = [
        write_hgt(tmp_path / "N48E008.hgt", np.full((1201, 1201), 700)),
        write_raster(tmp_path / "fine.tif", fine, posts),
    ]
    for order in (paths, paths[::-1]):
        with Dem.open(order) as dem:
            lon, lat = 8.5 + np.array([10, 50, 101]) / 3600, 48.5 - np.array([10, 50, 10]) / 3600
            assert dem.heights(lon, lat).tolist() == [10, 700, 700]
            assert dem.datum == "mixed (EGM96, unknown)"
            patch = dem.posts(8.5 + np.array([39, 40]) / 3600, 48.5 - np.array([49, 50]) / 3600)
            assert patch is not None
            assert set(patch.z.ravel()) == {10, 700}
            assert patch.mosaic.posting_m[1] * patch.step == pytest.approx(30.9, abs=0.1)


def test_overlapping_rasters_of_one_grid_fill_each_other(tmp_path: Path, write_raster: Write) -> None:
    first, second = np.full((10, 10), 1.0), np.full((10, 10), 2.0)
    first[3, 3] = np.nan
    paths = [write_raster(tmp_path / f"{k}.tif", z, POSTS) for k, z in enumerate((first, second))]
    with Dem.open(paths) as dem:
        assert dem.heights(8 + np.array([0, 3]) * 0.001, 49 - np.array([0, 3]) * 0.001).tolist() == [1, 2]


@pytest.mark.parametrize(
    ("dtype", "fill", "nodata"),
    [
        ("int16", -32768, -32768),
        ("int16", -32768, None),
        ("int16", -9999, None),
        ("int16", 0, 0),
        ("uint16", 65535, 65535),
        ("float32", np.nan, None),
        ("float32", -3.4e38, -3.4e38),
        ("float32", np.inf, None),
        ("float64", -9999, -9999),
        ("float32", -32767, None),
    ],
)
def test_voids_are_unknown_and_never_zero(
    tmp_path: Path, write_raster: Write, dtype: str, fill: float, nodata: float | None
) -> None:
    z = np.full((5, 5), 50, dtype)
    z[2, 2] = fill
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS, nodata=nodata)]) as dem:
        heights = dem.heights(*at_posts(POSTS, 5, 5))
        assert np.isnan(heights[2, 2])
        assert np.isfinite(heights).sum() == 24
        assert np.isnan(dem.heights(8.0021, 48.9979))


def test_zero_and_below_are_heights(tmp_path: Path, write_raster: Write) -> None:
    z = np.array([[0, -5], [-430, 0]], np.int16)
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS)]) as dem:
        assert dem.heights(*at_posts(POSTS, 2, 2)).tolist() == z.tolist()


def test_scale_offset_and_feet_are_applied(tmp_path: Path, write_raster: Write) -> None:
    z = np.array([[100, 200], [300, -32768]], np.int16)
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS, scales=0.1, offsets=1000.0)]) as dem:
        assert dem.heights(*at_posts(POSTS, 2, 2)).ravel() == pytest.approx(
            [1010, 1020, 1030, np.nan], nan_ok=True
        )
    with Dem.open([write_raster(tmp_path / "b.tif", z, POSTS, units="ft")]) as dem:
        assert dem.heights(8.0, 49.0) == pytest.approx(30.48)


@pytest.mark.parametrize(
    ("crs", "posts", "datum"),
    [
        ("EPSG:4326+5773", POSTS, "EGM96"),
        ("EPSG:4326+3855", POSTS, "EGM2008"),
        ("EPSG:25832+7837", Affine(10, 0, 450_000, 0, -10, 5_430_000), "DHHN2016"),
        ("EPSG:4979", POSTS, "WGS 84 ellipsoid"),
        ("EPSG:4326", POSTS, "unknown"),
    ],
)
def test_the_datum_is_what_the_raster_states(
    tmp_path: Path, write_raster: Write, crs: str, posts: Affine, datum: str
) -> None:
    with Dem.open([write_raster(tmp_path / "a.tif", hills(5, 5), posts, crs)]) as dem:
        assert dem.datum == datum
        assert datum in dem.description


def test_real_tiles_join(shared_data: Path) -> None:
    folder = shared_data / "karlsruhe"
    south, north = (
        np.fromfile(folder / n, ">i2").reshape(1201, 1201) for n in ("N48E008.hgt", "N49E008.hgt")
    )
    with Dem.open([folder / "N48E008.hgt", folder / "N49E008.hgt"]) as dem:
        k = np.arange(1201)
        assert dem.heights(8 + k / 1200, 49.0).tolist() == south[0].tolist() == north[-1].tolist()
        assert dem.heights(8 + k / 1200, 49 + 1 / 1200).tolist() == north[-2].tolist()
        seam = dem.heights(8 + k / 1200, 49 + 0.5 / 1200)
        assert seam == pytest.approx((north[-1] + north[-2]) / 2, abs=1e-6)
        assert dem.description == "2 rasters, posting 92.6 m, datum EGM96"


def test_a_gzipped_hgt_tile_is_read_where_it_is(tmp_path: Path, write_hgt: Write) -> None:
    plain = write_hgt(tmp_path / "N48E008.hgt", np.arange(1201 * 1201).reshape(1201, 1201) % 900)
    packed = tmp_path / "gz" / "N48E008.hgt.gz"
    packed.parent.mkdir()
    packed.write_bytes(gzip.compress(plain.read_bytes(), 1))
    lon, lat = np.linspace(8.01, 8.99, 50), np.linspace(48.99, 48.01, 50)
    with Dem.open([plain]) as a, Dem.open([packed]) as b:
        assert np.isfinite(a.heights(lon, lat)).all()
        assert a.heights(lon, lat).tolist() == b.heights(lon, lat).tolist()
        assert (a.datum, a.description) == (b.datum, b.description)
