"""Times of the common kind, read by the column."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.formats.time_texts import unix_seconds

SIGNS = "0123456789-T:.Z+ "
STAMPS = st.integers(-8_000_000_000_000_000, 8_000_000_000_000_000).map(
    lambda micros: datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=micros)
)


def by_pandas(text: str) -> float:
    """What the library makes of one time."""
    stamp = pd.to_datetime(text, utc=True, format="ISO8601", errors="coerce")
    return (
        float("nan")
        if stamp is pd.NaT
        else int(stamp.to_datetime64().astype("datetime64[us]").astype(int)) / 1e6
    )


@given(st.lists(st.tuples(STAMPS, st.integers(0, 9))))
def test_every_time_that_is_written_is_read(stamps: list[tuple[datetime, int]]) -> None:
    texts, told = [], []
    for stamp, digits in stamps:
        fraction = f"{stamp.microsecond:06d}000"[:digits]
        texts.append(f"{stamp:%Y-%m-%dT%H:%M:%S}".zfill(19) + ("." + fraction if digits else "") + "Z")
        told.append(stamp.replace(microsecond=int((fraction + "000000")[:6])).timestamp())
    assert unix_seconds(texts) == pytest.approx(np.array(told), abs=2e-6)


@given(st.integers(0, 23), st.sampled_from(SIGNS), st.sampled_from(["", "1", "Z"]))
def test_what_is_nearly_of_that_form_is_read_as_by_the_library(at: int, sign: str, tail: str) -> None:
    whole = "2016-02-29T15:34:20.125Z"
    text = whole[:at] + sign + whole[at + 1 :] + tail
    np.testing.assert_array_equal(unix_seconds([text]), [by_pandas(text)])
    assert unix_seconds([whole])[0] == by_pandas(whole)


@pytest.mark.parametrize(
    "text",
    [
        "2018-05-04T15:34:20", "2018-05-04T17:34:20+02:00", "2018-02-30T00:00:00Z", "2018-13-01T00:00:00Z",
        "2018-05-04T24:00:00Z", "2018-05-04T15:34:60Z", "2018-05-04T15:34:20.Z", "2018-05-04T15:34:20.5ZZ",
        "2018-05-04T15:34:20.1234567890Z", "2018-05-04 15:34:20Z", "", "half past three", "２018-05-04T15:34:20Z",
        "2018-05-04T15:34:20Z and more than thirty letters",
    ],
)  # fmt: skip
def test_other_forms_cost_no_other_time(text: str) -> None:
    whole = "2016-02-29T15:34:20.125Z"
    np.testing.assert_array_equal(unix_seconds([text, whole]), [by_pandas(text), by_pandas(whole)])


def test_both_kinds_and_none_together() -> None:
    texts = ["2018-05-04T15:34:20Z", None, "2018-05-04T17:34:21+02:00", "no time", "2018-05-04T15:34:22.25Z"]
    out = unix_seconds(texts)
    assert np.isnan(out[[1, 3]]).all()
    assert (out[[0, 2, 4]] - 1525448060).tolist() == [0, 1, 2.25]
    assert len(unix_seconds([])) == 0
