"""The tables of the experiments: what a row shows, where the page takes tables, that every part has its place."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def seeds(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("seeds")


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("seeds_rows")


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
def test_numbers_have_three_digits(rows: ModuleType, value: float, text: str) -> None:
    assert rows.number(value) == text


def test_a_row_shows_median_and_extremes_of_the_known_seeds(rows: ModuleType) -> None:
    row = rows.Row("e", "error", "m", "0.30", [4.0, float("nan"), 1.0, 2.0], "Because.")
    lines = rows.markdown_table([row]).splitlines()
    assert lines[2] == "| error | m | 0.30 | 2.00 | 1.00 | 4.00 | 3 |"
    assert lines[-1] == "- error: Because."
    text = rows.text_table([row]).splitlines()
    assert text[0] == "e"
    assert text[2].split() == ["error", "m", "0.30", "2.00", "1.00", "4.00", "3"]


def test_a_row_without_a_value_shows_dashes(rows: ModuleType) -> None:
    assert "| e | - | - | - | - | 0 |" in rows.markdown_table([rows.Row("x", "q", "e", "", [])])


def test_subjects_get_a_line_each(rows: ModuleType) -> None:
    found = [
        rows.Row("e", "a: RMSE", "%", "", [1.0, 2.0, 3.0], "Odd."),
        rows.Row("e", "a: time", "s", "", [0.5]),
        rows.Row("e", "b: RMSE", "%", "", [4.0], "Odd."),
    ]
    lines = rows.markdown_table(found).splitlines()
    assert lines[0] == "|  | RMSE, % | time, s |"
    assert lines[2:4] == ["| a | 2.00 (1.00 to 3.00) | 0.500 |", "| b | 4.00 | - |"]
    assert lines[-1] == "- a: RMSE; b: RMSE: Odd."


def test_pipes_do_not_break_a_table(rows: ModuleType) -> None:
    assert r"| \|e\| |" in rows.markdown_table([rows.Row("x", "|e|", "m", "1", [1.0])])


def test_tables_are_renewed_in_their_place_only(seeds: ModuleType, rows: ModuleType) -> None:
    page = "a\n<!-- table: calais -->\nold\n<!-- end -->\nb\n<!-- table: lahrech -->\n\n<!-- end -->\nc\n"
    once = seeds.renewed(page, "calais", [rows.Row("Drive", "error", "m", "1", [2.0])])
    assert "old" not in once
    assert once.startswith("a\n<!-- table: calais -->\n\n### Drive\n\n| quantity")
    assert once.endswith("\n<!-- end -->\nb\n<!-- table: lahrech -->\n\n<!-- end -->\nc\n")
    assert seeds.renewed(once, "calais", [rows.Row("Drive", "error", "m", "1", [2.0])]) == once


def test_a_page_without_a_place_is_refused(seeds: ModuleType, rows: ModuleType) -> None:
    with pytest.raises(ValueError, match="0 places for the tables of methods"):
        seeds.renewed("nothing here", "methods", [rows.Row("x", "q", "m", "", [1.0])])


def test_the_page_has_a_place_for_every_part(seeds: ModuleType) -> None:
    page = seeds.DOCUMENT.read_text(encoding="utf-8")
    assert re.findall(r"<!-- table: (\w+) -->", page) == list(seeds.PARTS)
    for part in seeds.PARTS:
        assert (BENCHMARKS / f"seeds_{part}.py").exists(), part


def test_calais_measures_what_its_tables_show(
    seeds: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every case on one drive, by the Kalman filter where there are particles: the limits of the issue hold."""
    calais = importlib.import_module("seeds_calais")
    scene = calais.Scene.make(2, calais.RECEIVER, tmp_path)
    for case in calais.CASES:
        swift = {**case.options, "filter": "ekf"} if case.method == "particle" else case.options
        figures = calais.measure(scene, replace(case, options=swift))
        shown = {quantity for quantity, _, _ in case.quantities if "receiver m8" not in quantity}
        assert shown - set(figures) <= {"epochs resampled, threshold 0.1"}
        assert figures["map-match rate"] >= 94
        assert figures["matches on the segment driven"] > 90
        assert figures["pitch, std"] < 0.08
        assert 40 < figures["segments with a slope"] < 75
        if case.velocity:
            assert figures["position U, std, beside GNSS alone"] < 0.6
            assert figures["pitch, std"] < 0.05


def test_published_quantities_are_measured_ones(seeds: ModuleType) -> None:
    """Each note names a case and a quantity that its table has; a slip would drop it silently."""
    calais = importlib.import_module("seeds_calais")
    names = {(case.name, quantity) for case in calais.CASES for quantity, _, _ in case.quantities}
    assert set(calais.NOTES) <= names
