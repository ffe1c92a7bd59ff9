"""Real roads over made ground: true heights everywhere, an erring elevation model, and drives that are solved together.

Roads keep to the ground as ``fusion.simulate`` lets streets do: within decimetres, with smooth grades; larger ones, and
what crosses another road at a second level, on banks and in cuttings of metres. The elevation model knows the ground
alone: no bridge, no bank, no cutting, and errs as that of a simulated town.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import shapely
from scipy.sparse.csgraph import connected_components

from fusion.frames import LocalProjection
from fusion.roads.table import RoadTable
from fusion.simulate.motion.routes import Arcs
from fusion.simulate.scene.plan import BRIDGE, GROUND, TUNNEL, Kind, Plan
from fusion.simulate.scene.segments import node_grades, node_heights, regression_slope
from fusion.simulate.scene.town import Terrain, Town
from fusion.simulate.write.dem_file import ERROR_LENGTH_M, ERROR_SIGMA_M, correlated_field
from fusion.terrain.corrected.files import HGT_VOID, tile_name
from fusion.terrain.corrected.grids import ArcSeconds, posting_m
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats, Ints
from privacy.city import City, Window

WINDOW: Window = (8.645, 49.385, 8.70, 49.42)
"""Heidelberg: the plain, the Neckar with its bridges, the foot of the hills."""
MARGIN_DEG = 0.02
BANKED = frozenset({"motorway", "motorway_link", "trunk", "trunk_link", "primary", "secondary"})
CLEARANCE_M = 6.0
NEAR_CROSSING_M = 120.0
RELIEF_BLUR_POSTS = 1.5
"""Of a given relief, three seconds of arc apart: its noise is not the ground's."""
_CLASSES = {"trunk": "primary", "trunk_link": "motorway_link"}
"""The simulator's names of classes that it has no speed for; other links are unclassified."""


