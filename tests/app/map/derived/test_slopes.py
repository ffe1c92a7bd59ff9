"""Slopes of chains against what one would compute by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.map.derived.chains import Chains
from app.map.derived.way_store import ChainSlopes, Measured, slopes_along
from fusion.network.segment_slopes import PLACE_SIGMA_M
from fusion.network.steepest import STRETCH_M

NAN = math.nan


def measured(length: list[float], slope: list[float], sigma: float = 0.5, **columns: list[float]) -> Measured:
    n = len(length)
    known = {"length_m": length, "slope_percent": slope, "slope_sigma_percent": [sigma] * n}
    unknown = {name: [NAN] * n for name in Measured.__dataclass_fields__}
    return Measured(**{name: np.array(v, float) for name, v in (unknown | known | columns).items()})


def one(segments: Measured) -> ChainSlopes:
    n = len(segments.length_m)
    return slopes_along(Chains(np.arange(n), np.array([0, n])), segments)


def test_the_mean_is_by_length_over_what_was_measured() -> None:
    found = one(measured([100.0, 300.0, 100.0], [2.0, NAN, -1.0]))
    assert found.length_m == [500.0]
    assert found.slope_percent == pytest.approx(0.5)
    assert found.measured_share == pytest.approx(0.4)
    assert found.slope_sigma_percent == pytest.approx(0.5)  # of neighbours that err as one, however many


def test_unknown_is_never_zero() -> None:
    found = one(measured([100.0, 50.0], [NAN, NAN]))
    assert found.measured_share == [0.0]
    for name in (
        "slope_percent",
        "slope_sigma_percent",
        "steepest_percent",
        "steepest_from_m",
        "steepest_to_m",
    ):
        assert np.isnan(getattr(found, name)).all()


def test_heights_at_both_ends_make_a_long_way_surer() -> None:
    n = 20
    rise = np.arange(n + 1) * 1.0
    heights = {
        "height_from_m": rise[:-1].tolist(),
        "height_to_m": rise[1:].tolist(),
        "height_sigma_m": [0.4] * n,
    }
    long = one(measured([50.0] * n, [2.0] * n, **heights))
    lane = 0.025 * math.sqrt(2)  # at either end, for they are farther apart than it lasts
    assert long.slope_sigma_percent == pytest.approx(100 * math.hypot(0.4, 0.4, lane) / 1000, rel=1e-4)
    # What slopes and heights say differently counts as well, and never makes it less sure than the segments are.
    heights["height_to_m"][-1] += 3.0
    assert one(measured([50.0] * n, [2.0] * n, **heights)).slope_sigma_percent == pytest.approx(
        100 * math.hypot(0.4, 0.4, lane, 3.0) / 1000, rel=1e-4
    )
    heights["height_to_m"][-1] += 300.0
    assert one(measured([50.0] * n, [2.0] * n, **heights)).slope_sigma_percent == pytest.approx(0.5)
    # A segment alone is as sure as it is.
    alone = {name: values[:1] for name, values in heights.items()}
    assert one(measured([50.0], [2.0], **alone)).slope_sigma_percent == pytest.approx(0.5)


def test_nodes_beside_their_place_count_where_the_grade_is_not_the_mean() -> None:
    heights = {"height_from_m": [0.0, 1.0], "height_to_m": [1.0, 11.0], "height_sigma_m": [0.0, 0.0]}
    found = one(measured([100.0, 100.0], [1.0, 10.0], sigma=9.0, **heights))
    lane = 100 * 0.025 * math.sqrt(2 * (1 - math.exp(-2)))
    assert found.slope_sigma_percent == pytest.approx(
        math.hypot(PLACE_SIGMA_M * math.hypot(4.5, 4.5), lane) / 200
    )


def test_the_steepest_stretch_goes_across_segments() -> None:
    found = one(measured([100.0, 10.0, 5.0, 100.0], [1.0, 8.0, 12.0, 1.0]))
    assert found.steepest_percent == pytest.approx((80 + 60 + 5) / 20)
    assert (found.steepest_from_m[0], found.steepest_to_m[0]) in {(100.0, 120.0), (95.0, 115.0)}


def test_what_a_segment_knows_of_its_inside_counts() -> None:
    inside = {
        "steepest_percent": [NAN, -9.0, NAN],
        "steepest_from_m": [NAN, 30.0, NAN],
        "steepest_to_m": [NAN, 50.0, NAN],
    }
    found = one(measured([100.0, 100.0, 40.0], [1.0, -2.0, 3.0], **inside))
    assert (found.steepest_percent[0], found.steepest_from_m[0], found.steepest_to_m[0]) == (
        -9.0,
        130.0,
        150.0,
    )
    # A shorter stretch is not the steepest 20 m, however steep.
    inside["steepest_to_m"][1] = 35.0
    assert one(measured([100.0, 100.0, 40.0], [1.0, -2.0, 3.0], **inside)).steepest_percent == [3.0]


def test_no_stretch_goes_over_what_was_not_measured() -> None:
    found = one(measured([12.0, 100.0, 12.0, 30.0], [9.0, NAN, 20.0, 0.0]))
    assert found.steepest_percent == pytest.approx(20.0 * 12 / 20)
    # Where nothing is as long as that, it is the steepest of what is there, as a whole.
    short = one(measured([12.0, 100.0, 5.0, 6.0], [9.0, NAN, -20.0, -10.0]))
    assert short.steepest_percent == pytest.approx(-160 / 11)
    assert (short.steepest_from_m[0], short.steepest_to_m[0]) == (112.0, 123.0)


def tries(length: list[float], slope: list[float]) -> tuple[float, float]:
    """The steepest of all stretches that begin each half metre, and how long the longest run is."""
    best, longest, start = 0.0, 0.0, 0
    while start < len(length):
        if math.isnan(slope[start]):
            start += 1
            continue
        end = start
        while end < len(length) and not math.isnan(slope[end]):
            end += 1
        x = np.concatenate([[0.0], np.cumsum(length[start:end])])
        h = np.concatenate([[0.0], np.cumsum(np.multiply(length[start:end], slope[start:end]))])
        begin = np.arange(0.0, x[-1] - STRETCH_M + 1e-9, 0.5)
        if len(begin):
            grade = np.abs(np.interp(begin + STRETCH_M, x, h) - np.interp(begin, x, h)) / STRETCH_M
            best = max(best, float(grade.max()))
        longest = max(longest, float(x[-1]))
        start = end
    return best, longest


# Lengths of half metres, so that a try each half metre meets every node.
LENGTHS = st.integers(1, 160).map(lambda n: n / 2)
SLOPES = st.one_of(st.just(NAN), st.floats(-15, 15))


@given(st.lists(st.lists(st.tuples(LENGTHS, SLOPES), min_size=1, max_size=12), min_size=1, max_size=4))
def test_any_chains_have_what_a_patient_search_finds(chains: list[list[tuple[float, float]]]) -> None:
    flat = [pair for chain in chains for pair in chain]
    first = np.cumsum([0, *map(len, chains)])
    found = slopes_along(
        Chains(np.arange(len(flat)), first), measured([p[0] for p in flat], [p[1] for p in flat])
    )
    for k, chain in enumerate(chains):
        known = [(m, s) for m, s in chain if not math.isnan(s)]
        whole = sum(m for m, _ in chain)
        assert found.measured_share[k] == pytest.approx(sum(m for m, _ in known) / whole)
        if known:
            mean = sum(m * s for m, s in known) / sum(m for m, _ in known)
            assert found.slope_percent[k] == pytest.approx(mean, abs=1e-9)
        best, longest = tries([m for m, _ in chain], [s for _, s in chain])
        if longest >= STRETCH_M:
            assert abs(found.steepest_percent[k]) == pytest.approx(best, abs=1e-6)
            assert found.steepest_to_m[k] - found.steepest_from_m[k] == pytest.approx(STRETCH_M)
        if known:
            assert -1e-9 <= found.steepest_from_m[k] < found.steepest_to_m[k] <= whole + 1e-9


@settings(max_examples=30)
@given(st.lists(st.tuples(LENGTHS, SLOPES), min_size=1, max_size=12))
def test_a_chain_gone_through_backwards_has_the_other_signs(chain: list[tuple[float, float]]) -> None:
    there = one(measured([m for m, _ in chain], [s for _, s in chain]))
    back = one(measured([m for m, _ in chain[::-1]], [-s for _, s in chain[::-1]]))
    np.testing.assert_allclose(back.slope_percent, -there.slope_percent, atol=1e-9)
    np.testing.assert_allclose(np.abs(back.steepest_percent), np.abs(there.steepest_percent), atol=1e-6)
    np.testing.assert_allclose(back.slope_sigma_percent, there.slope_sigma_percent)


@given(
    errors=st.lists(st.lists(st.floats(0, 3), min_size=9, max_size=9), min_size=3, max_size=8),
    length=st.lists(st.floats(5, 300), min_size=7, max_size=7),
)
def test_a_way_is_never_told_to_be_surer_than_it_is(errors: list[list[float]], length: list[float]) -> None:
    """Whatever makes heights err, as long as none makes one err up and another down."""
    by_node = np.array(errors)
    n = len(by_node) - 1
    along = np.array(length[:n])
    sigma = 100 * np.linalg.norm(np.diff(by_node, axis=0), axis=1) / along
    height = np.linalg.norm(by_node, axis=1)
    segments = measured(
        along.tolist(),
        [0.0] * n,
        slope_sigma_percent=sigma.tolist(),
        height_from_m=[0.0] * n,
        height_to_m=[0.0] * n,
        height_sigma_m=np.maximum(height[:-1], height[1:]).tolist(),
    )
    true = 100 * np.linalg.norm(by_node[-1] - by_node[0]) / along.sum()
    assert one(segments).slope_sigma_percent >= true - 1e-9
