"""NumPy's vectors as PostgreSQL's arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import Sessions

_ELEMENTS: dict[str, Any] = {
    "bigint": st.integers(-(2**63), 2**63 - 1),
    "float8": st.floats(),
    "boolean": st.booleans(),
}
_TYPES = {"bigint": np.int64, "float8": np.float64, "boolean": np.bool_}


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), kind=st.sampled_from(sorted(_ELEMENTS)))
def test_vectors_come_back_as_they_went(sessions: Sessions, data: st.DataObject, kind: str) -> None:
    values = data.draw(st.lists(_ELEMENTS[kind], max_size=20))
    masked = data.draw(st.lists(st.booleans(), min_size=len(values), max_size=len(values)))
    vector = np.array(values, _TYPES[kind])
    query = text(f"SELECT :plain, :masked, pg_typeof(:plain) = '{kind}[]'::regtype")
    with sessions() as session:
        plain, with_nulls, right = session.execute(
            query, {"plain": vector, "masked": np.ma.array(vector, mask=masked)}
        ).one()
    assert right
    assert repr(plain) == repr(vector.tolist())
    assert repr(with_nulls) == repr(
        [None if hidden else value for value, hidden in zip(vector.tolist(), masked, strict=True)]
    )


@pytest.mark.parametrize("odd", [np.zeros((2, 2)), np.array(["a"]), np.zeros(2, np.complex128)])
def test_other_arrays_are_refused(sessions: Sessions, odd: Any) -> None:
    with sessions() as session, pytest.raises(psycopg.DataError, match="vectors of numbers"):
        session.connection().connection.driver_connection.execute("SELECT %s", (odd,))  # type: ignore[union-attr]
