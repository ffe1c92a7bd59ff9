"""``versant score``: every form of a profile, what is refused, and real roads where they are."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from app.cli import app

Rows = list[dict[str, float]]


def score(*arguments: object, language: str = "C.UTF-8") -> Result:
    command = ["score", *map(str, arguments), "--quiet"]
    return CliRunner().invoke(app, command, env={"LC_ALL": language, "COLUMNS": "1000"})


def figures(path: Path) -> dict[str, dict[float, dict[str, Any]]]:
    """What is reported, by source and length."""
    sources = json.loads(path.read_text())["sources"]
    return {one["name"]: {row["length_m"]: row for row in one["lengths"]} for one in sources}


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reference town-1 as a file."""
    path = tmp_path_factory.mktemp("reference") / "town.csv"
    result = score("--reference", "town-1", "--write", path)
    assert result.exit_code == 0, result.output
    assert "the reference, 7.5 km" in result.stdout
    return path


@pytest.fixture(scope="module")
def rows(town: Path) -> Rows:
    with town.open() as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def polyline(rows: Rows) -> str:
    """Google's encoding with six decimals."""
    text, before = "", [0, 0]
    for row in rows:
        now = [round(row[name] * 1e6) for name in ("lat_deg", "lon_deg")]
        for value in (b - a for a, b in zip(before, now, strict=True)):
            left = ~(value << 1) if value < 0 else value << 1
            while left >= 0x20:
                text += chr((0x20 | (left & 0x1F)) + 63)
                left >>= 5
            text += chr(left + 63)
        before = now
    return text


def shape(rows: Rows) -> list[dict[str, float]]:
    return [{"lat": row["lat_deg"], "lon": row["lon_deg"]} for row in rows]


def line(rows: Rows) -> dict[str, Any]:
    coordinates = [[row["lon_deg"], row["lat_deg"], row["height_m"]] for row in rows]
    return {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "LineString", "coordinates": coordinates},
    }


def gpx(rows: Rows, point: str, around: str) -> str:
    points = (
        f'<{point} lat="{r["lat_deg"]}" lon="{r["lon_deg"]}"><ele>{r["height_m"]}</ele></{point}>'
        for r in rows
    )
    begin = "".join(f"<{name}>" for name in around.split())
    end = "".join(f"</{name}>" for name in reversed(around.split()))
    return f'<gpx version="1.1" creator="x">{begin}{"".join(points)}{end}</gpx>'


def point_of(row: dict[str, float]) -> dict[str, Any]:
    place = {"type": "Point", "coordinates": [row["lon_deg"], row["lat_deg"]]}
    return {"type": "Feature", "geometry": place, "properties": {"Elevation": row["height_m"]}}


FORMS = {
    "distances.csv": lambda rows: (
        "distance_m;height_m\n" + "\n".join(f"{r['distance_m']};{r['height_m']}" for r in rows)
    ),
    "places.csv": lambda rows: (
        "Latitude,Longitude,Ele\n" + "\n".join(f"{r['lat_deg']},{r['lon_deg']},{r['height_m']}" for r in rows)
    ),
    "track.gpx": lambda rows: gpx(rows, "trkpt", "trk trkseg"),
    "route.gpx": lambda rows: gpx(rows, "rtept", "rte"),
    "line.geojson": lambda rows: json.dumps({"type": "FeatureCollection", "features": [line(rows)]}),
    "points.geojson": lambda rows: json.dumps(
        {"type": "FeatureCollection", "features": [point_of(row) for row in rows]}
    ),
    "range.json": lambda rows: json.dumps({"range_height": [[r["distance_m"], r["height_m"]] for r in rows]}),
    "shape.json": lambda rows: json.dumps({"shape": shape(rows), "height": [r["height_m"] for r in rows]}),
    "encoded.json": lambda rows: json.dumps(
        {"encoded_polyline": polyline(rows), "height": [r["height_m"] for r in rows]}
    ),
    "google.json": lambda rows: json.dumps(
        {
            "results": [
                {"elevation": r["height_m"], "location": {"lat": r["lat_deg"], "lng": r["lon_deg"]}}
                for r in rows
            ]
        }
    ),
    "columns.json": lambda rows: json.dumps(
        {
            "epochs": len(rows),
            "lat_deg": [r["lat_deg"] for r in rows],
            "lon_deg": [r["lon_deg"] for r in rows],
            "alt_m": [None, *(r["height_m"] for r in rows[1:])],
        }
    ),
    "log.csv": lambda rows: (
        "time_s,lat_deg,lon_deg,alt_msl_m\n"
        + "\n".join(f"{1.7e9 + k},{r['lat_deg']},{r['lon_deg']},{r['height_m']}" for k, r in enumerate(rows))
    ),
}


