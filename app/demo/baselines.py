"""What one has without Versant, and one thing that nobody has: the true heights of a structure's ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.cli.console import Bars
from app.cli.fuse_files import Fusion
from app.demo.score import Estimate, SegmentKey
from fusion.pipeline import parse_options
from fusion.simulate.demonstration import Demonstration
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem


def feature_key(feature: Mapping[str, Any]) -> SegmentKey:
    """The identity of a segment."""
    properties = feature["properties"]
    return int(properties["osm_way_id"]), int(properties["from_node"]), int(properties["to_node"])


def baselines(
    bundle: Demonstration, features: Sequence[Mapping[str, Any]], bars: Bars
) -> dict[str, dict[SegmentKey, Estimate]]:
    """A line through the raw altitudes, the DEM's heights at a segment's ends, and ``straight_lines``."""
    terrain = {
        feature_key(f): Estimate(f["properties"]["dem_slope_percent"], float("nan"))
        for f in features
        if f["properties"]["dem_slope_percent"] is not None
    }
    return {"raw": _raw(bundle, bars), "dem": terrain, "straight": straight_lines(bundle.town)}


def straight_lines(town: Town) -> dict[SegmentKey, Estimate]:
    """Every segment of a bridge or tunnel: the straight line between the road's true heights at the structure's ends.

    A structure is a way (``town`` cuts ways where their kind changes). Real elevation models know these heights to
    metres at best, so that this is the best that guessing can do.
    """
    roads, lines = town.roads, {}
    structure = roads.bridge | roads.tunnel
    for way in np.unique(roads.osm_way_id[structure]):
        of_way = np.flatnonzero(roads.osm_way_id == way)
        # Segments are drawn the same way round: one end is nobody's to_node, the other nobody's from_node.
        (first,) = set(town.start[of_way].tolist()) - set(town.end[of_way].tolist())
        (last,) = set(town.end[of_way].tolist()) - set(town.start[of_way].tolist())
        rise = town.node_height_m[last] - town.node_height_m[first]
        slope = 100 * float(rise / town.length_m[of_way].sum())
        for k in of_way.tolist():
            key = int(roads.osm_way_id[k]), int(roads.from_node[k]), int(roads.to_node[k])
            lines[key] = Estimate(slope, float("nan"))
    return lines


def _raw(bundle: Demonstration, bars: Bars) -> dict[SegmentKey, Estimate]:
    with Dem.open([bundle.dem]) as dem:
        raw = Fusion("raw", parse_options("raw"), bundle.town.roads, dem)
        show = bars.work("baseline raw")
        for k, path in enumerate(bundle.drives):
            show(path.name, k / len(bundle.drives))
            raw.add(path)
        slopes = raw.features()
    return {
        (s.osm_way_id, s.from_node, s.to_node): Estimate(
            _number(s.slope_percent), _number(s.slope_sigma_percent)
        )
        for s in slopes
    }


def _number(value: float | None) -> float:
    return float(np.nan) if value is None else value
