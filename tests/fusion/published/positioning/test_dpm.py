"""The Polya urn against its law: how often a draw is new, what a new one is, what a copy of a particle remembers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.gnss.error_models.base import Series
from fusion.gnss.reception import LOS, NLOS
from fusion.published.positioning.dpm import (
    LOS_SIMULATED,
    NLOS_BASE,
    BaseMeasure,
    DpmModel,
    Urns,
    draw_all,
    draw_pairs,
    open_row,
)
from fusion.types import Floats


def drawn(
    base: BaseMeasure, epochs: int, particles: int, rows: int, centre_m: float = 0.0
) -> tuple[Urns, Floats]:
    """Urns of one satellite after some epochs, and the means that were drawn, (epochs, particles)."""
    urns, rng = Urns.empty(rows, 1, particles), np.random.default_rng(5)
    means = np.empty((epochs, particles))
    for t in range(epochs):
        open_row(urns, t % rows)
        draw_pairs(urns, t % rows, 0, base, np.full(particles, centre_m), rng)
        means[t] = urns.mean_m[t % rows, 0]
    return urns, means


def test_a_draw_is_new_as_often_as_the_urn_says() -> None:
    """P(new at the n-th) = alpha / (alpha + n - 1): the number of different values has the Ewens mean."""
    base, epochs = LOS_SIMULATED._replace(alpha=4.0), 60
    _, means = drawn(base, epochs, 800, epochs)
    different = [len(np.unique(means[:, i])) for i in range(means.shape[1])]
    chance = base.alpha / (base.alpha + np.arange(epochs))
    error = np.sqrt((chance * (1 - chance)).sum() / means.shape[1])
    assert np.mean(different) == pytest.approx(chance.sum(), abs=4 * error)


def test_past_draws_are_equally_likely() -> None:
    base = LOS_SIMULATED._replace(alpha=1.0)
    _, means = drawn(base, 3, 30_000, 3)
    fresh = means[1] != means[0]
    assert np.mean(fresh) == pytest.approx(0.5, abs=0.02)
    third = means[2][fresh]
    assert np.mean(third == means[0][fresh]) == pytest.approx(1 / 3, abs=0.02)
    assert np.mean(third == means[1][fresh]) == pytest.approx(1 / 3, abs=0.02)


def test_new_draws_follow_the_base_measure() -> None:
    urns, means = drawn(NLOS_BASE._replace(alpha=1e12), 1, 4000, 1, centre_m=17.0)
    law = stats.t(df=NLOS_BASE.dof, loc=17.0, scale=np.sqrt(NLOS_BASE.scale_m2 / NLOS_BASE.k / NLOS_BASE.dof))
    assert stats.kstest(means[0], law.cdf).pvalue > 1e-3
    variance = stats.invgamma(NLOS_BASE.dof / 2, scale=NLOS_BASE.scale_m2 / 2)
    assert stats.kstest(urns.variance_m2[0, 0], variance.cdf).pvalue > 1e-3


def test_a_base_measure_follows_the_residual_only_where_it_is_said_to() -> None:
    _, means = drawn(LOS_SIMULATED, 1, 2000, 1, centre_m=500.0)
    assert np.abs(np.median(means)) < 1.0


def test_copies_remember_what_their_ancestor_drew() -> None:
    never_new = LOS_SIMULATED._replace(alpha=1e-9)
    urns, rng = Urns.empty(10, 1, 4), np.random.default_rng(0)
    open_row(urns, 0)
    draw_pairs(urns, 0, 0, LOS_SIMULATED, np.zeros(4), rng)
    first = urns.mean_m[0, 0].copy()
    urns.resample(np.array([2, 2, 2, 1]))
    open_row(urns, 1)
    draw_pairs(urns, 1, 0, never_new, np.zeros(4), rng)
    assert urns.mean_m[1, 0].tolist() == first[[2, 2, 2, 1]].tolist()
    urns.resample(np.array([3, 0, 0, 0]))
    open_row(urns, 2)
    draw_pairs(urns, 2, 0, never_new, np.zeros(4), rng)
    assert urns.mean_m[2, 0].tolist() == first[[1, 2, 2, 2]].tolist()


def test_rows_are_forgotten_when_the_ring_comes_round() -> None:
    urns, means = drawn(LOS_SIMULATED._replace(alpha=1.0), 50, 500, 3)
    assert urns.seen[0] == 3
    # What is left can come only from the rows that are kept, or be new: no value spans more than the ring forgets.
    assert all(len(np.unique(means[:, i])) > 1 for i in range(20))


def test_satellites_without_a_residual_draw_nothing() -> None:
    urns = Urns.empty(2, 3, 5)
    open_row(urns, 0)
    residual = np.zeros((5, 2))
    residual[:, 1] = np.nan
    mean, _ = draw_all(
        urns, 0, np.array([0, 2]), np.array([True, False]), LOS_SIMULATED, NLOS_BASE, residual,
        np.random.default_rng(0),
    )  # fmt: skip
    assert np.isfinite(mean[:, 0]).all() and np.isnan(mean[:, 1]).all()
    assert urns.seen.tolist() == [1, 0, 0]


def test_reflected_errors_are_followed_and_direct_ones_are_not() -> None:
    rng = np.random.default_rng(2)
    state = np.repeat([LOS, NLOS], 100)
    error_m = np.where(state == NLOS, 40.0, 0.0) + rng.normal(0, 1, 200)
    part = Series(np.arange(200.0), error_m, state, np.full(200, 40.0))
    mean, variance = DpmModel().track(part, 4)
    assert np.abs(mean[20:100]).max() < 4.0
    assert mean[120:] == pytest.approx(error_m[120:], abs=6.0)
    assert np.all(variance > 0)
