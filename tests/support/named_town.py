"""A cross of streets with a place in its middle and a river beside: what has names on a map."""

from __future__ import annotations

from pathlib import Path

import osmium
from osmium.osm.mutable import Node, Way

LON, LAT, STEP = 8.69, 49.41, 0.004
FIRST_ID = 9000
"""Of nodes and ways: other roads of tests have smaller ones."""


def nodes(first: int, end: int) -> list[int]:
    return [FIRST_ID + n for n in range(first, end)]


def write_named_town(file: Path) -> Path:
    """The town as an extract of OpenStreetMap."""
    with osmium.SimpleWriter(str(file)) as writer:
        for n in range(-9, 10):
            writer.add_node(Node(id=FIRST_ID + 10 + n, location=(LON + n * STEP, LAT), version=1))
            writer.add_node(Node(id=FIRST_ID + 30 + n, location=(LON, LAT + n * STEP), version=1))
            writer.add_node(Node(id=FIRST_ID + 50 + n, location=(LON + n * STEP, LAT - STEP / 2), version=1))
        tags = {"place": "town", "name": "Łódź", "population": "1500"}
        writer.add_node(
            Node(id=FIRST_ID + 70, location=(LON + 1.5 * STEP, LAT + 1.5 * STEP), tags=tags, version=1)
        )
        main = {"highway": "primary", "name": "Große Straße", "ref": "B 37"}
        writer.add_way(Way(id=FIRST_ID + 1, nodes=nodes(1, 20), tags=main, version=1))
        lane = {"highway": "residential", "name": "Şirin Çeşme"}
        writer.add_way(Way(id=FIRST_ID + 2, nodes=nodes(21, 40), tags=lane, version=1))
        river = {"waterway": "river", "name": "Neckar"}
        writer.add_way(Way(id=FIRST_ID + 3, nodes=nodes(41, 60), tags=river, version=1))
    return file
