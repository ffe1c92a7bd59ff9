"""Lines and numbers of RINEX files."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.errors import MalformedLogError
from fusion.formats.rinex import lines as rinex_lines
from fusion.formats.rinex.lines import number, numbers, seconds_of, split_lines

BEGAN = datetime(1980, 1, 6)  # noqa: DTZ001 - of the GPS scale


def value(text: str) -> float:
    """The number in the whole of a text."""
    data = np.frombuffer(text.encode(), np.uint8)
    return float(number(data, 0, len(data)))


@given(st.decimals(-99999999, 99999999, allow_nan=False, places=3))
def test_numbers_of_observations_are_those_of_python(x: object) -> None:
    assert value(f"{x!s:>14}") == float(str(x))


@given(st.integers(-(10**13), 10**13), st.integers(-32, 32), st.sampled_from("DEde"))
def test_numbers_with_exponents_are_right_to_the_last_bits(digits: int, power: int, letter: str) -> None:
    x = float(f"{digits}E{power}")
    text = f"{x:19.12E}"
    assert value(text.replace("E", letter)) == pytest.approx(float(text), rel=5e-16, abs=0)


@pytest.mark.parametrize("text", ["", " ", "     "])
def test_blanks_are_no_number(text: str) -> None:
    assert math.isnan(value(text))


@pytest.mark.parametrize(
    "text", ["x", "1x", "1.2.3", "-", "+", ".", "1D", "1Dx", "1D+", "1 2", "1D99999999999", "--1"]
)
def test_what_is_no_number_is_infinite(text: str) -> None:
    assert math.isinf(value(text))


@given(st.binary(max_size=30))
def test_any_bytes_give_a_number_or_say_that_they_are_none(data: bytes) -> None:
    text = np.frombuffer(data, np.uint8)
    assert isinstance(float(number(text, 0, len(text))), float)


def test_long_numbers_keep_their_size() -> None:
    assert value("123456789012345678901234") == pytest.approx(1.2345678901234568e23, rel=1e-15)
    assert value("0.0000000000000000000000001234567890") == pytest.approx(1.23456789e-25, rel=1e-8)
    assert value("+5.") == 5
    assert value("-.5D+01") == -5


@given(st.lists(st.text(alphabet="ab \r", max_size=5), max_size=6), st.booleans())
def test_lines_are_those_that_line_feeds_end(parts: list[str], ended: bool) -> None:
    text = "\n".join(parts) + ("\n" if ended else "")
    wanted = text.split("\n")
    wanted = [part.removesuffix("\r") for part in (wanted[:-1] if wanted[-1] == "" else wanted)]
    found = split_lines(text.encode())
    assert [found.line(i) for i in range(len(found))] == wanted


def test_more_lines_than_fit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rinex_lines, "MOST_LINES", 3)
    with pytest.raises(MalformedLogError, match="Split the recording"):
        split_lines(b"\n" * 4)


def test_columns_behind_the_end_of_a_line_are_blank() -> None:
    found = split_lines(b"12\n  34 56\n")
    both = np.array([0, 1])
    assert found.column(both, 0).tolist() == [ord("1"), ord(" ")]
    assert np.array_equal(found.numbers(both, 2, 2), [np.nan, 34], equal_nan=True)
    assert numbers(found.text, np.array([0]), np.array([2])).tolist() == [12]


@given(st.datetimes(min_value=BEGAN, max_value=datetime(2079, 12, 31)))  # noqa: DTZ001
def test_calendar_times_count_from_the_gps_epoch(when: datetime) -> None:
    columns = ((0, 4), (4, 3), (7, 3), (10, 3), (13, 3), (16, 11))
    rest = (
        f"{when.month:3}{when.day:3}{when.hour:3}{when.minute:3}{when.second + when.microsecond / 1e6:11.7f}"
    )
    found = split_lines(f"{when.year:4}{rest}\n{when.year % 100:4}{rest}\n".encode())
    seconds, good = seconds_of(found, np.array([0, 1]), columns)
    assert good.all()
    assert seconds == pytest.approx((when - BEGAN).total_seconds(), abs=1e-6)


def test_impossible_calendar_times_are_none() -> None:
    columns = ((0, 4), (4, 3), (7, 3), (10, 3), (13, 3), (16, 11))
    texts = ["2023 13  1  0  0  0.0000000", "2023  0  1  0  0  0.0000000", "2023  1 32  0  0  0.0000000",
             "1979  1  1  0  0  0.0000000", "2023  1  1 25  0  0.0000000", "2023  1  1  0 60  0.0000000",
             "", "2023  1  1  0  0 xx"]  # fmt: skip
    found = split_lines("\n".join(texts).encode())
    seconds, good = seconds_of(found, np.arange(len(texts)), columns)
    assert not good.any()
    assert np.isnan(seconds).all()
