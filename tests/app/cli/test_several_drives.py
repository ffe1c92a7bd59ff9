"""A zip or a folder of several drives: a line for each, what is unclear is said, and options decide it."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from fusion.formats import sort_files
from fusion.formats.grouping import Rule, Unclear, Why
from fusion.simulate.demonstration import Demonstration, write_all

T0 = 1_600_000_000


def ride(began_s: int, rows: int = 40, lat: float = 49.0) -> str:
    lines = (f"{T0 + began_s + k},{lat + 1e-4 * k:.5f},8.4" for k in range(rows))
    return "time_s,lat_deg,lon_deg\n" + "\n".join(lines) + "\n"


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


@pytest.fixture
def rides(tmp_path: Path) -> Path:
    """A zip of three rides, the first in two parts, and of files that are none."""
    path = tmp_path / "rides.zip"
    files = {
        "a.csv": ride(0),
        "b.csv": ride(41, lat=49.004),
        "later.csv": ride(90_000),
        "last.csv": ride(180_000),
        "notes.txt": "hello there",
        "empty.gpx": "<gpx><trk/></gpx>",
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def test_upload_tells_of_each_drive_in_a_zip_and_of_each_file_in_none(
    web: Any, rides: Path, tmp_path: Path
) -> None:
    figures = tmp_path / "figures.json"
    result = run("upload", rides, "--server", web.base, "--json", figures)
    rows = json.loads(figures.read_text())["uploads"]
    drives = {drive["id"]: drive["filename"] for drive in web.client.get("/v1/drives").json()["drives"]}
    assert sorted(drives.values()) == ["a.csv, b.csv", "last.csv", "later.csv"]
    assert [(row["file"].removeprefix(f"{rides}: "), row["status"]) for row in rows] == [
        ("a.csv, b.csv", "queued"),
        ("later.csv", "queued"),
        ("last.csv", "queued"),
        ("notes.txt", "left out"),
        ("empty.gpx", "left out"),
    ]
    assert [drives[row["drive"]] for row in rows[:3]] == ["a.csv, b.csv", "later.csv", "last.csv"]
    assert "holds no track" in rows[4]["reason"]
    assert "a.csv, b.csv go on where the one before ended" in result.stderr
    assert "empty.gpx was left out. This GPX file holds no track" in result.stderr
    assert result.exit_code == 1  # a log came to nothing
    assert run("upload", rides, "--server", web.base, "--apart").exit_code == 1
    assert run("upload", rides, "--server", web.base, "--together").exit_code == 0
    assert len(web.client.get("/v1/drives").json()["drives"]) == 3 + 2 + 1
    both = run("upload", rides, "--together", "--apart", "--server", web.base)
    assert both.exit_code == 2


def test_files_are_sorted_as_the_service_sorts_them(rides: Path) -> None:
    found = sort_files([rides])
    names = [[found.files[k].name for k in drive] for drive in found.grouping.drives]
    assert names == [["a.csv", "b.csv"], ["later.csv"], ["last.csv"]]
    assert found.grouping.unclear == (Unclear((0, 1), Why.CONTINUES),)
    assert [name for name, _ in found.left_out] == ["notes.txt", "empty.gpx"]
    assert len(sort_files([rides], rule=Rule.APART).grouping.drives) == 4
    again = sort_files([rides, rides])
    assert len(again.grouping.drives) == 3
    assert dict(again.left_out)["a.csv"] == "It holds the same as a.csv, and counts once."


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("town"), 2, seed=1, duration_s=60.0)


def slopes(result: Result) -> list[tuple[int, float]]:
    properties = [one["properties"] for one in json.loads(result.stdout)["features"]]
    return [(one["osm_way_id"], one["slope_percent"]) for one in properties]


def test_fuse_and_track_take_the_drives_of_a_zip_one_by_one(bundle: Demonstration, tmp_path: Path) -> None:
    zipped, out = tmp_path / "rides.zip", tmp_path / "figures.json"
    with zipfile.ZipFile(zipped, "w") as archive:
        for path in bundle.drives:
            archive.write(path, path.name)
    fuse = ("fuse", "--roads", bundle.osm, "--method", "raw", "--json", out)
    result = run(*fuse, zipped)
    assert result.exit_code == 0, result.stderr
    assert f"{zipped}: 2 drives." in result.stderr
    logs = json.loads(out.read_text())["logs"]
    assert [log["file"] for log in logs] == [f"{zipped}: {path.name}" for path in bundle.drives]
    assert slopes(result) == slopes(run(*fuse, *bundle.drives))
    repeated = run(*fuse, zipped, bundle.drives[0])
    assert "the same bytes as" in repeated.stderr
    track = run("track", zipped, "-o", tmp_path / "track.csv")
    assert "from 2 of 2 logs" in track.stdout
    assert run("track", zipped, "-o", tmp_path / "track.csv", "--together", "--apart").exit_code == 2
