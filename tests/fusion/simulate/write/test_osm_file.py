"""The map that a simulation writes, read back."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import osmium
import pytest

from fusion.roads.osm import read_roads
from fusion.simulate.demonstration import Demonstration
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.osm_file import write_osm


@pytest.mark.parametrize("seed", (1, 2, 3))
def test_the_map_reads_back_as_the_same_roads(tmp_path: Path, seed: int) -> None:
    town = make_town(seed)
    write_osm(town, tmp_path / "town.osm")
    roads = read_roads(tmp_path / "town.osm")
    for column in roads.columns():
        np.testing.assert_array_equal(getattr(roads, column), getattr(town.roads, column), err_msg=column)
    assert not roads.skipped


def test_the_map_holds_what_readers_must_pass_over(bundle: Demonstration) -> None:
    tags = [dict(w.tags) for w in osmium.FileProcessor(str(bundle.osm), osmium.osm.WAY)]
    assert sum(t.get("highway") == "footway" for t in tags) >= 3
    assert sum("building" in t for t in tags) >= 20
    assert sum(t.get("junction") == "roundabout" and "oneway" not in t for t in tags) == 3
    motorways = [t for t in tags if t.get("highway") == "motorway"]
    assert 0 < sum("oneway" in t for t in motorways) < len(motorways)
    assert any(t.get("oneway") == "-1" for t in tags)
    assert any(t.get("tunnel") == "yes" and t["layer"] == "-1" for t in tags)


def test_every_node_of_a_way_is_in_the_file(bundle: Demonstration) -> None:
    root = ET.parse(bundle.osm).getroot()  # noqa: S314  (our own file)
    nodes = [n.get("id") for n in root.iter("node")]
    assert len(nodes) == len(set(nodes))
    assert {nd.get("ref") for nd in root.iter("nd")} <= set(nodes)
