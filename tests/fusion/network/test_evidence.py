"""Passes condensed segment by segment: in any order, one by one or all at once, and out again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.evidence import COMMON_SIGMA_PERCENT, CONSENSUS_PASSES, REJECT_SIGMAS, SegmentEvidence
from fusion.network.pass_factor import PassFactor, symmetric

Keyed = tuple[int, PassFactor]


def a_pass(
    slope: float,
    sigma: float = 0.3,
    seed: int = 0,
    history: tuple[int, ...] = (),
    size: int = 4,
    **more: float,
) -> PassFactor:
    """A pass over segment 5 with some information, whatever it says about the slope."""
    rng = np.random.default_rng(seed)
    size *= 1 + len(history)
    root = rng.normal(size=(size, size))
    values = {"start_m": 0.0, "end_m": 18.0, "roughness": 3e-5, "observations": 3} | more
    return PassFactor(
        segments=(*history, 5),
        information=symmetric((root @ root.T)[np.triu_indices(size)], size),
        vector=rng.normal(size=size),
        slope_percent=slope,
        slope_sigma_percent=sigma,
        first_time_s=0.0,
        last_time_s=1.0,
        **values,  # type: ignore[arg-type]
    )


@st.composite
def pass_lists(draw: st.DrawFn, min_size: int = 0, max_size: int = 9) -> list[Keyed]:
    """Passes around 2 % with wild ones among them, some conditional on other segments; keys in no order."""
    count = draw(st.integers(min_size, max_size))
    keys = draw(st.permutations(range(100, 100 + count)))
    wild = draw(st.lists(st.sampled_from([0.0, 0.0, 0.2, 1.5, 4.0, -6.0]), min_size=count, max_size=count))
    histories = draw(st.lists(st.sampled_from([(), (), (3,), (2, 3)]), min_size=count, max_size=count))
    return [
        (key, a_pass(2.0 + off, 0.3 + 0.05 * k, key, history, observations=k + 1, end_m=10.0 + k))
        for k, (key, off, history) in enumerate(zip(keys, wild, histories, strict=True))
    ]


def assert_close(left: SegmentEvidence, right: SegmentEvidence) -> None:
    """Equal but for the rounding of sums; a sum that all its passes left may remain as nothing."""
    assert left.passes.tobytes() == right.passes.tobytes()
    for history in left.groups.keys() | right.groups.keys():
        a, b = (one.groups.get(history, (0.0, 0.0)) for one in (left, right))
        assert a[0] == pytest.approx(b[0], rel=1e-9, abs=1e-9)
        assert a[1] == pytest.approx(b[1], rel=1e-9, abs=1e-9)


@given(pass_lists(min_size=1), st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_change_a_bit(passes: list[Keyed], random: object) -> None:
    shuffled = list(passes)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert SegmentEvidence.build(passes).encode() == SegmentEvidence.build(shuffled).encode()


@given(pass_lists(min_size=1), st.integers(0, 9), st.integers(1, 4))
def test_passes_that_come_later_make_what_all_make_at_once(
    passes: list[Keyed], first: int, batch: int
) -> None:
    """Whichever verdicts turn on the way, in batches of any size."""
    factor_of = dict(passes)
    known = SegmentEvidence.build(passes[:first])
    for start in range(first, len(passes), batch):
        added = passes[start : start + batch]
        wanted = known.missing_for(added)
        known = known.with_passes(added, {key: factor_of[key] for key in wanted})
        assert_close(known, SegmentEvidence.build(passes[: start + batch]))
    assert_close(known, SegmentEvidence.build(passes))


def test_one_pass_can_turn_the_verdict_over_another_both_ways() -> None:
    """Two against one: with the third pass, the first is the odd one out; with further ones it is not."""
    odd, even = [(1, a_pass(8.0, seed=1))], [(2, a_pass(2.0, seed=2)), (3, a_pass(2.1, seed=3))]
    known = SegmentEvidence.build([*odd, even[0]])
    assert known.accepted.all()
    assert known.missing_for(even[1:]) == [1]
    with pytest.raises(KeyError):
        known.with_passes(even[1:])
    known = known.with_passes(even[1:], dict(odd))
    assert known.accepted.tolist() == [False, True, True]
    assert_close(known, SegmentEvidence.build([*odd, *even]))
    agreeing = [(key, a_pass(8.0 + 0.1 * key, seed=key)) for key in range(4, 8)]
    wanted = known.missing_for(agreeing)
    assert wanted == [1, 2, 3]
    known = known.with_passes(agreeing, dict([*odd, *even]))
    assert known.accepted.tolist() == [True, False, False, True, True, True, True]
    assert_close(known, SegmentEvidence.build([*odd, *even, *agreeing]))


def test_adding_without_a_turn_needs_no_stored_factor() -> None:
    known = SegmentEvidence.build([(k, a_pass(2.0 + 0.1 * k, seed=k)) for k in range(5)])
    added = [(9, a_pass(2.2, seed=9)), (8, a_pass(30.0, seed=8))]
    assert known.missing_for(added) == []
    later = known.with_passes(added)
    assert later.keys.tolist() == [0, 1, 2, 3, 4, 8, 9]
    assert later.accepted.tolist() == [True] * 5 + [False, True]
    assert known.keys.tolist() == [0, 1, 2, 3, 4], "what was known stays as it was"


@given(pass_lists(min_size=2), st.data())
def test_a_pass_that_came_and_left_leaves_no_trace(passes: list[Keyed], data: st.DataObject) -> None:
    """Leaving is building anew from those that stay, which must not depend on how the others came."""
    gone = data.draw(st.sampled_from(passes))
    staying = [p for p in passes if p[0] != gone[0]]
    never = SegmentEvidence.build(staying)
    never.with_passes([gone], dict(staying))
    assert SegmentEvidence.build(staying[::-1]).encode() == never.encode()


def test_sums_are_those_of_the_passes_that_are_accepted() -> None:
    accepted = [(k, a_pass(2.0, seed=k, history=(3,) if k % 2 else ())) for k in range(6)]
    outlier = (7, a_pass(40.0, seed=7))
    known = SegmentEvidence.build([*accepted, outlier])
    for history, wanted in (((5,), accepted[0::2]), ((3, 5), accepted[1::2])):
        information, vector = known.groups[history]
        assert information == pytest.approx(sum(f.information for _, f in wanted))
        assert vector == pytest.approx(sum(f.vector for _, f in wanted))
    assert set(known.groups) == {(5,), (3, 5)}
    assert known.observations == sum(f.observations for _, f in accepted)


def test_an_outlier_is_rejected_and_stays_visible() -> None:
    fair = [(k, a_pass(2.0 + 0.1 * k, seed=k, end_m=15.0)) for k in range(4)]
    outlier = (9, a_pass(12.0, 0.4, seed=9, end_m=18.0, roughness=1e-3))
    known = SegmentEvidence.build([*fair, outlier])
    assert known.keys.tolist() == [0, 1, 2, 3, 9]
    assert known.accepted.tolist() == [True] * 4 + [False]
    assert known.slope_percent[-1] == 12.0
    assert known.slope_sigma_percent[-1] == 0.4
    without = SegmentEvidence.build(fair)
    for name in ("observations", "driven", "roughness", "birge_ratio"):
        assert getattr(known, name) == getattr(without, name), name
    assert np.array_equal(known.groups[(5,)][0], without.groups[(5,)][0])


def test_two_that_contradict_each_other_are_both_accepted() -> None:
    assert CONSENSUS_PASSES == 3
    assert SegmentEvidence.build([(1, a_pass(2.0)), (2, a_pass(30.0))]).accepted.all()


@pytest.mark.parametrize("sigmas", [REJECT_SIGMAS - 0.3, REJECT_SIGMAS + 0.3])
def test_how_far_a_pass_may_lie_from_the_others(sigmas: float) -> None:
    """Many passes settle the consensus; what remains is the pass's own sigma and what passes differ by anyway."""
    many = [(k, a_pass(2.0, 0.3)) for k in range(400)]
    allowed = np.hypot(0.5, COMMON_SIGMA_PERCENT)
    stranger = (999, a_pass(2.0 - sigmas * allowed, 0.5))
    assert SegmentEvidence.build([*many, stranger]).accepted[-1] == (sigmas < REJECT_SIGMAS)


