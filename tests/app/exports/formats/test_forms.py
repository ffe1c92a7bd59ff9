"""Every file for another program keeps the grammar of its consumer; the checkers know the grammar and no writer."""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import pytest

from app.exports.formats import FORMATS
from fusion.errors import BadOptionsError

Mapped = Any  # of conftest, which cannot be imported
FOR_PROGRAMS = [name for name, one in FORMATS.items() if one.consumer]


@pytest.mark.parametrize("name", FOR_PROGRAMS)
def test_each_says_what_it_is_and_is_the_same_twice(name: str, mapped: Mapped, tmp_path: Path) -> None:
    form = FORMATS[name]
    assert form.name == name and form.consumer and form.description
    assert form.suffixes and all(re.fullmatch(r"(\.[a-z]+)+", s) for s in form.suffixes)
    assert "/" in form.media_type and form.media_type.split("/")[0] in ("application", "text")
    for option, field in form.options.model_fields.items():
        assert field.description and field.description.endswith("."), option
        assert not field.is_required(), "a format works without options"
    counts = [mapped.write(name, tmp_path / f"{k}{form.suffixes[0]}")[0] for k in range(2)]
    one, two = ((tmp_path / f"{k}{form.suffixes[0]}").read_bytes() for k in range(2))
    assert one == two and counts[0] == counts[1] > 0


@pytest.mark.parametrize("name", FOR_PROGRAMS)
def test_wrong_options_are_told(name: str) -> None:
    form = FORMATS[name]
    with pytest.raises(BadOptionsError, match=r"takes no option 'colour' here\. It takes: "):
        form.parse_options({"colour": "red"}, local=True)
    for option in form.options.local_files:
        assert getattr(form.parse_options({option: "x"}, local=True), option) == Path("x")
        with pytest.raises(BadOptionsError, match=f"takes no option '{option}' here"):
            form.parse_options({option: "/etc/passwd"}, local=False)


def test_a_wrong_value_is_told_with_its_option() -> None:
    with pytest.raises(BadOptionsError, match="osrm-speeds: mass_kg: Input should be greater than 0"):
        FORMATS["osrm-speeds"].parse_options({"mass_kg": "-3"}, local=True)
    with pytest.raises(
        BadOptionsError, match="vehicle: Input should be 'car', 'truck', 'bicycle' or 'e-bike'"
    ):
        FORMATS["osrm-speeds"].parse_options({"vehicle": "tank"}, local=True)


# OSRM: key and value of src/updater/csv_source.cpp, whole numbers as its older versions read.

OSRM_LINE = re.compile(r"(0|[1-9]\d*),(0|[1-9]\d*),([1-9]\d*)")


def osrm_checked(text: str) -> dict[tuple[int, int], int]:
    assert text.endswith("\n")
    found = {}
    for line in text.split("\n")[:-1]:
        match = OSRM_LINE.fullmatch(line)
        assert match, line
        key = int(match[1]), int(match[2])
        assert key not in found
        found[key] = int(match[3])
    return found


def test_osrm_speeds_have_a_line_for_each_direction_that_may_be_driven(
    mapped: Mapped, tmp_path: Path
) -> None:
    count, notes = mapped.write("osrm-speeds", tmp_path / "speeds.csv", vehicle="bicycle")
    speeds = osrm_checked((tmp_path / "speeds.csv").read_text())
    assert len(speeds) == count and any("OpenStreetMap contributors" in note for note in notes)
    wanted = set()
    with mapped.source() as source:
        segments = list(source.segments(gaps=True))
    for s in segments:
        wanted |= {(s.from_node, s.to_node)} if s.oneway >= 0 else set()
        wanted |= {(s.to_node, s.from_node)} if s.oneway <= 0 else set()
    assert set(speeds) == wanted
    uphill = [s for s in segments if s.slope_percent and s.slope_percent > 4 and s.oneway == 0]
    assert len(uphill) > 10
    assert all(speeds[s.from_node, s.to_node] < speeds[s.to_node, s.from_node] for s in uphill)


def test_osrm_speeds_of_what_was_measured_alone_and_with_digits(mapped: Mapped, tmp_path: Path) -> None:
    count, _ = mapped.write("osrm-speeds", tmp_path / "all.csv")
    fewer, _ = mapped.write("osrm-speeds", tmp_path / "some.csv", unmeasured="skip", decimals="1")
    assert 0 < fewer < count
    assert all(re.fullmatch(r"\d+,\d+,\d+\.\d", line) for line in (tmp_path / "some.csv").read_text().split())


