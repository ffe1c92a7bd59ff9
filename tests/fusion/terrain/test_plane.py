"""Plane fits: exact on planes wherever they lie, honest when nothing is determined."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.terrain.plane import plane_through

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
    plane = plane_through(x + x0, y + y0, 300 + a * x + b * y)
    assert (plane.a, plane.b) == pytest.approx((a, b), abs=1e-7)
    assert plane.height_at(x0 + 5.0, y0 - 7.0) == pytest.approx(300 + 5 * a - 7 * b, abs=1e-5)
    assert plane.posts == len(x)
    if len(x) > 3:
        assert plane.sigma_m < 1e-6


@given(st.integers(0, 99), st.floats(0, 6.3))
def test_a_shift_of_the_origin_changes_nothing(seed: int, angle: float) -> None:
    x, y = window(seed, 4, 6, angle, 30.0)
    z = np.random.default_rng(seed).normal(200, 10, len(x))
    here, there = plane_through(x, y, z), plane_through(x + 1e6, y - 1e6, z)
    assert (there.a, there.b, there.sigma_m) == pytest.approx((here.a, here.b, here.sigma_m), abs=1e-8)
    for one, other in zip(x, y, strict=True):
        assert there.height_at(one + 1e6, other - 1e6) == pytest.approx(here.height_at(one, other), abs=1e-6)


@given(st.integers(0, 99))
def test_solves_the_normal_equations(seed: int) -> None:
    """Equation 3.10, solved directly where it is well conditioned."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.normal(size=(3, 12))
    design = np.column_stack([x, y, np.ones(12)])
    a, b, c = np.linalg.solve(design.T @ design, design.T @ z)
    plane = plane_through(x, y, z)
    assert (plane.a, plane.b) == pytest.approx((a, b), abs=1e-8)
    assert plane.height_at(0.0, 0.0) == pytest.approx(c, abs=1e-8)
    residual = z - design @ [a, b, c]
    assert plane.sigma_m == pytest.approx(np.sqrt(residual @ residual / 9))


@given(st.integers(3, 20), st.floats(0, 6.3), PLACE)
def test_collinear_points_make_no_plane(n: int, angle: float, x0: float) -> None:
    s = np.arange(n) * 30.0
    assert plane_through(x0 + s * np.cos(angle), s * np.sin(angle), s).posts == 0


def test_too_few_points_make_no_plane() -> None:
    x, y = np.array([0.0, 1, 1, 0]), np.array([0.0, 0, 1, 1])
    assert plane_through(x[:2], y[:2], x[:2]).posts == 0
    assert plane_through(np.zeros(4), np.zeros(4), x).posts == 0
    three = plane_through(x[:3], y[:3], np.array([1.0, 3, 8]))
    assert (three.a, three.b, three.posts) == (pytest.approx(2), pytest.approx(5), 3)
    assert np.isnan(three.sigma_m)
