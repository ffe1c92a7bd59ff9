"""What routers that sample nodes make of either model: grades between nodes, bridges and tunnels as a whole."""

from __future__ import annotations

import numpy as np

from fusion.types import Bools, Ints
from routers.errors import Errors, Rows
from routers.made import Scene, on_structure
from routers.samplers import HgtTile, samplers

BANK_M = 1.0
LEAST_M = 20.0


def sampled_rows(scene: Scene, before: HgtTile, after: tuple[HgtTile, HgtTile], measured: Bools) -> Rows:
    """GraphHopper and BRouter: nodes of segments on the ground, and ends of bridges and tunnels.

    ``after``: tiles for BRouter and for GraphHopper.
    """
    town, decks = scene.town, on_structure(scene.town)
    ground = np.flatnonzero(~decks & (town.length_m >= LEAST_M))
    spans = _spans(scene)
    a = np.r_[town.start[ground], [one[0] for one in spans]].astype(int)
    b = np.r_[town.end[ground], [one[1] for one in spans]].astype(int)
    length = np.r_[town.length_m[ground], [one[2] for one in spans]]
    seen = np.r_[measured[ground], [bool(measured[one[3]].all()) for one in spans]].astype(bool)
    true = 100 * (town.node_height_m[b] - town.node_height_m[a]) / length
    at_decks = np.isin(np.arange(len(town.node_id)), np.r_[town.start[decks], town.end[decks]])
    span = np.arange(len(a)) >= len(ground)
    banked = np.r_[np.abs(scene.above_ground_m[ground]) > BANK_M, np.zeros(len(spans), bool)].astype(bool)
    where = {
        "bridges and tunnels": span,
        "beside them": ~span & (at_decks[a] | at_decks[b]),
        "banks and cuttings": banked,
    }
    rows: Rows = []
    for name in samplers(before):
        errors = []
        for tile in (before, after["GraphHopper" in name]):
            height = samplers(tile)[name](town.node_lon_deg, town.node_lat_deg)
            errors.append(100 * (height[b] - height[a]) / length - true)
        rows += Errors(errors[0], errors[1], where, seen).rows(name)
    return rows


def _spans(scene: Scene) -> list[tuple[int, int, float, Ints]]:
    """Bridges and tunnels of a way as a whole: both end nodes, length, rows; those that are chains."""
    town, found = scene.town, []
    decks = np.flatnonzero(on_structure(town))
    for way in np.unique(town.roads.osm_way_id[decks]):
        rows = decks[town.roads.osm_way_id[decks] == way]
        nodes, count = np.unique(np.r_[town.start[rows], town.end[rows]], return_counts=True)
        ends = nodes[count == 1]
        length = float(town.length_m[rows].sum())
        if len(ends) == 2 and len(nodes) == len(rows) + 1 and length >= LEAST_M:
            found.append((int(ends[0]), int(ends[1]), length, rows))
    return found
