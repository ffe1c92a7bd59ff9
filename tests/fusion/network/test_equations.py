"""Sums of small blocks against dense matrices; and what holds for whole solutions, in whatever order they came."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.adjust import Adjustment, adjust
from fusion.network.equations import Blocks, EquationSystem, pattern_of
from fusion.network.pass_factor import PassFactor
from network_draws import driven_town

NONE = np.empty(0, np.int64)


def dense(size: int, blocks: list[Blocks]) -> tuple[np.ndarray, np.ndarray]:
    """The sum of blocks, entry by entry."""
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    for one in blocks:
        for at, information, right, weight in zip(
            one.variables, one.information, one.vector, one.weight, strict=True
        ):
            matrix[np.ix_(at, at)] += weight * information
            vector[at] += weight * right
    return matrix, vector


def observed(seed: int, size: int) -> list[Blocks]:
    rng = np.random.default_rng(seed)
    out = [Blocks.of_rows(np.arange(size)[:, None], np.ones((size, 1)), 0.0, 9.0)]
    for k in (2, 3):
        m = int(rng.integers(0, 2 * size))
        variables = np.array([rng.choice(size, k, replace=False) for _ in range(m)], np.int64).reshape(m, k)
        out.append(
            Blocks.of_rows(variables, rng.normal(size=(m, k)), rng.normal(size=m), rng.uniform(0.1, 2, m))
        )
        out[-1].weight = rng.uniform(0.1, 3.0, m)
    return out


@given(seed=st.integers(0, 2**31), size=st.integers(3, 30), last=st.integers(0, 3))
def test_solutions_and_covariances_against_dense(seed: int, size: int, last: int) -> None:
    blocks = observed(seed, size)
    held = np.random.default_rng(seed).choice(size, last, replace=False)
    system = EquationSystem(size, blocks, np.sort(held))
    for _ in range(2):  # other weights, the same equations
        matrix, vector = dense(size, blocks)
        found, inverse = system.solve(), np.linalg.inv(matrix)
        assert found.x == pytest.approx(inverse @ vector, rel=1e-9, abs=1e-10)
        for one in blocks:
            expected = inverse[one.variables[:, :, None], one.variables[:, None, :]]
            assert found.equations.covariance(one.variables) == pytest.approx(expected, rel=1e-9, abs=1e-10)
            spread = np.einsum("mij,mji->m", one.information, expected)
            assert found.expected_squares(one) == pytest.approx(one.squares(found.x) + spread, abs=1e-9)
        blocks[0].weight = blocks[0].weight * 2.0


def test_rounding_is_held_by_a_ridge_and_what_nothing_determines_is_refused() -> None:
    pair = np.array([[0, 1]])
    nearly = [
        Blocks.of_rows(pair, np.array([1.0, -1.0]), 1.0, 1.0),
        Blocks.of_rows(pair[:, :1], np.ones((1, 1)), 0.0, 1e17),
    ]
    assert np.diff(EquationSystem(2, nearly, NONE).solve().x) == pytest.approx(-1.0, rel=1e-6)
    negative = [replace(nearly[0], information=-nearly[0].information)]
    with pytest.raises(ValueError, match="not positive definite"):
        EquationSystem(2, negative, NONE).solve()


def test_a_pattern_holds_what_shares_a_block() -> None:
    pattern = pattern_of(5, [np.array([[0, 1, 2]]), np.array([[2, 3], [3, 2]])]).toarray() != 0
    expected = np.zeros((5, 5), bool)
    expected[:3, :3] = expected[2:4, 2:4] = True
    assert np.array_equal(pattern, expected)


def apart(left: Adjustment, right: Adjustment) -> float:
    """The largest difference of slopes and of sigmas, in sigmas."""
    sigma = right.slope_sigma_percent
    return float(
        max(
            np.abs((left.slope_percent - right.slope_percent) / sigma).max(),
            np.abs(left.slope_sigma_percent / sigma - 1).max(),
        )
    )


def turned(drives: dict[int, list[PassFactor]]) -> dict[int, list[PassFactor]]:
    """The same, as if all had come the other way round."""
    return {k: passes[::-1] for k, passes in reversed(drives.items())}


def test_the_order_of_arrival_changes_nothing() -> None:
    table, drives = driven_town()
    assert apart(adjust(table, turned(drives)), adjust(table, drives)) < 1e-9


def test_a_deleted_drive_leaves_no_trace() -> None:
    table, drives = driven_town()
    before = adjust(table, {k: d for k, d in drives.items() if k != 3})
    adjust(table, drives)
    after = adjust(table, {k: d for k, d in turned(drives).items() if k != 3})
    assert apart(after, before) < 1e-9


@given(seed=st.integers(0, 2**31), size=st.integers(3, 30), late=st.integers(1, 3))
def test_late_unknowns_are_eliminated_after_all_that_they_occur_with(seed: int, size: int, late: int) -> None:
    blocks = observed(seed, size)
    held = np.random.default_rng(seed).choice(size, late, replace=False)
    place = EquationSystem(size, blocks, held).how.place
    for one in blocks:
        for variables in one.variables:
            among = np.isin(variables, held)
            if among.any() and not among.all():
                assert place[variables[among]].min() > place[variables[~among]].max()
