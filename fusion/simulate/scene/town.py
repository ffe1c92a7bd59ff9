"""A synthetic town whose every road height and slope is known: data, from which drives and files are made elsewhere.

Its ground is a random smooth field with a hill for the tunnel and a valley for bridges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fusion.frames import LocalProjection
from fusion.roads.table import RoadTable
from fusion.simulate.scene.plan import Plan
from fusion.simulate.scene.segments import (
    Way,
    cut_into_ways,
    hermite,
    node_heights,
    node_ids,
    regression_slope,
    tabulate,
)
from fusion.simulate.scene.streets import draw_grid, draw_outskirts
from fusion.types import Floats, Ints

HALF_SIZE_M = 1000.0
"""The town reaches this far from its centre in either direction."""
GEOID_UNDULATION_M = 48.0
"""Height of EGM96 above WGS 84 assumed over the whole town."""
_HILL_XY_M = (-500.0, -160.0)
_VALLEY_X_M = 500.0
_TUNNEL_HILL_M = 25.0
_VALLEY_DEPTH_M = 16.0
_HILL_WIDTH_M = 145.0
"""One sigma of the Gaussian across the hill, as that of the valley beside it."""
_VALLEY_WIDTH_M = 85.0
_WAVES = 40
"""Plane waves whose sum is the random part."""
_ROUGHNESS = 0.030
"""Root mean square grade of the random part."""


@dataclass(frozen=True)
class Terrain:
    """Ground height above EGM96 over the town's plane (x east, y north, metres from its centre).

    The random part is a sum of plane waves (wavelengths 350 to 1500 m), so that height and gradient are
    smooth and known everywhere.
    """

    base_m: float
    tilt: Floats
    wave_x: Floats
    wave_y: Floats
    phase: Floats
    amplitude_m: Floats
    hill_m: float = _TUNNEL_HILL_M
    valley_m: float = _VALLEY_DEPTH_M

    @classmethod
    def random(cls, rng: np.random.Generator) -> Terrain:
        """Draw a terrain; its random part has a root mean square grade of 3 % in every direction together."""
        length_m = np.exp(rng.uniform(np.log(350.0), np.log(1500.0), _WAVES))
        direction = rng.uniform(0.0, 2 * np.pi, _WAVES)
        wave = 2 * np.pi / length_m
        grade = rng.uniform(0.5, 1.0, _WAVES) * _ROUGHNESS * np.sqrt(2 / _WAVES)
        return cls(
            base_m=float(rng.uniform(200.0, 320.0)),
            tilt=rng.normal(0.0, 0.01, 2),
            wave_x=wave * np.cos(direction),
            wave_y=wave * np.sin(direction),
            phase=rng.uniform(0.0, 2 * np.pi, _WAVES),
            amplitude_m=grade / wave,
        )

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Ground height in metres at points of any one shape."""
        x, y = np.asarray(x_m, float), np.asarray(y_m, float)
        z = self.base_m + self.tilt[0] * x + self.tilt[1] * y
        for a, kx, ky, p in zip(self.amplitude_m, self.wave_x, self.wave_y, self.phase, strict=True):
            z = z + a * np.sin(kx * x + ky * y + p)
        far2 = ((x - _HILL_XY_M[0]) ** 2 + (y - _HILL_XY_M[1]) ** 2) / _HILL_WIDTH_M**2
        z = z + self.hill_m * np.exp(-far2 / 2)
        across = (x - _VALLEY_X_M - 30.0 * np.sin(y / 260.0)) / _VALLEY_WIDTH_M
        return np.asarray(z - self.valley_m * np.exp(-(across**2) / 2))


CENTRE_LON_DEG, CENTRE_LAT_DEG = 7.85, 47.99
"""The fictional town's centre; the place is chosen only so that its plane and DEM posting are typical."""


