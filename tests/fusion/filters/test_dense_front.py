"""Dense elimination is what linear algebra says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.filters.dense_front import DenseFront


@given(seed=st.integers(0, 2**31), size=st.integers(0, 12), data=st.data())
def test_what_is_eliminated_comes_back(seed: int, size: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, size))
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size + 3))
    matrix, vector = root @ root.T + 0.1 * np.eye(size), rng.normal(size=size)
    covariance, x = np.linalg.inv(matrix), np.linalg.solve(matrix, vector)
    front, left, right = DenseFront.eliminate(matrix, vector, count)
    rest = covariance[count:, count:]
    assert left @ rest == pytest.approx(np.eye(size - count), abs=1e-8)
    assert rest @ right == pytest.approx(x[count:], abs=1e-8)
    found, spread = front.solve(x[count:], rest)
    assert found == pytest.approx(x, abs=1e-8)
    assert spread == pytest.approx(covariance, abs=1e-8)


def test_what_is_not_determined_is_said() -> None:
    with pytest.raises(ValueError, match="not determined"):
        DenseFront.eliminate(np.zeros((2, 2)), np.zeros(2), 1)
