"""Mean grades between known heights: what the segments of a way add up to, and that the tool adds them up alike."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from accuracy.sequences import load_tool, quietly, tool_beside
from accuracy.stretches import Stretch, find_stretches, grade_sigma_percent
from fusion.roads.osm import read_roads

WAY = ((1, 1, 2), (1, 2, 3), (2, 4, 3))


def test_slopes_add_up_to_a_mean_grade_along_the_way() -> None:
    # the last 20 m of the first segment, all of the second, and half of the third against its direction
    stretch = Stretch(200.0, 5.0, WAY, np.array([0.2, 1.0, -0.5]), np.array([100.0, 120.0, 120.0]))
    slopes = {WAY[0]: (1.0, 0.5), WAY[1]: (4.0, 1.0), WAY[2]: (-2.0, 2.0)}
    assert stretch.grade_percent(slopes) == pytest.approx((20 * 1.0 + 120 * 4.0 + 60 * 2.0) / 200)
    assert stretch.true_grade_percent() == 2.5
    assert grade_sigma_percent(stretch, slopes) == pytest.approx(np.sqrt(10**2 + 120**2 + 120**2) / 200)
    assert stretch.grade_percent({WAY[0]: (1.0, 0.5)}) is None


# The tool leaves the closing of files to the collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_the_tool_adds_slopes_up_alike(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "storuman"
    path = tool_beside(folder, "stretches.py")
    if not (folder.is_dir() and path.exists()):
        pytest.skip("../shared/data/storuman or ../shared/tools/stretches.py is not on this machine")
    tool = load_tool(path)
    roads = read_roads(folder / "roads.osm")
    drawn = np.random.default_rng(1).normal(size=len(roads))
    keys = zip(*(c.tolist() for c in (roads.osm_way_id, roads.from_node, roads.to_node)), strict=True)
    slopes = {key: (slope, 1.0) for key, slope in zip(keys, drawn.tolist(), strict=True)}
    names = ("osm_way_id", "from_node", "to_node", "slope_percent")
    features = [{"properties": dict(zip(names, (*key, s), strict=True))} for key, (s, _) in slopes.items()]
    file = tmp_path / "slopes.geojson"
    file.write_text(json.dumps({"features": features}))
    heights, map_file = folder / "heights.csv", folder / "roads.osm"
    said = json.loads(quietly(tool.score, fix=str(heights), roads=str(map_file), slopes=str(file), logs=[]))
    stretches = find_stretches(tool, heights, map_file)
    errors = [(s.grade_percent(slopes) or np.nan) - s.true_grade_percent() for s in stretches]
    assert len(errors) == said["stretches"]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(said["slopes_rmse"], abs=1e-3)
    assert np.median([s.length_m for s in stretches]) == pytest.approx(said["median_length_m"], abs=0.5)
