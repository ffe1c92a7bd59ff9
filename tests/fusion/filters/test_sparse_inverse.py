"""Solutions and selected covariances against numpy's dense inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse

from fusion.filters.sparse_inverse import Elimination, NormalEquations


def from_pairs(
    size: int, pairs: np.ndarray, rng: np.random.Generator, hold: float = 0.3
) -> sparse.csc_matrix:
    """Observed differences of random weight between unknowns, and a weak hold on each."""
    matrix = hold * np.eye(size)
    for (a, b), weight in zip(pairs, rng.uniform(0.1, 10.0, len(pairs)), strict=True):
        row = np.zeros(size)
        row[a], row[b] = 1.0, -rng.uniform(0.5, 1.5)
        matrix += weight * np.outer(row, row)
    return sparse.csc_matrix(matrix)


def grid_pairs(width: int, height: int) -> np.ndarray:
    number = np.arange(width * height).reshape(height, width)
    across = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    down = np.column_stack([number[:-1].ravel(), number[1:].ravel()])
    return np.concatenate([across, down])


def check(matrix: sparse.csc_matrix, rng: np.random.Generator) -> None:
    """Solution, variances and the covariances of all pairs that share an equation."""
    size = matrix.shape[0]
    inverse = np.linalg.inv(matrix.toarray())
    equations = NormalEquations.of(matrix)
    vector = rng.normal(size=size)
    assert equations.solve(vector) == pytest.approx(inverse @ vector, rel=1e-8, abs=1e-10)
    scale = np.abs(inverse).max()
    alone = equations.covariance(np.arange(size)[:, None])
    assert alone.ravel() == pytest.approx(np.diag(inverse), rel=1e-8)
    pairs = np.argwhere(np.triu(matrix.toarray(), 1) != 0)
    blocks = equations.covariance(pairs)
    expected = inverse[pairs[:, :, None], pairs[:, None, :]]
    assert blocks == pytest.approx(expected, rel=1e-8, abs=1e-10 * scale)
    assert np.array_equal(blocks, blocks.transpose(0, 2, 1))


@given(seed=st.integers(0, 2**31), size=st.integers(1, 40), density=st.floats(0.0, 3.0))
def test_any_network_of_differences(seed: int, size: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, size, (int(density * size), 2))
    check(from_pairs(size, pairs[pairs[:, 0] != pairs[:, 1]], rng), rng)


def test_grids_where_much_is_filled_in() -> None:
    for width, height in ((1, 1), (2, 9), (12, 11)):
        rng = np.random.default_rng(width)
        check(from_pairs(width * height, grid_pairs(width, height), rng), rng)


def test_trees_chains_and_stars_where_nothing_is() -> None:
    rng = np.random.default_rng(2)
    size = 60
    tree = np.column_stack([np.arange(1, size), [rng.integers(0, k) for k in range(1, size)]])
    chain = np.column_stack([np.arange(1, size), np.arange(size - 1)])
    star = np.column_stack([np.arange(1, size), np.zeros(size - 1, np.int64)])
    for pairs in (tree, chain, star):
        check(from_pairs(size, pairs, rng), rng)


def test_a_block_over_all_unknowns_of_an_equation_comes_out_whole() -> None:
    """As factors do: an equation over five unknowns makes all their covariances available at once."""
    rng = np.random.default_rng(3)
    size, matrix = 30, 0.2 * np.eye(30)
    groups = np.array([rng.choice(size, 5, replace=False) for _ in range(12)])
    for group in groups:
        row = np.zeros(size)
        row[group] = rng.normal(size=5)
        matrix += np.outer(row, row)
    inverse = np.linalg.inv(matrix)
    blocks = NormalEquations.of(sparse.csc_matrix(matrix)).covariance(groups)
    assert blocks == pytest.approx(inverse[groups[:, :, None], groups[:, None, :]], rel=1e-8, abs=1e-9)


def test_separate_parts_know_nothing_of_each_other() -> None:
    rng = np.random.default_rng(4)
    parts = [from_pairs(4, grid_pairs(2, 2), rng) for _ in range(2)]
    together = NormalEquations.of(sparse.block_diag(parts, format="csc"))
    alone = NormalEquations.of(parts[1]).covariance(np.arange(4)[None])
    assert together.covariance(np.arange(4, 8)[None]) == pytest.approx(alone, nan_ok=True)
    assert np.isnan(together.covariance(np.array([[0, 5]]))[0, 0, 1]), "not in the pattern, so not known"


def test_no_rows_give_no_blocks() -> None:
    equations = NormalEquations.of(sparse.csc_matrix(np.eye(3)))
    assert equations.covariance(np.empty((0, 4), np.int64)).shape == (0, 4, 4)


@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 2.0], [2.0, 1.0]],
        [[-1.0, 0.0], [0.0, 1.0]],
        [[1.0, 1.0], [1.0, 1.0]],
        [[1.0, 0.0], [0.0, 0.0]],
        [[0.0, 1.0], [1.0, 0.0]],
        [[2.0, -1.0, -1.0], [-1.0, 2.0, -1.0], [-1.0, -1.0, 2.0]],
    ],
    ids=["indefinite", "negative", "rank one", "unknown in no equation", "zero diagonal", "level not held"],
)
def test_what_is_not_positive_definite_is_refused(matrix: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="normal equations are"):
        NormalEquations.of(sparse.csc_matrix(np.array(matrix)))


def test_an_unknown_in_no_equation_is_found_in_a_large_network() -> None:
    rng = np.random.default_rng(5)
    matrix = from_pairs(50, grid_pairs(10, 5), rng).tolil()
    matrix[17, :] = matrix[:, 17] = 0.0
    held = sparse.csc_matrix(matrix)
    held.eliminate_zeros()
    with pytest.raises(ValueError, match="normal equations are"):
        NormalEquations.of(held)


def test_a_covariance_is_there_even_where_the_matrix_holds_a_zero() -> None:
    """Two equations over the same pair may cancel to exactly 0; what the pair shares with others still counts."""
    size, hub = 8, 2
    matrix = np.diag(np.full(size, 4.0))
    for leaf in (0, 1, 3, 4, 5, 6, 7):
        matrix[leaf, hub] = matrix[hub, leaf] = 1.0
    stored = sparse.coo_matrix(matrix)
    rows, columns = (np.append(v, extra) for v, extra in ((stored.row, [0, 1]), (stored.col, [1, 0])))
    cancelled = sparse.csc_matrix((np.append(stored.data, [0.0, 0.0]), (rows, columns)), shape=matrix.shape)
    assert cancelled.nnz == stored.nnz + 2
    expected = np.linalg.inv(matrix)[np.ix_([0, 1, 2], [0, 1, 2])]
    assert NormalEquations.of(cancelled).covariance(np.array([[0, 1, 2]]))[0] == pytest.approx(expected)


def test_an_order_serves_another_matrix_of_the_same_pattern() -> None:
    rng = np.random.default_rng(6)
    first, second = (from_pairs(20, grid_pairs(5, 4), rng) for _ in range(2))
    again = NormalEquations.of(second, NormalEquations.of(first).how)
    vector = rng.normal(size=20)
    assert again.solve(vector) == pytest.approx(np.linalg.solve(second.toarray(), vector))
    assert again.covariance(np.arange(20)[:, None]).ravel() == pytest.approx(
        np.diag(np.linalg.inv(second.toarray()))
    )


@given(seed=st.integers(0, 2**31), size=st.integers(2, 40), share=st.floats(0.0, 0.9))
def test_what_is_eliminated_onto_a_border_and_follows_from_it(seed: int, size: int, share: float) -> None:
    """The border's matrix is Schur's complement; given its solution and covariance, all inside comes out as ever."""
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, size, (2 * size, 2))
    matrix = from_pairs(size, pairs[pairs[:, 0] != pairs[:, 1]], rng)
    border = max(1, int(share * size))
    order = rng.permutation(size)
    inside, outside = order[:-border], order[-border:]
    equations = NormalEquations.of(matrix, Elimination(matrix, order, border))
    dense, vector = matrix.toarray(), rng.normal(size=size)
    left = np.linalg.solve(
        dense[np.ix_(inside, inside)], np.column_stack([dense[np.ix_(inside, outside)], vector[inside]])
    )
    schur = dense[np.ix_(outside, outside)] - dense[np.ix_(outside, inside)] @ left[:, :-1]
    assert equations.border_matrix() == pytest.approx(schur, rel=1e-8, abs=1e-8)
    reduced = equations.reduced(vector)
    assert reduced[-border:] == pytest.approx(
        vector[outside] - dense[np.ix_(outside, inside)] @ left[:, -1], rel=1e-8, abs=1e-8
    )
    inverse = np.linalg.inv(dense)
    found = equations.solve_inside(reduced, (inverse @ vector)[outside])
    assert found == pytest.approx(inverse @ vector, rel=1e-7, abs=1e-8)
    equations.set_border_covariance(inverse[np.ix_(outside, outside)])
    entries = np.argwhere(dense != 0)
    assert equations.covariance(entries)[:, 0, 1] == pytest.approx(
        inverse[entries[:, 0], entries[:, 1]], rel=1e-7, abs=1e-8
    )


def test_covariances_of_blocks_that_are_known_are_those_of_any() -> None:
    """Slots that were kept, for the very array that they were kept for."""
    dense = np.diag(np.full(6, 4.0)) + np.diag(np.full(5, -1.0), 1) + np.diag(np.full(5, -1.0), -1)
    matrix = sparse.csc_matrix(dense)
    how = Elimination(matrix, np.arange(6))
    rows = np.array([[0, 1], [4, 3]])
    how.slots(rows, keep=True)
    found = NormalEquations.of(matrix, how)
    inverse = np.linalg.inv(dense)
    for asked in (rows, rows.copy()):
        assert found.covariance(asked) == pytest.approx(inverse[asked[:, :, None], asked[:, None, :]])
    assert how.kept_slots(rows.copy()) is None
