"""The page of the experiments: where it takes tables, that every part has its place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import seeds
from published.rows import Row

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def test_tables_are_renewed_in_their_place_only() -> None:
    page = "a\n<!-- table: calais -->\nold\n<!-- end -->\nb\n<!-- table: lahrech -->\n\n<!-- end -->\nc\n"
    once = seeds.renewed(page, "calais", [Row("Drive", "error", "m", "1", [2.0])])
    assert "old" not in once
    assert once.startswith("a\n<!-- table: calais -->\n\n| quantity | Drive |")
    assert once.endswith("\n<!-- end -->\nb\n<!-- table: lahrech -->\n\n<!-- end -->\nc\n")
    assert seeds.renewed(once, "calais", [Row("Drive", "error", "m", "1", [2.0])]) == once


def test_experiments_that_differ_have_a_table_each() -> None:
    once = seeds.renewed(
        "<!-- table: saadaoui -->\n\n<!-- end -->\n", "saadaoui", [Row("Drive", "error", "m", "1", [2.0])]
    )
    assert once.startswith("<!-- table: saadaoui -->\n\n### Drive\n\n| quantity | unit |")


def test_a_page_without_a_place_is_refused() -> None:
    with pytest.raises(ValueError, match="0 places for the tables of methods"):
        seeds.renewed("nothing here", "methods", [Row("x", "q", "m", "", [1.0])])


def test_the_page_has_a_place_for_every_part() -> None:
    assert list(seeds.PAGES) == list(seeds.PARTS)
    for part in seeds.PARTS:
        page = seeds.PAGES[part].read_text(encoding="utf-8")
        assert seeds.MARKERS.get(part, part) in re.findall(r"<!-- table: (\w+) -->", page)
        assert (BENCHMARKS / f"{seeds.PARTS[part].replace('.', '/')}.py").exists(), part
