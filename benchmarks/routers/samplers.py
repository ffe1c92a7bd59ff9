"""How routers take heights out of HGT tiles, after their sources; nothing of this project's own fit is known here.

Valhalla      ``src/skadi/sample.cc``: bilinear between the four posts. Grades (``src/mjolnir/elevationbuilder.cc``,
              ``src/skadi/util.cc``): heights every 60 m along an edge and at its end, bridges and tunnels in proportion
              between their ends; each difference over 60 m, also the last; the mean with weights of energy
GraphHopper   ``HeightTile.getHeight``: without interpolation the post of one of 3601 equal parts of a degree, with it
              bilinear; at each node, bridges and tunnels in proportion between their ends
              (``EdgeElevationInterpolator``)
BRouter       ``ElevationRaster.getElevation``: bilinear, cut off to quarters of a metre; at each node, none inside
              bridges and tunnels (``OsmNodeP.getSElev``)
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fusion.types import Floats

POSTING_M = 60.0
SHORTEST_M = 10.0
VOID = -32768

Sampler = Callable[[Floats, Floats], Floats]


class HgtTile:
    """One tile of 3601 x 3601 posts."""

    def __init__(self, path: Path) -> None:
        self.z = np.frombuffer(path.read_bytes(), ">i2").reshape(3601, 3601).astype(float)

    def bilinear(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """Heights at places (n,), m."""
        last = len(self.z) - 1
        u, v = (lon_deg - np.floor(lon_deg)) * last, (1 - (lat_deg - np.floor(lat_deg))) * last
        x, y = np.floor(u).astype(int), np.floor(v).astype(int)
        a, b = u - x, v - y
        z = np.where(self.z == VOID, np.nan, self.z)
        upper = (1 - a) * z[y, x] + a * z[y, x + 1]
        return np.asarray((1 - b) * upper + b * ((1 - a) * z[y + 1, x] + a * z[y + 1, x + 1]))

    def one_post(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """As GraphHopper without interpolation."""
        n = len(self.z)
        x = np.minimum((n * (lon_deg - np.floor(lon_deg))).astype(int), n - 1)
        y = np.maximum(n - 1 - (n * (lat_deg - np.floor(lat_deg))).astype(int), 0)
        return np.asarray(self.z[y, x])

    def quarters(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """As BRouter."""
        return np.asarray(np.trunc(4 * self.bilinear(lon_deg, lat_deg)) / 4)


def samplers(tile: HgtTile) -> dict[str, Sampler]:
    """By the routers' names."""
    return {
        "GraphHopper, bilinear": tile.bilinear,
        "GraphHopper, one post": tile.one_post,
        "BRouter": tile.quarters,
    }


def stations_m(length_m: float) -> Floats:
    """Where Valhalla looks along an edge: every 60 m, and at the end."""
    return np.append(np.arange(0.0, length_m, POSTING_M), length_m)


def valhalla_grades(height_m: Floats, length_m: float, structure: bool) -> tuple[float, float]:
    """``weighted_grade`` and ``max_upward_grade`` as edges have them, percent, from heights at ``stations_m``."""
    if length_m < SHORTEST_M:
        return 0.0, 0.0
    height = np.asarray(height_m, float)
    if structure:
        height = height[0] + np.arange(len(height)) * (height[-1] - height[0]) / len(height)
    grade = 100 * np.diff(height) / POSTING_M
    bounded = np.clip(grade, -10, 15)
    weight = 1 + bounded / np.where(bounded > 0, 7.0, 17.0)
    mean = float((bounded * weight).sum() / weight.sum())
    return (int(mean * 0.6 + 6.5) - 6) / 0.6, float(np.ceil(max(grade.max(), 0.0)))
