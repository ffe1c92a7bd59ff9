"""``versant fuse``, ``track``, ``simulate`` and ``methods``: everything that needs no service."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import rasterio
from affine import Affine
from PIL import Image
from typer.testing import CliRunner, Result

import fusion
from app.cli import app
from app.exports.formats import SEGMENT_FORMATS
from app.map.segment import PROPERTIES
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.formats import FORMATS, read_log
from fusion.simulate.demonstration import Demonstration, write_all
from fusion.terrain.windows import WINDOWS

runner = CliRunner()
FAST = ("--method", "raw")  # what is tested here is the command, not the estimator


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("town"), 3, seed=1, duration_s=60.0)


def run(*arguments: str | Path) -> Result:
    return runner.invoke(app, [str(a) for a in arguments])


def features(path: Path) -> dict[tuple[int, int, int], dict[str, object]]:
    read = [f["properties"] for f in json.loads(path.read_text())["features"]]
    return {(p["osm_way_id"], p["from_node"], p["to_node"]): p for p in read}


def test_without_an_output_file_geojson_goes_to_standard_output(bundle: Demonstration) -> None:
    result = run("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST)
    assert result.exit_code == 0, result.stderr
    document = json.loads(result.stdout)
    assert document["type"] == "FeatureCollection"
    assert "OpenStreetMap" in document["attribution"]
    assert len(document["features"]) > 3


def test_one_dem_option_takes_several_rasters(bundle: Demonstration, tmp_path: Path) -> None:
    copy = tmp_path / "again.tif"
    copy.write_bytes(bundle.dem.read_bytes())
    given = run("fuse", bundle.drives[0], "--roads", bundle.osm, "--method", "dem", "--dem", bundle.dem, copy)
    assert given.exit_code == 0, given.stderr
    assert len(json.loads(given.stdout)["features"]) > 3
    none = run("fuse", "--roads", bundle.osm, "--dem", bundle.dem, copy)
    assert none.exit_code == 2
    assert "no log is named" in none.stderr


@pytest.mark.parametrize("suffix", [output.suffixes[0] for output in SEGMENT_FORMATS.values()])
def test_suffix_chooses_the_output(bundle: Demonstration, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"slopes{suffix}"
    result = run("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert out.stat().st_size > 0
    assert not result.stdout


def test_order_of_logs_changes_nothing_and_a_repeated_log_counts_once(
    bundle: Demonstration, tmp_path: Path
) -> None:
    copy = tmp_path / "copy.csv"
    copy.write_bytes(bundle.drives[0].read_bytes())
    one, two = tmp_path / "one.geojson", tmp_path / "two.geojson"
    assert run("fuse", *bundle.drives, "--roads", bundle.osm, *FAST, "-o", one).exit_code == 0
    again = run("fuse", *reversed(bundle.drives), copy, "--roads", bundle.osm, *FAST, "-o", two)
    assert again.exit_code == 0
    assert "counted once" in again.stderr
    first, second = features(one), features(two)
    assert first
    for slopes in (first, second):
        for properties in slopes.values():
            del properties["updated_at"]
    assert first == second


def test_a_script_gets_the_same_numbers(bundle: Demonstration, tmp_path: Path) -> None:
    out = tmp_path / "out.geojson"
    fuse = ("fuse", *bundle.drives[:2], "--roads", bundle.osm, "--dem", bundle.dem, *FAST, "-o", out)
    assert run(*fuse).exit_code == 0
    roads = fusion.read_roads(bundle.osm)
    with fusion.Dem.open([bundle.dem]) as dem:
        drives = [fusion.run_drive(fusion.read_log(p), roads, dem, method="raw") for p in bundle.drives[:2]]
        frame = fusion.segments_frame(fusion.solve(drives, roads, dem))
    assert [*frame.columns][:-1] == [name for name in PROPERTIES if name not in {"id", "updated_at"}]
    written = features(out)
    assert len(frame) == len(written) > 3
    for _, row in frame.iterrows():
        properties = written[row.osm_way_id, row.from_node, row.to_node]
        for name in [*frame.columns][:-1]:
            value, expected = row[name], properties[name]
            if isinstance(expected, float):
                assert value == pytest.approx(expected, abs=1e-3), name
            else:
                assert (None if pd.isna(value) else value) == expected, name


def test_a_failing_log_is_reported_and_the_others_go_on(bundle: Demonstration, tmp_path: Path) -> None:
    bad, out, report = tmp_path / "bad.csv", tmp_path / "out.geojson", tmp_path / "report.json"
    bad.write_text("time_s,speed_mps\n1,2\n")
    arguments = (bad, tmp_path / "none.csv", bundle.drives[0], "--roads", bundle.osm, *FAST)
    result = run("fuse", *arguments, "-o", out, "--json", report)
    assert result.exit_code == 1
    complaints = [line for line in result.stderr.splitlines() if line.startswith("versant:")]
    assert len(complaints) == 2
    assert "bad.csv" in complaints[0]
    assert "lat_deg" in complaints[0]
    assert "none.csv" in complaints[1]
    assert features(out)
    logs = json.loads(report.read_text())["logs"]
    assert [log["status"] for log in logs] == ["failed", "failed", "done"]
    assert logs[2]["report"]["method"] == "raw"


def test_nothing_is_written_when_every_log_fails(bundle: Demonstration, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("time_s,speed_mps\n1,2\n")
    out = tmp_path / "out.geojson"
    assert run("fuse", tmp_path / "bad.csv", "--roads", bundle.osm, "-o", out).exit_code == 1
    assert not out.exists()


def test_terrain_is_stated_beside_the_measured_slope(bundle: Demonstration, tmp_path: Path) -> None:
    out = tmp_path / "out.geojson"
    with_dem = run("fuse", bundle.drives[0], "--roads", bundle.osm, "--dem", bundle.dem, *FAST, "-o", out)
    assert with_dem.exit_code == 0, with_dem.stderr
    assert any(p["dem_slope_percent"] is not None for p in features(out).values())
    assert run("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST, "-o", out).exit_code == 0
    assert all(p["dem_slope_percent"] is None for p in features(out).values())


@pytest.fixture
def aster(bundle: Demonstration, tmp_path: Path) -> tuple[Path, Path]:
    """The town's elevation raster and a quality layer, as a pair of ASTER files."""
    elevations, quality = (tmp_path / f"ASTGTM2_N48E008_{kind}.tif" for kind in ("dem", "num"))
    elevations.write_bytes(bundle.dem.read_bytes())
    with rasterio.open(elevations) as raster:
        profile = {**raster.profile, "dtype": "int16", "nodata": None, "driver": "GTiff"}
        with rasterio.open(quality, "w", **profile) as layer:
            layer.write(np.full(raster.shape, 5, np.int16), 1)
    return elevations, quality


