"""Plane fits: exact on planes wherever they lie, honest when nothing is determined."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.terrain.plane import fit_plane

SLOPE = st.floats(-0.5, 0.5)
POSTING = st.sampled_from([1.0, 30.0, 90.0])
SIDE = st.integers(2, 9)
PLACE = st.sampled_from([0.0, 1e3, -4e5, 1e6, 5.4e6])


def window(seed: int, rows: int, columns: int, angle: float, posting: float) -> tuple[np.ndarray, np.ndarray]:
    """A rotated rectangle of posts, some of them missing, never fewer than 3 off one line."""
    v, u = (w.ravel() * posting for w in np.indices((rows, columns)))
    keep = np.random.default_rng(seed).random(len(u)) < 0.7
    keep[[0, 1, -1]] = True
    u, v = u[keep], v[keep]
    return u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)


@given(st.integers(0, 99), SIDE, SIDE, st.floats(0, 6.3), POSTING, SLOPE, SLOPE, PLACE, PLACE)
def test_recovers_a_plane_anywhere(
    seed: int,
    rows: int,
    columns: int,
    angle: float,
    posting: float,
    a: float,
    b: float,
    x0: float,
    y0: float,
) -> None:
    x, y = window(seed, rows, columns, angle, posting)
    plane = fit_plane(x + x0, y + y0, 300 + a * x + b * y)
    assert plane is not None
    assert (plane.a, plane.b) == pytest.approx((a, b), abs=1e-7)
    assert plane.height(np.array([x0 + 5.0]), np.array([y0 - 7.0])) == pytest.approx(
        300 + 5 * a - 7 * b, abs=1e-5
    )
    assert plane.posts == len(x)
    if len(x) > 3:
        assert plane.sigma_m < 1e-6


@given(st.integers(0, 99), st.floats(0, 6.3))
def test_a_shift_of_the_origin_changes_nothing(seed: int, angle: float) -> None:
    x, y = window(seed, 4, 6, angle, 30.0)
    z = np.random.default_rng(seed).normal(200, 10, len(x))
    here, there = fit_plane(x, y, z), fit_plane(x + 1e6, y - 1e6, z)
    assert here is not None
    assert there is not None
    assert (there.a, there.b, there.sigma_m) == pytest.approx((here.a, here.b, here.sigma_m), abs=1e-8)
    assert there.height(x + 1e6, y - 1e6) == pytest.approx(here.height(x, y), abs=1e-6)


@given(st.integers(0, 99))
def test_solves_the_normal_equations(seed: int) -> None:
    """Equation 3.10, solved directly where it is well conditioned."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.normal(size=(3, 12))
    design = np.column_stack([x, y, np.ones(12)])
    a, b, c = np.linalg.solve(design.T @ design, design.T @ z)
    plane = fit_plane(x, y, z)
    assert plane is not None
    assert (plane.a, plane.b) == pytest.approx((a, b), abs=1e-8)
    assert plane.height(np.zeros(1), np.zeros(1)) == pytest.approx(c, abs=1e-8)
    residual = z - design @ [a, b, c]
    assert plane.sigma_m == pytest.approx(np.sqrt(residual @ residual / 9))


@given(st.integers(3, 20), st.floats(0, 6.3), PLACE)
def test_collinear_points_make_no_plane(n: int, angle: float, x0: float) -> None:
    s = np.arange(n) * 30.0
    assert fit_plane(x0 + s * np.cos(angle), s * np.sin(angle), s) is None


def test_too_few_points_make_no_plane_and_voids_do_not_count() -> None:
    x, y = np.array([0.0, 1, 0, 1]), np.array([0.0, 0, 1, 1])
    assert fit_plane(x[:2], y[:2], x[:2]) is None
    assert fit_plane(x, y, np.array([1, np.nan, np.nan, 2])) is None
    assert fit_plane(np.zeros(4), np.zeros(4), x) is None
    three = fit_plane(x, y, np.array([1, 3, np.nan, 8]))
    assert three is not None
    assert (three.a, three.b, three.posts) == (pytest.approx(2), pytest.approx(5), 3)
    assert np.isnan(three.sigma_m)
