"""Fewer points: no highest and lowest, no end of a gap and no bend is lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.drives.outputs.thinning import thinned
from fusion.types import Ints

NONE = np.zeros(0, np.bool_)


@st.composite
def columns(draw: st.DrawFn) -> tuple[dict[str, np.ndarray], int]:
    n = draw(st.integers(1, 400))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    standing = rng.random(n) < draw(st.sampled_from([0.0, 0.3, 1.0]))
    unknown = draw(st.sampled_from([0.0, 0.2, 1.0]))
    table = {
        "along": np.cumsum(np.where(standing, 0.0, rng.exponential(20, n))),
        "height": np.where(rng.random(n) < unknown, np.nan, np.cumsum(rng.normal(size=n))),
        "grade": np.where(rng.random(n) < unknown, np.nan, rng.normal(size=n).round(1)),
        "starts": rng.random(n) < draw(st.sampled_from([0.0, 0.02, 0.5])),
        "outage": rng.random(n) < draw(st.sampled_from([0.0, 0.02, 0.5])),
        "x": rng.normal(size=n),
        "y": rng.normal(size=n),
    }
    return table, draw(st.integers(2, 500))


def kept_of(table: dict[str, np.ndarray], points: int) -> Ints:
    peaks = (table["height"], table["grade"])
    return thinned(points, table["along"], peaks, table["starts"], table["outage"], (table["x"], table["y"]))


@given(columns())
def test_extremes_and_ends_of_gaps_stay(given_: tuple[dict[str, np.ndarray], int]) -> None:
    table, points = given_
    n, kept = len(table["along"]), kept_of(*given_)
    assert (np.diff(kept) > 0).all()
    assert {0, n - 1} <= set(kept.tolist())
    starts = np.flatnonzero(table["starts"])
    assert set(starts.tolist()) | set((starts[starts > 0] - 1).tolist()) <= set(kept.tolist())
    for name in ("height", "grade"):
        known = np.isfinite(table[name])
        if known.any():
            assert np.nanmax(table[name][kept]) == np.nanmax(table[name])
            assert np.nanmin(table[name][kept]) == np.nanmin(table[name])
    ends = 2 + 2 * len(starts)
    assert len(kept) <= max(points, ends + 4)
    if n <= points:
        assert len(kept) == n


@pytest.mark.parametrize("points", range(2, 30))
def test_bends_take_no_room_from_peaks(points: int) -> None:
    """What is more than was asked for are ends and the peaks of one stretch, nothing else."""
    rng = np.random.default_rng(points)
    for _ in range(20):
        table = {
            **{name: rng.normal(size=100) for name in ("height", "grade", "x", "y")},
            **{name: np.zeros(100, np.bool_) for name in ("starts", "outage")},
            "along": np.cumsum(rng.exponential(20, 100)),
        }
        assert len(kept_of(table, points)) <= max(points, 2 + 4)


def test_each_stretch_keeps_its_own_peaks() -> None:
    """Ten hills in a row, and a bump of one epoch on each."""
    n, none = 10_000, np.zeros(10_000, np.bool_)
    along = np.arange(n, dtype=float)
    height = np.sin(along / n * 20 * np.pi)
    bumps = 500 + 1000 * np.arange(10)
    height[bumps] = 3 + np.arange(10)
    kept = thinned(100, along, (height,), none, none)
    assert set(bumps.tolist()) <= set(kept.tolist())
    assert len(kept) <= 100


def test_bends_stay() -> None:
    """A block of streets: its corners are among few points."""
    side, none = 1000, np.zeros(4000, np.bool_)
    step = np.arange(side, dtype=float)
    x = np.r_[step, np.full(side, 1000.0), 1000 - step, np.zeros(side)]
    y = np.r_[np.zeros(side), step, np.full(side, 1000.0), 1000 - step]
    kept = thinned(42, np.arange(4000, dtype=float) + 5, (), none, none, (x + 0.3, y))
    for corner in (1000, 2000, 3000):
        assert np.abs(kept - corner).min() <= 1


def test_outages_keep_their_ends_unless_they_are_everywhere() -> None:
    n = 1000
    along, none = np.arange(n, dtype=float), np.zeros(n, np.bool_)
    outage = (along >= 333) & (along < 777)
    assert {332, 333, 776, 777} <= set(thinned(20, along, (), none, outage).tolist())
    assert len(thinned(20, along, (), none, np.arange(n) % 2 == 0)) <= 20


def test_columns_without_a_row() -> None:
    assert len(thinned(2, np.zeros(0), (), NONE, NONE)) == 0