def test_the_quality_layer_of_the_terrain_is_found_or_may_be_named(
    bundle: Demonstration, aster: tuple[Path, Path], tmp_path: Path
) -> None:
    elevations, quality = aster
    out = tmp_path / "out.geojson"
    fuse = ("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST, "-o", out)
    far = tmp_path / "far.tif"
    with rasterio.open(bundle.dem) as raster:
        east = Affine.translation(10.0, 0.0) @ raster.transform
        with rasterio.open(far, "w", **{**raster.profile, "transform": east}) as moved:
            moved.write(raster.read())
    for named in ((), ("--dem", quality), ("--dem", far)):  # a raster elsewhere is not credited
        result = run(*fuse, "--dem", elevations, *named)
        assert result.exit_code == 0, result.stderr
        assert json.loads(out.read_text())["attribution"].endswith(f"elevation from {elevations.name}")
    assert any(p["dem_slope_percent"] is not None for p in features(out).values())
    alone = run(*fuse, "--dem", quality)
    assert (alone.exit_code, "is a quality layer" in alone.stderr) == (1, True)
    quality.write_bytes(b"")
    spoilt = run(*fuse, "--dem", elevations)
    assert (spoilt.exit_code, f"{quality.name} is empty" in spoilt.stderr) == (1, True)


@pytest.mark.slow
def test_pictures_and_tracks_have_numbers_and_names_when_there_are_several(
    bundle: Demonstration, tmp_path: Path
) -> None:
    extra = ("--profile", tmp_path / "p.png", "--track", tmp_path / "t.geojson", "-o", tmp_path / "o.csv")
    assert run("fuse", bundle.drives[0], "--roads", bundle.osm, *FAST, *extra).exit_code == 0
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    path, *points = json.loads((tmp_path / "t.geojson").read_text())["features"]
    assert path["geometry"]["type"] == "MultiLineString"
    assert len(points) > 10
    assert run("fuse", *bundle.drives[:2], "--roads", bundle.osm, *FAST, *extra).exit_code == 0
    first, second = (path.stem for path in bundle.drives[:2])
    names = {f"p-1-{first}.png", f"p-2-{second}.png", f"t-1-{first}.geojson", f"t-2-{second}.geojson"}
    assert {path.name for path in tmp_path.iterdir()} == names | {
        "p.png",
        "t.geojson",
        "o.csv",
        "o.csv-metadata.json",
    }


def test_a_map_shows_all_roads_around_the_drives(bundle: Demonstration, tmp_path: Path) -> None:
    drawn = tmp_path / "map.png"
    arguments = ("fuse", *bundle.drives[:2], "--roads", bundle.osm, "--dem", bundle.dem, *FAST, "-o")
    result = run(*arguments, tmp_path / "o.csv", "--map", drawn)
    assert result.exit_code == 0, result.stderr
    assert f"{drawn}: map" in result.stderr
    with Image.open(drawn) as picture:
        assert len(picture.convert("RGB").getcolors(1_000_000) or []) > 50
    drawn.unlink()
    assert run(*arguments, tmp_path / "o.csv", "--map", tmp_path / "none" / "map.png").exit_code == 2


def test_track_repeats_what_the_receiver_logged(bundle: Demonstration, tmp_path: Path) -> None:
    out = tmp_path / "track.csv"
    result = run("track", bundle.drives[1], "-o", out)
    assert result.exit_code == 0, result.stderr
    log = read_log(bundle.drives[1])
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "time_s",
        "lat_deg",
        "lon_deg",
        "height_ell_m",
        "alt_msl_m",
        "h_acc_m",
        "v_acc_m",
    ]
    for name in rows[0]:
        written = np.array([float(row[name]) if row[name] else np.nan for row in rows])
        np.testing.assert_allclose(written, getattr(log.fix, name), rtol=0, atol=6e-4)
    degrees = np.array([float(row["lat_deg"]) for row in rows])
    np.testing.assert_allclose(degrees, log.fix.lat_deg, rtol=0, atol=1e-9)


