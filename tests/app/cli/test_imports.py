"""What ``versant import-roads`` says beside its bars."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.core.db import make_engine, session_factory
from app.network.extracts import all_roads
from app.roads.documents import ImportCounts, remarks, summary
from fusion.simulate.scene.town import Town
from fusion.simulate.write.osm_file import write_osm
from network_support import drive_over


def test_an_import_without_losses_needs_no_remark() -> None:
    assert remarks(ImportCounts("town", kept=5, moved=1, dropped=2, added=3)) == []


def test_what_becomes_of_segments_is_told() -> None:
    assert summary(ImportCounts("town", kept=5)) == "region town has 5 segments (5 kept, 0 added; 0 dropped)"
    counts = ImportCounts(
        "town", kept=5, moved=4, renumbered=3, reversed=2, far=1, added=6, split=7, merged=8, dropped=9, released=10,
        dry_run=True,
    )  # fmt: skip
    assert summary(counts) == (
        "region town would have 21 segments (5 kept, 4 moved within the tolerance, 3 renumbered, 2 reversed, "
        "1 moved farther, 6 added; 7 split, 8 merged, 9 dropped, 10 left to other regions)"
    )


def test_lost_and_restored_slopes_and_unused_nodes_are_told() -> None:
    counts = ImportCounts(
        "town", kept=5, measured_lost=2, restored=7, drives_again=4,
        skipped={"no length": 1, "node missing from the file": 6},
    )  # fmt: skip
    assert remarks(counts) == [
        "2 segments lose what was measured on them, because they were moved, split, merged or dropped. It is kept for "
        "some time, and comes back if they do.",
        "7 segments have back what was measured before they went.",
        "4 drives are computed again by themselves.",
        "7 node pairs of the file's roads are no segments (no length: 1, node missing from the file: 6).",
    ]


def test_regions_by_commands(
    database_url: str, monkeypatch: pytest.MonkeyPatch, town: Town, tmp_path: Path
) -> None:
    """Import, trial run, what is refused, list and removal, as an operator has them."""
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path / "data"))
    runner = CliRunner()

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        done = runner.invoke(app, [str(a) for a in arguments])
        return done.exit_code, done.stdout, done.stderr

    n = len(town.roads)
    write_osm(town, tmp_path / "Hill Town.osm")
    figures = tmp_path / "figures.json"
    assert run("regions", "list")[1].startswith("There are no regions yet.")
    status, said, _ = run("import-roads", tmp_path / "Hill Town.osm", "--dry-run", "--json", figures)
    assert (status, json.loads(figures.read_text())["added"]) == (0, n)
    assert f"region hill-town would have {n} segments (0 kept, {n} added; 0 dropped)" in said
    status, said, _ = run("import-roads", tmp_path / "Hill Town.osm", "--json", figures)
    assert f"region hill-town has {n} segments" in said
    told = json.loads(figures.read_text())
    assert (status, told["region"], told["segments"], told["dry_run"]) == (0, "hill-town", n, False)
    assert 0 <= told["longest_hold_s"] < 60
    engine = make_engine(database_url)
    with session_factory(engine)() as session:
        table, ids = all_roads(session)
    drive_over(session_factory(engine), table, ids, dict.fromkeys(range(20), (2.0, 0.5)))
    engine.dispose()
    assert run("regions", "list", "--json", figures)[1].startswith(
        f"hill-town: {n} segments, 20 of them measured; from"
    )
    assert json.loads(figures.read_text())["regions"][0]["measured"] == 20
    status, _, error = run("regions", "remove", "hill-town")
    assert status == 1
    assert "20 of the 20 measured segments of hill-town" in error
    assert "--yes" in error
    status, said, _ = run("regions", "remove", "hill-town", "--dry-run")
    assert (status, "1 drive would be computed again by itself." in said) == (0, True)
    status, said, _ = run("regions", "remove", "hill-town", "--yes")
    assert (status, f"region hill-town has 0 segments (0 kept, 0 added; {n} dropped)" in said) == (0, True)
    status, _, error = run("regions", "remove", "hill-town")
    assert (status, "There is no region 'hill-town'. There is none yet." in error) == (1, True)
    status, said, _ = run("import-roads", tmp_path / "Hill Town.osm", "--region", "a b")
    assert status == 1
    status, said, _ = run("import-roads", tmp_path / "Hill Town.osm", "--region", "town")
    assert (status, "20 segments have back what was measured before they went." in said) == (0, True)
