"""A person tries it with logs that lack something or are wrong: fuse and the service say so, in the same sentences."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import rasterio
from typer.testing import CliRunner

from app.cli import app
from app.core.db import Sessions
from app.core.settings import Settings
from app.jobs.context import JobContext
from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from fusion.formats.versant_csv import VersantCsvFormat
from processing_support import accept_upload, drive_now, process_drive

DAY_S = 86_400.0
POSITION = ("time_s", "lat_deg", "lon_deg")
Row = dict[str, str]
Change = Callable[[Row], Row]


def changed(log: bytes, day: int, change: Change = lambda row: row, seconds: int = 75) -> bytes:
    """A log of another day, with each row changed."""
    rows = list(csv.DictReader(io.StringIO(log.decode())))[:seconds]
    rows = [change(row | {"time_s": f"{float(row['time_s']) + day * DAY_S:.3f}"}) for row in rows]
    text = io.StringIO()
    out = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    out.writeheader()
    out.writerows(rows)
    return text.getvalue().encode()


def only(*names: str) -> Change:
    return lambda row: {name: row[name] for name in names}


def without(*names: str) -> Change:
    return lambda row: {name: value for name, value in row.items() if name not in names}


def heights(factor: float, offset_m: float) -> Change:
    return lambda row: row | {"alt_msl_m": f"{float(row['alt_msl_m']) * factor + offset_m:.2f}"}


def upside_down(row: Row) -> Row:
    """Uphill is downhill to every sensor."""
    turned = {name: f"{-float(row[name]):.4f}" for name in ("vel_d_mps", "pitch_deg") if row[name]}
    return heights(-1.0, 600.0)(without("acc_x_mps2", "acc_y_mps2", "acc_z_mps2")(row)) | turned


def feet(row: Row) -> Row:
    return heights(1 / 0.3048, 0.0)(only(*POSITION, "alt_msl_m")(row))


def fused(folder: Path, logs: Mapping[str, bytes], roads: Path, *dem: Path) -> dict[str, Any]:
    """What ``versant fuse --json`` says; with it what goes to standard error (``said``), the output's attribution and
    slopes."""
    paths = [folder / name for name in logs]
    for path in paths:
        path.write_bytes(logs[path.name])
    out, figures = folder / "out.geojson", folder / "figures.json"
    rasters = [str(part) for path in dem for part in ("--dem", path)]
    outputs = ["-o", str(out), "--json", str(figures)]
    command = ["fuse", *map(str, paths), "--roads", str(roads), *rasters, *outputs]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    document = json.loads(out.read_text())
    return {
        **json.loads(figures.read_text()),
        "said": result.stderr,
        "attribution": document["attribution"],
        "slopes": {
            (p["osm_way_id"], p["from_node"]): (p["slope_percent"], p["slope_sigma_percent"])
            for p in (feature["properties"] for feature in document["features"])
        },
    }


def served(context: JobContext, logs: Mapping[str, bytes]) -> dict[str, dict[str, Any]]:
    """The reports of the drives' documents once all of them are published; drives are named as their logs."""
    ids = {}
    for name, content in logs.items():
        drive, _ = accept_upload(
            context.sessions, context.blobs, [content], filename=name, method="profile", options=None
        )
        process_drive(context, drive.id, drive.generation)
        ids[name] = drive.id
    reports = {name: drive_now(context, key).report for name, key in ids.items()}
    text = json.dumps(reports)
    for name, key in ids.items():
        text = text.replace(str(key), name)
    found: dict[str, dict[str, Any]] = json.loads(text)
    return found


SENTENCES = {
    "misnamed.csv": ("my_height", "The log has no altitudes, so it measures no heights"),
    "noalt.csv": ("The log has no altitudes, so it measures no heights", VersantCsvFormat.altitude_advice),
    "nodoppler.csv": ("no vertical Doppler velocity", VersantCsvFormat.doppler_advice),
    "positions.csv": (
        "rest on the elevation model alone",
        "The log has no altitudes, so its slopes are less sure",
        "no vertical Doppler velocity",
    ),
    "ellipsoid.csv": (r"altitudes are 4\d m above the elevation model \(datum EGM96\)", "not affected"),
    "feet.csv": ("seem to be in feet",),
    "zeros.csv": ("All altitudes of the log are 0 m", "rest on the elevation model alone"),
}
"""Of each log what it is told, in this order among others."""


