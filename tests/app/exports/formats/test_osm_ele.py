"""Files with ``ele``: on every node of a road, as measured, without a step; and what SUMO makes of them."""

from __future__ import annotations

import gzip
import re
import subprocess
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np
import osmium
import pytest

from app.exports.writing.osm_files import damage_told, merged, read_nodes
from fusion.errors import BadOptionsError, RoadsError
from fusion.roads.node_heights import node_heights
from fusion.roads.osm import DRIVABLE
from sumo_support import sumo_program

ELE = re.compile(r"-?\d+\.\d\d")
Mapped = Any  # of conftest, which cannot be imported


@dataclass
class OsmXml:
    """An OSM XML file, read by nothing of ours."""

    root: Element

    @classmethod
    def of(cls, path: Path) -> OsmXml:
        data = path.read_bytes()
        if path.suffix == ".gz":
            data = gzip.decompress(data)
        return cls(defusedxml.ElementTree.fromstring(data))

    def nodes(self) -> dict[int, Element]:
        return {int(node.attrib["id"]): node for node in self.root.findall("node")}

    def ways(self) -> dict[int, Element]:
        return {int(way.attrib["id"]): way for way in self.root.findall("way")}


def tags(element: Element) -> dict[str, str]:
    return {tag.attrib["k"]: tag.attrib["v"] for tag in element.findall("tag")}


def refs(way: Element) -> list[int]:
    return [int(nd.attrib["ref"]) for nd in way.findall("nd")]


def checked(path: Path, least: int = 100) -> dict[int, float]:
    """The grammar: a version, nodes before ways, every node of a highway with one plain number; the heights."""
    file = OsmXml.of(path)
    assert file.root.tag == "osm" and file.root.attrib["version"] == "0.6"
    kinds = [child.tag for child in file.root if child.tag in ("node", "way", "relation")]
    assert kinds == sorted(kinds, key=["node", "way", "relation"].index)
    nodes, heights = file.nodes(), {}
    for way in file.ways().values():
        if "highway" not in tags(way):
            continue
        for node in refs(way):
            value = tags(nodes[node])["ele"]
            assert ELE.fullmatch(value)
            heights[node] = float(value)
    assert len(heights) > least
    return heights


@pytest.fixture(scope="module")
def written(mapped: Mapped, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, list[str]]:
    path = tmp_path_factory.mktemp("ele") / "town.osm"
    return path, *mapped.write("osm-ele", path)


def test_every_road_node_has_a_height_and_measured_ones_have_what_was_measured(
    mapped: Mapped, written: tuple[Path, int, list[str]]
) -> None:
    path, count, notes = written
    heights = checked(path)
    assert count == len(heights)
    assert set(heights) == set(read_nodes([mapped.osm], roads_only=False).node.tolist())
    for node, height in mapped.heights.items():
        assert heights[node] == pytest.approx(height, abs=0.006)
    assert f"{count} nodes of roads have a height: {len(mapped.heights)} measured" in notes[0]
    generator = OsmXml.of(path).root.attrib["generator"]
    assert "ele: metres above mean sea level & so on; Roads © OpenStreetMap contributors" in generator


def test_unmeasured_roads_follow_the_ground_shifted_to_the_datum_of_what_was_measured(
    mapped: Mapped, written: tuple[Path, int, list[str]]
) -> None:
    heights, town = checked(written[0]), mapped.town
    truth = {int(n): h + 3.0 for n, h in zip(town.node_id, town.node_height_m, strict=True)}
    off = np.array([heights[node] - truth[node] for node in heights if node not in mapped.heights])
    assert len(off) > 50
    with mapped.source() as source:
        ground = source.ground_heights(town.node_lon_deg, town.node_lat_deg)
    dem_off = np.abs(ground - town.node_height_m)
    # Far nearer than the raster is, and in the right datum: a shift of 3 m would show in the median.
    assert np.median(off) == pytest.approx(0.0, abs=0.8)
    assert np.sqrt(np.mean(off**2)) < 0.7 * np.sqrt(np.nanmean(dem_off**2))


