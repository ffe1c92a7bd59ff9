"""Triangulated heights: equations 2.33-2.34 and what follows from them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fusion.terrain.local_grid import tin_heights

HEIGHTS = hnp.arrays(float, st.tuples(st.integers(2, 6), st.integers(2, 7)), elements=st.floats(-400, 5000))
SHARE = st.floats(0, 1)


def at(z: np.ndarray, u: float, v: float) -> float:
    return float(tin_heights(z, np.array([u], float), np.array([v], float))[0])


def equation_2_34(z: np.ndarray, x: float, y: float, dx: float, dy: float) -> float:
    """The printed formula in metres, posts at (column * dx, row * dy)."""
    i = min(int(np.floor(x / dx)), z.shape[1] - 2)
    j = min(int(np.floor(y / dy)), z.shape[0] - 2)
    za, zb, zc, zd = z[j, i], z[j, i + 1], z[j + 1, i], z[j + 1, i + 1]
    if (x - i * dx) / dx + (y - j * dy) / dy <= 1:
        return float(za + (zb - za) / dx * (x - i * dx) + (zc - za) / dy * (y - j * dy))
    return float(zd + (zd - zc) / dx * (x - (i + 1) * dx) + (zd - zb) / dy * (y - (j + 1) * dy))


@given(HEIGHTS, SHARE, SHARE)
def test_equals_the_printed_formula_on_unequal_postings(z: np.ndarray, a: float, b: float) -> None:
    dx, dy = 19.51, -30.89
    u, v = a * (z.shape[1] - 1), b * (z.shape[0] - 1)
    assert at(z, u, v) == pytest.approx(equation_2_34(z, u * dx, v * dy, dx, dy), abs=1e-6)


@given(st.integers(2, 6), st.integers(2, 7), *[st.floats(-100, 100)] * 3, SHARE, SHARE)
def test_is_exact_for_planes(
    rows: int, columns: int, slope_u: float, slope_v: float, level: float, a: float, b: float
) -> None:
    v, u = np.indices((rows, columns))
    z = level + slope_u * u + slope_v * v
    x, y = a * (columns - 1), b * (rows - 1)
    assert at(z, x, y) == pytest.approx(level + slope_u * x + slope_v * y, abs=1e-9)


@given(HEIGHTS)
def test_reproduces_the_posts(z: np.ndarray) -> None:
    v, u = np.indices(z.shape)
    assert tin_heights(z, u.ravel().astype(float), v.ravel().astype(float)).tolist() == z.ravel().tolist()


@given(HEIGHTS, SHARE, SHARE, st.floats(0, 2 * np.pi), st.sampled_from(["column", "row", "diagonal"]))
def test_is_continuous_across_every_edge(z: np.ndarray, a: float, b: float, angle: float, edge: str) -> None:
    i, j = int(a * (z.shape[1] - 2)), int(b * (z.shape[0] - 2))
    u, v = {"column": (i + 1, j + b), "row": (i + a, j + 1), "diagonal": (i + a, j + 1 - a)}[edge]
    u, v = min(u, z.shape[1] - 1.001), min(v, z.shape[0] - 1.001)
    step = 1e-7
    there = at(z, max(u + step * np.cos(angle), 0), max(v + step * np.sin(angle), 0))
    assert there == pytest.approx(at(z, u, v), abs=4 * step * np.ptp(z) + 1e-6)


def test_voids_are_unknown_only_where_their_triangle_is_touched() -> None:
    z = np.arange(9.0).reshape(3, 3)
    z[0, 0] = np.nan
    assert np.isnan(at(z, 0.2, 0.2))
    assert np.isnan(at(z, 0.0, 0.5))
    assert at(z, 0.6, 0.6) == pytest.approx(0.6 + 3 * 0.6)
    assert at(z, 1.0, 0.0) == 1.0
    assert at(z, 0.5, 0.5) == 2.0  # on the diagonal, which the void does not touch


@pytest.mark.parametrize(
    ("u", "v"), [(-0.1, 1), (2.1, 1), (1, -0.1), (1, 2.1), (np.nan, 1), (1, np.inf), (-5, -5), (9, 9)]
)
def test_is_unknown_off_the_posts(u: float, v: float) -> None:
    assert np.isnan(at(np.zeros((3, 3)), u, v))


def test_the_last_row_and_column_belong() -> None:
    z = np.arange(9.0).reshape(3, 3)
    assert [at(z, 2, 2), at(z, 2, 0.5), at(z, 0.5, 2)] == [8, 3.5, 6.5]
