"""Which part of a road network is solved again when passes came or went, and what of it is published.

Pure functions over arrays: the service runs them on extracts of its database, ``versant fuse`` on a road file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.neighbourhoods import PUBLISH_RADIUS_M, WINDOW_RADIUS_M, gap_rows, neighbourhood
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

Bools = NDArray[np.bool_]

_METRES_PER_DEGREE = 110_000.0  # a little less than any degree of latitude, so that boxes come out wider
_STRIP_M = 200.0
_HIGHEST_DEG = 89.9


@dataclass(frozen=True, eq=False)
class Window:
    """Masks of shape (n,) over a road table: ``solved`` together, driven ones and gaps; ``published`` of it."""

    solved: Bools
    published: Bools
    """Rows whose slope is replaced; one that is not solved has none any more."""
    ring: Bools
    """Driven rows just outside: where their slopes move, the change reaches farther than was thought."""


def window_around(
    network: RoadTable, driven: Bools, touched: Bools, shown: Bools, scale: float = 1.0
) -> Window:
    """What to solve when the passes over ``touched`` rows changed.

    ``shown`` rows have a published slope, among them former gaps that must vanish. Gaps count as roads: what
    they join influences each other. ``scale`` multiplies the library's radii.
    """
    open_rows = driven | gap_rows(network, driven)
    reach = open_rows | shown | touched
    solved = neighbourhood(network, reach, touched, scale * WINDOW_RADIUS_M) & open_rows
    published = neighbourhood(network, reach, touched, scale * PUBLISH_RADIUS_M)
    middle = 0.5 * scale * (PUBLISH_RADIUS_M + WINDOW_RADIUS_M)
    ring = neighbourhood(network, reach, touched, middle) & driven & ~published
    return Window(solved, published, ring)


def rows_of(table: RoadTable, part: RoadTable) -> Ints:
    """For each segment of ``part`` its row in ``table``, which holds them all; shape (len(part),)."""
    candidates = np.flatnonzero(np.isin(table.osm_way_id, part.osm_way_id))
    row = dict(zip(_identities(table.subset(candidates)), candidates.tolist(), strict=True))
    return np.array([row[identity] for identity in _identities(part)], np.int64)


def _identities(table: RoadTable) -> Iterator[tuple[int, int, int]]:
    return zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True)


def boxes_around(lon0: Floats, lat0: Floats, lon1: Floats, lat1: Floats, radius_m: float) -> Floats:
    """Disjoint boxes (m, 4: west, south, east, north) that hold all within ``radius_m`` of the lines given.

    Strips of latitude, each cut into the runs of longitude that are needed: an index finds what lies in them
    once, and a long drive costs its own length, not the area that it spans.
    """
    margin = radius_m / _METRES_PER_DEGREE
    step = _STRIP_M / _METRES_PER_DEGREE
    south, north = np.minimum(lat0, lat1) - margin, np.maximum(lat0, lat1) + margin
    widening = margin / np.cos(np.radians(np.minimum(np.maximum(np.abs(south), np.abs(north)), _HIGHEST_DEG)))
    west, east = np.minimum(lon0, lon1) - widening, np.maximum(lon0, lon1) + widening
    first, last = np.floor(south / step).astype(np.int64), np.floor(north / step).astype(np.int64)
    strips = last - first + 1
    line = np.repeat(np.arange(len(strips)), strips)
    strip = np.repeat(first, strips) + np.arange(len(line)) - np.repeat(np.cumsum(strips) - strips, strips)
    return _runs(strip, west[line], east[line], step)


def _runs(strip: Ints, west: Floats, east: Floats, step: float) -> Floats:
    """Overlapping intervals of each strip joined into runs, as boxes."""
    order = np.lexsort((west, strip))
    boxes: list[list[float]] = []
    at: int | None = None
    for k in order.tolist():
        if at == strip[k] and west[k] <= boxes[-1][2]:
            boxes[-1][2] = max(boxes[-1][2], float(east[k]))
            continue
        at = int(strip[k])
        boxes.append([float(west[k]), at * step, float(east[k]), (at + 1) * step])
    return np.array(boxes, float).reshape(-1, 4)