# RouteE Compass: one number a line, as many as edges, which count from 0 in the order of the file.


def gunzipped(data: bytes) -> str:
    return gzip.decompress(data).decode()


def grades_checked(text: str, edges: int, unit: float) -> list[float]:
    lines = text.split("\n")
    assert lines.pop() == "" and len(lines) == edges
    assert all(re.fullmatch(r"-?\d+\.\d+", line) for line in lines)
    grades = [float(line) / unit for line in lines]
    assert all(abs(grade) < 0.6 for grade in grades)
    return grades


@pytest.mark.parametrize(("unit", "factor"), [("decimal", 1.0), ("percent", 100.0), ("millis", 1000.0)])
def test_a_network_for_routee_is_consistent_in_itself(
    mapped: Mapped, tmp_path: Path, unit: str, factor: float
) -> None:
    count, _ = mapped.write("routee-grades", tmp_path / "net.zip", unit=unit)
    with zipfile.ZipFile(tmp_path / "net.zip") as archive:
        assert archive.testzip() is None
        files = {name: archive.read(name) for name in archive.namelist()}
    edges = list(csv.DictReader(io.StringIO(gunzipped(files["edges-compass.csv.gz"]))))
    vertices = list(csv.DictReader(io.StringIO(gunzipped(files["vertices-compass.csv.gz"]))))
    mapping = list(csv.DictReader(io.StringIO(gunzipped(files["vertices-mapping.csv.gz"]))))
    assert [int(e["edge_id"]) for e in edges] == list(range(count))
    assert [int(v["vertex_id"]) for v in vertices] == list(range(len(vertices)))
    assert [v["vertex_id"] for v in mapping] == [v["vertex_id"] for v in vertices]
    ends = {int(e[side]) for e in edges for side in ("src_vertex_id", "dst_vertex_id")}
    assert ends == set(range(len(vertices)))
    grades = grades_checked(gunzipped(files["edges-grade-enumerated.txt.gz"]), count, factor)
    by_edge = {(e["src_vertex_id"], e["dst_vertex_id"]): g for e, g in zip(edges, grades, strict=True)}
    both = [(g, by_edge[b, a]) for (a, b), g in by_edge.items() if (b, a) in by_edge]
    assert len(both) > 100 and all(there == pytest.approx(-back, abs=1e-9) for there, back in both)
    readme = files["README.txt"].decode()
    assert f'grade_unit = "{unit}"' in readme and "OpenStreetMap contributors" in readme


def test_grades_of_a_consumer_s_own_edges_are_those_between_their_ends(
    mapped: Mapped, tmp_path: Path
) -> None:
    """Edges over several segments, as simplified graphs have them, in an order of the consumer's own."""
    nodes = sorted(mapped.heights)[:40]
    vertices, edges = tmp_path / "vertices-mapping.csv.gz", tmp_path / "edges-compass.csv.gz"
    rows = "".join(f"{k},{node}\n" for k, node in enumerate(nodes))
    vertices.write_bytes(gzip.compress(f"vertex_id,vertex_uuid\n{rows}90,17\n".encode()))
    pairs = [(k, (k * 7 + 3) % 40, 100.0 + k) for k in range(40)]
    lines = [f"{k},{a},{b},{d}\n" for k, (a, b, d) in enumerate(pairs)] + ["40,90,1,10\n"]
    edges.write_bytes(
        gzip.compress(("edge_id,src_vertex_id,dst_vertex_id,distance\n" + "".join(reversed(lines))).encode())
    )
    out = tmp_path / "edges-grade-enumerated.txt.gz"
    given = {"edges": str(edges), "vertices": str(vertices)}
    count, notes = mapped.write("routee-grades", out, **given)
    found = [float(line) for line in gunzipped(out.read_bytes()).split()]
    assert count == len(found) == 41 and found[40] == 0.0
    for grade, (a, b, distance) in zip(found, pairs, strict=False):
        rise = mapped.heights[nodes[b]] - mapped.heights[nodes[a]]
        assert grade == pytest.approx(rise / distance, abs=1e-5)
    assert any("Of 1 of 41 edges an end is no node of a road here" in note for note in notes)


