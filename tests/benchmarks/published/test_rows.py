"""The tables of the experiments: what a row shows, how rows become a table."""

from __future__ import annotations

import pytest

from published.rows import Row, markdown_table, number, side_by_side, text_table


@pytest.mark.parametrize(
    ("value", "text"),
    (
        (0.0, "0"),
        (float("nan"), "-"),
        (12345.6, "12346"),
        (12.345, "12.3"),
        (-0.0123, "-0.0123"),
        (0.9996, "1.000"),
        (2.5e-7, "2.5e-07"),
    ),
)
def test_numbers_have_three_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_a_row_shows_median_and_extremes_of_the_known_seeds() -> None:
    row = Row("e", "error", "m", "0.30", [4.0, float("nan"), 1.0, 2.0], "Because.")
    lines = markdown_table([row]).splitlines()
    assert lines[2] == "| error | m | 0.30 | 2.00 (1.00 to 4.00) |"
    assert lines[-1] == "- error: Because."
    text = text_table([row]).splitlines()
    assert text[0] == "e"
    assert text[2].split() == ["error", "m", "0.30", "2.00", "1.00", "4.00", "3"]


def test_a_row_without_a_value_shows_dashes() -> None:
    assert "| q | e | - | - |" in markdown_table([Row("x", "q", "e", "", [])])


def test_subjects_get_a_line_each() -> None:
    found = [
        Row("e", "a: RMSE", "%", "", [1.0, 2.0, 3.0], "Odd."),
        Row("e", "a: time", "s", "", [0.5]),
        Row("e", "b: RMSE", "%", "", [4.0], "Odd."),
    ]
    lines = markdown_table(found).splitlines()
    assert lines[0] == "|  | RMSE, % | time, s |"
    assert lines[2:4] == ["| a | 2.00 (1.00 to 3.00) | 0.500 |", "| b | 4.00 | - |"]
    assert lines[-1] == "- a: RMSE; b: RMSE: Odd."


def test_what_is_printed_stands_above_the_subjects() -> None:
    lines = markdown_table([Row("e", "a: RMSE", "%", "3 to 4", [1.0]), Row("e", "a: time", "s", "", [2.0])])
    assert lines.splitlines()[2:] == ["| published | 3 to 4 | - |", "| a | 1.00 | 2.00 |"]


def test_experiments_stand_side_by_side() -> None:
    rows = [
        Row("one", "error", "m", "0.30", [1.0, 2.0, 4.0], "Of one."),
        Row("one", "rate", "%", "-", [5.0], "Of both."),
        Row("two", "error", "m", "", [3.0], "Of two."),
        Row("two", "rate", "%", "", [6.0], "Of both."),
        Row("two", "count", "", "", [7.0]),
    ]
    assert side_by_side(rows).splitlines() == [
        "| quantity | one | two |",
        "| --- | ---: | ---: |",
        "| error, m | 2.00 (1.00 to 4.00) *0.30* | 3.00 |",
        "| rate, % | 5.00 | 6.00 |",
        "| count | - | 7.00 |",
        "",
        "- error (one): Of one.",
        "- rate: Of both.",
        "- error (two): Of two.",
    ]


def test_pipes_do_not_break_a_table() -> None:
    assert r"| \|e\| |" in markdown_table([Row("x", "|e|", "m", "1", [1.0])])
