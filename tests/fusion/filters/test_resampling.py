"""Every resampling scheme: its exact law, and sound at the edges where others break."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from fusion.errors import UnknownNameError
from fusion.filters.resampling import (
    _BLOCK,
    RESAMPLERS,
    Resampler,
    _sorted_uniforms,
    _uniforms,
    multinomial,
    normalised,
)

SCHEMES = list(RESAMPLERS)
EXACT_IF_EQUAL = ["residual", "stratified", "systematic"]
WEIGHTS = np.array([0.45, 0.30, 0.15, 0.06, 0.04])
FALSE_ALARM = 1e-6  # of each test, were its seed drawn again; the seeds are fixed
Law = dict[tuple[int, ...], float]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES)


def counted(ancestors: np.ndarray | tuple[int, ...], n: int) -> tuple[int, ...]:
    return tuple(np.bincount(np.asarray(ancestors, np.int64), minlength=n).tolist())


def draws_from(chances: list[np.ndarray], given_copies: np.ndarray) -> Law:
    """The law of the numbers of descendants, with one independent draw from each of ``chances``."""
    law: Law = defaultdict(float)
    n = len(given_copies)
    for chosen in itertools.product(range(n), repeat=len(chances)):
        probability = float(np.prod([c[i] for c, i in zip(chances, chosen, strict=True)]))
        law[tuple(np.add(counted(chosen, n), given_copies).tolist())] += probability
    return law


def multinomial_law(w: np.ndarray) -> Law:
    return draws_from([w] * len(w), np.zeros(len(w), int))


def residual_law(w: np.ndarray) -> Law:
    copies = np.floor(len(w) * w).astype(int)
    missing = len(w) - int(copies.sum())
    return draws_from([(len(w) * w - copies) / missing] * missing, copies)


def parts(w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Begin and end of each particle's part of [0, n]."""
    ends = len(w) * np.cumsum(w)
    return ends - len(w) * w, ends


def stratified_law(w: np.ndarray) -> Law:
    begin, end = parts(w)
    strata = [np.clip(np.minimum(end, k + 1) - np.maximum(begin, k), 0, 1) for k in range(len(w))]
    return draws_from(strata, np.zeros(len(w), int))


def systematic_law(w: np.ndarray) -> Law:
    """Between two neighbouring places at which a point passes into another particle's part nothing changes."""
    _, end = parts(w)
    law: Law = defaultdict(float)
    for low, high in itertools.pairwise(sorted({0.0, 1.0, *(end % 1.0)})):
        points = np.arange(len(w)) + (low + high) / 2
        law[counted(np.searchsorted(end, points, side="right"), len(w))] += high - low
    return law


LAWS = {
    "multinomial": multinomial_law,
    "residual": residual_law,
    "stratified": stratified_law,
    "systematic": systematic_law,
}


def p_value(resample: Resampler, law: Law, runs: int = 4000) -> float:
    """Of the chi-square test of the draws against the law; 0 for what the law excludes."""
    seen = Counter(counted(resample(WEIGHTS, 11, step), len(WEIGHTS)) for step in range(runs))
    law = {c: p for c, p in law.items() if p > 1e-12}
    if not seen.keys() <= law.keys():
        return 0.0
    often = [c for c, p in law.items() if runs * p >= 5]
    observed, expected = [seen[c] for c in often], [runs * law[c] for c in often]
    if runs - sum(expected) > 1e-6:
        observed.append(runs - sum(observed))
        expected.append(runs - sum(expected))
    if len(expected) == 1:
        return 1.0
    return float(stats.chisquare(observed, expected).pvalue)


@each_scheme
def test_every_law_is_unbiased(scheme: str) -> None:
    """Of the laws themselves, so that draws that follow them are."""
    law = LAWS[scheme](WEIGHTS)
    assert sum(law.values()) == pytest.approx(1.0)
    mean = sum(p * np.array(counts) for counts, p in law.items())
    assert mean == pytest.approx(5 * WEIGHTS)


@pytest.mark.slow
@each_scheme
def test_the_numbers_of_descendants_follow_their_law(scheme: str) -> None:
    assert p_value(RESAMPLERS[scheme], LAWS[scheme](WEIGHTS)) > FALSE_ALARM