def test_a_list_of_grades_without_edges_or_with_wrong_ones_is_refused(mapped: Mapped, tmp_path: Path) -> None:
    out, vertices, edges = tmp_path / "g.txt.gz", tmp_path / "v.csv", tmp_path / "e.csv"
    with pytest.raises(BadOptionsError, match="in the order of your edges: name edges="):
        mapped.write("routee-grades", out)
    vertices.write_text("vertex_id,vertex_uuid\n0,1\n")
    for text, message in [
        ("edge_id,src_vertex_id\n", "has no column dst_vertex_id and none distance"),
        ("edge_id,src_vertex_id,dst_vertex_id,distance\n1,0,0,5\n", "does not count from 0"),
        ("edge_id,src_vertex_id,dst_vertex_id,distance\n0,x,0,5\n", "e.csv, line 2"),
    ]:
        edges.write_text(text)
        with pytest.raises(BadOptionsError, match=message):
            mapped.write("routee-grades", out, edges=str(edges), vertices=str(vertices))
    with pytest.raises(BadOptionsError, match="cannot be read"):
        mapped.write("routee-grades", out, edges=str(tmp_path / "none"), vertices=str(vertices))


# OpenSidewalks 0.3, subschemas of edges and nodes: the properties of each kind; others begin with ext:.

ROAD_FIELDS = {
    "_id",
    "_u_id",
    "_v_id",
    "highway",
    "incline",
    "length",
    "name",
    "description",
    "foot",
    "surface",
    "width",
}
ROADS = {
    "trunk",
    "primary",
    "secondary",
    "tertiary",
    "residential",
    "unclassified",
    "service",
    "living_street",
}
CUSTOM_FIELDS = {"_id", "_u_id", "_v_id", "foot"}


def sidewalks_checked(path: Path) -> dict[str, dict[str, Any]]:
    """Edges by their names."""
    document = json.loads(path.read_text())
    assert document["$schema"] == "https://sidewalks.washington.edu/opensidewalks/0.3/schema.json"
    assert set(document) <= {
        "type",
        "$schema",
        "features",
        "dataSource",
        "dataTimestamp",
        "pipelineVersion",
        "region",
    }
    assert document["type"] == "FeatureCollection" and isinstance(document["dataSource"], dict)
    nodes: dict[str, list[float]] = {}
    edges: dict[str, dict[str, Any]] = {}
    for feature in document["features"]:
        assert set(feature) == {"type", "geometry", "properties"} and feature["type"] == "Feature"
        properties, geometry = feature["properties"], feature["geometry"]
        plain = {name for name in properties if not name.startswith("ext:")}
        assert isinstance(properties["_id"], str) and properties["_id"]
        if geometry["type"] == "Point":
            assert plain == {"_id"} and properties["_id"] not in nodes
            nodes[properties["_id"]] = geometry["coordinates"]
            continue
        assert geometry["type"] == "LineString" and len(geometry["coordinates"]) >= 2
        assert plain <= (ROAD_FIELDS if "highway" in properties else CUSTOM_FIELDS)
        assert properties.get("highway", "trunk") in ROADS
        if "incline" in properties:
            assert isinstance(properties["incline"], float) and -1 <= properties["incline"] <= 1
        assert properties.get("length", 0) >= 0 and isinstance(properties.get("name", ""), str)
        assert properties["_id"] not in edges
        edges[properties["_id"]] = feature
    for edge in edges.values():
        ends = edge["geometry"]["coordinates"][0], edge["geometry"]["coordinates"][-1]
        assert nodes[edge["properties"]["_u_id"]] == ends[0] and nodes[edge["properties"]["_v_id"]] == ends[1]
    return edges


def test_opensidewalks(mapped: Mapped, tmp_path: Path) -> None:
    count, _ = mapped.write("opensidewalks", tmp_path / "walk.geojson")
    edges = sidewalks_checked(tmp_path / "walk.geojson")
    with mapped.source() as source:
        segments = {f"s{s.id}": s for s in source.segments(gaps=True) if not s.highway.startswith("motorway")}
    assert set(edges) == set(segments) and count == len(edges)
    for name, edge in edges.items():
        slope = segments[name].steepest_percent
        incline = edge["properties"].get("incline", edge["properties"].get("ext:incline"))
        assert incline == (None if slope is None else pytest.approx(slope / 100, abs=1e-4))
    fewer, _ = mapped.write("opensidewalks", tmp_path / "some.geojson", measured="true", incline="mean")
    some = sidewalks_checked(tmp_path / "some.geojson")
    assert fewer == len(some) == sum(s.slope_percent is not None for s in segments.values()) < count
