"""``versant elevation``, and what ``import-dem`` says of rasters that lie under no road."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.core.db import Sessions
from fusion.roads.table import RoadTable
from road_support import replace_roads

runner = CliRunner()


def raster(path: Path, west: float) -> Path:
    with rasterio.open(
        path, "w", driver="GTiff", width=40, height=24, count=1, dtype="float32", crs="EPSG:4326",
        transform=Affine(1 / 1200, 0, west, 0, -1 / 1200, 49.01), nodata=-9999,
    ) as dataset:  # fmt: skip
        dataset.write(np.full((24, 40), 100, np.float32), 1)
    return path


@pytest.fixture
def service(
    sessions: Sessions, database_url: str, chain: Callable[..., RoadTable], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Sessions:  # fmt: skip
    """Ten segments at 8.5 E that the commands find, the first of them measured."""
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path / "data"))
    with sessions.begin() as session:
        replace_roads(session, chain(), "x", "0" * 64)
        session.execute(text("INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, "
                             "observations) SELECT min(id), 1, 1, 1, 1 FROM segments"))  # fmt: skip
    return sessions


def run(*arguments: str | Path, status: int = 0) -> str:
    done = runner.invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == status, done.output
    return done.output


def test_rasters_are_listed_ranked_and_removed(
    service: Sessions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = tmp_path / "figures.json"
    near, far = raster(tmp_path / "near.tif", 8.495), raster(tmp_path / "far.tif", 20.0)
    assert "Warning" not in run("import-dem", near)
    said = run("import-dem", far, "--priority", "2", "--json", figures)
    assert "Warning: no road that is imported lies under far.tif." in said
    assert json.loads(figures.read_text())["without_roads"] == ["far.tif"]

    out = tmp_path / "out.geojson"
    for place, credited in (
        ((), "near.tif"),
        (("--driven",), "near.tif"),
        (("--bbox", "8.0,48,8.1,49.9"), None),
    ):
        run("export", "-o", out, *place)
        said = json.loads(out.read_text())["attribution"]
        assert said.endswith(f"elevation from {credited}") if credited else "elevation" not in said

    table = run("elevation", "list", "--json", figures)
    assert [line.split()[0] for line in table.splitlines()[1:]] == ["far.tif", "near.tif"]
    rows = {row["name"]: row for row in json.loads(figures.read_text())["rasters"]}
    assert (rows["near.tif"]["segments"], rows["far.tif"]["segments"]) == (10, 0)
    assert (rows["near.tif"]["priority"], rows["far.tif"]["priority"]) == (0, 2)
    assert rows["near.tif"]["bounds_deg"] == pytest.approx([8.495, 48.99, 8.52833, 49.01], abs=1e-4)
    assert rows["near.tif"]["posting_m"] == pytest.approx(92.7, abs=0.1)

    assert "near.tif has priority -1." in run("elevation", "priority", "near.tif", "-1", "--json", figures)
    assert json.loads(figures.read_text())["priorities"] == {"near.tif": -1, "far.tif": 2}
    assert "There are: near.tif, far.tif." in run("elevation", "priority", "none.tif", "1", status=1)

    said = run("elevation", "remove", "near.tif", "--dry-run", "--json", figures)
    assert (
        "Under near.tif lie 10 segments, 1 of them measured, and 0 drives. 1 measured segments lie under no"
        in said
    )
    assert json.loads(figures.read_text())["bare"] == 1
    assert "Nothing is removed: 1 measured segments" in run("elevation", "remove", "near.tif", status=1)
    assert "near.tif" in run("elevation", "list")
    assert "Removed: far.tif." in run("elevation", "remove", "far.tif")
    assert "Removed: near.tif." in run("elevation", "remove", "NEAR.tif", "--yes")
    assert len(run("elevation", "list").splitlines()) == 1

    kept = tmp_path / "data" / "dem"
    for path in kept.rglob("*.tif"):
        os.utime(path, (0, 0))
    with service.begin() as session:
        session.execute(text("UPDATE dem_versions SET imported_at = imported_at - interval '8 days'"))
    monkeypatch.setenv("VERSANT_DEM_URL", str(kept))
    assert "near.tif" not in run("sweep"), "another service may use rasters that are kept for themselves"
    assert len(list(kept.rglob("*.tif"))) == 2
    monkeypatch.delenv("VERSANT_DEM_URL")
    assert "near.tif: this elevation raster is in no use any more and removed." in run("sweep")
    assert list(kept.rglob("*.tif")) == []


@pytest.mark.usefixtures("service")
def test_a_raster_whose_file_is_lost_is_listed_and_said_so(tmp_path: Path) -> None:
    run("import-dem", raster(tmp_path / "near.tif", 8.495))
    (file,) = (tmp_path / "data" / "dem").glob("*/near.tif")
    file.unlink()
    said = run("elevation", "list")
    assert "versant: " in said
    assert "near.tif" in said.splitlines()[1]
    assert "Removed: near.tif." in run("elevation", "remove", "near.tif", "--yes")


@pytest.mark.parametrize(
    "command",
    [
        ["export", "-o", "out.geojson"], ["settle"], ["sweep"], ["elevation", "list"],
        ["elevation", "remove", "a.tif"], ["elevation", "priority", "a.tif", "1"], ["import-control", "points.csv"],
        ["doctor"], ["backup", "copy"],
    ],
    ids=lambda command: command[0],
)  # fmt: skip
def test_a_mistyped_folder_becomes_no_database(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.csv").write_text("lat_deg,lon_deg,height_m\n49,8.5,100\n")
    done = runner.invoke(app, [*command, "--data-dir", str(tmp_path / "typo")])
    assert done.exit_code == 1
    assert done.stderr.startswith(f"versant: There is no Versant database in {tmp_path / 'typo'}.")
    assert "versant up" in done.stderr
    assert "import-roads" in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["points.csv"]
