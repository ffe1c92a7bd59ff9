"""What the stored map covers and whose data it is: what several routes say of it beside its segments."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.http import Service
from app.map.segment import Segment
from app.network import ZOOM
from app.network.cells import cell_bounds
from app.roads.store import road_crowds, road_extent, road_tag
from app.terrain.coverage import names_over, sources_over
from app.terrain.store import current_dem
from fusion.types import Bools, Floats, Ints

MOST_ROADS = 0.98
"""Share of the roads that an opened map shows from west to east, and from south to north."""
BOX_DIGITS, MOST_BOXES = 4, 300
SHOWN_AT_ONCE = 1.5
"""Tiles of the lowest zoom that has any, over which an opened map may reach: from farther nothing is drawn."""


def cached_extent(service: Service, session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Read once per road import."""
    version = road_tag(session)
    if version not in service.extents:
        service.extents.clear()
        service.extents[version] = road_extent(session)
    return service.extents.get(version)


def cached_crowd(service: Service, session: Session) -> Bounds | None:
    """A box that holds most roads, degrees: extracts have lone roads that lead far away. As ``cached_extent``."""
    tag = ("crowd", road_tag(session))
    if tag not in service.extents:
        extent = cached_extent(service, session)  # first: it forgets what was of other roads
        widest = SHOWN_AT_ONCE * 2 ** (ZOOM - service.settings.tile_min_zoom)
        service.extents[tag] = None if extent is None else crowded_box(road_crowds(session), extent, widest)
    return service.extents[tag]


def crowded_box(crowds: Mapping[int, int], extent: Bounds, widest: float = math.inf) -> Bounds:
    """The smallest box of cells outside of which, on each side, lie no more of the segments than is left out.

    Where it were wider or higher than ``widest`` cells, as of roads in two countries, it is that of the roads near
    the place where most of them are together.
    """
    cells = np.array(list(crowds), np.int64)
    weights = np.array(list(crowds.values()), float)
    places = np.array([cells >> ZOOM, cells & ((1 << ZOOM) - 1)])
    low, high = _most_of(places, weights)
    if (high - low).max() >= widest:
        near = _together(places, weights, widest)
        low, high = _most_of(places[:, near], weights[near])
    west, south, _, _ = cell_bounds(int(low[0]) << ZOOM | int(high[1]))
    _, _, east, north = cell_bounds(int(high[0]) << ZOOM | int(low[1]))
    return max(west, extent[0]), max(south, extent[1]), min(east, extent[2]), min(north, extent[3])


def _most_of(places: Ints, weights: Floats) -> tuple[Ints, Ints]:
    """The first and last column and row of the cells without those left out; rows of ``places`` are x and y."""
    beyond = (1 - MOST_ROADS) / 2
    sides = []
    for along in places:
        order = np.argsort(along, kind="stable")
        share = np.cumsum(weights[order]) / weights.sum()
        sides.append(along[order[np.searchsorted(share, (beyond + 1e-9, 1 - beyond - 1e-9))]])
    low, high = np.transpose(sides)
    return low, high


def _together(places: Ints, weights: Floats, widest: float) -> Bools:
    """Which cells lie in a part of the map, ``widest`` cells wide and high, in the middle of the largest crowd."""
    parts = places // max(int(widest / 3), 1)
    _, part = np.unique(parts, axis=1, return_inverse=True)
    mine = part == np.argmax(np.bincount(part, weights))
    middle = np.average(places[:, mine], axis=1, weights=weights[mine])
    return np.asarray((np.abs(places - middle[:, None]) <= (widest - 1) / 2).all(axis=0))


def dem_names(service: Service, session: Session, shown: Sequence[Segment] | None = None) -> tuple[str, ...]:
    """The active elevation rasters that cover a segment that is shown, as attributions name them; None: any segment."""
    active = current_dem(session, service.settings.dem_dir)
    if shown is None:
        return tuple(source.credit for source in sources_over(session, active))
    return names_over(active, [_box(s) for s in shown])


def elevation_credits(service: Service, session: Session) -> list[dict[str, Any]]:
    """Whose elevation data lies where, of those under any segment: ``credit`` and its ``boxes``, degrees; a map credits
    by it what it shows. A raster of unknown bounds is everywhere. None where they are too many for a small document.
    """
    active = current_dem(session, service.settings.dem_dir)
    boxes: dict[str, list[list[float]]] = {}
    for source in sources_over(session, active):
        box = source.bounds_deg or (-180.0, -90.0, 180.0, 90.0)
        boxes.setdefault(source.credit, []).append([round(corner, BOX_DIGITS) for corner in box])
    if sum(map(len, boxes.values())) > MOST_BOXES:
        return []
    return [{"credit": credit, "boxes": each} for credit, each in boxes.items()]


def dem_names_at(
    service: Service, session: Session, places: Iterable[tuple[float, float]]
) -> tuple[str, ...]:
    """The same of rasters that cover one of these places (longitude, latitude), which are looked at only if need be."""
    active = current_dem(session, service.settings.dem_dir)
    if active is None or not active.sources:
        return ()
    return names_over(active, [(lon, lat, lon, lat) for lon, lat in places])


def _box(segment: Segment) -> Bounds:
    (lon0, lat0), (lon1, lat1) = segment.coordinates
    return min(lon0, lon1), min(lat0, lat1), max(lon0, lon1), max(lat0, lat1)
