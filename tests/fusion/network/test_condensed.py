"""Condensed passes say what their passes say of the road, the drives' own errors integrated out, and can be undone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factor_support import Sensors, driven, graded, steady, street
from fusion.network.adjust import adjust
from fusion.network.condensed import CondensedPasses, condense
from fusion.network.curve import knot_length
from fusion.network.drive_beliefs import LAG_MEAN_S, LAG_SIGMA_S
from fusion.network.drive_constants import FREE_INFORMATION, ConstantsInformation
from fusion.network.pass_factor import CONSTANT_SIGMA, CONSTANTS, LAG, NUISANCES, SETTINGS, PassFactor
from fusion.network.road_beliefs import GRADE_SIGMA
from fusion.network.segment_slopes import Adjustment
from fusion.roads.table import RoadTable

TABLE = street(55, 70, 120, 43)
WITH_ALL = Sensors(
    doppler=0.02, pitch=0.01, force=0.02, altitude_m=0.3, pressure_m=0.2, mount=0.03, bias=-0.01, lag_s=2.0,
    farther_m=3.0,
)  # fmt: skip
SENSORS = st.sampled_from(
    [WITH_ALL, Sensors(), Sensors(doppler=np.nan, pitch=0.01, mount=0.02), Sensors(altitude_m=0.5)]
)


def hills(row: int, at: np.ndarray) -> np.ndarray:
    along = np.concatenate([[0.0], np.cumsum(TABLE.length_m)])[row] + at
    return 300 + 4 * np.sin(along / 60) + 0.02 * along


def length_of(table: RoadTable, row: int) -> float:
    return float(knot_length(table.length_m[row]))


def drive(seed: int, sensors: Sensors = WITH_ALL) -> list[PassFactor]:
    passes = driven(TABLE, range(len(TABLE)), hills, sensors, np.random.default_rng(seed))
    return [replace(p, place=k // 2) for k, p in enumerate(passes)]


def sum_of(passes: Sequence[PassFactor], row: int, weight: float = 1.0) -> CondensedPasses:
    """What one drive says of a row."""
    mine = [p for p in passes if p.segment == row]
    return CondensedPasses.of_drive(
        mine, [weight] * len(mine), ConstantsInformation.of_passes(passes), len(passes), length_of(TABLE, row)
    )


def key_of(one: PassFactor, kind: int) -> tuple[int, int]:
    return kind, int(getattr(one, SETTINGS[kind])) if kind in SETTINGS else 0


def schur(information: np.ndarray, vector: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gone = np.setdiff1d(np.arange(len(vector)), kept)
    inner = information[np.ix_(kept, gone)] @ np.linalg.pinv(
        information[np.ix_(gone, gone)], rcond=1e-18, hermitian=True
    )
    return (
        information[np.ix_(kept, kept)] - inner @ information[np.ix_(gone, kept)],
        vector[kept] - inner @ vector[gone],
    )


def constants_elsewhere(
    passes: Sequence[PassFactor], k: int
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int]]]:
    """What all passes but one say of all constants that any pass speaks of, and their keys."""
    keys = sorted({key_of(p, kind) for p in passes for kind in range(len(CONSTANTS))})
    information, vector = np.zeros((len(keys), len(keys))), np.zeros(len(keys))
    for p in (*passes[:k], *passes[k + 1 :]):
        n = len(p.vector) - NUISANCES
        prior = np.full(n + NUISANCES, FREE_INFORMATION)
        prior[1:n:2] = GRADE_SIGMA**-2
        prior[n : n + len(CONSTANTS)] = 0.0
        said, right = schur(p.information + np.diag(prior), p.vector, np.arange(n, n + len(CONSTANTS)))
        at = [keys.index(key_of(p, kind)) for kind in range(len(CONSTANTS))]
        information[np.ix_(at, at)] += said
        vector[at] += right
    return information, vector, keys


def dense(passes: Sequence[PassFactor], k: int, weight: float, share: float) -> tuple[np.ndarray, np.ndarray]:
    """The normal equations of one pass, of its drive's constants and of the errors of heights, reduced to its knots."""
    one = passes[k]
    knots = len(one.vector) - NUISANCES
    information, vector = weight * one.information, weight * one.vector
    said, right, keys = constants_elsewhere(passes, k)
    sigma = np.array(CONSTANT_SIGMA)
    kinds = [kind for kind in range(len(CONSTANTS)) if one.used[kind]]
    mine = np.array([keys.index(key_of(one, kind)) for kind in kinds], int)
    others = np.setdiff1d(np.arange(len(keys)), mine)
    said[others, others] += sigma[[keys[j][0] for j in others]] ** -2.0
    left = said[np.ix_(mine, others)] @ np.linalg.inv(said[np.ix_(others, others)])
    at = np.array(kinds, int) + knots
    information[np.ix_(at, at)] += share * (said[np.ix_(mine, mine)] - left @ said[np.ix_(others, mine)])
    vector[at] += share * (right[mine] - left @ right[others])
    mean = np.zeros(len(CONSTANTS))
    sigma[LAG], mean[LAG] = np.hypot(LAG_MEAN_S[1], LAG_SIGMA_S), LAG_MEAN_S[0]
    every = np.arange(knots, knots + NUISANCES)
    information[every, every] += np.append(sigma**-2.0, np.full(NUISANCES - len(CONSTANTS), FREE_INFORMATION))
    vector[every[: len(CONSTANTS)]] += mean * sigma**-2.0
    return schur(information, vector, np.arange(knots))


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    sensors=SENSORS,
    k=st.integers(0, 3),
    weight=st.sampled_from([0.2, 1.0, 1.25]),
    share=st.sampled_from([0.1, 1.0]),
)
def test_what_is_left_of_a_pass_is_what_dense_algebra_leaves(
    seed: int, sensors: Sensors, k: int, weight: float, share: float
) -> None:
    passes = drive(seed, sensors)
    elsewhere = ConstantsInformation.of_passes(passes) - ConstantsInformation.of_passes([passes[k]])
    information, vector = condense(passes[k], weight, elsewhere, share)
    wanted, right = dense(passes, k, weight, share)
    scale = np.sqrt(np.maximum(np.diagonal(wanted), 1e-6))
    assert np.abs((information - wanted) / np.outer(scale, scale)).max() < 1e-6
    assert np.abs((vector - right) / scale).max() < 1e-6 * max(np.abs(vector / scale).max(), 1.0)


