"""Networks for SUMO: the grammar of its schemas, heights and slopes as measured, and what its programs make of them."""

from __future__ import annotations

import math
import zipfile
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np
import pytest
from pyproj import Proj

from app.exports.writing.road_courses import _parts
from fusion.errors import BadOptionsError
from sumo_support import run, sumo_program

Mapped = Any  # of conftest, which cannot be imported
Place = tuple[float, float, float]
TRUE_M = 3.0
"""What heights of the map are above those of the town (conftest's offset)."""


def members(path: Path) -> dict[str, Element]:
    with zipfile.ZipFile(path) as archive:
        return {
            name: defusedxml.ElementTree.fromstring(archive.read(name))
            for name in archive.namelist()
            if name != "README.txt"
        }


def places(shape: str) -> list[Place]:
    found = []
    for place in shape.split():
        x, y, z = place.split(",")
        found.append((float(x), float(y), float(z)))
    return found


def parameter(edge: Element, key: str) -> str:
    (found,) = [p.attrib["value"] for p in edge.findall("param") if p.attrib["key"] == key]
    return found


def incline(edge: Element) -> float:
    value = parameter(edge, "incline")
    assert value.endswith("%")
    return float(value[:-1])


@pytest.fixture(scope="module")
def plain(mapped: Mapped, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sumo") / "town.zip"
    count, _ = mapped.write("sumo", path)
    assert count == len(members(path)["roads.edg.xml"].findall("edge"))
    return path


def test_plain_xml_has_every_road_in_each_direction_that_may_be_driven(mapped: Mapped, plain: Path) -> None:
    files = members(plain)
    assert set(files) == {"roads.nod.xml", "roads.edg.xml", "roads.typ.xml", "roads.netccfg"}
    nodes = {n.attrib["id"]: n.attrib for n in files["roads.nod.xml"]}
    types = {t.attrib["id"] for t in files["roads.typ.xml"]}
    segments: dict[tuple[int, int, int], int] = {}
    row = {int(n): k for k, n in enumerate(mapped.town.node_id)}
    degrees = zip(mapped.town.node_lon_deg.round(7), mapped.town.node_lat_deg.round(7), strict=True)
    place = {lon_lat: k for k, lon_lat in enumerate(degrees)}
    for edge in files["roads.edg.xml"]:
        shape = places(edge.attrib["shape"])
        assert edge.attrib["type"] in types
        for end, (lon, lat, z) in ((edge.attrib["from"], shape[0]), (edge.attrib["to"], shape[-1])):
            assert (float(nodes[end]["x"]), float(nodes[end]["y"]), float(nodes[end]["z"])) == (lon, lat, z)
        way = int(edge.attrib["id"].lstrip("-").split("#")[0])
        for (a, b), (c, d) in pairwise([(lon, lat) for lon, lat, _ in shape]):
            key = (way, place[a, b], place[c, d])
            segments[key] = segments.get(key, 0) + 1
    roads = mapped.town.roads
    wanted = set()
    for way, a, b, oneway in zip(roads.osm_way_id, roads.from_node, roads.to_node, roads.oneway, strict=True):
        wanted |= {(way, row[a], row[b])} if oneway >= 0 else set()
        wanted |= {(way, row[b], row[a])} if oneway <= 0 else set()
    assert set(segments) == wanted and set(segments.values()) == {1}


def test_ways_are_parted_where_they_meet_and_loops_in_their_middle() -> None:
    ends = np.array([True, False, True, False, False, True])
    parts = [part.tolist() for part in _parts(np.array([0, 1, 2, 3, 4, 2, -1, 5, 5, 3]), ends)]
    assert parts == [[0, 1, 2], [2, 3], [3, 4, 2], [5, 3]]


def test_heights_are_those_measured_and_inclines_those_of_the_edges(mapped: Mapped, plain: Path) -> None:
    edges = members(plain)["roads.edg.xml"].findall("edge")
    known = {
        (round(lon, 7), round(lat, 7)): mapped.heights[int(node)]
        for node, lon, lat in zip(
            mapped.town.node_id, mapped.town.node_lon_deg, mapped.town.node_lat_deg, strict=True
        )
        if int(node) in mapped.heights
    }
    seen = 0
    for edge in edges:
        shape = places(edge.attrib["shape"])
        measured = [(lon, lat) in known for lon, lat, _ in shape]
        assert float(parameter(edge, "measured")) == pytest.approx(np.mean(measured), abs=0.006)
        for (lon, lat, z), here in zip(shape, measured, strict=True):
            assert not here or z == pytest.approx(known[lon, lat], abs=0.001)
        run_m = sum(
            math.hypot((c - a) * math.cos(math.radians(b)), d - b) * 111_195
            for (a, b, _), (c, d, _) in pairwise(shape)
        )
        if all(measured):
            seen += 1
            assert incline(edge) == pytest.approx(100 * (shape[-1][2] - shape[0][2]) / run_m, abs=0.05)
    assert seen > 50
    there = {edge.attrib["id"]: edge for edge in edges}
    assert all(incline(there[f"-{name}"]) == -incline(e) for name, e in there.items() if f"-{name}" in there)


def net_of(town: Any, *, projection: str = "+proj=tmerc +lat_0=48 +lon_0=7.85 +datum=WGS84 +units=m") -> str:
    """A network of two edges after each other on one street, as netconvert writes it, but 2 m to the right; flat."""
    way = next(
        w for w in np.unique(town.roads.osm_way_id) if w % 4 > 1 and (town.roads.osm_way_id == w).sum() >= 4
    )
    rows = np.flatnonzero(town.roads.osm_way_id == way)
    nodes = [*town.start[rows], town.end[rows[-1]]]
    x, y = Proj(projection.replace("!", ""))(town.node_lon_deg[nodes], town.node_lat_deg[nodes])
    shape = [f"{a + 500:.2f},{b + 700:.2f}" for a, b in zip(x, y, strict=True)]
    half = len(shape) // 2
    first, second = " ".join(shape[: half + 1]), " ".join(shape[half:])
    junctions = "".join(
        f'<junction id="{name}" type="priority" x="{xy.split(",")[0]}" y="{xy.split(",")[1]}" incLanes="{lanes}"'
        f' shape="{xy} {xy}"/>'
        for name, xy, lanes in (
            ("a", shape[0], ""),
            ("b", shape[half], "x_0"),
            ("c", shape[-1], f"{way}#1_0"),
        )
    )
    return (
        f'<net><location netOffset="500.00,700.00" projParameter="{projection}"/>'
        f'<edge id=":b_0" function="internal"><lane id=":b_0_0" index="0" shape="{shape[half]} {shape[half]}"/></edge>'
        f'<edge id="x" from="a" to="b" shape="{first}"><lane id="x_0" index="0" speed="9" shape="{first}"/></edge>'
        f'<edge id="{way}#1" from="b" to="c" shape="{second}"><lane id="{way}#1_0" index="0" shape="{second}"/>'
        f'<param key="incline" value="up"/></edge>{junctions}'
        f'<connection from="x" to="{way}#1" fromLane="0" toLane="0" via=":b_0_0" dir="s"/>'
        f'<connection from=":b_0" to="{way}#1" fromLane="0" toLane="0" dir="s"/></net>'
    )


def test_a_network_of_one_s_own_gets_heights_and_keeps_all_else(mapped: Mapped, tmp_path: Path) -> None:
    own, out = tmp_path / "own.net.xml", tmp_path / "out.net.xml"
    own.write_text(net_of(mapped.town))
    count, notes = mapped.write("sumo", out, net=str(own))
    assert (count, notes) == (2, notes) and not any("No road" in note for note in notes)
    before, after = (defusedxml.ElementTree.parse(path).getroot() for path in (own, out))
    lanes = {lane.attrib["id"]: lane for lane in after.iter("lane")}
    assert [one.tag for one in before.iter() if one.tag != "param"] == [
        one.tag for one in after.iter() if one.tag != "param"
    ]
    assert lanes["x_0"].attrib["speed"] == "9"
    ends = [places(lanes[name].attrib["shape"]) for name in ("x_0", lanes_second(lanes))]
    inner = places(lanes[":b_0_0"].attrib["shape"])
    assert inner[0][2] == inner[-1][2] == pytest.approx(ends[0][-1][2], abs=0.01)
    true = {(round(lon, 6), round(lat, 6)): h for lon, lat, h in zip(
        mapped.town.node_lon_deg, mapped.town.node_lat_deg, mapped.town.node_height_m, strict=True)}  # fmt: skip
    plane = Proj("+proj=tmerc +lat_0=48 +lon_0=7.85 +datum=WGS84 +units=m")
    checked = 0
    for x, y, z in [*ends[0], *ends[1]]:
        lon, lat = plane(x - 500, y - 700, inverse=True)
        if (height := true.get((round(lon, 6), round(lat, 6)))) is not None:
            checked += 1
            assert z == pytest.approx(height + TRUE_M, abs=0.02)
    assert checked >= 4
    for edge in after.findall("edge")[1:]:
        shape = places(edge.attrib["shape"])
        run_m = sum(math.dist(p[:2], q[:2]) for p, q in pairwise(shape))
        assert incline(edge) == pytest.approx(100 * (shape[-1][2] - shape[0][2]) / run_m, abs=0.01)
    (level,) = [j.attrib["z"] for j in after.findall("junction") if j.attrib["id"] == "b"]
    assert float(level) == pytest.approx(inner[0][2], abs=0.01)


def lanes_second(lanes: dict[str, Element]) -> str:
    return next(name for name in lanes if name.endswith("#1_0"))


def test_what_is_no_network_or_is_nowhere_is_refused(mapped: Mapped, tmp_path: Path) -> None:
    own = tmp_path / "own.net.xml"
    for text, words in (
        ("<net><location projParameter='!'/></net>", "where on Earth"),
        ("<osm/>", "no network"),
        ("<net", "cannot be read"),
    ):
        own.write_text(text)
        with pytest.raises(BadOptionsError, match=words):
            mapped.write("sumo", tmp_path / "out.net.xml", net=str(own))
    with pytest.raises(BadOptionsError, match="net=FILE"):
        mapped.write("sumo", tmp_path / "out.net.xml")


@pytest.fixture(scope="module")
def built(mapped: Mapped, plain: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The plain network as netconvert builds it, and that with heights put in again."""
    folder = tmp_path_factory.mktemp("built")
    netconvert = sumo_program("netconvert")
    zipfile.ZipFile(plain).extractall(folder)
    said = run(netconvert, "-c", "roads.netccfg", folder=folder)
    assert "Error" not in said
    mapped.write("sumo", folder / "measured.net.xml", net=str(folder / "roads.net.xml"))
    return folder / "roads.net.xml", folder / "measured.net.xml"


def slopes_driven(net: Path, folder: Path, sumo: str) -> dict[tuple[str, float], tuple[float, float, float]]:
    """What a vehicle tells of each edge: x, y and slope in percent, by edge and place along its lane."""
    root = defusedxml.ElementTree.parse(net).getroot()
    edges = [e.attrib["id"] for e in root.findall("edge") if e.get("function") != "internal"]
    trips = "".join(f'<trip id="{n}" depart="{n}" from="{edge}" to="{edge}" departSpeed="max"/>'
                    for n, edge in enumerate(edges))  # fmt: skip
    (folder / "trips.xml").write_text(f"<routes>{trips}</routes>")
    run(sumo, "-n", net, "-r", "trips.xml", "--fcd-output", "fcd.xml", "--no-step-log", "--no-warnings",
        "--fcd-output.attributes", "lane,pos,slope,x,y", "--time-to-teleport", "-1", folder=folder)  # fmt: skip
    found = {}
    for vehicle in defusedxml.ElementTree.parse(folder / "fcd.xml").getroot().iter("vehicle"):
        if not vehicle.attrib["lane"].startswith(":"):
            slope = 100 * math.tan(math.radians(float(vehicle.attrib["slope"])))
            x, y = float(vehicle.attrib["x"]), float(vehicle.attrib["y"])
            found[vehicle.attrib["lane"], float(vehicle.attrib["pos"])] = (x, y, slope)
    return found


def test_sumo_drives_the_slopes_that_were_measured(
    mapped: Mapped, built: tuple[Path, Path], tmp_path: Path
) -> None:
    """On edges all of whose nodes were measured, to what the town has there; netconvert's own are off at junctions."""
    sumo = sumo_program("sumo")
    town = mapped.town
    true: dict[int, list[float]] = {}
    way = town.roads.osm_way_id
    known = np.isin(town.roads.from_node, list(mapped.heights)) & np.isin(
        town.roads.to_node, list(mapped.heights)
    )
    slope = 100 * (town.node_height_m[town.end] - town.node_height_m[town.start]) / town.length_m
    for number in np.unique(way):
        rows = way == number
        if known[rows].all():
            true[int(number)] = [float(slope[rows].min()), float(slope[rows].max())]
    off: list[list[float]] = []
    for net in built:
        beyond = []
        for (lane, _), (_, _, driven) in slopes_driven(net, tmp_path, sumo).items():
            number, sign = int(lane.lstrip("-").split("#")[0]), -1 if lane.startswith("-") else 1
            if number in true:
                low, high = sorted(sign * s for s in true[number])
                beyond.append(max(low - driven, driven - high, 0.0))
        off.append(beyond)
    assert len(off[0]) > 200 and len(off[1]) > 200
    assert np.quantile(off[1], 0.99) < 0.05
    assert max(off[1]) < 0.3
    assert np.sqrt(np.mean(np.square(off[1]))) < 0.1 * np.sqrt(np.mean(np.square(off[0])))


@pytest.mark.parametrize("path", ["built", "plain"])
def test_the_same_data_make_the_same_bytes(
    mapped: Mapped, plain: Path, tmp_path: Path, path: str, request: pytest.FixtureRequest
) -> None:
    options: dict[str, str] = {}
    again, before = tmp_path / "again.zip", plain
    if path == "built":
        net, before = request.getfixturevalue("built")
        again, options = tmp_path / "again.net.xml", {"net": str(net)}
    mapped.write("sumo", again, **options)
    assert again.read_bytes() == before.read_bytes()
