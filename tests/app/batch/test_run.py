"""``versant batch`` gives the numbers of ``versant fuse``, whoever works on it and however often it is cut off."""

from __future__ import annotations

import hashlib
import json
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from altimeter_support import altimeter_gpx
from app.batch.folder import BatchFolder
from app.batch.hands import Hands, hands
from app.batch.run import Done, Request, run
from app.batch.solving import StoredEvidence
from app.cli import app
from app.cli.logs.fusing import Fusion
from app.cli.logs.named import LogFiles
from fusion.network.segment_slopes import Adjustment
from fusion.pipeline import parse_options
from fusion.results import Solution
from fusion.roads.osm import read_roads
from fusion.simulate.demonstration import Demonstration, write_all
from fusion.terrain.dem import Dem
from fusion.types import Progress, no_progress

OPTIONS = parse_options("profile")
BROKEN = "time_s,speed_mps\n1,2\n"


class Unseen:
    """Nobody looks."""

    def work(self, name: str) -> Progress:
        return no_progress

    def count(self, name: str, total: int) -> Callable[[int], None]:
        return lambda more: None


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    """A town, and below ``logs`` mixed formats: plain, in a zip, twice, as a part of another, and broken."""
    town = write_all(tmp_path_factory.mktemp("town"), 4, seed=1, duration_s=60.0)
    folder = town.osm.parent / "logs"
    folder.mkdir()
    for path in town.drives[:3]:
        shutil.copy(path, folder)
    with zipfile.ZipFile(folder / "bundle.zip", "w") as bundle:
        bundle.write(town.drives[3], town.drives[3].name)
    (folder / "again.csv").write_bytes(town.drives[0].read_bytes())
    lines = town.drives[0].read_text().splitlines(keepends=True)
    (folder / "shorter.csv").write_text("".join(lines[:-5]))
    (folder / "broken.csv").write_text(BROKEN)
    (folder / "altimeter.gpx").write_text(altimeter_gpx(town.simulated[1], 4.0))
    return town


@pytest.fixture(scope="module")
def two() -> Iterator[Hands]:
    with hands(None, 2, "2GB") as found:
        yield found


def request(town: Demonstration, **more: Any) -> Request:
    asked: dict[str, Any] = {
        "logs": (str(town.osm.parent / "logs"),),
        "roads": town.osm,
        "rasters": (town.dem,),
        "method": "profile",
        "options": OPTIONS.model_dump(mode="json"),
        "control": None,
        "gaps": True,
        "formats": ("geoparquet", "csv", "pmtiles"),
    }
    return Request(**asked | more)


@pytest.fixture(scope="module")
def done(town: Demonstration, two: Hands) -> tuple[Done, Path]:
    folder = town.osm.parent / "out"
    return run(request(town), BatchFolder(folder), two, Unseen()), folder


def fused(town: Demonstration) -> Solution:
    """The same logs by what ``versant fuse`` does."""
    with Dem.open([town.dem], trusted=True) as dem:
        fusion = Fusion("profile", OPTIONS, read_roads(town.osm), dem)
        for path in sorted((town.osm.parent / "logs").iterdir()):
            if path.name not in ("broken.csv", town.drives[0].name):
                fusion.add(LogFiles((path,)))
        assert any(one.result.late_by is not None for one in fusion.fused), "an altimeter, made anew"
        return fusion.solve(gaps=True).solution