@settings(max_examples=20)
@given(seeds=st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=6, unique=True), data=st.data())
def test_what_is_added_and_taken_off_leaves_nothing(seeds: list[int], data: st.DataObject) -> None:
    """Whatever the order, to the rounding of what was added."""
    made = [sum_of(drive(seed), 2, 1.1) for seed in seeds]
    whole = made[0]
    for one in made[1:]:
        whole = whole + one
    left = whole
    for k in data.draw(st.permutations(range(len(made)))):
        left = left + -made[k]
    assert (left.passes, left.drives, left.observations) == (0, 0, 0)
    assert np.array_equal(left.covered, np.zeros(len(left.covered)))
    assert np.abs(left.information).max() <= 1e-14 * len(made) * np.abs(whole.information).max()
    assert np.abs(left.vector).max() <= 1e-14 * len(made) * max(np.abs(one.vector).max() for one in made)
    again = CondensedPasses.decode(whole.encode())
    assert all(
        np.array_equal(a, b)
        for a, b in ((getattr(again, f.name), getattr(whole, f.name)) for f in fields(CondensedPasses))
    )


def test_a_pass_that_is_not_accepted_adds_nothing() -> None:
    one = sum_of(drive(1), 1, 0.0)
    assert (one.passes, one.drives, one.observations, one.rows) == (0, 0, 0, 0.0)
    assert not one.information.any()


