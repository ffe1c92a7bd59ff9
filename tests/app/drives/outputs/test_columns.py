"""Long columns are written as single values are."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.core.text import rounded
from app.drives.outputs.columns import csv_chunks, numbers, time_texts
from app.drives.outputs.track import time_text


@given(st.lists(st.floats()), st.sampled_from([3, 4, 7]))
def test_numbers_are_rounded_as_one_is(values: list[float], digits: int) -> None:
    got = numbers(np.array(values, float), digits)
    wanted = [rounded(value, digits) for value in values]
    assert got == wanted
    assert [math.copysign(1, v) for v in got if v is not None] == [
        math.copysign(1, v) for v in wanted if v is not None
    ]


@given(st.lists(st.one_of(st.floats(0, 4e9), st.just(math.nan))))
def test_times_are_written_as_one_is(values: list[float]) -> None:
    assert time_texts(np.array(values, float)) == [time_text(value) for value in values]


@given(
    st.lists(
        st.one_of(st.none(), st.booleans(), st.integers(), st.text(alphabet=st.characters(codec="utf-8")))
    )
)
def test_a_table_reads_back(values: list[object]) -> None:
    text = "".join(csv_chunks({"a": values, "b": list(range(len(values)))}))
    head, *rows = csv.reader(io.StringIO(text, newline=""))
    said = {None: "", True: "true", False: "false"}
    assert head == ["a", "b"]
    assert [row[0] for row in rows] == [
        said[v] if v is None or isinstance(v, bool) else str(v) for v in values
    ]