def test_what_is_odd_about_a_log_is_told_by_both(context: JobContext, files: Path, tmp_path: Path) -> None:
    good = (files / "0.csv").read_bytes()
    logs = {
        "good.csv": changed(good, 0),
        "noalt.csv": changed(good, 10, without("alt_msl_m")),
        "misnamed.csv": changed(good, 15).replace(b"alt_msl_m", b"my_height"),
        "nodoppler.csv": changed(good, 20, without("vel_d_mps")),
        "positions.csv": changed(good, 30, only(*POSITION)),
        "ellipsoid.csv": changed(good, 40, heights(1.0, 47.5)),
        "feet.csv": changed(good, 50, feet),
        "zeros.csv": changed(good, 60, lambda row: only(*POSITION)(row) | {"alt_msl_m": "0"}),
    }
    alone = fused(tmp_path, logs, files / "town.osm", files / "town.tif")
    reports = {Path(one["file"]).name: one["report"] for one in alone["logs"]}
    assert reports["good.csv"]["warnings"] == []
    for name, wanted in SENTENCES.items():
        warnings = reports[name]["warnings"]
        assert re.search(".*".join(map(_as_pattern, wanted)), " ".join(warnings)), warnings
        for warning in warnings:
            assert f"{name}: {warning}" in alone["said"]
    told = served(context, logs)
    assert {name: report["warnings"] for name, report in told.items()} == {
        name: report["warnings"] for name, report in reports.items()
    }
    for figure in ("dem_share", "dem_only", "distance_m", "segments_estimated"):
        assert {n: r[figure] for n, r in told.items()} == {n: r[figure] for n, r in reports.items()}
    assert {name for name, report in told.items() if report["dem_only"]} == {"positions.csv", "zeros.csv"}


def _as_pattern(text: str) -> str:
    return text if "\\" in text else re.escape(text)


def test_a_drive_that_contradicts_and_a_duplicate(context: JobContext, files: Path, tmp_path: Path) -> None:
    """Both are told as they are now: what a drive was told when it came changes with the others."""
    good, other = ((files / f"{k}.csv").read_bytes() for k in (0, 2))
    logs = {
        "wrong.csv": changed(good, 10, upside_down),
        "again.csv": changed(good, 0, only(*POSITION, "alt_msl_m")),
        "good.csv": changed(good, 0),
        "other.csv": changed(other, 0),
        "third.csv": changed(other, 30),
    }
    first = served(context, {"wrong.csv": logs["wrong.csv"]})["wrong.csv"]
    assert first["rejected_segments"] == 0
    assert not [warning for warning in first["warnings"] if "contradicts" in warning]
    told = served(context, logs)
    alone = fused(tmp_path, logs, files / "town.osm", files / "town.tif")
    reports = {Path(one["file"]).name: one["report"] for one in alone["logs"]}
    for name, report in reports.items():
        assert [w.replace(str(tmp_path) + "/", "") for w in report["warnings"]] == told[name]["warnings"]
        assert report["rejected_segments"] == told[name]["rejected_segments"]
    (said,) = (warning for warning in told["wrong.csv"]["warnings"] if "contradicts" in warning)
    share = told["wrong.csv"]["rejected_segments"] / told["wrong.csv"]["segments_in_network"]
    assert f"({share:.0%}) and is rejected there" in said
    assert "This drive is a duplicate of good.csv" in told["again.csv"]["warnings"][-1]
    assert (
        alone["slopes"]
        == fused(
            tmp_path,
            {n: c for n, c in logs.items() if n != "again.csv"},
            files / "town.osm",
            files / "town.tif",
        )["slopes"]
    )


@pytest.fixture
def elsewhere(files: Path, tmp_path: Path) -> Path:
    """The town's elevations, at another place."""
    path = tmp_path / "elsewhere.tif"
    with rasterio.open(files / "town.tif") as raster:
        a, b, west, d, e, north = list(raster.transform)[:6]
        moved = raster.profile | {"transform": rasterio.Affine(a, b, west + 5.0, d, e, north - 4.0)}
        with rasterio.open(path, "w", **moved) as out:
            out.write(raster.read())
    return path


def test_an_elevation_model_of_another_place(
    sessions: Sessions, files: Path, elsewhere: Path, tmp_path: Path
) -> None:
    """It is told, not credited, and does nothing: the slopes are those without any."""
    logs = {"0.csv": changed((files / "0.csv").read_bytes(), 0)}
    roads, folder = files / "town.osm", tmp_path / "dem"
    with_it, none = fused(tmp_path, logs, roads, elsewhere), fused(tmp_path, logs, roads)
    assert with_it["slopes"] == none["slopes"]
    assert "elsewhere" not in with_it["attribution"]
    assert with_it["height_datum"] == none["height_datum"]
    (said,) = with_it["logs"][0]["report"]["warnings"]
    assert none["logs"][0]["report"]["warnings"] == []
    assert "no height under the drive, and could not be used. There is elsewhere.tif." in said
    assert "no elevation model there" in with_it["logs"][0]["summary"]
    assert "no elevation model." in none["logs"][0]["summary"]
    road_imports.import_roads(sessions, roads, folder)
    dem_imports.import_dem(sessions, [elsewhere], folder)
    context = JobContext(Settings(data_dir=tmp_path), sessions)
    assert served(context, logs)["0.csv"]["warnings"] == [said]