def test_a_written_track_is_a_log_again(bundle: Demonstration, tmp_path: Path) -> None:
    out = tmp_path / "track.csv"
    assert run("track", bundle.drives[0], "-o", out).exit_code == 0
    again, log = read_log(out), read_log(bundle.drives[0])
    np.testing.assert_allclose(again.fix.lon_deg, log.fix.lon_deg, rtol=0, atol=1e-9)
    assert not again.warnings


def test_track_of_several_logs_names_them_and_keeps_going(bundle: Demonstration, tmp_path: Path) -> None:
    out = tmp_path / "track.geojson"
    result = run("track", bundle.drives[0], tmp_path / "none.csv", bundle.drives[2], "-o", out)
    assert result.exit_code == 1
    assert "none.csv" in result.stderr
    read = json.loads(out.read_text())["features"]
    names = {f["properties"]["log"] for f in read}
    assert names == {bundle.drives[0].name, bundle.drives[2].name}
    assert {f["geometry"]["type"] for f in read} == {"MultiLineString", "Point"}


def test_a_track_is_not_drawn_across_a_gap(tmp_path: Path) -> None:
    log, out = tmp_path / "gap.csv", tmp_path / "gap.geojson"
    times = [*range(10), *range(100, 110)]
    body = "".join(f"{1_700_000_000 + t},49.0,{8.4 + t * 1e-5:.6f}\n" for t in times)
    log.write_text("time_s,lat_deg,lon_deg\n" + body)
    assert run("track", log, "-o", out).exit_code == 0
    lines = json.loads(out.read_text())["features"][0]["geometry"]["coordinates"]
    assert [len(line) for line in lines] == [10, 10]


def test_simulated_files_depend_on_the_seed_alone(tmp_path: Path) -> None:
    arguments = ("--drives", "1", "--receiver", "phone", "--duration", "30")
    for folder, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        result = run("simulate", "-o", tmp_path / folder, "--seed", seed, *arguments)
        assert result.exit_code == 0, result.stderr
    for name in ("town.osm", "truth.csv", "drive_01.csv"):
        a, b, c = ((tmp_path / folder / name).read_bytes() for folder in "abc")
        assert a == b != c
    assert len(read_log(tmp_path / "a" / "drive_01.csv").fix) > 20


def test_methods_lists_every_registry(tmp_path: Path) -> None:
    report = tmp_path / "methods.json"
    result = run("methods", "--json", report)
    assert result.exit_code == 0, result.stderr
    figures = json.loads(report.read_text())
    for role, registry in (
        ("methods", METHODS),
        ("formats", FORMATS),
        ("windows", WINDOWS),
        ("positionings", POSITIONINGS),
    ):
        assert list(figures[role]) == list(registry)
        assert all(name in result.stdout for name in registry)
    for name, method in METHODS.items():
        assert list(figures["methods"][name]["options"]) == list(method.options_model.model_fields)


def test_methods_of_one_name_only() -> None:
    result = run("methods", "raw")
    assert result.exit_code == 0
    assert "particles" not in result.stdout
    assert run("methods", "nonsense").exit_code == 1
