"""The demonstration: its scores on numbers known by hand, and a small one from end to end."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.cli.console import Console
from app.cli.supervisor import Service
from app.demo.command import show_scores
from app.demo.files import figures, map_page, write_files
from app.demo.run import DemoError, demo_service, run_demo, straight_lines
from app.demo.score import Estimate, Truth, by_kind, by_structure, examples, score
from fusion.simulate.scene.town import Town

ROADS = {
    (1, 1, 2): Truth(2.0, "primary", bridge=False, tunnel=False),
    (1, 2, 3): Truth(-4.0, "primary", bridge=True, tunnel=False),
    (2, 3, 4): Truth(0.5, "residential", bridge=False, tunnel=False),
    (2, 4, 5): Truth(8.0, "residential", bridge=False, tunnel=True),
}
MEASURED = {
    (1, 1, 2): Estimate(3.0, 0.6),
    (1, 2, 3): Estimate(-4.0, 0.1),
    (2, 3, 4): Estimate(-1.5, 0.5),
    (9, 9, 9): Estimate(50.0, 0.1),
}


def test_score_by_hand() -> None:
    got = score(ROADS, MEASURED)
    assert (got.segments, got.estimated, got.coverage) == (4, 3, 0.75)
    assert got.rmse_percent == pytest.approx(math.sqrt((1 + 0 + 4) / 3))
    assert got.p90_percent == pytest.approx(1.8)  # between 1 and 2, at 0.9 of the way from first to last
    assert got.within_95 == pytest.approx(2 / 3)
    assert got.wrong_sign == 0.0  # the one that is wrong is not steep


def test_score_of_nothing_is_unknown_and_not_perfect() -> None:
    nothing = score(ROADS, {})
    assert nothing.coverage == 0
    assert math.isnan(nothing.rmse_percent)
    assert math.isnan(nothing.within_95)


def test_baseline_without_sigma_has_no_share() -> None:
    assert math.isnan(score(ROADS, {(1, 1, 2): Estimate(2.0, float("nan"))}).within_95)


def test_kinds_cover_every_segment() -> None:
    kinds = by_kind(ROADS, MEASURED)
    assert list(kinds) == ["primary", "residential"]
    assert sum(one.segments for one in kinds.values()) == len(ROADS)


def test_structures_are_scored_apart_from_the_open_road() -> None:
    kinds = by_structure(ROADS, MEASURED)
    assert {name: one.segments for name, one in kinds.items()} == {"open road": 2, "bridges": 1, "tunnels": 1}
    assert kinds["bridges"].rmse_percent == 0.0
    assert kinds["open road"].rmse_percent == pytest.approx(math.sqrt((1 + 4) / 2))
    assert kinds["tunnels"].estimated == 0


def test_a_straight_line_joins_the_true_ends_of_each_structure(town: Town) -> None:
    lines = straight_lines(town)
    roads = town.roads
    structures = np.flatnonzero(roads.bridge | roads.tunnel)
    assert len(lines) == len(structures)
    for way in np.unique(roads.osm_way_id[structures]):
        rows = np.flatnonzero(roads.osm_way_id == way)
        slopes = {line.slope_percent for key, line in lines.items() if key[0] == way}
        assert len(slopes) == 1
        # The rises of its segments, taken from their true ends, add up to the line's.
        rises = town.node_height_m[town.end[rows]] - town.node_height_m[town.start[rows]]
        assert slopes.pop() == pytest.approx(100 * rises.sum() / town.length_m[rows].sum())


def test_the_page_of_the_map_holds_all_roads() -> None:
    lines = ([[8.5, 49.25], [8.51, 49.2]], [[8.4, 49.3], [8.45, 49.22], [8.46, 49.21]])
    features = [{"geometry": {"coordinates": line}} for line in lines]
    assert map_page(features) == "/map?bbox=8.40000,49.20000,8.51000,49.30000"


@pytest.mark.parametrize("count", range(7))
def test_examples_are_distinct_and_not_more_than_asked(count: int) -> None:
    shown = examples(ROADS, count)
    assert len(set(shown)) == len(shown) <= max(count, 0)
    assert set(shown) <= set(ROADS)


@pytest.fixture(scope="module")
def running() -> Iterator[Service]:
    """As people have it: it asks for a key."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("VERSANT_ACCESS")
        with demo_service(Console(quiet=True)) as running:
            yield running


@pytest.mark.slow
@pytest.mark.db
def test_small_demo_from_end_to_end(
    running: Service, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    console = Console(quiet=True)
    with console.progress() as bars:
        result = run_demo(running, tmp_path / "input", bars, drives=2, duration_s=90.0)
    files = write_files(result, tmp_path)
    assert all(path.stat().st_size > 0 for path in files.values())
    collection = json.loads((tmp_path / "slopes.geojson").read_text())
    assert len(collection["features"]) == len(result.bundle.town.roads)
    for name in ("slopes.png", "profile.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "errors.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(result.truth)
    for row in rows:
        if row["slope_percent"]:
            error = float(row["slope_percent"]) - float(row["true_slope_percent"])
            assert float(row["error_percent"]) == pytest.approx(error, abs=2e-4)
        else:
            assert row["error_percent"] == ""
    scores = figures(result)["scores"]
    assert set(scores) == {"service", "raw", "dem"}
    assert scores["service"]["estimated"] > 0
    assert all(set(one) == {*scores, "straight"} for one in figures(result)["by_structure"].values())
    show_scores(console, result)
    shown = capsys.readouterr().out
    assert f"of {len(result.truth)} driven segments" in shown
    for part in (
        "All driven segments",
        "Bridges and tunnels beside the open road",
        "Versant by class of road",
    ):
        assert part in shown
    assert f"{scores['service']['rmse_percent']:.2f}" in shown


@pytest.mark.slow
@pytest.mark.db
def test_a_drive_that_fails_ends_the_demo_in_words(running: Service, tmp_path: Path) -> None:
    with Console(quiet=True).progress() as bars, pytest.raises(DemoError, match="ended as failed"):
        run_demo(running, tmp_path, bars, drives=1, duration_s=2.0)
