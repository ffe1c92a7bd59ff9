"""Small towns with made-up drives, for tests of how networks are solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from accuracy.adjustment_drives import PLACE_M, Synthetic
from fusion.frames import LocalProjection
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable

Drives = dict[int, list[PassFactor]]


def town(width: int, height: int, side_m: float = 45.0) -> RoadTable:
    """A grid of streets, somewhat crooked."""
    rng = np.random.default_rng(width * height)
    plane = LocalProjection(8.5, 49.0)
    x, y = (side_m * v.ravel().astype(float) for v in np.meshgrid(np.arange(width), np.arange(height)))
    lon, lat = plane.to_lonlat(x + rng.uniform(-8, 8, x.size), y + rng.uniform(-8, 8, y.size))
    number = np.arange(width * height).reshape(height, width)
    start = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    end = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    n = len(start)
    return RoadTable.from_columns(
        osm_way_id=np.arange(n), from_node=start, to_node=end,
        lon0_deg=lon[start], lat0_deg=lat[start], lon1_deg=lon[end], lat1_deg=lat[end],
        oneway=np.zeros(n), bridge=np.zeros(n, bool), tunnel=np.zeros(n, bool), layer=np.zeros(n),
        highway=["residential"] * n, name=[None] * n,
    )  # fmt: skip


@cache
def driven_town(
    width: int = 7, height: int = 6, drives: int = 6, length_m: float = 1200.0, place_m: float = PLACE_M
) -> tuple[RoadTable, Drives]:
    """A town and drives through it, by number, whose positions err by so much along each axis."""
    table = town(width, height)
    makers = Synthetic(table, width + drives, place_m)
    return table, {k: makers.drive(makers.route(length_m)) for k in range(drives)}


def within(
    table: RoadTable, drives: Mapping[int, Sequence[PassFactor]], rows: np.ndarray
) -> tuple[RoadTable, Drives, Drives]:
    """The part of a network that a mask names: its table, the passes inside by its rows, the passes outside."""
    number = np.cumsum(rows) - 1
    inside = {
        k: [replace(p, segment=int(number[p.segment])) for p in d if rows[p.segment]]
        for k, d in drives.items()
    }
    outside = {k: [p for p in d if not rows[p.segment]] for k, d in drives.items() if inside[k]}
    return table.subset(rows), {k: d for k, d in inside.items() if d}, outside
