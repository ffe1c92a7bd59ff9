"""OSM files to segments: every format, every tag that counts, and files that cannot be used."""

from __future__ import annotations

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
import osmium
import pytest
from osmium.osm.mutable import Node, Way

from fusion.errors import RoadsError
from fusion.roads.osm import DRIVABLE, read_roads
from fusion.roads.table import RoadTable

NODES = {1: (8.40, 49.00), 2: (8.41, 49.01), 3: (8.42, 49.01), 4: (8.43, 49.02), 5: (8.43, 49.02)}


def write(path: Path, ways: Iterable[Way], nodes: dict[int, tuple[float, float]] = NODES) -> Path:
    with osmium.SimpleWriter(str(path)) as writer:
        for node, location in nodes.items():
            writer.add_node(Node(id=node, location=location, version=1))
        for way in ways:
            writer.add_way(way)
    return path


def road(id: int, nodes: list[int], **tags: str) -> Way:  # noqa: A002
    return Way(id=id, nodes=nodes, tags={"highway": "residential"} | tags, version=1)


def keys(table: RoadTable) -> list[tuple[int, int, int]]:
    return list(zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True))


@pytest.mark.parametrize("suffix", ["osm", "osm.gz", "osm.pbf"])
def test_every_format_gives_the_same_segments(tmp_path: Path, suffix: str) -> None:
    ways = [road(20, [4, 2, 1], name="Übergang", bridge="yes", layer="1"), road(10, [1, 2, 3], tunnel="yes")]
    table = read_roads(write(tmp_path / f"town.{suffix}", ways))
    assert keys(table) == [(10, 1, 2), (10, 2, 3), (20, 2, 1), (20, 4, 2)]
    assert table.lon0_deg.tolist() == [8.40, 8.41, 8.41, 8.43]
    assert table.lat1_deg.tolist() == [49.01, 49.01, 49.00, 49.01]
    assert table.name.tolist() == [None, None, "Übergang", "Übergang"]
    assert table.bridge.tolist() == [False, False, True, True]
    assert table.tunnel.tolist() == [True, True, False, False]
    assert table.layer.tolist() == [0, 0, 1, 1]
    assert set(table.highway) == {"residential"}
    assert not table.skipped


def test_content_counts_and_not_the_name(tmp_path: Path) -> None:
    packed = write(tmp_path / "town.osm.gz", [road(1, [1, 2])]).read_bytes()
    (tmp_path / "blob").write_bytes(packed)
    (tmp_path / "town.osm.pbf").write_bytes(gzip.decompress(packed))
    assert keys(read_roads(tmp_path / "blob")) == keys(read_roads(tmp_path / "town.osm.pbf")) == [(1, 1, 2)]


def test_only_drivable_ways(tmp_path: Path) -> None:
    kinds = [*sorted(DRIVABLE), "footway", "cycleway", "path", "steps", "construction", "busway", "proposed"]
    ways = [road(k, [1, 2], highway=kind) for k, kind in enumerate(kinds, 1)]
    table = read_roads(write(tmp_path / "a.osm", [*ways, Way(id=99, nodes=[1, 2], tags={"building": "yes"})]))
    assert table.highway.tolist() == sorted(DRIVABLE)


@pytest.mark.parametrize(
    ("tags", "oneway"),
    [
        ({}, 0),
        ({"oneway": "yes"}, 1),
        ({"oneway": "true"}, 1),
        ({"oneway": "1"}, 1),
        ({"oneway": "-1"}, -1),
        ({"oneway": "reverse"}, -1),
        ({"oneway": "no"}, 0),
        ({"oneway": "reversible"}, 0),
        ({"junction": "roundabout"}, 1),
        ({"junction": "circular"}, 1),
        ({"junction": "yes"}, 0),
        ({"junction": "roundabout", "oneway": "-1"}, -1),
        ({"highway": "motorway"}, 1),
        ({"highway": "motorway", "oneway": "no"}, 0),
        ({"highway": "motorway_link"}, 0),
    ],
)
def test_oneway(tmp_path: Path, tags: dict[str, str], oneway: int) -> None:
    table = read_roads(write(tmp_path / "a.osm", [road(1, [1, 2], **tags)]))
    assert table.oneway.tolist() == [oneway]


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({}, (False, False, 0)),
        ({"bridge": "no", "tunnel": "no", "layer": "0"}, (False, False, 0)),
        ({"bridge": "viaduct", "layer": "2"}, (True, False, 2)),
        ({"tunnel": "building_passage", "layer": "-1"}, (False, True, -1)),
        ({"layer": "ground"}, (False, False, 0)),
        ({"layer": "1;2"}, (False, False, 0)),
        ({"layer": "70000"}, (False, False, 0)),
    ],
)
def test_structures(tmp_path: Path, tags: dict[str, str], expected: tuple[bool, bool, int]) -> None:
    table = read_roads(write(tmp_path / "a.osm", [road(1, [1, 2], **tags)]))
    assert (bool(table.bridge[0]), bool(table.tunnel[0]), int(table.layer[0])) == expected


def test_pairs_with_a_missing_node_or_without_length_are_counted(tmp_path: Path) -> None:
    ways = [road(1, [1, 2, 77, 3, 4]), road(2, [2, 2, 3]), road(3, [4, 5, 3]), road(4, [78, 79])]
    table = read_roads(write(tmp_path / "a.osm.pbf", ways))
    assert keys(table) == [(1, 1, 2), (1, 3, 4), (2, 2, 3), (3, 5, 3)]
    assert table.skipped == {"node missing from the file": 3, "no length": 2}


