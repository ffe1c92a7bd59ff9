"""The compiled random streams against the distributions they claim to follow."""

import numpy as np
import pytest
from scipy import stats

from fusion.filters.random import fill_normals, fill_uniforms, seed_stream


def stream(seed: int, step: int = 0, block: int = 0) -> np.ndarray:
    state = np.empty(4, np.uint64)
    seed_stream(seed, step, block, state)
    return state


def test_normals_follow_the_normal_distribution_in_body_and_tail() -> None:
    draws = np.empty(2_000_000)
    fill_normals(stream(3), draws)
    edges = np.array(
        [-np.inf, -4, -3.6541528853610088, -3, -2, -1, -0.2, 0, 0.2, 1, 2, 3, 3.6541528853610088, 4, np.inf]
    )
    counts = np.histogram(draws, edges)[0]
    expected = np.diff(stats.norm.cdf(edges)) * len(draws)
    # A sound generator fails this once in a million seeds; the seed is fixed.
    assert stats.chisquare(counts, expected).pvalue > 1e-6
    assert stats.kstest(draws[:100_000], "norm").pvalue > 1e-6


def test_uniforms_fill_the_half_open_unit_interval() -> None:
    draws = np.empty(500_000)
    fill_uniforms(stream(5), draws)
    assert draws.min() >= 0
    assert draws.max() < 1
    assert stats.kstest(draws, "uniform").pvalue > 1e-6


@pytest.mark.parametrize("other", [(1, 0, 1), (1, 1, 0), (2, 0, 0)])
def test_streams_of_different_keys_are_uncorrelated(other: tuple[int, int, int]) -> None:
    first, second = np.empty(100_000), np.empty(100_000)
    fill_normals(stream(1, 0, 0), first)
    fill_normals(stream(*other), second)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(len(first))


def test_consecutive_draws_are_uncorrelated() -> None:
    draws = np.empty(1_000_000)
    fill_normals(stream(7), draws)
    for lag in (1, 2, 3, 9):
        assert abs(np.mean(draws[lag:] * draws[:-lag])) < 5 / np.sqrt(len(draws))


def test_a_stream_goes_on_where_it_stopped() -> None:
    whole, parts = np.empty(1000), np.empty(1000)
    fill_normals(stream(9), whole)
    state = stream(9)
    fill_normals(state, parts[:333])
    fill_normals(state, parts[333:])
    assert np.array_equal(whole, parts)
