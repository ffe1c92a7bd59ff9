"""Names of the map: which are read beside the roads, and that files kept for changes have them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import osmium
import pytest
from osmium.osm.mutable import Node, Way

from fusion.roads.names import LONGEST_NAME, MapNames
from fusion.roads.osm import read_roads
from fusion.roads.osm_changes import apply_changes, keep_roads

CORNERS = {1: (8.40, 49.00), 2: (8.41, 49.01), 3: (8.42, 49.01), 4: (8.43, 49.02)}


def place(number: int, **tags: str) -> Node:
    return Node(id=number, location=(8.4 + number / 1e4, 49.0), tags=tags, version=1)


def way(number: int, nodes: list[int], **tags: str) -> Way:
    return Way(id=number, nodes=nodes, tags=tags, version=1)


NODES = [
    place(10, place="city", name="Großstadt", population="1 234.567"),
    place(11, place="village", name="  Łódź\n Dolna "),
    place(12, place="hamlet"),
    place(13, place="locality", name="At the stone"),
    place(14, place="suburb", name="x" * (LONGEST_NAME + 1)),
    place(15, place="town", name="Ytown", population="many"),
]
WAYS = [
    way(20, [1, 2, 3], highway="primary", name="High Street", ref="B 37"),
    way(21, [3, 4], highway="residential", name="Lane", ref="7"),
    way(22, [1, 99, 3], waterway="river", name="Neckar"),
    way(23, [1, 99], waterway="stream", name="Nowhere"),
    way(24, [2, 3], waterway="stream"),
    way(25, [2, 4], waterway="ditch", name="Ditch"),
    way(26, [2, 4], highway="footway", waterway="canal", name="Canal", ref="9"),
]


def written(path: Path, nodes: list[Node] = NODES, ways: list[Way] = WAYS) -> Path:
    with osmium.SimpleWriter(str(path)) as writer:
        for number, at in CORNERS.items():
            writer.add_node(Node(id=number, location=at, version=1))
        for node in nodes:
            writer.add_node(node)
        for one in ways:
            writer.add_way(one)
    return path


def read(path: Path) -> MapNames:
    names = MapNames()
    read_roads(path, names=names)
    return names


def rows(names: MapNames) -> list[tuple[Any, ...]]:
    columns = (names.layer, names.osm_id, names.kind, names.name, names.population)
    return sorted(zip(*columns, strict=True))


WANTED = [
    ("places", 10, "city", "Großstadt", 1234567),
    ("places", 11, "village", "Łódź Dolna", None),
    ("places", 15, "town", "Ytown", None),
    ("roads", 20, "primary", "B 37", None),
    ("water", 22, "river", "Neckar", None),
    ("water", 26, "canal", "Canal", None),
]


@pytest.mark.parametrize("suffix", ["osm", "osm.gz", "osm.pbf"])
def test_names_of_every_format(tmp_path: Path, suffix: str) -> None:
    names = read(written(tmp_path / f"town.{suffix}"))
    assert rows(names) == WANTED
    lines = dict(zip(zip(names.layer, names.osm_id, strict=True), names.lines_deg(), strict=True))
    np.testing.assert_array_equal(lines["places", 10], [[8.401, 49.0]])
    np.testing.assert_array_equal(lines["roads", 20], [CORNERS[1], CORNERS[2], CORNERS[3]])
    # The extract lacks the node in the middle.
    np.testing.assert_array_equal(lines["water", 22], [CORNERS[1], CORNERS[3]])


def test_the_roads_are_the_same_with_names_and_without(tmp_path: Path) -> None:
    file = written(tmp_path / "town.osm.pbf")
    plain, beside = read_roads(file), read_roads(file, names=MapNames())
    for column in plain.columns():
        np.testing.assert_array_equal(getattr(plain, column), getattr(beside, column))
    assert set(plain.osm_way_id.tolist()) == {20, 21}


def test_files_kept_for_changes_have_the_names_and_changes_change_them(tmp_path: Path) -> None:
    kept = tmp_path / "kept.osm.pbf"
    keep_roads(written(tmp_path / "town.osm.pbf"), kept)
    assert rows(read(kept)) == WANTED
    assert not list(
        osmium.FileProcessor(str(kept), osmium.osm.WAY).with_filter(osmium.filter.IdFilter([24, 25]))
    )
    changes = tmp_path / "day.osc"
    changes.write_text("""<osmChange version="0.6">
        <modify><node id="11" version="2" lat="49.0" lon="8.4011"><tag k="place" v="town"/><tag k="name" v="Grown"/>
        </node></modify>
        <create><node id="16" version="1" lat="60.0" lon="8.4"><tag k="place" v="city"/><tag k="name" v="Far"/></node>
        </create>
        <delete><way id="22" version="2"/></delete></osmChange>""")
    updated = tmp_path / "updated.osm.pbf"
    apply_changes(kept, changes, updated, (8.3, 48.9, 8.5, 49.1))
    assert [row[:4] for row in rows(read(updated))] == [
        ("places", 10, "city", "Großstadt"),
        ("places", 11, "town", "Grown"),
        ("places", 15, "town", "Ytown"),
        ("roads", 20, "primary", "B 37"),
        ("water", 26, "canal", "Canal"),
    ]