@given(st.lists(st.tuples(st.floats(-30, 30), st.floats(0.01, 5)), min_size=1, max_size=12))
def test_the_majority_is_always_accepted(slopes: list[tuple[float, float]]) -> None:
    known = SegmentEvidence.build([(k, a_pass(*values)) for k, values in enumerate(slopes)])
    assert known.accepted.sum() * 2 > len(slopes)
    assert known.birge_ratio >= 1.0


def test_fair_passes_are_hardly_ever_rejected() -> None:
    rng = np.random.default_rng(11)
    turned = total = 0
    for count in (3, 5, 12):
        for _ in range(150):
            sigma = rng.uniform(0.2, 1.0, count)
            slopes = 3.0 + rng.normal(size=count) * np.hypot(sigma, COMMON_SIGMA_PERCENT)
            known = SegmentEvidence.build(
                [(k, a_pass(*each)) for k, each in enumerate(zip(slopes, sigma, strict=True))]
            )
            turned, total = turned + int((~known.accepted).sum()), total + count
    assert turned < 0.002 * total


def test_the_birge_ratio_grows_with_disagreement_and_is_one_without() -> None:
    def ratio(*slopes: float) -> float:
        return SegmentEvidence.build([(k, a_pass(s, 0.3)) for k, s in enumerate(slopes)]).birge_ratio

    assert ratio(2.0) == ratio(2.0, 2.1) == ratio(2.0, 2.1, 1.9, 2.0) == 1.0
    assert 1.0 < ratio(2.0, 3.2, 2.0, 3.2) < ratio(2.0, 3.4, 2.0, 3.4)
    # Birge's ratio with the imaginary passes: chi squared of two passes 3 % apart is 4.5 / 0.1525.
    expected = np.sqrt((4.5 / (0.3**2 + 0.25**2) + 3) / (1 + 3))
    assert ratio(0.0, 3.0) == pytest.approx(expected)