def bytes_of(folder: Path) -> dict[str, str]:
    """Digests of all that is in a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.slow
def test_it_gives_the_numbers_of_fuse(town: Demonstration, done: tuple[Done, Path]) -> None:
    wanted, found = fused(town), done[0].solution
    assert found is not None
    assert np.array_equal(found.roads.osm_way_id, wanted.roads.osm_way_id)
    assert np.array_equal(found.roads.from_node, wanted.roads.from_node)
    sigma = np.array([one.slope_sigma_percent for one in wanted.slopes])
    for name in ("slope_percent", "slope_sigma_percent"):
        one, other = (np.array([getattr(s, name) for s in w.slopes]) for w in (found, wanted))
        assert np.max(np.abs(one - other) / sigma) < 1e-6, name
    for name in ("height_from_m", "height_to_m", "steepest_percent", "driven_share"):
        one, other = (np.array([getattr(s, name) for s in w.slopes], float) for w in (found, wanted))
        np.testing.assert_allclose(one, other, atol=1e-6, err_msg=name)
    assert [s.drives for s in found.slopes] == [s.drives for s in wanted.slopes]
    assert (found.rejected, found.duplicates, found.height_datum) == (
        wanted.rejected, wanted.duplicates, wanted.height_datum,
    )  # fmt: skip


@pytest.mark.slow
def test_every_log_has_a_line_in_the_report(town: Demonstration, done: tuple[Done, Path]) -> None:
    rows = {Path(row["log"]).name: row for row in pq.read_table(done[1] / "report.parquet").to_pylist()}
    first, second, third = (path.name for path in town.drives[:3])
    assert {name: row["status"] for name, row in rows.items()} == {
        "again.csv": "done", first: "repeated", second: "done", third: "done", "bundle.zip": "done",
        "shorter.csv": "done", "broken.csv": "failed", "altimeter.gpx": "done",
    }  # fmt: skip
    assert "lacks required columns" in rows["broken.csv"]["reason"]
    assert rows[first]["reason"].endswith("again.csv")
    assert rows["shorter.csv"]["duplicate_of"].endswith("again.csv")
    assert any("duplicate" in said for said in rows["shorter.csv"]["warnings"])
    assert json.loads(rows[second]["report"])["segments_estimated"] == rows[second]["segments"] > 3


@pytest.mark.slow
def test_one_worker_makes_the_same_bytes(
    town: Demonstration, done: tuple[Done, Path], tmp_path: Path
) -> None:
    with hands(None, 1, "2GB") as one:
        run(request(town), BatchFolder(tmp_path), one, Unseen())
    assert bytes_of(tmp_path) == bytes_of(done[1])


@pytest.mark.slow
def test_it_goes_on_where_it_was_cut_off(
    town: Demonstration, done: tuple[Done, Path], two: Hands, tmp_path: Path
) -> None:
    """What is there is not made again; what is half there, of other inputs or of a dead command is made or removed."""
    folder = tmp_path / "out"
    shutil.copytree(done[1], folder)
    drives = sorted((folder / "drives").iterdir())
    drives[0].unlink()
    (folder / "report.parquet").unlink()
    (folder / "scratch").mkdir()
    (folder / "passes" / "place=0-0-0").mkdir()
    (folder / "passes" / "place=0-0-0" / "former.parquet").write_text("of former logs")
    kept = [*drives[1:], *(folder / "located").iterdir(), *(folder / "roads").rglob("*.parquet")]
    before = [path.stat().st_mtime_ns for path in kept]
    run(request(town), BatchFolder(folder), two, Unseen())
    assert bytes_of(folder) == bytes_of(done[1])
    assert [path.stat().st_mtime_ns for path in kept] == before


@pytest.mark.slow
def test_its_network_goes_on_after_the_last_step(
    town: Demonstration, done: tuple[Done, Path], two: Hands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut off in each solution once, it has done no more of them than one that went through, but for these."""
    solve, solutions = StoredEvidence.adjusted, list[bool]()

    def cut_off(*given: Any) -> Adjustment:
        solutions.append(len(solutions) % 2 == 0)
        if solutions[-1]:
            raise InterruptedError
        return solve(*given)

    monkeypatch.setattr(StoredEvidence, "adjusted", cut_off)
    folder = BatchFolder(tmp_path)
    while not folder.manifest.exists():
        with suppress(InterruptedError):
            run(request(town), folder, two, Unseen())
    steps = len(solutions)
    assert bytes_of(tmp_path) == bytes_of(done[1])

    def counted(*given: Any) -> Adjustment:
        solutions.append(False)
        return solve(*given)

    solutions.clear()
    monkeypatch.setattr(StoredEvidence, "adjusted", counted)
    run(request(town), BatchFolder(tmp_path / "through"), two, Unseen())
    assert len(solutions) > 1, "an altimeter that is late"
    assert steps == 2 * len(solutions)


@pytest.mark.slow
def test_other_inputs_make_what_depends_on_them_anew(town: Demonstration, two: Hands, tmp_path: Path) -> None:
    logs, folder = tmp_path / "logs", BatchFolder(tmp_path / "out")
    logs.mkdir()
    for path in town.drives[:2]:
        shutil.copy(path, logs)
    asked = request(
        town, logs=(str(logs),), method="raw", options=parse_options("raw").model_dump(mode="json")
    )
    assert len(run(asked, folder, two, Unseen()).outcomes) == 2
    (logs / town.drives[0].name).write_text(BROKEN)
    shutil.copy(town.drives[2], logs)
    again = run(asked, folder, two, Unseen())
    assert [one.status for one in again.outcomes] == ["failed", "done", "done"]
    run(asked, BatchFolder(tmp_path / "fresh"), two, Unseen())
    assert bytes_of(folder.path) == bytes_of(tmp_path / "fresh")


def invoke(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["batch", *map(str, arguments)])


@pytest.mark.slow
def test_the_command_says_what_came_of_it(
    town: Demonstration, done: tuple[Done, Path], tmp_path: Path
) -> None:
    report = tmp_path / "figures.json"
    result = invoke(
        town.osm.parent / "logs", "--roads", town.osm, "--dem", town.dem, "-o", done[1], "--processes", 1,
        "--gaps", "--formats", "geoparquet,csv,pmtiles", "--json", report,
    )  # fmt: skip
    assert result.exit_code == 1, "one log failed"
    assert "broken.csv: This CSV lacks" in result.stderr
    figures = json.loads(report.read_text())
    assert (figures["logs"], figures["done"], figures["repeated"], figures["failed"]) == (8, 6, 1, 1)
    assert figures["duplicates"] == 1
    assert (done[1] / "slopes.csv").read_text().count("\n") == figures["segments"] + 1


@pytest.mark.slow
def test_nothing_but_broken_logs_is_reported_too(town: Demonstration, two: Hands, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(BROKEN)
    asked = request(town, logs=(str(tmp_path / "a.csv"),))
    found = run(asked, BatchFolder(tmp_path / "out"), two, Unseen())
    assert found.solution is None
    assert pq.read_table(tmp_path / "out" / "report.parquet")["status"].to_pylist() == ["failed"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--formats", "nonsense"],
        ["--method", "nonsense"],
        ["--scheduler", "tcp://127.0.0.1:1", "--processes", "2"],
    ],
    ids=" ".join,
)
def test_wrong_usage_is_said_before_the_work(tmp_path: Path, arguments: Sequence[str]) -> None:
    result = invoke(tmp_path, "--roads", tmp_path / "r.osm", "-o", tmp_path / "out", *arguments)
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()


def test_one_command_at_a_time(tmp_path: Path) -> None:
    with BatchFolder(tmp_path).held():
        result = invoke(tmp_path, "--roads", tmp_path / "r.osm", "-o", tmp_path)
    assert result.exit_code == 1
    assert "Another command is at work" in result.stderr