def wrong_remainders(weights: np.ndarray, seed: int, step: int) -> np.ndarray:
    """Residual resampling that draws what is left over by the whole weights."""
    copies = np.floor(len(weights) * weights).astype(int)
    missing = len(weights) - int(copies.sum())
    drawn = multinomial(weights, seed, step)[np.random.default_rng([seed, step]).permutation(5)[:missing]]
    return np.sort(np.append(np.repeat(np.arange(len(weights)), copies), drawn))


def slipped_points(weights: np.ndarray, seed: int, step: int) -> np.ndarray:
    """Systematic resampling whose first point is drawn from a tenth too narrow a range."""
    u = 0.9 * np.random.default_rng([seed, step]).random()
    return np.searchsorted(np.cumsum(weights), (np.arange(len(weights)) + u) / len(weights), side="right")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "wrong"), [("residual", wrong_remainders), ("systematic", slipped_points)]
)
def test_the_test_of_the_law_sees_known_mistakes(scheme: str, wrong: Resampler) -> None:
    assert p_value(wrong, LAWS[scheme](WEIGHTS)) < FALSE_ALARM


@pytest.mark.slow
@each_scheme
def test_large_clouds_are_unbiased_across_the_blocks_of_the_loops(scheme: str) -> None:
    """Descendants of 50 groups of neighbours, by a z test whose error bound is that of the least exact scheme."""
    n, groups, runs = 20_000, 50, 200
    weights = np.random.default_rng(2).gamma(0.3, size=n)
    weights /= weights.sum()
    share = weights.reshape(groups, -1).sum(axis=1)
    total = np.zeros(groups)
    for step in range(runs):
        total += np.bincount(RESAMPLERS[scheme](weights, 3, step) // (n // groups), minlength=groups)
    z = (total - runs * n * share) / np.sqrt(runs * n * share * (1 - share))
    assert np.abs(z).max() < stats.norm.isf(FALSE_ALARM / (2 * groups))


def test_every_block_of_the_loops_draws_numbers_of_its_own() -> None:
    for draws in (_uniforms(1, 2, 4 * _BLOCK), np.diff(_sorted_uniforms(1, 2, 4 * _BLOCK), prepend=0.0)):
        apart = np.corrcoef(draws.reshape(4, _BLOCK)) - np.eye(4)
        assert np.abs(apart).max() < 5 / np.sqrt(_BLOCK)


@each_scheme
@given(
    weights=st.lists(st.floats(0, 1, allow_subnormal=False), min_size=1, max_size=50).filter(
        lambda w: sum(w) > 1e-6
    ),
    step=st.integers(0, 2**31 - 1),
    scale=st.sampled_from([1.0, 1 - 1e-9, 1 + 1e-9, 1e-30, 1e30]),
)
def test_ancestors_are_ascending_and_within_the_bounds_of_theory(
    scheme: str, weights: list[float], step: int, scale: float
) -> None:
    w = np.array(weights) / np.sum(weights)
    n = len(w)
    ancestors = RESAMPLERS[scheme](w * scale, 1, step)
    assert ancestors.dtype == np.int64
    assert ancestors.shape == w.shape
    assert np.all(np.diff(ancestors) >= 0)
    assert ancestors[0] >= 0
    assert ancestors[-1] < n
    assert np.all(w[ancestors] > 0)
    low, high = bounds(scheme, w)
    counts = np.bincount(ancestors, minlength=n)
    assert np.all(counts >= low)
    assert np.all(counts <= high)


def bounds(scheme: str, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fewest and most descendants of each particle, where rounding may move what should be a whole number."""
    n = len(w)
    whole, ceiling = np.floor(n * w - 1e-9), np.ceil(n * w + 1e-9)
    if scheme == "systematic":
        return whole, ceiling
    if scheme == "residual":
        return whole, np.full(n, n)
    if scheme == "stratified":  # the strata that lie wholly in a particle's part, and those that it touches
        begin, end = parts(w)
        inside = np.floor(end - 1e-9) - np.ceil(begin + 1e-9)
        return np.maximum(inside, 0), np.ceil(end + 1e-9) - np.floor(begin - 1e-9)
    return np.zeros(n), np.full(n, n)


@each_scheme
@pytest.mark.parametrize("n", [1, 2, 3, 49, 1000, 4096, 4097, 10_000])
@pytest.mark.parametrize("total", [1.0, 1 - 1e-9, 1 + 1e-9])
def test_equal_weights(scheme: str, n: int, total: float) -> None:
    """One descendant each, but for independent draws; 49 * (1 / 49) is a little less than 1, for one."""
    ancestors = RESAMPLERS[scheme](np.full(n, total / n), 2, 5)
    assert len(ancestors) == n
    assert ancestors[-1] < n
    if scheme in EXACT_IF_EQUAL:
        assert np.array_equal(ancestors, np.arange(n))


@each_scheme
def test_the_sum_of_the_weights_plays_no_part(scheme: str) -> None:
    weights = np.random.default_rng(4).gamma(0.3, size=1000)
    expected = RESAMPLERS[scheme](weights, 7, 9)
    for power in (-60, -1, 40):
        assert np.array_equal(RESAMPLERS[scheme](np.ldexp(weights, power), 7, 9), expected)


@each_scheme
@pytest.mark.parametrize("where", [0, 37, 99])
def test_one_dominant_weight(scheme: str, where: int) -> None:
    alone = np.zeros(100)
    alone[where] = 1.0
    assert set(RESAMPLERS[scheme](alone, 0, 0).tolist()) == {where}
    almost = np.full(100, 1e-12)
    almost[where] = 1.0
    assert set(RESAMPLERS[scheme](almost, 0, 0).tolist()) == {where}


@each_scheme
def test_one_particle_is_its_own_ancestor(scheme: str) -> None:
    for weight in (1.0, 1 - 1e-9, 1e-300, 1e300):
        assert RESAMPLERS[scheme](np.array([weight]), 0, 0).tolist() == [0]


@each_scheme
@pytest.mark.parametrize("weights", [[0.0, 0.0], [np.nan, 1.0], [np.inf, 1.0], [1e308, 1e308]])
def test_weights_without_a_positive_finite_sum_are_refused(scheme: str, weights: list[float]) -> None:
    with pytest.raises(ValueError, match="positive, finite sum"):
        RESAMPLERS[scheme](np.array(weights), 0, 0)


@each_scheme
def test_the_same_on_any_number_of_threads_and_anew_at_each_step(scheme: str) -> None:
    weights = np.random.default_rng(6).gamma(0.3, size=50_001)
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, min(2, before)):
            numba.set_num_threads(threads)
            results.append(RESAMPLERS[scheme](weights, 8, 1))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(RESAMPLERS[scheme](weights, 8, 1), results[0])
    assert not np.array_equal(RESAMPLERS[scheme](weights, 8, 2), results[0])
    assert not np.array_equal(RESAMPLERS[scheme](weights, 9, 1), results[0])


@each_scheme
def test_particles_that_cannot_be_have_no_descendants(scheme: str) -> None:
    log_weights = np.full(1000, -np.inf)
    log_weights[::7] = np.random.default_rng(3).normal(-1e5, 1.0, len(log_weights[::7]))
    ancestors = RESAMPLERS[scheme](normalised(log_weights), 0, 0)
    assert np.all(ancestors % 7 == 0)


def test_log_weights_are_normalised() -> None:
    assert normalised(np.log([1.0, 3.0])) == pytest.approx([0.25, 0.75])
    assert normalised(np.array([-1e6, -np.inf, -1e6])) == pytest.approx([0.5, 0.0, 0.5])
    assert normalised(np.array([1e6])).tolist() == [1.0]
    for log_weights in ([-np.inf, -np.inf], [0.0, np.nan], [0.0, np.inf]):
        with pytest.raises(ValueError, match="finite log weight"):
            normalised(np.array(log_weights))


def test_an_unknown_scheme_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="multinomial, residual, stratified, systematic"):
        RESAMPLERS["bootstrap"]