@pytest.mark.parametrize("name", FORMS)
def test_every_form_is_read_and_is_what_it_was_made_of(
    name: str, town: Path, rows: Rows, tmp_path: Path
) -> None:
    profile, report = tmp_path / name, tmp_path / "report.json"
    profile.write_text(FORMS[name](rows))
    result = score(profile, "--reference", town, "--json", report, "--length", 100, "--length", 500)
    assert result.exit_code == 0, result.output
    found = figures(report)
    assert list(found) == [str(profile), "level road"], "a reference of a file has no elevation model"
    assert found[str(profile)][100]["rms_percent"] < 0.1
    assert found[str(profile)][500]["coverage"] > 0.95
    assert found["level road"][100]["rms_percent"] > 2
    assert "100% of it lies on town.csv" in result.stdout


def test_a_made_reference_brings_its_elevation_model_and_raw_altitudes_are_a_row(
    rows: Rows, tmp_path: Path
) -> None:
    rng = np.random.default_rng(4)
    good, raw, report = tmp_path / "good.json", tmp_path / "raw.gpx", tmp_path / "report.json"
    good.write_text(FORMS["shape.json"]([row | {"height_m": row["height_m"] + 48} for row in rows[::-1]]))
    raw.write_text(
        FORMS["track.gpx"]([row | {"height_m": row["height_m"] + rng.normal(0, 2)} for row in rows])
    )
    result = score(good, "--raw", raw, "--reference", "town-1", "--json", report)
    assert result.exit_code == 0, result.output
    found = figures(report)
    assert list(found) == [str(good), "elevation model", "raw altitudes", "level road"]
    by_source = {name: lengths[100]["rms_percent"] for name, lengths in found.items()}
    assert by_source[str(good)] < 0.1 < by_source["raw altitudes"]
    assert by_source["raw altitudes"] == pytest.approx(100 * 2 * np.sqrt(2) / 100, rel=0.2)
    assert 1 < by_source["elevation model"] < 6
    profile = json.loads(report.read_text())["sources"][0]
    assert (profile["backwards"], profile["offset_m"]) == (True, pytest.approx(48, abs=0.05))
    table = [line.split() for line in result.stdout.splitlines()]
    assert [line[-8] for line in table if line[:2] == ["level", "road"]] == [
        "50",
        "100",
        "200",
        "500",
        "1000",
    ]


def test_a_profile_in_german(rows: Rows, town: Path, tmp_path: Path) -> None:
    profile = tmp_path / "line.geojson"
    profile.write_text(FORMS["line.geojson"](rows))
    report = tmp_path / "report.json"
    result = score(profile, "--reference", town, "--json", report, language="de_DE.UTF-8")
    assert result.exit_code == 0, result.output
    assert "davon liegt auf town.csv" in result.stdout
    assert "ebene Straße" in result.stdout
    assert "Stücke" in result.stdout
    assert "level road" in figures(report), "what programs read is the same in every language"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("lat_deg,lon_deg,height_m\n10,10,1\n10.001,10,2\n10.002,10,3\n", "does not lie on town-1"),
        ('{"type": "LineString", "coordinates": [[8, 49], [8.1, 49]]}', "has no heights"),
        ('{"height": [1, 2, 3]}', "says of no height where it is"),
        ('{"height": [1, 2', "is no JSON"),
        ('{"height": [1, 2], "shape": [{"lat": 1, "lon": 2}]}', "neither a profile in GeoJSON nor"),
        ('[{"lat": 1}]', "neither a profile in GeoJSON nor"),
        ("no profile at all", "in no format that is known here"),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_no_profile_of_that_road_is_refused(content: str, said: str, tmp_path: Path) -> None:
    profile = tmp_path / "x.txt"
    profile.write_text(content)
    result = score(profile, "--reference", "town-1")
    assert result.exit_code == 1
    (complaint,) = result.stderr.splitlines()
    assert said in complaint


def test_a_reference_that_is_none_is_wrong_usage(tmp_path: Path) -> None:
    result = score("--reference", "town-9")
    assert (result.exit_code, "town-1, town-2, town-3" in result.stderr) == (2, True)
    apart = tmp_path / "apart.csv"
    apart.write_text("distance_m,height_m\n0,1\n500,2\n")
    result = score("--reference", apart)
    assert (result.exit_code, "no two points within 30 m" in result.stderr) == (1, True)
    short = tmp_path / "short.csv"
    short.write_text("distance_m,height_m\n0,1\n20,2\n")
    result = score("--reference", short)
    assert (result.exit_code, "no stretch of such a length" in result.stderr) == (2, True)


def test_a_surveyed_road_against_a_satellites_elevation_model(karlsruhe: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    raster = karlsruhe / "N48E008.hgt"
    result = score("--reference", karlsruhe / "ref_09.csv", "--dem", raster, "--json", report)
    assert result.exit_code == 0, result.output
    found = figures(report)
    assert 3 < found["elevation model"][50]["rms_percent"] < 9
    assert found["elevation model"][500]["rms_percent"] < found["elevation model"][50]["rms_percent"]
