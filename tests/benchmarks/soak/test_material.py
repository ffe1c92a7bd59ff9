"""Maps that change as a soak wants them to: little, and in one way each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.roads.osm import read_roads
from fusion.simulate.scene.town import Town
from fusion.simulate.write.osm_file import write_osm
from soak.material import MOVED_NODES, with_moved_nodes, without_way

Key = tuple[int, int, int]


def roads_of(town: Town, path: Path) -> dict[Key, tuple[float, ...]]:
    """The ends of every segment of the town's map."""
    write_osm(town, path)
    table = read_roads(path)
    keys = zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True)
    ends = np.column_stack([table.lon0_deg, table.lat0_deg, table.lon1_deg, table.lat1_deg]).tolist()
    return dict(zip(keys, map(tuple, ends), strict=True))


def test_nodes_move_and_all_segments_stay(town: Town, tmp_path: Path) -> None:
    before = roads_of(town, tmp_path / "before.osm")
    after = roads_of(with_moved_nodes(town, np.random.default_rng(1)), tmp_path / "after.osm")
    assert before.keys() == after.keys()
    assert MOVED_NODES / 2 <= sum(before[key] != after[key] for key in before) <= 6 * MOVED_NODES


def test_one_way_goes(town: Town, tmp_path: Path) -> None:
    before = roads_of(town, tmp_path / "before.osm")
    after = roads_of(without_way(town, np.random.default_rng(1)), tmp_path / "after.osm")
    gone = before.keys() - after.keys()
    assert after.items() <= before.items()
    assert len({way for way, _, _ in gone}) == 1
