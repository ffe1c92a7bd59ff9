"""Roads as OpenDRIVE: read by a reader of its own that evaluates cubics as simulators do, and by SUMO's netconvert."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Proj

from app.exports.formats.opendrive import cubics
from sumo_support import run, sumo_program

Mapped = Any  # of conftest, which cannot be imported


def numbers(element: Element, *names: str) -> list[float]:
    return [float(element.attrib[name]) for name in names]


@dataclass
class Record:
    """A cubic that holds from ``s`` on."""

    s: float
    coefficients: list[float]

    def at(self, s: float) -> tuple[float, float]:
        """Height and grade."""
        a, b, c, d = self.coefficients
        ds = s - self.s
        return a + b * ds + c * ds**2 + d * ds**3, b + 2 * c * ds + 3 * d * ds**2


class Road:
    """A road as simulators read it: the last record that begins at or before s counts."""

    def __init__(self, element: Element) -> None:
        self.element, self.length = element, float(element.attrib["length"])
        self.lines = [numbers(g, "s", "x", "y", "hdg", "length") for g in element.iter("geometry")]
        self.records = [
            Record(float(e.attrib["s"]), numbers(e, "a", "b", "c", "d")) for e in element.iter("elevation")
        ]

    def place(self, s: float) -> tuple[float, float]:
        start, x, y, heading, _ = [one for one in self.lines if one[0] <= s + 1e-9][-1]
        return x + (s - start) * math.cos(heading), y + (s - start) * math.sin(heading)

    def height(self, s: float) -> float:
        return [one for one in self.records if one.s <= s + 1e-9][-1].at(s)[0]

    def lanes(self, side: str) -> list[int]:
        return [int(lane.attrib["id"]) for one in self.element.iter(side) for lane in one]


@pytest.fixture(scope="module")
def written(mapped: Mapped, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Element]:
    path = tmp_path_factory.mktemp("xodr") / "town.xodr"
    count, _ = mapped.write("opendrive", path)
    root = defusedxml.ElementTree.parse(path).getroot()
    assert root is not None and count == len(root.findall("road")) > 50
    return path, root


@pytest.fixture(scope="module")
def roads(written: tuple[Path, Element]) -> list[Road]:
    return [Road(one) for one in written[1].findall("road")]


def test_the_document_is_what_its_schema_orders(written: tuple[Path, Element]) -> None:
    _, root = written
    assert root.tag == "OpenDRIVE" and root[0].tag == "header" and {one.tag for one in root[1:]} == {"road"}
    said = {one.attrib["code"]: one.attrib["value"] for one in root[0].findall("userData")}
    assert said["height_datum"] == "mean sea level & so on"
    parts = ["link", "type", "planView", "elevationProfile", "lateralProfile", "lanes", "userData"]
    assert all([part.tag for part in road] == parts for road in root.findall("road"))
    ids = [road.attrib["id"] for road in root.findall("road")]
    assert len(set(ids)) == len(ids)


def test_lines_and_cubics_go_on_without_a_step(roads: list[Road]) -> None:
    for road in roads:
        assert road.lines[0][0] == road.records[0].s == 0
        for (s, x, y, heading, length), after in pairwise(road.lines):
            assert after[0] == pytest.approx(s + length, abs=2e-3)
            end = x + length * math.cos(heading), y + length * math.sin(heading)
            assert math.dist(end, after[1:3]) < 1e-3
        assert road.length == pytest.approx(road.lines[-1][0] + road.lines[-1][4], abs=2e-3)
        for one, other in pairwise(road.records):
            (height, grade), (next_height, next_grade) = one.at(other.s), other.at(other.s)
            assert height == pytest.approx(next_height, abs=1e-3)
            assert grade == pytest.approx(next_grade, abs=1e-4)


def test_heights_and_places_are_those_of_the_nodes(mapped: Mapped, written: tuple[Path, Element]) -> None:
    _, root = written
    plane = Proj(root.findtext("header/geoReference"))
    town, found = mapped.town, {}
    for road in map(Road, root.findall("road")):
        for s in [*(line[0] for line in road.lines), road.length]:
            lon, lat = plane(*road.place(s), inverse=True)
            found[round(lon, 6), round(lat, 6)] = road.height(s)
    places = zip(town.node_lon_deg.round(6), town.node_lat_deg.round(6), town.node_id.tolist(), strict=True)
    off = [
        found[lon, lat] - mapped.heights[n]
        for lon, lat, n in places
        if n in mapped.heights and (lon, lat) in found
    ]
    assert len(off) > 100
    assert np.abs(off).max() < 0.005


def test_lanes_are_those_of_the_tags_and_one_way_roads_lie_in_their_middle(roads: list[Road]) -> None:
    kinds = set()
    for road in roads:
        right, left = road.lanes("right"), road.lanes("left")
        assert right == [-n for n in range(1, len(right) + 1)] and right
        assert left == list(range(len(left), 0, -1))
        (offset,) = [float(one.attrib["a"]) for one in road.element.iter("laneOffset")]
        assert offset == (0 if left else len(right) * 3.25 / 2)
        kinds.add(bool(left))
    assert kinds == {True, False}


def test_links_name_each_other(roads: list[Road]) -> None:
    ends = {"predecessor": "start", "successor": "end"}
    linked = {
        (road.element.attrib["id"], ends[link.tag]): (link.attrib["elementId"], link.attrib["contactPoint"])
        for road in roads
        for link in next(road.element.iter("link"))
    }
    assert linked and all(linked[other] == one for one, other in linked.items())
    by_id = {road.element.attrib["id"]: road for road in roads}
    for one, other in linked.items():
        a, b = (by_id[name].place(0 if end == "start" else by_id[name].length) for name, end in (one, other))
        assert math.dist(a, b) < 2e-3


@given(st.lists(st.tuples(st.floats(1, 200), st.floats(-10, 10)), min_size=1, max_size=10), st.floats(0, 100))
def test_cubics_pass_through_all_heights_and_are_straight_on_straight_roads(
    steps: list[tuple[float, float]], start: float
) -> None:
    runs, rises = np.array(steps).T
    s, height = np.r_[0.0, np.cumsum(runs)], np.r_[start, start + np.cumsum(rises)]
    found = cubics(s, height)
    run = np.diff(s)
    assert (found * np.stack([run**0, run, run**2, run**3], 1)).sum(1) == pytest.approx(height[1:], abs=1e-6)
    even = cubics(s, start + 0.05 * s)
    assert even[:, 1] == pytest.approx(0.05, abs=1e-9) and np.abs(even[:, 2:]).max() < 1e-9


def test_sumo_s_netconvert_reads_the_heights(
    written: tuple[Path, Element], roads: list[Road], tmp_path: Path
) -> None:
    netconvert = sumo_program("netconvert")
    said = run(netconvert, "--opendrive-files", written[0], "-o", "net.xml", "--opendrive.curve-resolution", "5",
               "--offset.disable-normalization", folder=tmp_path)  # fmt: skip
    assert "Error" not in said
    root = defusedxml.ElementTree.parse(tmp_path / "net.xml").getroot()
    edges = {edge.attrib["id"].lstrip("-").split(".")[0]: edge for edge in root.findall("edge")
             if edge.get("function") is None}  # fmt: skip
    assert len(edges) > 0.9 * len(roads)
    off = []
    for road in roads:
        if (edge := edges.get(road.element.attrib["id"])) is None:
            continue
        shape = edge.get("shape") or next(edge.iter("lane")).attrib["shape"]
        z = [float(place.split(",")[2]) for place in shape.split()]
        true = [road.height(s) for s in np.linspace(0, road.length, 100)]
        off.append(max(min(true) - min(z), max(z) - max(true), 0.0))
    assert max(off) < 0.1
