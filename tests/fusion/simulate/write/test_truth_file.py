"""The true slopes as a file: of the whole town, of what drives covered."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from fusion.simulate.demonstration import Demonstration
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_truth


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def test_truth_of_the_whole_town(tmp_path: Path, town: Town) -> None:
    write_truth(town, tmp_path / "truth.csv")
    rows = rows_of(tmp_path / "truth.csv")
    assert list(rows[0]) == [
        "osm_way_id",
        "from_node",
        "to_node",
        "slope_percent",
        "driven_m",
        "length_m",
        "passes",
    ]
    assert [int(r["osm_way_id"]) for r in rows] == list(town.roads.osm_way_id)
    slopes = [float(r["slope_percent"]) for r in rows]
    np.testing.assert_allclose(slopes, town.true_slope_percent, atol=6e-4)
    assert all(r["passes"] == "1" and r["driven_m"] == r["length_m"] for r in rows)


def test_truth_of_drives_is_what_they_covered(bundle: Demonstration) -> None:
    rows = rows_of(bundle.truth)
    roads = bundle.town.roads
    listed = {(int(r["osm_way_id"]), int(r["from_node"]), int(r["to_node"])): int(r["passes"]) for r in rows}
    long = [p.segment for d in bundle.simulated for p in d.passes() if p.driven_m >= 10]
    counts = np.bincount(long, minlength=len(roads))
    for k in range(len(roads)):
        key = (int(roads.osm_way_id[k]), int(roads.from_node[k]), int(roads.to_node[k]))
        assert listed.get(key, 0) == counts[k]
    assert 0 < len(rows) < len(roads)
