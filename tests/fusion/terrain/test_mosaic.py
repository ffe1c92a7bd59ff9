"""Rectangles of posts: around places, across blocks, beyond the rasters, thinned."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st

from fusion.frames import LocalProjection
from fusion.terrain import dem as dem_module
from fusion.terrain.dem import Dem
from terrain_support import POSTS, at_posts, hills, posts_deg

Write = Callable[..., Path]


def test_the_posts_around_a_place(tmp_path: Path, write_raster: Write) -> None:
    z = hills(40, 50)
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS)]) as dem:
        places = np.array([8.0138, 8.0102]), np.array([48.9888, 48.9852])
        patch = dem.posts(*places, margin_posts=2)
        assert patch is not None
        assert patch.z.tolist() == z[9:18, 8:17].tolist()
        lon, lat = posts_deg(patch)
        assert (lon[0, 0], lat[0, 0]) == pytest.approx((8.008, 48.991))
        assert (lon[-1, -1], lat[-1, -1]) == pytest.approx((8.016, 48.983))
        x, y = LocalProjection(8.008, 48.991).to_xy(lon, lat)
        assert (x[0, 0], y[0, 0]) == pytest.approx((0, 0), abs=1e-3)
        assert x[0, 1] == pytest.approx(patch.mosaic.posting_m[0], rel=1e-2)
        assert y[1, 0] == pytest.approx(-patch.mosaic.posting_m[1], rel=1e-2)
        assert (patch.u, patch.v) == (pytest.approx([13.8, 10.2]), pytest.approx([11.2, 14.8]))
        wide = dem.posts(*places, margin_posts=2, margin_m=500.0)
        assert wide is not None
        assert wide.z.shape == (5 + 2 * 5, 5 + 2 * 7)
        assert dem.posts(np.array([9.0, 9.1]), np.array([49.0, 49.1])) is None
        assert dem.posts(np.array([8.01, np.nan]), np.array([48.99, 48.99])) is None


def test_beyond_the_raster_posts_are_void(tmp_path: Path, write_raster: Write) -> None:
    with Dem.open([write_raster(tmp_path / "a.tif", hills(5, 5), POSTS)]) as dem:
        patch = dem.posts(np.array([8.0035]), np.array([48.9985]))
        assert patch is not None
        assert np.isnan(patch.z[:, -1]).all()
        assert np.isfinite(patch.z[:, :-1]).all()


def test_very_many_posts_are_thinned(
    tmp_path: Path, write_raster: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    lon, lat = at_posts(POSTS, 60, 80)
    z = 1000 * (lon - 8) + 2000 * (lat - 48)
    with Dem.open([write_raster(tmp_path / "a.tif", z, POSTS)]) as dem:
        monkeypatch.setattr(dem_module, "_MAX_PATCH_POSTS", 100)
        patch = dem.posts(np.array([8.01, 8.05]), np.array([48.96, 48.99]), margin_posts=0)
        assert patch is not None
        assert patch.z.size < 200
        lon, lat = posts_deg(patch)
        assert patch.z == pytest.approx(1000 * (lon - 8) + 2000 * (lat - 48), abs=1e-6)
        assert (lon.max() >= 8.05, lat.min() <= 48.96) == (True, True)


@pytest.fixture(scope="module")
def rough(tmp_path_factory: pytest.TempPathFactory, write_raster: Write) -> tuple[Dem, np.ndarray]:
    """Several blocks of posts that say which they are."""
    z = np.arange(900 * 800, dtype=np.int32).reshape(900, 800) % 8999
    return Dem.open(
        [write_raster(tmp_path_factory.mktemp("rough") / "a.tif", z, Affine(0.001, 0, 8.4, 0, -0.001, 49.1))]
    ), z


@given(st.integers(0, 799), st.integers(0, 899), st.integers(0, 60), st.integers(0, 600), st.integers(0, 9))
def test_windows_across_blocks_hold_the_posts_in_their_order(
    rough: tuple[Dem, np.ndarray], u: int, v: int, wide: int, tall: int, thinning: int
) -> None:
    dem, z = rough
    right, bottom = min(u + wide, 799), min(v + tall, 899)
    lon, lat = 8.4 + np.array([u, right]) * 0.001, 49.1 - np.array([v, bottom]) * 0.001
    with pytest.MonkeyPatch.context() as patch_context:
        patch_context.setattr(
            dem_module, "_MAX_PATCH_POSTS", 4_000_000 if thinning < 4 else 9_000 // thinning
        )
        patch = dem.posts(lon, lat, margin_posts=0)
    assert patch is not None
    rows = patch.v0 + patch.step * np.arange(patch.z.shape[0])
    columns = patch.u0 + patch.step * np.arange(patch.z.shape[1])
    assert (patch.u0, patch.v0) == (u, v)
    assert (rows[-1] > bottom, columns[-1] > right) == (True, True)
    inside = np.ix_(rows < 900, columns < 800)
    assert patch.z[inside].tolist() == z[np.ix_(rows[rows < 900], columns[columns < 800])].tolist()
    assert np.isnan(patch.z[rows >= 900]).all()
    assert np.isnan(patch.z[:, columns >= 800]).all()