def test_a_pair_driven_twice_by_one_way_is_one_segment_per_direction(tmp_path: Path) -> None:
    table = read_roads(write(tmp_path / "a.osm", [road(1, [1, 2, 3, 1, 2, 1])]))
    assert keys(table) == [(1, 1, 2), (1, 2, 1), (1, 2, 3), (1, 3, 1)]


def test_nodes_may_follow_the_ways(tmp_path: Path) -> None:
    path = tmp_path / "overpass.osm"
    path.write_text(
        '<osm version="0.6"><way id="7"><nd ref="2"/><nd ref="1"/><tag k="highway" v="track"/></way>'
        '<node id="1" lat="49.5" lon="8.5"/><node id="2" lat="49.6" lon="8.5"/></osm>'
    )
    table = read_roads(path)
    assert keys(table) == [(7, 2, 1)]
    assert (table.lat0_deg[0], table.lat1_deg[0]) == (49.6, 49.5)


def test_deleted_ways_are_left_out(tmp_path: Path) -> None:
    gone = Way(id=2, nodes=[1, 2], tags={"highway": "track"}, version=2, visible=False)
    path = tmp_path / "a.osh"
    with osmium.SimpleWriter(str(path)) as writer:
        for node, location in NODES.items():
            writer.add_node(Node(id=node, location=location, version=1, visible=True))
        writer.add_way(Way(id=1, nodes=[1, 2], tags={"highway": "track"}, version=1, visible=True))
        writer.add_way(gone)
    assert keys(read_roads(path)) == [(1, 1, 2)]


def town(tmp_path: Path, suffix: str) -> Path:
    nodes = {k: (8 + k / 1000, 49 + (k % 7) / 1000) for k in range(1, 400)}
    return write(tmp_path / f"town.{suffix}", [road(1, list(nodes))], nodes)


@pytest.mark.parametrize("suffix", ["osm", "osm.gz", "osm.pbf"])
def test_a_truncated_file_is_refused(tmp_path: Path, suffix: str) -> None:
    path = town(tmp_path, suffix)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 5])
    with pytest.raises(RoadsError, match=f"town.{suffix} is damaged"):
        read_roads(path)


def test_a_pbf_with_flipped_bytes_is_refused(tmp_path: Path) -> None:
    path = town(tmp_path, "osm.pbf")
    broken = bytearray(path.read_bytes())
    broken[len(broken) // 2 : len(broken) // 2 + 40] = b"\x55" * 40
    path.write_bytes(broken)
    with pytest.raises(RoadsError, match="is damaged"):
        read_roads(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "no OpenStreetMap file"),
        (b"time_s,lat_deg,lon_deg\n1,2,3\n", "no OpenStreetMap file"),
        (b"<gpx></gpx>", "is damaged"),
        (b"<osm version='0.6'></osm>", "holds no drivable way"),
        (gzip.compress(b"not a map", mtime=0), "is damaged"),
    ],
)
def test_files_that_are_no_roads(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "roads.osm"
    path.write_bytes(content)
    with pytest.raises(RoadsError, match=says) as caught:
        read_roads(path)
    assert "roads.osm" in str(caught.value)


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(RoadsError, match=r"absent\.osm cannot be read: No such file"):
        read_roads(tmp_path / "absent.osm")
    with pytest.raises(RoadsError, match="cannot be read: Is a directory"):
        read_roads(tmp_path)


def test_roads_without_positions_say_so(tmp_path: Path) -> None:
    with pytest.raises(RoadsError, match="not the positions of their nodes"):
        read_roads(write(tmp_path / "a.osm", [road(1, [1, 2])], nodes={9: (8.0, 49.0)}))
    with pytest.raises(RoadsError, match="have no length"):
        read_roads(write(tmp_path / "b.osm", [road(1, [4, 5])]))


def test_progress_rises_and_may_abort(tmp_path: Path) -> None:
    shares: list[float] = []
    path = write(tmp_path / "a.osm", [road(1, [1, 2])])
    read_roads(path, lambda stage, share: shares.append(share))
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0

    def abort(stage: str, share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read_roads(path, abort)


@pytest.mark.parametrize(
    "name", ["karlsruhe/roads_00.osm", "karlsruhe/roads_09_10.osm", "comma2k19/roads.osm"]
)
def test_real_extracts_agree_with_a_plain_xml_reading(shared_data: Path, name: str) -> None:
    root = ET.parse(shared_data / name).getroot()  # noqa: S314
    position = {n.get("id"): (n.get("lon"), n.get("lat")) for n in root.iter("node")}
    expected = set()
    for way in root.iter("way"):
        if {t.get("k"): t.get("v") for t in way.iter("tag")}.get("highway") in DRIVABLE:
            refs = [n.get("ref") for n in way.iter("nd")]
            for a, b in pairwise(refs):
                if a in position and b in position and position[a] != position[b]:
                    expected.add((int(way.get("id", "")), int(a or ""), int(b or "")))
    assert set(keys(read_roads(shared_data / name))) == expected


@pytest.mark.slow
def test_real_pbf(shared_data: Path) -> None:
    table = read_roads(shared_data / "maps" / "heidelberg-2024-09.test.osm.pbf")
    assert len(table) > 100_000
    assert len(set(keys(table))) == len(table)
    assert keys(table) == sorted(keys(table))
    assert set(np.unique(table.oneway)) == {-1, 0, 1}
    assert table.bridge.any()
    assert table.tunnel.any()
    assert table.length_m.min() > 0
    assert set(table.oneway[table.highway == "motorway"]) == {1}


def test_a_coordinate_that_is_none_is_damage(tmp_path: Path) -> None:
    (tmp_path / "a.osm").write_text('<osm version="0.6"><node id="1" lat="49.0x" lon="8.0"/></osm>')
    with pytest.raises(RoadsError, match="is damaged"):
        read_roads(tmp_path / "a.osm")
