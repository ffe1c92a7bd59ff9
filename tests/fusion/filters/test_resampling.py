"""Every resampling scheme: unbiased, and sound at the edges where others break."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.errors import UnknownNameError
from fusion.filters.resampling import RESAMPLERS

SCHEMES = list(RESAMPLERS)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_expected_descendants_are_n_times_the_weight(scheme: str) -> None:
    weights = np.array([0.45, 0.30, 0.15, 0.06, 0.04])
    runs = 4000
    counts = np.zeros(5)
    for step in range(runs):
        counts += np.bincount(RESAMPLERS[scheme](weights, 11, step), minlength=5)
    mean = counts / runs
    # Multinomial counts have the largest variance that an unbiased scheme may have: n w (1 - w).
    standard_error = np.sqrt(5 * weights * (1 - weights) / runs)
    assert np.all(np.abs(mean - 5 * weights) < 5 * standard_error)


@pytest.mark.parametrize("scheme", SCHEMES)
@given(
    weights=st.lists(st.floats(0, 1, allow_subnormal=False), min_size=1, max_size=50).filter(
        lambda w: sum(w) > 1e-6
    ),
    step=st.integers(0, 2**31 - 1),
)
def test_ancestors_are_ascending_indices_of_positive_weight(
    scheme: str, weights: list[float], step: int
) -> None:
    w = np.array(weights) / np.sum(weights)
    ancestors = RESAMPLERS[scheme](w, 1, step)
    assert ancestors.shape == w.shape
    assert np.all(np.diff(ancestors) >= 0)
    assert ancestors[0] >= 0
    assert ancestors[-1] < len(w)
    assert np.all(w[ancestors] > 0)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("total", [1 - 1e-9, 1 + 1e-9])
def test_weights_that_do_not_quite_sum_to_one(scheme: str, total: float) -> None:
    w = np.full(1000, total / 1000)
    for step in range(50):
        ancestors = RESAMPLERS[scheme](w, 2, step)
        assert ancestors[-1] <= 999


@pytest.mark.parametrize("scheme", SCHEMES)
def test_one_particle_and_one_dominant_weight(scheme: str) -> None:
    assert RESAMPLERS[scheme](np.array([1.0]), 0, 0).tolist() == [0]
    w = np.zeros(100)
    w[37] = 1.0
    assert set(RESAMPLERS[scheme](w, 0, 0).tolist()) == {37}


def test_systematic_gives_floor_or_ceil_of_the_expected_number() -> None:
    rng = np.random.default_rng(4)
    for step in range(100):
        w = rng.dirichlet(np.full(30, 0.3))
        counts = np.bincount(RESAMPLERS["systematic"](w, 5, step), minlength=30)
        assert np.all(counts >= np.floor(30 * w - 1e-9))
        assert np.all(counts <= np.ceil(30 * w + 1e-9))


def test_an_unknown_scheme_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="multinomial, systematic"):
        RESAMPLERS["bootstrap"]
