"""``versant settle``, ``versant repeats``, and gaps in what ``export`` and ``fuse`` write."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import text
from typer.testing import CliRunner, Result

from app.cli import app
from app.core.db import Sessions, make_engine, session_factory
from app.drives.publishing import SETTLE_AFTER_S
from app.network import extracts as road_store
from app.network.settle import settle_due
from fusion.simulate.demonstration import write_all
from fusion.simulate.scene.town import Town
from network_support import assert_same, drive_over, rows_of
from road_support import replace_roads

runner = CliRunner()


@pytest.fixture
def sessions(database_url: str, monkeypatch: pytest.MonkeyPatch, town: Town) -> Iterator[Sessions]:
    """A database that the commands find, with the town's roads and a drive around gaps."""
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    engine = make_engine(database_url)
    factory = session_factory(engine)
    with factory.begin() as session:
        replace_roads(session, town.roads, "town.osm", "0" * 64)
        table, ids = road_store.all_roads(session)
    drive_over(factory, table, ids, {row: (2.0, 0.5) for row in range(0, 60) if row % 4})
    yield factory
    engine.dispose()


def run(*arguments: str | Path) -> Result:
    result = runner.invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.stderr
    return result


def test_rebuild_makes_the_network_from_its_passes(sessions: Sessions, tmp_path: Path) -> None:
    before = rows_of(sessions)
    with sessions.begin() as session:
        for relation in ("network_slopes", "segment_slopes"):
            session.execute(text(f"DELETE FROM {relation}"))
    result = run("settle", "--json", tmp_path / "figures.json")
    assert_same(before, rows_of(sessions))
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["segments"] > 0
    assert f"{figures['segments']} segments of the network" in result.stdout


def test_workers_settle_it_side_by_side(sessions: Sessions, tmp_path: Path) -> None:
    """Each cell once, however often it was asked for."""
    before = rows_of(sessions)
    with sessions.begin() as session:
        for relation in ("network_slopes", "segment_slopes"):
            session.execute(text(f"DELETE FROM {relation}"))
    for _ in range(2):
        result = run("settle", "--by-workers", "--json", tmp_path / "figures.json")
    cells = json.loads((tmp_path / "figures.json").read_text())["cells"]
    assert f"{cells} cells wait for the workers." in result.stdout
    assert rows_of(sessions) == {}

    def lane(_: int) -> int:
        settled = 0
        while settle_due(sessions, SETTLE_AFTER_S):
            settled += 1
        return settled

    with ThreadPoolExecutor(3) as lanes:
        assert sum(lanes.map(lane, range(3))) == cells > 1
    assert_same(before, rows_of(sessions))


def test_repeats_are_shown_learned_and_reset(sessions: Sessions, tmp_path: Path) -> None:
    assert "No segment has been driven twice yet." in run("repeats", "show").stdout
    with sessions() as session:
        table, ids = road_store.all_roads(session)
    for day in range(1, 4):
        drive_over(sessions, table, ids, {0: (2.0 + day, 0.5), 1: (2.0, 0.5)}, 1.7e9 + 86_400.0 * day)
    with sessions.begin() as session:
        report = json.dumps({"format": "ubx", "sensors": {"barometer": {}}})
        session.execute(text("UPDATE drives SET report = CAST(:report AS jsonb)"), {"report": report})
    assert "class      barometer, ubx" in run("repeats", "show", "--json", tmp_path / "shown.json").stdout
    assert json.loads((tmp_path / "shown.json").read_text())["repeats"][0]["group"] == "all"
    for command in ("learn", "reset"):
        result = run("repeats", command, "--json", tmp_path / "classes.json")
        assert "all taken at their word" in result.stdout
        [one] = json.loads((tmp_path / "classes.json").read_text())["classes"]
        assert (one["name"], one["applied"], one["marking"]) == ("barometer, ubx", 1.0, False)


def test_export_writes_gaps_on_demand(sessions: Sessions, tmp_path: Path) -> None:
    gaps = sum(not row[2] for row in rows_of(sessions).values())
    assert gaps > 0

    def slopes(*flags: str) -> list[dict[str, str]]:
        run("export", "-o", tmp_path / "map.csv", *flags)
        with (tmp_path / "map.csv").open(newline="") as file:
            return [row for row in csv.DictReader(file) if row["slope_percent"]]

    plain, asked, driven = slopes(), slopes("--gaps"), slopes("--gaps", "--driven")
    assert [row["drives"] for row in plain] == ["1"] * len(plain)
    assert len(asked) == len(plain) + gaps
    assert sum(row["drives"] == row["observations"] == "0" for row in asked) == gaps
    assert driven == plain


def test_fuse_says_where_a_log_was_rejected(tmp_path: Path) -> None:
    bundle = write_all(tmp_path, 1, seed=1, duration_s=60.0)
    report = tmp_path / "report.json"
    bad = tmp_path / "bad.csv"
    bad.write_text("nonsense")
    outputs = ("--json", report, "-o", tmp_path / "o.csv")
    arguments = [str(a) for a in ("fuse", bad, *bundle.drives, "--roads", bundle.osm, *outputs)]
    result = runner.invoke(app, arguments)
    assert result.exit_code == 1
    logs = json.loads(report.read_text())["logs"]
    assert [log.get("rejected_segments") for log in logs] == [None, 0]


@pytest.mark.slow
def test_fuse_writes_gaps_on_demand(tmp_path: Path) -> None:
    bundle = write_all(tmp_path, 2, seed=1, duration_s=150.0)

    def drives(*flags: str) -> list[int]:
        out = tmp_path / "out.geojson"
        run("fuse", *bundle.drives, "--roads", bundle.osm, "--method", "profile", "-o", out, *flags)
        return [f["properties"]["drives"] for f in json.loads(out.read_text())["features"]]

    plain, asked = drives(), drives("--gaps")
    assert min(plain) == 1
    assert [count for count in asked if count] == plain
    assert asked.count(0) > 0


@pytest.mark.slow
@pytest.mark.parametrize("method", ["profile", "raw"])
def test_order_of_logs_changes_nothing(tmp_path: Path, method: str) -> None:
    bundle = write_all(tmp_path, 3, seed=1, duration_s=60.0)
    found = []
    for logs in (bundle.drives, bundle.drives[::-1]):
        out = tmp_path / "out.geojson"
        run(
            "fuse", *logs, "--roads", bundle.osm, "--dem", bundle.dem, "--method", method, "-o", out, "--gaps"
        )
        features = json.loads(out.read_text())["features"]
        found.append([{k: v for k, v in f["properties"].items() if k != "updated_at"} for f in features])
    assert found[0] == found[1]
