"""Polynomials in the place of projections: both ways, small and large."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from fusion.frames import LocalProjection
from fusion.terrain.dem import Dem
from fusion.terrain.local_grid import LocalGrid, polynomial
from terrain_support import posts_deg

Write = Callable[..., Path]
PLANE = LocalProjection(8.4, 49.0)


def both_ways(grid: LocalGrid, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metres of grid coordinates, shape (n, 2), and the grid coordinates of those metres."""
    u0, v0, du, dv = grid.grid_box
    x0, y0, half = grid.plane_box
    xy = np.array(
        [polynomial(grid.to_plane, (a - u0) / du, (b - v0) / dv) for a, b in zip(u, v, strict=True)]
    )
    back = np.array([polynomial(grid.to_grid, (x - x0) / half, (y - y0) / half) for x, y in xy])
    return xy, back


@given(
    st.floats(-3, 3),
    st.floats(-60, 70),
    st.integers(0, 10**6),
    st.sampled_from([1 / 36000, 1 / 3600, 1 / 1200]),
    st.integers(1, 128),
    st.integers(1, 128),
)
def test_degrees_to_metres_and_back_within_a_micrometre(
    east: float, north: float, seed: int, step: float, columns: int, rows: int
) -> None:
    """Up to 128 posts of three arc seconds, anywhere, up to 3 degrees from the middle of the plane."""
    plane = LocalProjection(8.0, north)

    def project(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return plane.to_xy(8.0 + east + u * step, north - v * step)

    grid = LocalGrid.over((5, 5 + columns), (-7, -7 + rows), project)
    rng = np.random.default_rng(seed)
    u, v = 5 + columns * rng.random(20), -7 + rows * rng.random(20)
    xy, back = both_ways(grid, u, v)
    assert np.abs(xy - np.column_stack(project(u, v))).max() < 1e-6
    assert np.abs(back - np.column_stack([u, v])).max() < 1e-6


@pytest.mark.parametrize("crs", [4326, 32632])
@pytest.mark.parametrize(("size", "within_m"), [(3, 1e-7), (60, 1e-7), (120, 1e-7), (1100, 1e-3)])
def test_a_patch_of_any_size_knows_where_its_posts_are(
    tmp_path: Path, write_raster: Write, crs: int, size: int, within_m: float
) -> None:
    """To nothing where segments are; still to less than a millimetre 50 km from the middle."""
    posts = (
        Affine(1 / 1200, 0, 8.0, 0, -1 / 1200, 49.5)
        if crs == 4326
        else Affine(90, 0, 430_000, 0, -90, 5_480_000)
    )
    with Dem.open([write_raster(tmp_path / "a.tif", np.zeros((1200, 1200), np.int8), posts, crs)]) as dem:
        corners = np.array([30.3, 30.3 + size]), np.array([20.2, 20.2 + size])
        lon, lat = (posts.c + posts.a * corners[0], posts.f + posts.e * corners[1])
        if crs != 4326:
            lon, lat = Transformer.from_crs(crs, 4326, always_xy=True).transform(lon, lat)
        patch = dem.posts(lon, lat)
        assert patch is not None
        x, y = PLANE.to_xy(*posts_deg(patch))
        pick = np.random.default_rng(size).integers(0, x.size, 50)
        rows, columns = np.unravel_index(pick, x.shape)
        xy, back = both_ways(
            patch.local_grid(PLANE), patch.u0 + columns.astype(float), patch.v0 + rows.astype(float)
        )
        assert np.abs(xy - np.column_stack([x.ravel()[pick], y.ravel()[pick]])).max() < within_m
        assert np.abs(back - np.column_stack([patch.u0 + columns, patch.v0 + rows])).max() < within_m
