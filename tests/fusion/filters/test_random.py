"""The compiled random streams against the distributions they claim to follow."""

import math

import numpy as np
import pytest
from scipy import stats

from fusion.filters.random import (
    GROUP,
    LANE_WORDS,
    LANES,
    fill_normals,
    fill_uniforms,
    seed_lanes,
    seed_stream,
)

# Each statistical bound below would fail a sound generator once in a million seeds; the seeds are fixed.
RARE = 1e-6
FIVE_SIGMA = 5.0


def stream(seed: int, step: int = 0, block: int = 0) -> np.ndarray:
    state = np.empty(4, np.uint64)
    seed_stream(seed, step, block, state)
    return state


def normals(count: int, seed: int, step: int = 0, block: int = 0) -> np.ndarray:
    lanes = np.empty(LANE_WORDS, np.uint64)
    seed_lanes(seed, step, block, lanes)
    draws = np.empty(count, np.float32)
    fill_normals(lanes, draws)
    return draws.astype(float)


@pytest.mark.slow
def test_normals_follow_the_normal_distribution_in_body_and_tail() -> None:
    draws = normals(8_000_000, 3)
    edges = np.array([-np.inf, -4.5, -4, -3, -2, -1, -0.2, -0.01, 0, 0.01, 0.2, 1, 2, 3, 4, 4.5, np.inf])
    counts = np.histogram(draws, edges)[0]
    expected = np.diff(stats.norm.cdf(edges)) * len(draws)
    assert stats.chisquare(counts, expected).pvalue > RARE
    assert stats.kstest(draws[:1_000_000], "norm").pvalue > RARE


@pytest.mark.slow
def test_the_tails_reach_beyond_five_sigma_as_often_as_they_should() -> None:
    beyond = sum(int(np.sum(np.abs(normals(8_000_000, 4, step)) > 5)) for step in range(8))
    expected = 64_000_000 * 2 * stats.norm.sf(5)
    assert stats.poisson.cdf(beyond, expected) > RARE
    assert stats.poisson.sf(beyond - 1, expected) > RARE


@pytest.mark.slow
def test_moments_up_to_the_sixth() -> None:
    draws = normals(8_000_000, 5)
    for order in range(1, 7):
        expected, square = (math.prod(range(1, k, 2)) if k % 2 == 0 else 0 for k in (order, 2 * order))
        error = math.sqrt((square - expected**2) / len(draws))
        assert abs(np.mean(draws**order) - expected) < FIVE_SIGMA * error


@pytest.mark.parametrize("other", [(1, 0, 1), (1, 1, 0), (2, 0, 0)])
def test_streams_of_different_keys_are_independent(other: tuple[int, int, int]) -> None:
    first, second = normals(200_000, 1, 0, 0), normals(200_000, *other)
    for a, b in ((first, second), (first**2, second**2), (np.abs(first), second)):
        assert abs(np.corrcoef(a, b)[0, 1]) < FIVE_SIGMA / math.sqrt(len(first))


@pytest.mark.slow
@pytest.mark.parametrize("lag", [1, 2, LANES, 2 * LANES, GROUP // 2, GROUP, 2048])
def test_draws_of_one_block_are_independent(lag: int) -> None:
    """Half a GROUP apart are the two of a pair, a GROUP two draws of one stream, 2048 two states of a particle."""
    draws = normals(2_000_000, 7)
    for power in (1, 2, 3):
        a = draws**power
        assert abs(np.corrcoef(a[lag:], a[:-lag])[0, 1]) < FIVE_SIGMA / math.sqrt(len(draws) - lag)
    assert abs(np.corrcoef(draws[lag:] ** 2, draws[:-lag])[0, 1]) < FIVE_SIGMA / math.sqrt(len(draws) - lag)


def test_a_shorter_array_receives_the_first_draws_of_a_longer_one() -> None:
    whole = normals(1000, 9)
    for count in (1, GROUP - 1, GROUP, GROUP + 1, 999):
        assert np.array_equal(normals(count, 9), whole[:count])


def test_a_second_call_goes_on_with_new_draws() -> None:
    lanes = np.empty(LANE_WORDS, np.uint64)
    seed_lanes(9, 0, 0, lanes)
    parts = np.empty((2, GROUP), np.float32)
    for part in parts:
        fill_normals(lanes, part)
    assert np.array_equal(parts.ravel().astype(float), normals(2 * GROUP, 9))


def test_uniforms_fill_the_half_open_unit_interval() -> None:
    draws = np.empty(500_000)
    fill_uniforms(stream(5), draws)
    assert draws.min() >= 0
    assert draws.max() < 1
    assert stats.kstest(draws, "uniform").pvalue > RARE


@pytest.mark.parametrize("other", [(1, 0, 1), (1, 1, 0), (2, 0, 0), (1, 0, -1)])
def test_uniforms_of_different_keys_are_uncorrelated(other: tuple[int, int, int]) -> None:
    first, second = np.empty(100_000), np.empty(100_000)
    fill_uniforms(stream(1, 0, 0), first)
    fill_uniforms(stream(*other), second)
    assert abs(np.corrcoef(first, second)[0, 1]) < FIVE_SIGMA / math.sqrt(len(first))