def test_no_step_appears_where_measured_heights_end(
    mapped: Mapped, written: tuple[Path, int, list[str]]
) -> None:
    heights, town = checked(written[0]), mapped.town
    nodes = read_nodes([mapped.osm], roads_only=False)
    h = np.array([heights[int(node)] for node in nodes.node])
    truth = dict(zip(town.node_id.tolist(), town.node_height_m.tolist(), strict=True))
    true_m = np.array([truth[int(node)] for node in nodes.node])
    with mapped.source() as source:
        ground = source.ground_heights(nodes.graph.lon_deg, nodes.graph.lat_deg)
    measured = np.isin(nodes.node, list(mapped.heights))
    a, b = nodes.graph.edge.T
    rim = (measured[a] != measured[b]) & ~nodes.graph.structure & np.isfinite(ground[a] + ground[b])
    assert np.count_nonzero(rim) > 20

    def error(height_m: np.ndarray) -> float:
        """Of the grades at the rim, RMS."""
        off = (height_m[b] - height_m[a]) - (true_m[b] - true_m[a])
        return float(np.sqrt(np.mean((off[rim] / nodes.graph.length_m[rim]) ** 2)))

    side_by_side = np.where(measured, h, ground + np.nanmedian((h - ground)[measured]))
    assert error(h) < 0.5 * error(side_by_side)


def test_ends_of_bridges_and_tunnels_are_nearer_to_the_truth_than_the_ground_is(mapped: Mapped) -> None:
    nodes, town = read_nodes([mapped.osm], roads_only=False), mapped.town
    truth = dict(zip(town.node_id.tolist(), town.node_height_m.tolist(), strict=True))
    true_m = np.array([truth[int(node)] for node in nodes.node])
    with mapped.source() as source:
        ground = source.ground_heights(nodes.graph.lon_deg, nodes.graph.lat_deg)
    ends = np.unique(nodes.graph.edge[nodes.graph.structure])
    assert len(ends) > 10
    found = node_heights(nodes.graph, ground, np.full(len(ground), np.nan)).height_m
    off, off_ground = ((h - true_m)[ends] for h in (found, ground))
    assert np.sqrt(np.mean(off**2)) < 0.6 * np.sqrt(np.mean(off_ground**2))


def test_all_suffixes_hold_the_same_and_twice_the_same_bytes(
    mapped: Mapped, written: tuple[Path, int, list[str]], tmp_path: Path
) -> None:
    heights = checked(written[0])
    mapped.write("osm-ele", tmp_path / "again.osm")
    assert (tmp_path / "again.osm").read_bytes() == written[0].read_bytes()
    mapped.write("osm-ele", tmp_path / "town.osm.gz")
    assert checked(tmp_path / "town.osm.gz") == heights
    for name in ("town.osm.pbf", "twice.osm.pbf"):
        mapped.write("osm-ele", tmp_path / name)
    assert (tmp_path / "town.osm.pbf").read_bytes() == (tmp_path / "twice.osm.pbf").read_bytes()
    found = {
        n.id: float(n.tags["ele"]) for n in osmium.FileProcessor(tmp_path / "town.osm.pbf", osmium.osm.NODE)
    }
    assert found == heights
    with osmium.io.Reader(str(tmp_path / "town.osm.pbf")) as reader:
        assert "metres above mean sea level" in reader.header().get("generator")
    with pytest.raises(BadOptionsError, match=r"writes \.osm\.pbf"):
        mapped.write("osm-ele", tmp_path / "town.txt")


