"""Expectation and maximisation against a plain reference, and what it may never do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from fusion.gnss.error_models.base import Series
from fusion.published.positioning.gmm import FLOOR_M2, MOST_STEPS, TOLERANCE, GmmModel, fit, moments, start
from fusion.types import Floats


def plain(sample: Floats, weight: Floats, mean: Floats, variance: Floats) -> float:
    """(B.21) to (B.25) in matrices, in place."""
    former = -np.inf
    for _ in range(MOST_STEPS):
        parts = weight * stats.norm.pdf(sample[:, None], mean, np.sqrt(variance))
        likelihood = float(np.log(parts.sum(axis=1)).sum())
        share = parts / parts.sum(axis=1, keepdims=True)
        total = share.sum(axis=0)
        weight[:] = total / len(sample)
        mean[:] = (share * sample[:, None]).sum(axis=0) / total
        variance[:] = np.maximum((share * (sample[:, None] - mean) ** 2).sum(axis=0) / total, FLOOR_M2)
        if likelihood - former <= TOLERANCE * len(sample):
            return likelihood
        former = likelihood
    return former


@given(st.integers(0, 10_000), st.integers(1, 4), st.floats(0, 40))
def test_it_is_the_plain_algorithm(seed: int, components: int, apart_m: float) -> None:
    rng = np.random.default_rng(seed)
    sample = np.concatenate([rng.normal(0, 2, 120), rng.normal(apart_m, 5, 80)])
    ours = start(sample, components, FLOOR_M2)
    reference = [column.copy() for column in ours]
    assert fit(sample, *ours, FLOOR_M2) == pytest.approx(plain(sample, *reference), rel=1e-9)
    for column, other in zip(ours, reference, strict=True):
        assert column == pytest.approx(other, rel=1e-6, abs=1e-6)


def test_two_normals_are_found() -> None:
    rng = np.random.default_rng(4)
    sample = np.concatenate([rng.normal(0, 1, 3000), rng.normal(20, 4, 1000)])
    weight, mean, variance = start(sample, 2, FLOOR_M2)
    fit(sample, weight, mean, variance, FLOOR_M2)
    assert weight == pytest.approx([0.75, 0.25], abs=0.02)
    assert mean == pytest.approx([0.0, 20.0], abs=0.4)
    assert np.sqrt(variance) == pytest.approx([1.0, 4.0], abs=0.3)


@given(st.lists(st.floats(-200, 200), min_size=1, max_size=40), st.integers(1, 4))
def test_a_fit_stays_a_mixture_and_keeps_the_sample_s_mean(values: list[float], components: int) -> None:
    sample = np.array(values)
    weight, mean, variance = start(sample, components, FLOOR_M2)
    fit(sample, weight, mean, variance, FLOOR_M2)
    assert weight.sum() == pytest.approx(1.0)
    assert np.all(variance >= FLOOR_M2) and np.isfinite(mean).all()
    middle, spread = moments(weight, mean, variance)
    assert middle == pytest.approx(sample.mean(), abs=1e-6 + 1e-6 * np.abs(sample).max())
    assert spread >= sample.var() * (1 - 1e-6) - 1e-6


@given(st.integers(1, 5), st.integers(0, 99))
def test_moments_are_those_of_draws(components: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.ones(components))
    mean, variance = rng.normal(0, 10, components), rng.uniform(1, 30, components)
    middle, spread = moments(weight, mean, variance)
    assert middle == pytest.approx(weight @ mean)
    assert spread == pytest.approx(weight @ (variance + mean**2) - middle**2)


def test_old_errors_leave_the_window() -> None:
    error_m = np.concatenate([np.full(100, 50.0), np.zeros(60)]) + np.random.default_rng(1).normal(0, 1, 160)
    part = Series(np.arange(160.0), error_m, np.ones(160, int), np.full(160, 45.0))
    mean, _ = GmmModel(window_s=40.0).track(part, 0)
    assert mean[99] == pytest.approx(50.0, abs=1.0)
    assert mean[-1] == pytest.approx(0.0, abs=1.0)