class Ground:
    """Heights of the ground: broad relief and hills of some hundred metres, and waves of a hundred."""

    def __init__(self, plane: LocalProjection, relief: Path | None, seed: int) -> None:
        rng = np.random.default_rng([seed, 70])
        self._plane, self._broad = plane, Terrain.random(rng)
        self._relief = None if relief is None else _blurred(relief)
        count = 60
        length = np.exp(rng.uniform(np.log(90.0), np.log(350.0), count))
        turn = rng.uniform(0, 2 * np.pi, count)
        self._wave = 2 * np.pi / length * np.stack([np.cos(turn), np.sin(turn)])
        self._phase = rng.uniform(0, 2 * np.pi, count)
        self._amplitude = 0.03 * np.sqrt(2 / count) * length / (2 * np.pi)

    def at(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """Metres, at places of any one shape."""
        x, y = self._plane.to_xy(lon_deg, lat_deg)
        waves = np.zeros(np.shape(x))
        for (kx, ky), phase, size in zip(self._wave.T, self._phase, self._amplitude, strict=True):
            waves += size * np.sin(kx * x + ky * y + phase)
        broad = self._broad.height(x, y) if self._relief is None else self._relief.heights(lon_deg, lat_deg)
        return np.asarray(broad + waves)

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """The same at metres from the middle."""
        return self.at(*self._plane.to_lonlat(x_m, y_m))


class _blurred:  # noqa: N801 - used as a function
    """The heights of a raster without its noise."""

    def __init__(self, path: Path) -> None:
        self._dem = Dem.open([path])
        self._step = 3 / 3600

    def heights(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """The mean of the raster around places."""
        offsets = np.arange(-2, 3)
        weight = np.exp(-0.5 * (offsets / RELIEF_BLUR_POSTS) ** 2)
        total = np.zeros(np.shape(lon_deg))
        for i, a in zip(offsets, weight, strict=True):
            for j, b in zip(offsets, weight, strict=True):
                total += a * b * self._dem.heights(lon_deg + i * self._step, lat_deg + j * self._step)
        return np.asarray(total / weight.sum() ** 2)


@dataclass(frozen=True, eq=False)
class Scene:
    """A town of real roads (rows of ``roads``), its ground, and the roads of the file that it is made of."""

    town: Town
    ground: Ground
    roads: RoadTable
    rows: Ints
    window: Window

    @cached_property
    def above_ground_m(self) -> Floats:
        """The middle of each segment over the ground; roads in cuttings are below 0."""
        town = self.town
        middle = town.road_height(np.arange(len(town.roads)), np.full(len(town.roads), 0.5))
        lon = (town.roads.lon0_deg + town.roads.lon1_deg) / 2
        return np.asarray(middle - self.ground.at(lon, (town.roads.lat0_deg + town.roads.lat1_deg) / 2))

    def write_tile(self, folder: Path, seed: int) -> Path:
        """The elevation model around the roads, as an HGT tile in whole metres; void elsewhere."""
        west, south, east, north = self.window
        grid, lon, lat = ArcSeconds(), int(np.floor(west)), int(np.floor(south))
        left, top = (lon + 180) * 3600, (89 - lat) * 3600
        u, v = grid.coordinates(
            np.array([west - MARGIN_DEG, east + MARGIN_DEG]),
            np.array([north + MARGIN_DEG, south - MARGIN_DEG]),
        )
        columns, rows = np.arange(*np.round(u).astype(int)), np.arange(*np.round(v).astype(int))
        x, y = grid.axes(columns.astype(float), rows.astype(float))
        z = self.ground.at(*np.meshgrid(x, y))
        spacing = posting_m(grid, float(columns.mean()), float(rows.mean()))
        z += ERROR_SIGMA_M * correlated_field(
            np.random.default_rng([seed, 71]), z.shape, spacing, ERROR_LENGTH_M
        )
        tile = np.full((3601, 3601), HGT_VOID, ">i2")
        tile[rows[0] - top : rows[-1] - top + 1, columns[0] - left : columns[-1] - left + 1] = np.rint(z)
        path = folder / tile_name(lat, lon)[:3] / f"{tile_name(lat, lon)}.hgt"
        path.parent.mkdir(parents=True)
        path.write_bytes(tile.tobytes())
        return path


def make_scene(roads: RoadTable, window: Window, relief: Path | None, seed: int) -> Scene:
    """The roads of a window that lead from each to each, with true heights."""
    rows = _circulating(roads, City(roads, window).rows)
    table = roads.subset(rows)
    plane = LocalProjection.around(table.lon0_deg, table.lat0_deg)
    ground = Ground(plane, relief, seed)
    names, node = np.unique(np.concatenate([table.from_node, table.to_node]), return_inverse=True)
    start, end = np.split(node.astype(np.int64), 2)
    lon, lat = np.empty(len(names)), np.empty(len(names))
    lon[start], lat[start] = table.lon0_deg, table.lat0_deg
    lon[end], lat[end] = table.lon1_deg, table.lat1_deg
    x, y = plane.to_xy(lon, lat)
    plan = Plan(np.random.default_rng([seed, 72]), x.tolist(), y.tolist())
    row_of = _draw(plan, table, start, end)
    _cross(plan, table, start, end)
    height = node_heights(plan, ground.at(lon, lat))
    grades = np.zeros((len(table), 2))
    for street, its in zip(plan.streets, row_of, strict=True):
        along = node_grades(plan, street, height)
        grades[its] = np.column_stack([along[:-1], along[1:]])
    length = np.hypot(x[end] - x[start], y[end] - y[start])
    slope = regression_slope(height[start], height[end], grades[:, 0], grades[:, 1], length)
    town = Town(
        seed=seed, roads=_driven(table), start=start, end=end, grade_start=grades[:, 0], grade_end=grades[:, 1],
        length_m=length, true_slope_percent=100 * slope, node_id=names, node_lon_deg=lon, node_lat_deg=lat, node_x_m=x,
        node_y_m=y, node_height_m=height, ways=(), footways=(), terrain=Terrain.random(np.random.default_rng(0)),
        projection=plane,
    )  # fmt: skip
    return Scene(town, ground, roads, rows, window)


def _circulating(roads: RoadTable, rows: Ints) -> Ints:
    """Those of the rows on which a vehicle that turns round at dead ends alone comes from everywhere to everywhere."""
    while True:
        table = roads.subset(rows)
        names, node = np.unique(np.concatenate([table.from_node, table.to_node]), return_inverse=True)
        start, end = np.split(node.astype(np.int64), 2)
        arcs = Arcs.of(cast(Town, SimpleNamespace(roads=table, start=start, end=end, node_id=names)))
        _, part = connected_components(arcs.graph(np.ones(len(arcs))), connection="strong")
        lost = part != np.bincount(part).argmax()
        if not lost.any():
            return rows
        rows = rows[np.bincount(arcs.segment, lost, len(rows)) == 0]


def _driven(table: RoadTable) -> RoadTable:
    """The same roads, by classes that the simulator has speeds for."""
    classes = [_CLASSES.get(h, "unclassified" if h.endswith("_link") and h != "motorway_link" else h)
               for h in table.highway.tolist()]  # fmt: skip
    columns: dict[str, Any] = {**vars(table), "highway": np.array(classes, object)}
    names = ("osm_way_id", "from_node", "to_node", "lon0_deg", "lat0_deg", "lon1_deg", "lat1_deg", "oneway", "bridge",
             "tunnel", "layer", "highway", "name")  # fmt: skip
    return RoadTable.from_columns(**{name: columns[name] for name in names})


def _draw(plan: Plan, table: RoadTable, start: Ints, end: Ints) -> list[Ints]:
    """Draw each way's runs of segments as streets; the rows of each. Ways go on smoothly where just two meet."""
    kinds = [
        Kind(highway, BRIDGE if bridge else TUNNEL if tunnel else GROUND)
        for highway, bridge, tunnel in zip(table.highway, table.bridge, table.tunnel, strict=True)
    ]
    drawn, ends = [], dict[int, list[tuple[int, int]]]()
    for run in _runs(table.osm_way_id, start, end):
        nodes = [int(start[run[0]]), *end[run].tolist()]
        plan.street(None, nodes, [kinds[row] for row in run])
        drawn.append(np.array(run))
        for tip, inner in ((nodes[0], nodes[1]), (nodes[-1], nodes[-2])):
            ends.setdefault(tip, []).append((tip, inner))
        if table.highway[run[0]] in BANKED:
            plan.embanked |= set(nodes)
    degree = np.bincount(np.r_[start, end])
    for tip, both in ends.items():
        if len(both) == 2 and degree[tip] == 2 and both[0][1] != both[1][1]:
            plan.merges.append((both[0][1], tip, both[1][1]))
    return drawn


def _runs(way: Ints, start: Ints, end: Ints) -> Iterator[list[int]]:
    """Rows of each way, one after the other as far as they join."""
    for rows in np.split(np.arange(len(way)), np.flatnonzero(np.diff(way)) + 1):
        left = {int(row) for row in rows}
        begins = {int(start[row]): int(row) for row in reversed(rows)}
        first = [int(row) for row in rows if start[row] not in set(end[rows].tolist())]
        for row in [*first, *rows.tolist()]:
            run: list[int] = []
            here: int | None = row
            while here is not None and here in left:
                left.discard(here)
                run.append(here)
                here = begins.get(int(end[here]))
            if run:
                yield run


def _cross(plan: Plan, table: RoadTable, start: Ints, end: Ints) -> None:
    """Bridges keep their clearance above the roads that they cross; banks and cuttings lead there."""
    x, y = np.array(plan.x_m), np.array(plan.y_m)
    lines = shapely.linestrings(
        np.stack([np.column_stack([x[start], y[start]]), np.column_stack([x[end], y[end]])], 1)
    )
    decks, others = np.flatnonzero(table.bridge), np.flatnonzero(~table.bridge & ~table.tunnel)
    one, other = shapely.STRtree(lines[others]).query(lines[decks], predicate="crosses")
    for deck, below in zip(decks[one].tolist(), others[other].tolist(), strict=True):
        under = [int(start[below]), int(end[below])]
        over = {int(start[deck]), int(end[deck])}
        if over & set(under):
            continue
        at = lines[deck].intersection(lines[below])
        plan.clearances += [(node, under, CLEARANCE_M) for node in sorted(over)]
        near = np.hypot(x - at.x, y - at.y) < NEAR_CROSSING_M
        plan.embanked |= set(np.flatnonzero(near).tolist())


def on_structure(town: Town) -> Bools:
    """Segments of bridges and tunnels."""
    return np.asarray(town.roads.bridge | town.roads.tunnel)