@dataclass(frozen=True)
class Town:
    """Roads with known heights. Arrays marked [n] run over the segments, in the order of ``roads``.

    Between its nodes a segment's height is a cubic whose grade is continuous along the street; kinks remain
    where streets meet. ``true_slope_percent`` is the slope of the least-squares line through the whole
    segment (what a truth made from a reference track would measure), positive uphill from from_node to
    to_node; the difference of the end heights over the length deviates from it by some tenths of a percent.
    """

    seed: int
    roads: RoadTable
    start: Ints
    """[n] index of from_node in the node arrays"""
    end: Ints
    """[n] index of to_node in the node arrays"""
    grade_start: Floats
    """[n] grade at from_node, a fraction, in the direction of drawing"""
    grade_end: Floats
    """[n] grade at to_node"""
    length_m: Floats
    """[n] length on the town's plane"""
    true_slope_percent: Floats
    """[n] true slope"""
    node_id: Ints
    """[m] OpenStreetMap ids of the nodes"""
    node_lon_deg: Floats
    node_lat_deg: Floats
    node_x_m: Floats
    """[m] east of the town's centre, metres"""
    node_y_m: Floats
    node_height_m: Floats
    """[m] height of the road above EGM96, metres"""
    ways: tuple[Way, ...]
    footways: tuple[tuple[int, int], ...]
    terrain: Terrain
    projection: LocalProjection
    curved: bool = False
    """Whether the real road bends smoothly through the nodes, as OpenStreetMap's chords of bends do; the town's streets
    run straight from node to node."""

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Height of the ground (not of bridges), metres above EGM96, at metres from the centre."""
        return self.terrain.height(x_m, y_m)

    def road_height(self, segment: Ints, share: Floats) -> Floats:
        """Height of the road, metres above EGM96, at ``share`` 0..1 of the way from from_node to to_node."""
        k = np.asarray(segment)
        z0, z1 = self.node_height_m[self.start[k]], self.node_height_m[self.end[k]]
        return hermite(z0, z1, self.grade_start[k], self.grade_end[k], self.length_m[k], share)

    @cached_property
    def junction_degree(self) -> Ints:
        """[m] number of segment ends at each node."""
        return np.bincount(np.r_[self.start, self.end], minlength=len(self.node_id)).astype(np.int64)


def make_town(seed: int = 1) -> Town:
    """Make the town of a seed: about 2 x 2 km, some 470 segments; the same on every machine to rounding."""
    terrain = Terrain.random(np.random.default_rng([seed, 0]))
    plan = Plan(np.random.default_rng([seed, 1]))
    draw_outskirts(draw_grid(plan))
    return Town(**tabulated(seed, plan, terrain, LocalProjection(CENTRE_LON_DEG, CENTRE_LAT_DEG)))


def tabulated(seed: int, plan: Plan, terrain: Terrain, projection: LocalProjection) -> dict[str, Any]:
    """What a ``Town`` holds, by name, from a plan whose streets are all drawn: heights, ways, segments, slopes."""
    height = node_heights(plan, terrain.height(np.array(plan.x_m), np.array(plan.y_m)))
    ways = cut_into_ways(plan, height)
    lon, lat = projection.to_lonlat(np.array(plan.x_m), np.array(plan.y_m))
    lon, lat = np.round(lon, 7), np.round(lat, 7)  # what OpenStreetMap stores
    x, y = projection.to_xy(lon, lat)
    cut = tabulate(ways, lon, lat)
    length = np.hypot(x[cut.end] - x[cut.start], y[cut.end] - y[cut.start])
    slope = regression_slope(height[cut.start], height[cut.end], cut.grade_start, cut.grade_end, length)
    return {
        "seed": seed,
        **vars(cut),
        "length_m": length,
        "true_slope_percent": 100 * slope,
        "node_id": node_ids(len(x)),
        "node_lon_deg": lon,
        "node_lat_deg": lat,
        "node_x_m": x,
        "node_y_m": y,
        "node_height_m": height,
        "ways": tuple(ways),
        "footways": tuple(plan.footways),
        "terrain": terrain,
        "projection": projection,
    }