def test_a_file_of_one_s_own_keeps_all_that_it_has(mapped: Mapped, tmp_path: Path) -> None:
    own = tmp_path / "own.osm"
    first = str(next(iter(mapped.heights)))
    text = mapped.osm.read_text()
    text = re.sub(
        rf'(<node id="{first}" [^/]*)/>', r'\1><tag k="ele" v="7"/><tag k="barrier" v="gate"/></node>', text
    )
    stranger = '<node id="-5" lat="47.9901" lon="7.8501" version="1"/>'
    path = f'<way id="-6" version="1"><nd ref="-5"/><nd ref="{first}"/><tag k="highway" v="path"/></way>'
    text = text.replace("<way ", stranger + "\n<way ", 1).replace("<relation", path + "\n<relation", 1)
    own.write_text(text)
    _, notes = mapped.write("osm-ele", tmp_path / "out.osm", osm=str(own))
    heights, before, after = checked(tmp_path / "out.osm"), OsmXml.of(own), OsmXml.of(tmp_path / "out.osm")
    assert -5 in heights and abs(heights[-5] - heights[int(first)]) < 60
    assert any("1 nodes had another ele" in note for note in notes)
    assert tags(after.nodes()[int(first)]) == {"ele": f"{heights[int(first)]:.2f}", "barrier": "gate"}
    assert len(after.root.findall("relation")) == len(before.root.findall("relation")) == 1
    houses = [n for n in before.nodes() if n not in heights]
    assert houses
    for kind in ("nodes", "ways"):
        old, new = getattr(before, kind)(), getattr(after, kind)()
        assert set(old) == set(new)
        for number, element in old.items():
            left = {k: v for k, v in tags(new[number]).items() if number not in heights or k != "ele"}
            assert left == {k: v for k, v in tags(element).items() if number not in heights or k != "ele"}
            assert refs(element) == refs(new[number])


def test_a_box_takes_the_ways_that_meet_it_whole(mapped: Mapped, tmp_path: Path) -> None:
    mapped.write("osm-ele", tmp_path / "part.osm", bbox=(7.848, 47.988, 7.852, 47.992))
    part, whole = OsmXml.of(tmp_path / "part.osm"), OsmXml.of(mapped.osm)
    checked(tmp_path / "part.osm", least=20)
    assert 0 < len(part.ways()) < len(whole.ways()) / 2
    for number, way in part.ways().items():
        assert refs(way) == refs(whole.ways()[number])
        assert set(refs(way)) <= set(part.nodes())
    with pytest.raises(RoadsError, match="no road with the positions of its nodes in this box"):
        mapped.write("osm-ele", tmp_path / "none.osm", bbox=(1.0, 1.0, 1.1, 1.1))


def test_a_file_that_is_none_is_named(mapped: Mapped, tmp_path: Path) -> None:
    (tmp_path / "x.osm").write_text("<osm><node")
    with pytest.raises(RoadsError, match=r"x\.osm: damaged"):
        mapped.write("osm-ele", tmp_path / "out.osm", osm=str(tmp_path / "x.osm"))


def test_sumo_s_netconvert_makes_edges_with_these_heights(
    written: tuple[Path, int, list[str]], tmp_path: Path
) -> None:
    netconvert = sumo_program("netconvert")
    types = tmp_path / "types.xml"
    kinds = "".join(f'<type id="highway.{kind}" numLanes="1" speed="13.9"/>' for kind in sorted(DRIVABLE))
    types.write_text(f"<types>{kinds}</types>")
    net = tmp_path / "net.xml"
    command = [netconvert, "--osm-files", str(written[0]), "--osm.elevation", "--type-files", str(types)]
    done = subprocess.run(
        [*command, "-o", str(net), "--no-warnings", "--offset.disable-normalization"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    heights = checked(written[0])
    root = defusedxml.ElementTree.fromstring(net.read_bytes())
    junctions = [j for j in root.findall("junction") if not j.attrib["id"].startswith(":")]
    assert len(junctions) > 50
    for junction in junctions:
        assert float(junction.attrib["z"]) == pytest.approx(heights[int(junction.attrib["id"])], abs=0.011)
    rises = 0
    for edge in root.findall("edge"):
        if "shape" in edge.attrib:  # bends between junctions
            z = [float(place.split(",")[2]) for place in edge.attrib["shape"].split()]
            rises += any(abs(p - q) > 0.05 for p, q in pairwise(z))
            assert min(heights.values()) - 0.01 <= min(z) and max(z) <= max(heights.values()) + 0.01
    assert rises > 20


def test_a_file_that_an_import_replaces_meanwhile_is_told_as_that(tmp_path: Path) -> None:
    path = tmp_path / "roads.osm"
    path.write_text("<osm version='0.6'></osm>")
    with pytest.raises(RoadsError, match="imported anew meanwhile"), damage_told([path]):
        path.unlink()
        list(merged([path]))
