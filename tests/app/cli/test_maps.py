"""``--map`` and ``--scale``: maps of what logs say, and of what the database holds in a box."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from app.core.db import Sessions, make_engine, session_factory
from app.map.picture import slope_map
from app.network import extracts as road_store
from fusion.simulate.demonstration import write_all
from fusion.simulate.scene.town import Town
from network_support import drive_over
from road_support import replace_roads

runner = CliRunner()


@pytest.fixture
def empty(database_url: str, monkeypatch: pytest.MonkeyPatch, town: Town) -> Iterator[Sessions]:
    """A database that the commands find, with the town's roads and no drive."""
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    engine = make_engine(database_url)
    factory = session_factory(engine)
    with factory.begin() as session:
        replace_roads(session, town.roads, "town.osm", "0" * 64)
    yield factory
    engine.dispose()


def run(*arguments: str | Path) -> Result:
    return runner.invoke(app, [str(a) for a in arguments])


def drawn(path: Path, *arguments: str) -> int:
    """How many segments the map shows."""
    report = path.with_name("report.json")
    result = run("export", "--map", path, "--json", report, *arguments)
    assert result.exit_code == 0, result.stderr
    assert path.stat().st_size > 10_000
    return int(json.loads(report.read_text())["segments_drawn"])


def test_a_map_of_the_database_shows_the_box_and_no_more_than_a_map_can(
    empty: Sessions, town: Town, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.svg"
    nothing = run("export", "--map", path)
    assert (nothing.exit_code, "No road has a slope" in nothing.stderr) == (1, True)
    assert not path.exists()
    with empty.begin() as session:
        table, ids = road_store.all_roads(session)
    rows = [int(row) for row in range(len(table)) if table.lon0_deg[row] < sorted(table.lon0_deg)[20]][:12]
    drive_over(empty, table, ids, dict.fromkeys(rows, (2.0, 0.5)))
    around = drawn(path)
    assert 12 < around < len(table), "the roads around those that were driven"
    assert drawn(path, "--driven") == 12
    west, south, east, north = table.bounds_deg()
    everything = f"--bbox={west},{south},{east},{north}"
    assert drawn(path, everything, "--scale", "8") == len(table)
    assert "8 % on, as asked." in path.read_text().replace("\n", " ")

    monkeypatch.setattr(slope_map, "MOST_SEGMENTS", 20)
    result = run("export", "--map", path, everything)
    assert (result.exit_code, result.stdout) == (0, f"{path}: map of 12 segments.\n")
    assert f"Undriven roads are left out: with them there are {len(table)} segments" in result.stderr
    assert "Undriven roads are left out" in path.read_text(), "the map itself says so"
    monkeypatch.setattr(slope_map, "MOST_SEGMENTS", 11)
    before = path.read_bytes()
    for box in ((), (everything,)):
        refused = run("export", "--map", path, *box)
        assert refused.exit_code == 1
        assert "12 driven segments" in refused.stderr
        assert "--bbox" in refused.stderr
    at_sea = run("export", "--map", path, "--bbox=1,1,1.1,1.1")
    assert (at_sea.exit_code, "no road in that box" in at_sea.stderr) == (1, True)
    whole = run("export", "--map", path, "--bbox=-30,30,30,60")
    assert (whole.exit_code, "at most. Name a smaller box" in whole.stderr) == (1, True)
    assert path.read_bytes() == before, "what fails leaves the file as it was"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["map.svg", "report.json"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "name a file by -o, or a map by --map"),
        (("--scale", "8"), "name a file by -o, or a map by --map"),
        (("-o", "a.csv", "--scale", "8"), "no --map is asked for"),
        (("--map", "map.jpg"), ".png, .pdf, .svg"),
        (("--map", "none/map.png"), "there is no folder"),
        (("--map", "map.png", "--scale", "0"), "0.5"),
    ],
)
def test_what_makes_no_map_is_wrong_usage(
    arguments: tuple[str, ...], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("export", *arguments)
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.replace("│", " ").split())


@pytest.mark.parametrize("option", ["--map", "--profile"])
def test_fuse_refuses_another_suffix_before_it_works(tmp_path: Path, option: str) -> None:
    result = run(
        "fuse", tmp_path / "none.csv", "--roads", tmp_path / "none.osm", option, tmp_path / "map.bmp"
    )
    assert result.exit_code == 2
    assert ".png, .pdf, .svg" in " ".join(result.stderr.replace("│", " ").split())


def test_a_map_of_logs_leaves_out_what_is_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = write_all(tmp_path, 1, seed=1, duration_s=60.0)
    path = tmp_path / "map.svg"
    fuse = (
        "fuse",
        *bundle.drives,
        "--roads",
        bundle.osm,
        "--method",
        "raw",
        "-o",
        tmp_path / "o.csv",
        "--map",
        path,
    )
    assert run(*fuse, "--scale", "8").exit_code == 0
    text = path.read_text()
    assert "slope unknown" in text
    assert "8 % on, as asked." in text.replace("\n", " ")
    monkeypatch.setattr(slope_map, "MOST_SEGMENTS", 5)
    assert run(*fuse).exit_code == 0
    assert "Undriven roads are left out" in path.read_text()
    assert "slope unknown" not in path.read_text()


def test_a_profile_is_what_its_suffix_says(tmp_path: Path) -> None:
    bundle = write_all(tmp_path, 1, seed=1, duration_s=60.0)
    for suffix, head in ((".pdf", b"%PDF"), (".svg", b"<?xml"), (".PNG", b"\x89PNG")):
        path = tmp_path / f"profile{suffix}"
        fuse = ("fuse", *bundle.drives, "--roads", bundle.osm, "--method", "raw", "-o", tmp_path / "o.csv")
        assert run(*fuse, "--profile", path).exit_code == 0
        assert path.read_bytes().startswith(head)
    assert "Heights: mean sea level as the receivers logged it." in (tmp_path / "profile.svg").read_text()