def with_sums(
    drives: Sequence[Sequence[PassFactor]], every: Adjustment, recent: int
) -> dict[int, Sequence[PassFactor]]:
    """The last drives as they are, the others as sums over each row, as they counted in the solution of all."""
    old = len(drives) - recent
    said: dict[int, Sequence[PassFactor]] = dict(enumerate(drives[old:]))
    for row in range(len(TABLE)):
        length, parts = length_of(TABLE, row), []
        for d in range(old):
            mine = [p for p in drives[d] if p.segment == row]
            weight = [every.weight[d, p.sequence] * every.accepted[d, p.sequence] for p in mine]
            parts.append(
                CondensedPasses.of_drive(
                    mine, weight, ConstantsInformation.of_passes(drives[d]), len(drives[d]), length
                )
            )
        whole = parts[0]
        for one in parts[1:]:
            whole = whole + one
        said[len(said)] = [whole.factor(row, length)]
    return said


@pytest.mark.parametrize(
    "sensors", [WITH_ALL, Sensors(altitude_m=0.5), Sensors(doppler=0.05, pitch=0.01, mount=0.02)]
)
def test_condensed_and_recent_passes_say_what_all_passes_say_and_claim_no_more(sensors: Sensors) -> None:
    drives = [drive(k, replace(sensors, mount=0.02 * np.sin(k), bias=0.01 * np.cos(k))) for k in range(40)]
    every = adjust(TABLE, dict(enumerate(drives)))
    found = adjust(TABLE, with_sums(drives, every, 10))
    moved = np.abs(found.slope_percent - every.slope_percent) / every.slope_sigma_percent
    assert moved.max() < 1.0, moved
    share = found.slope_sigma_percent / every.slope_sigma_percent
    assert share.min() > 0.98, share
    assert share.max() < 1.2, share
    assert np.array_equal(found.observations, every.observations)
    assert np.array_equal(found.passes + found.rejected, every.passes + every.rejected)
    assert np.allclose(found.driven_share, every.driven_share)


def test_condensed_passes_without_errors_of_drives_are_exact() -> None:
    """Passes that speak of the road alone may be summed or not."""
    rng = np.random.default_rng(3)
    drives = [
        [graded(TABLE, row, lambda at: 0.02 + 1e-4 * at, 0.02, rng, sequence=row) for row in range(4)]
        for _ in range(20)
    ]
    every = adjust(TABLE, dict(enumerate(drives)))
    found = adjust(TABLE, with_sums(drives, every, 5))
    sigma = every.slope_sigma_percent
    assert np.abs((found.slope_percent - every.slope_percent) / sigma).max() < 0.02
    assert np.abs(found.slope_sigma_percent / sigma - 1).max() < 0.005


@pytest.mark.parametrize("old", [20, 2000])
def test_a_road_that_was_rebuilt_is_what_the_newest_drives_say(old: int) -> None:
    """However many passes over the old one are in the sum."""
    flat, steep = steady(TABLE, 1, 2.0, 0.01), steady(TABLE, 1, 9.0, 0.01)
    one = CondensedPasses.of_drive([flat], [1.0], ConstantsInformation.nothing(), 1, length_of(TABLE, 1))
    whole = replace(
        one, information=old * one.information, vector=old * one.vector, rows=old * one.rows,
        log_roughness=old * one.log_roughness, covered=old * one.covered, passes=old, drives=old,
    )  # fmt: skip
    said: dict[int, list[PassFactor]] = {k: [steep] for k in range(8)}
    said[8] = [whole.factor(1, length_of(TABLE, 1))]
    found = adjust(TABLE, said)
    assert found.slope_percent[1] == pytest.approx(9.0, abs=0.1)
    assert not found.accepted[8, 0]
    assert all(found.accepted[k, 0] for k in range(8))
    odd = adjust(TABLE, {**said, **{k: [flat] for k in range(5)}})  # most of the newest say what the sum says
    assert odd.slope_percent[1] == pytest.approx(2.0, abs=0.1)
    assert odd.accepted[8, 0]
    assert (odd.passes[1], odd.rejected[1]) == (old + 5, 3)