def test_the_driven_part_and_the_roughness_are_those_of_all_that_are_accepted() -> None:
    known = SegmentEvidence.build(
        [
            (1, a_pass(2.0, start_m=4.0, end_m=9.0, roughness=1e-6)),
            (2, a_pass(2.0, start_m=7.0, end_m=13.0, roughness=1e-4)),
        ]
    )
    assert known.driven == (4.0, 13.0)
    assert known.roughness == pytest.approx(1e-5)


@given(pass_lists())
def test_what_is_encoded_comes_back_bit_by_bit(passes: list[Keyed]) -> None:
    known = SegmentEvidence.build(passes)
    again = SegmentEvidence.decode(known.encode())
    assert again.encode() == known.encode()
    assert again.passes.tobytes() == known.passes.tobytes()
    assert again.groups.keys() == known.groups.keys()
    for history, (information, vector) in known.groups.items():
        assert np.array_equal(again.groups[history][0], information)
        assert np.array_equal(again.groups[history][1], vector)


def test_decoded_evidence_goes_on_like_the_one_that_was_encoded() -> None:
    first, second = [(1, a_pass(2.0, seed=1))], [(2, a_pass(2.3, seed=2))]
    again = SegmentEvidence.decode(SegmentEvidence.build(first).encode()).with_passes(second)
    assert again.encode() == SegmentEvidence.build([*first, *second]).encode()


def test_evidence_does_not_change_when_a_factor_does_afterwards() -> None:
    factor = replace(a_pass(2.0), segments=(5,))
    known = SegmentEvidence.build([(1, factor)])
    before = known.encode()
    factor.information[:] = 0.0
    factor.vector[:] = 0.0
    assert known.encode() == before
