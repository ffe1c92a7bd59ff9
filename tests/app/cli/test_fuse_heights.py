"""``versant fuse``: heights and what they refer to, surveyed heights, and one drive in two logs."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from app.exports.formats import SEGMENT_FORMATS
from fusion.formats import read_log
from fusion.report import with_duplicate
from fusion.simulate.demonstration import Demonstration, write_all
from fusion.terrain.datum import MEAN_SEA_LEVEL

runner = CliRunner()
FAST = ("--method", "raw")  # where what is tested is the command, not the estimator


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("town"), 1, seed=1, duration_s=60.0)


def run(*arguments: str | Path) -> Result:
    return runner.invoke(app, [str(a) for a in arguments])


def features(path: Path) -> dict[tuple[int, int, int], dict[str, object]]:
    read = [f["properties"] for f in json.loads(path.read_text())["features"]]
    return {(p["osm_way_id"], p["from_node"], p["to_node"]): p for p in read}


def test_a_drive_in_two_formats_counts_once(bundle: Demonstration, tmp_path: Path) -> None:
    """The same drive with fewer columns and digits: it changes nothing, and whoever gave it is told."""
    log = read_log(bundle.drives[0])
    poor, out, report = tmp_path / "poor.csv", tmp_path / "out.geojson", tmp_path / "report.json"
    columns = (log.fix.time_s, log.fix.lat_deg, log.fix.lon_deg, log.fix.alt_msl_m)
    rows = zip(*(c.tolist() for c in columns), strict=True)
    body = "".join(f"{t:.2f},{lat:.5f},{lon:.5f},{alt:.0f}\n" for t, lat, lon, alt in rows)
    poor.write_text("time_s,lat_deg,lon_deg,alt_msl_m\n" + body)
    said = []
    for method in ("profile", "raw"):
        fuse = ("fuse", "--roads", bundle.osm, "--method", method, "-o", out, "--json", report)
        assert run(*fuse, bundle.drives[0]).exit_code == 0
        alone = features(out)
        for logs in ((bundle.drives[0], poor), (poor, bundle.drives[0])):
            both = run(*fuse, *logs)
            assert both.exit_code == 0, both.stderr
            assert {key: p["slope_percent"] for key, p in features(out).items()} == {
                key: p["slope_percent"] for key, p in alone.items()
            }
            assert {p["drives"] for p in features(out).values()} == {1}
            (again,) = (one for one in json.loads(report.read_text())["logs"] if one["file"] == str(poor))
            said.append(again["report"]["warnings"][-1])
            assert f"{poor}: {said[-1]}" in both.stderr
    assert said == with_duplicate([], str(bundle.drives[0])) * 4


def test_surveyed_heights_bring_their_datum(bundle: Demonstration, tmp_path: Path) -> None:
    """A point 48 m above the drive, as an ellipsoid is, lifts every height that the drive reaches, and no slope."""
    out, points, report = tmp_path / "out.geojson", tmp_path / "points.csv", tmp_path / "report.json"
    fuse = (
        "fuse",
        bundle.drives[0],
        "--roads",
        bundle.osm,
        "--method",
        "profile",
        "-o",
        out,
        "--json",
        report,
    )
    assert run(*fuse).exit_code == 0
    document = json.loads(out.read_text())
    assert document["height_datum"] == MEAN_SEA_LEVEL
    before = features(out)
    driven = max(document["features"], key=lambda f: f["properties"]["observations"])
    (lon0, lat0), (lon1, lat1) = driven["geometry"]["coordinates"]
    middle = f"{0.5 * (lat0 + lat1)},{0.5 * (lon0 + lon1)}"
    height = 0.5 * (driven["properties"]["height_from_m"] + driven["properties"]["height_to_m"])
    points.write_text(f"lat_deg,lon_deg,height_m\n{middle},{height + 48:.3f}\n10,10,5\n")
    surveyed = run(*fuse, "--control", points)
    assert surveyed.exit_code == 0, surveyed.stderr
    far = "Control point line 3 of points.csv lies more than 20 m from the roads around the drives."
    assert far in surveyed.stderr
    figures = json.loads(report.read_text())
    assert figures["remarks"] == [far]
    assert figures["height_datum"] == json.loads(out.read_text())["height_datum"]
    assert figures["height_datum"].startswith("the datum of the control points")
    for key, after in features(out).items():
        assert after["height_from_m"] - before[key]["height_from_m"] == pytest.approx(48, abs=0.5)
        assert after["height_sigma_m"] < 0.5 * before[key]["height_sigma_m"]
        change = after["slope_percent"] - before[key]["slope_percent"]
        assert abs(change) < 0.01 * after["slope_sigma_percent"] + 1e-4


def test_a_file_of_surveyed_heights_that_cannot_be_used_stops_everything(
    bundle: Demonstration, tmp_path: Path
) -> None:
    points = tmp_path / "points.csv"
    points.write_text("lat_deg,lon_deg,height_m\n49,8.5,high\n")
    result = run("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST, "--control", points)
    assert result.exit_code == 1
    assert result.stderr == "versant: Line 2 of points.csv: height_m is 'high', which is no number.\n"


@pytest.mark.parametrize("suffix", [output.suffixes[0] for output in SEGMENT_FORMATS.values()])
def test_heights_are_in_every_output(bundle: Demonstration, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"slopes{suffix}"
    assert run("fuse", bundle.drives[0], "--roads", bundle.osm, "-o", out).exit_code == 0
    if suffix == ".csv":
        table = pd.read_csv(out)
    elif suffix == ".parquet":
        table = pd.read_parquet(out)
    else:
        table = geopandas.read_file(out, layer="segments" if suffix == ".gpkg" else None)
    of_network = ["height_from_m", "height_to_m", "height_sigma_m", "steepest_percent", "driven_share"]
    assert table[of_network].notna().all().all()
    assert table.driven_share.between(0, 1).all()
    assert (table.steepest_to_m - table.steepest_from_m <= 20.001).all()
    level = table.set_index(["from_node"]).height_from_m.groupby(level=0)
    assert (level.nunique() == 1).all(), "segments that meet share their node's height"


def test_slope_only_methods_know_no_heights(bundle: Demonstration, tmp_path: Path) -> None:
    out = tmp_path / "out.geojson"
    assert run("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST, "-o", out).exit_code == 0
    assert "height_datum" not in json.loads(out.read_text())
    for properties in features(out).values():
        assert (
            properties["height_from_m"]
            is properties["steepest_percent"]
            is properties["driven_share"]
            is None
        )
