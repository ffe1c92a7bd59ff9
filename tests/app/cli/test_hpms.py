"""``versant hpms``: sections along a made street of known grades, against a real database."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.core.db import Sessions
from app.map.heights.classes import BOUNDS_PERCENT, CLASSES, by_class, classed
from app.map.heights.grades import Grades
from app.map.heights.places import distances_along_m
from fusion.roads.table import RoadTable
from road_support import replace_roads

runner = CliRunner()
MILE_M = 1609.344
LON, LAT, STEP = 8.5, 49.0, 0.001
SIGMA = 0.5
GRADES = [0.2, 0.2, -1.5, -1.5, -1.5, 3.4, 5.0, 5.0, -7.0, 9.0, None, None]
"""Percent of each segment of the street, None: nobody drove there."""
STEP_M = float(distances_along_m(np.array([[LON, LAT], [LON + STEP, LAT]]))[-1])

_MEASURED = text(
    """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations,
        height_from_m, height_to_m, height_sigma_m)
    SELECT s.id, m.slope, :sigma, 2, 9, m.low, m.low + m.slope / 100 * s.length_m, 0.5
    FROM unnest(CAST(:node AS bigint[]), CAST(:slope AS float8[]), CAST(:low AS float8[])) AS m (node, slope, low)
    JOIN segments AS s ON s.from_node = m.node
    """
)


@pytest.fixture
def street(sessions: Sessions, chain: Callable[..., RoadTable]) -> Sessions:
    """A street that runs east from (LON, LAT), a segment of ``GRADES`` after the other."""
    slopes = [one for one in GRADES if one is not None]
    low = 100 + np.concatenate([[0.0], np.cumsum([one / 100 * STEP_M for one in slopes])])[:-1]
    with sessions.begin() as session:
        replace_roads(session, chain(len(GRADES), LON, LAT), "street.osm", "0" * 64)
        values = {"node": [100 + k for k in range(len(slopes))], "slope": slopes, "low": low.tolist()}
        session.execute(_MEASURED, {**values, "sigma": SIGMA})
    return sessions


def line(start: float, end: float, off_deg: float = 0.0) -> list[tuple[float, float]]:
    """Between two places of the street, counted in segments."""
    return [(LON + STEP * k, LAT + off_deg) for k in np.linspace(start, end, 7).tolist()]


def wkt(places: list[tuple[float, float]]) -> str:
    return "LINESTRING (" + ", ".join(f"{lon} {lat}" for lon, lat in places) + ")"


def miles(segments: float) -> float:
    return segments * STEP_M / MILE_M


def run(monkeypatch: pytest.MonkeyPatch, url: str, *arguments: str | Path) -> Any:
    monkeypatch.setenv("VERSANT_DATABASE_URL", url)
    return runner.invoke(app, ["hpms", *map(str, arguments)])


def write_csv(path: Path, *rows: tuple[Any, ...]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("Route_ID", "Begin_Point", "End_Point", "WKT"), *rows])
    return path


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_miles_of_each_class_add_up_to_the_section(
    street: Sessions, database_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    whole = miles(len(GRADES))
    sections = write_csv(
        tmp_path / "sections.csv",
        ("I-5 N", 10, 10 + whole, wkt(line(0, 12, 5e-5))),
        ("I-5 S", "10.5", 10.5 + whole, wkt(line(12, 0))),
        ("SR 7", 0, 2 * miles(3), wkt(line(2, 5))),
    )
    out, figures = tmp_path / "grades.csv", tmp_path / "figures.json"
    done = run(monkeypatch, database_url, sections, "-o", out, "--json", figures)
    assert done.exit_code == 0, done.output
    there, back, level = read(out)
    assert (there["route_id"], there["begin_point"]) == ("I-5 N", "10")
    wanted = dict(zip(CLASSES, [2, 3, 1, 2, 1, 1], strict=True))
    for row in (there, back):
        for name, segments in wanted.items():
            assert float(row[f"grades_{name}"]) == pytest.approx(miles(segments), abs=0.012), name
        assert float(row["unmeasured_miles"]) == pytest.approx(miles(2), abs=0.012)
        assert float(row["measured_share"]) == pytest.approx(10 / 12, abs=0.02)
        assert 0.8 < float(row["class_probability"]) < 0.99
    for row in (there, back, level):
        parts = [float(row[f"grades_{name}"]) for name in CLASSES] + [float(row["unmeasured_miles"])]
        assert sum(parts) == pytest.approx(float(row["section_miles"]), abs=1e-9)
    assert float(level["grades_b"]) == float(level["section_miles"]) == pytest.approx(2 * miles(3), abs=6e-4)
    assert float(level["line_miles"]) == pytest.approx(miles(3), abs=6e-4)
    assert "SR 7 0-" in done.output and "Lengths are scaled to the section" in done.output
    assert done.output.count("miles long") == 1
    said = json.loads(figures.read_text())
    assert said["sections"] == 3 and "OpenStreetMap" in said["attribution"]


def test_geojson_and_lines_in_parts_are_taken(
    street: Sessions, database_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    parts = [line(2, 3.5), line(3.5, 5)]
    feature = {
        "type": "Feature",
        "properties": {"ROUTE_ID": "SR 7", "begin_point": 0, "END_POINT": miles(3)},
        "geometry": {"type": "MultiLineString", "coordinates": parts},
    }
    sections = tmp_path / "sections.geojson"
    sections.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    done = run(monkeypatch, database_url, sections, "-o", tmp_path / "g.csv")
    assert done.exit_code == 0, done.output
    (row,) = read(tmp_path / "g.csv")
    assert row["grades_b"] == row["section_miles"] and row["measured_share"] == "1.0"


def test_away_from_roads_nothing_is_measured(street: Sessions) -> None:
    with street() as session:
        found = by_class(session, np.array(line(0, 3, 0.01)), 25.0)
    assert found.length_m.tolist() == [0.0] * 6 and math.isnan(found.sure)
    assert found.whole_m == pytest.approx(3 * STEP_M, rel=1e-3)


@pytest.mark.parametrize(
    ("row", "says"),
    [
        (("A", 3, 3, wkt(line(0, 1))), "section 1: end_point 3 is not beyond begin_point 3"),
        (("A", "x", 3, wkt(line(0, 1))), "section 1: begin_point x or end_point 3 is no number"),
        (("A", 0, 1, "POINT (8 49)"), "no line that hangs together. Point"),
        (("A", 0, 1, "LINESTRING (8 49"), "no line that hangs together"),
        (("A", 0, 1, ""), "no line that hangs together"),
        (("A", 0, 1, "LINESTRING (500000 5400000, 500100 5400000)"), "no longitude and latitude"),
        (
            ("A", 0, 1, "MULTILINESTRING ((8 49, 8.1 49), (8.2 49, 8.3 49))"),
            "hangs together. MultiLineString",
        ),
    ],
)
def test_a_section_that_is_wrong_is_named(
    tmp_path: Path, database_url: str, monkeypatch: pytest.MonkeyPatch, row: tuple[Any, ...], says: str
) -> None:
    done = run(monkeypatch, database_url, write_csv(tmp_path / "s.csv", row), "-o", tmp_path / "o.csv")
    assert done.exit_code == 1 and says in done.output
    assert not (tmp_path / "o.csv").exists()


def test_files_that_are_no_sections_are_told(
    tmp_path: Path, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content, says in (
        ("a.csv", "route_id,begin_point\n", "lacks the columns end_point, wkt"),
        ("b.csv", "route_id,begin_point,end_point,wkt\n", "has no section"),
        ("c.geojson", "{", "cannot be read"),
        (
            "d.geojson",
            '{"features": [{"properties": {"route_id": 1}}]}',
            "no property begin_point, end_point",
        ),
    ):
        (tmp_path / name).write_text(content)
        done = run(monkeypatch, database_url, tmp_path / name, "-o", tmp_path / "o.csv")
        assert done.exit_code == 1 and says in done.output, name


@pytest.mark.parametrize(
    ("slope", "name"),
    [(0.44, "a"), (0.46, "b"), (-2.44, "b"), (2.46, "c"), (-4.46, "d"), (6.5, "e"), (-8.5, "f")],
)
def test_a_class_ends_halfway_to_the_next(slope: float, name: str) -> None:
    """As grades to a tenth of a percent are classed: 0.4 is A, 0.5 is B."""
    grades = Grades(np.array([slope, np.nan]), np.array([0.0, np.nan]))
    found = classed(grades, np.array([True, False]), 20.0)
    assert found.length_m.tolist() == [10.0 * (name == one) for one in CLASSES]
    assert found.sure == 1.0


def test_the_probability_of_a_class_is_that_of_the_size() -> None:
    """By a draw: the sign does not matter, and a level road with a wide sigma may be either way."""
    rng = np.random.default_rng(31)
    for mean, sigma in ((3.4, 0.5), (0.1, 0.4), (-6.0, 1.5), (9.0, 1.0)):
        found = classed(Grades(np.array([mean]), np.array([sigma])), np.array([True]), 10.0)
        drawn = np.searchsorted(BOUNDS_PERCENT, np.abs(rng.normal(mean, sigma, 200_000)), side="right")
        assert found.sure == pytest.approx(np.mean(drawn == np.argmax(found.length_m)), abs=0.005)
