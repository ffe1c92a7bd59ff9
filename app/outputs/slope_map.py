"""Segments as a picture: the map of their slopes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from app.outputs.features import SegmentFeature
from fusion.plot_map import MapSegments, draw_slope_map
from fusion.roads.table import RoadTable


def slope_map_png(
    path: Path,
    roads: RoadTable,
    features: Iterable[SegmentFeature],
    *,
    title: str,
    credit: str,
) -> None:
    """Draw all ``roads``; those that no feature gives a slope are unknown. Raises ``ValueError`` without any road."""
    draw_slope_map(path, map_segments(roads, features), title=title, credit=credit.replace("$", r"\$"))


def map_segments(roads: RoadTable, features: Iterable[SegmentFeature]) -> MapSegments:
    """The roads with the slopes of those of the features that are among them."""
    known = {(f.osm_way_id, f.from_node, f.to_node): f for f in features}
    slope, sigma = np.full(len(roads), np.nan), np.full(len(roads), np.nan)
    keys = zip(roads.osm_way_id.tolist(), roads.from_node.tolist(), roads.to_node.tolist(), strict=True)
    for row, key in enumerate(keys):
        feature = known.get(key)
        if feature is not None and feature.slope_percent is not None:
            slope[row] = feature.slope_percent
            sigma[row] = np.nan if feature.slope_sigma_percent is None else feature.slope_sigma_percent
    return MapSegments(
        lon0_deg=roads.lon0_deg,
        lat0_deg=roads.lat0_deg,
        lon1_deg=roads.lon1_deg,
        lat1_deg=roads.lat1_deg,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        bridge=roads.bridge,
        tunnel=roads.tunnel,
    )
