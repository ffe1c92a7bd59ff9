"""Combination of drives: the textbook's numbers, in any order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.combine import HEIGHTS, NETWORK_ONLY, SlopePart, combine, published_slope

estimates = st.lists(
    st.tuples(st.floats(-30, 30), st.floats(0.01, 20), st.integers(1, 1000)), min_size=1, max_size=30
)


def columns(rows: list[tuple[float, float, int]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    slope, sigma, count = zip(*rows, strict=True)
    return np.array(slope), np.array(sigma), np.array(count)


@given(estimates, st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_change_a_digit(
    rows: list[tuple[float, float, int]], random: object
) -> None:
    shuffled = list(rows)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert combine(*columns(rows)) == combine(*columns(shuffled))


@given(estimates)
def test_the_result_lies_between_the_estimates_and_never_claims_more_than_the_weights(
    rows: list[tuple[float, float, int]],
) -> None:
    slope, sigma, count = columns(rows)
    total = combine(slope, sigma, count)
    assert slope.min() - 1e-9 <= total.slope_percent <= slope.max() + 1e-9
    assert total.slope_sigma_percent >= np.sum(sigma**-2.0) ** -0.5 * (1 - 1e-12)
    assert total.drives == len(rows)
    assert total.observations == count.sum()


def test_agreeing_estimates_average_by_inverse_variance() -> None:
    total = combine(np.array([2.0, 2.6]), np.array([0.5, 1.0]), np.array([3, 4]))
    assert total.slope_percent == pytest.approx((2.0 * 4 + 2.6 * 1) / 5)
    assert total.slope_sigma_percent == pytest.approx(1 / np.sqrt(5))


def test_estimates_that_contradict_each_other_widen_sigma() -> None:
    agreeing = combine(np.array([5.0, 5.2]), np.array([0.2, 0.2]), np.array([5, 5]))
    fighting = combine(np.array([5.0, 9.0]), np.array([0.2, 0.2]), np.array([5, 5]))
    assert fighting.slope_sigma_percent == pytest.approx(2.0)
    assert fighting.slope_sigma_percent > 10 * agreeing.slope_sigma_percent


def test_one_estimate_stays_as_it_is() -> None:
    total = combine(np.array([-3.5]), np.array([0.7]), np.array([9]))
    assert (total.slope_percent, total.slope_sigma_percent, total.drives) == (-3.5, pytest.approx(0.7), 1)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan, np.inf])
def test_an_impossible_sigma_is_refused(sigma: float) -> None:
    with pytest.raises(ValueError, match="sigma"):
        combine(np.array([1.0]), np.array([sigma]), np.array([1]))
    with pytest.raises(ValueError, match="at least one"):
        combine(np.array([]), np.array([]), np.array([]))


def test_the_networks_slope_is_published_as_it_is() -> None:
    whole = published_slope([SlopePart(1.25, 0.4, 7, 90, network=True)])
    assert (whole.slope_percent, whole.slope_sigma_percent, whole.drives, whole.observations) == (
        1.25, 0.4, 7, 90
    )  # fmt: skip


def test_measurements_are_combined_and_guesses_give_way() -> None:
    network, gap, raw = (
        SlopePart(1.0, 0.5, 7, 90, network=True),
        SlopePart(9.0, 3.0, 0, 0, network=True),
        SlopePart(2.0, 1.0, 1, 5),
    )
    whole = published_slope([network, raw])
    alone = combine(np.array([1.0, 2.0]), np.array([0.5, 1.0]), np.array([90, 5]))
    assert (whole.slope_percent, whole.slope_sigma_percent) == (
        alone.slope_percent,
        alone.slope_sigma_percent,
    )
    assert (whole.drives, whole.observations) == (8, 95)
    assert (published_slope([gap, raw]).slope_percent, published_slope([gap, raw]).drives) == (2.0, 1)
    assert (published_slope([gap]).slope_percent, published_slope([gap]).drives) == (9.0, 0)


KNOWN = dict(zip(NETWORK_ONLY, (0.5, 101.0, 102.0, 2.5, 7.0, 3.0, 23.0), strict=True))


def test_what_only_the_network_knows_is_taken_over() -> None:
    network, raw = SlopePart(1.0, 0.5, 7, 90, network=True, **KNOWN), SlopePart(2.0, 1.0, 1, 5)
    for parts in ([network], [network, raw], [raw, network]):
        whole = published_slope(parts)
        assert {name: getattr(whole, name) for name in NETWORK_ONLY} == KNOWN


def test_slope_only_drives_know_no_heights() -> None:
    whole = published_slope([SlopePart(2.0, 1.0, 1, 5), SlopePart(2.1, 1.0, 1, 5)])
    assert [getattr(whole, name) for name in NETWORK_ONLY] == [None] * len(NETWORK_ONLY)


def test_of_a_gap_that_gives_way_the_nodes_heights_stay() -> None:
    gap, raw = SlopePart(9.0, 3.0, 0, 0, network=True, **KNOWN), SlopePart(2.0, 1.0, 1, 5)
    alone, measured = published_slope([gap]), published_slope([gap, raw])
    assert {name: getattr(alone, name) for name in NETWORK_ONLY} == KNOWN
    assert measured.slope_percent == 2.0
    for name in NETWORK_ONLY:
        assert getattr(measured, name) == (KNOWN[name] if name in HEIGHTS else None)


def test_an_elevation_model_is_one_source_however_many_drive() -> None:
    one = SlopePart(3.0, 4.0, 1, 5, of_terrain=True)
    ten = published_slope([one] * 10)
    assert (ten.slope_percent, ten.slope_sigma_percent) == (3.0, 4.0)
    assert (ten.drives, ten.observations) == (10, 50)
    better = SlopePart(2.0, 2.0, 1, 5, of_terrain=True)
    assert published_slope([one, better]).slope_sigma_percent == 2.0
    raw = SlopePart(1.0, 1.0, 1, 7)
    beside = published_slope([one, one, raw])
    assert beside.slope_sigma_percent == pytest.approx(published_slope([one, raw]).slope_sigma_percent)
    assert beside.drives == 3


def test_the_network_holds_the_elevation_model_already() -> None:
    network, terrain = SlopePart(1.0, 0.5, 7, 90, network=True), SlopePart(5.0, 1.0, 1, 5, of_terrain=True)
    whole = published_slope([network, terrain])
    assert (whole.slope_percent, whole.slope_sigma_percent, whole.drives) == (1.0, 0.5, 8)
    gap = SlopePart(9.0, 3.0, 0, 0, network=True)
    assert published_slope([gap, terrain]).slope_percent == 5.0
