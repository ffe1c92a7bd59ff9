"""Straight streets whose heights are known exactly, and simulated drives along them: for questions that no map answers.

A street is a town of ``fusion.simulate`` without any other road, so that drives and logs of it are made as of a town.
"""

from __future__ import annotations

import numpy as np

from accuracy.truth import Key, TrueSlope, Truth
from fusion.frames import LocalProjection
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import Route
from fusion.simulate.motion.vehicle import Driver
from fusion.simulate.scene.plan import Kind
from fusion.simulate.scene.segments import Way, node_ids, regression_slope, tabulate
from fusion.simulate.scene.town import CENTRE_LAT_DEG, CENTRE_LON_DEG, Terrain, Town
from fusion.types import Floats

_LONGEST_S = 3600.0


def make_street(east_m: Floats, height_m: Floats, grade: Floats) -> Town:
    """A street eastwards through nodes, shape (n,), with the road's height and grade (a fraction) at each.

    Between two nodes the height is a cubic; segments are drawn eastwards, in this order.
    """
    plane = LocalProjection(CENTRE_LON_DEG, CENTRE_LAT_DEG)
    north_m = np.zeros(len(east_m))
    lon, lat = plane.to_lonlat(east_m, north_m)
    way = Way(1, "Street", Kind("tertiary"), tuple(range(len(east_m))), grade)
    cut = tabulate([way], lon, lat)
    length = np.diff(east_m)
    slope = regression_slope(height_m[cut.start], height_m[cut.end], cut.grade_start, cut.grade_end, length)
    return Town(
        seed=0,
        roads=cut.roads,
        start=cut.start,
        end=cut.end,
        grade_start=cut.grade_start,
        grade_end=cut.grade_end,
        length_m=length,
        true_slope_percent=100 * slope,
        node_id=node_ids(len(east_m)),
        node_lon_deg=lon,
        node_lat_deg=lat,
        node_x_m=east_m,
        node_y_m=north_m,
        node_height_m=height_m,
        ways=(way,),
        footways=(),
        terrain=Terrain.random(np.random.default_rng(0)),  # nothing lies beside the street
        projection=plane,
    )


def make_hills(length_m: float, segment_m: float) -> Town:
    """A street of equal segments over hills with grades to nearly 10 %."""
    east = np.arange(0.0, length_m + segment_m / 2, segment_m)
    height = 200 + 5 * np.sin(east / 90) + 1.5 * np.sin(east / 37 + 1)
    return make_street(east, height, 5 / 90 * np.cos(east / 90) + 1.5 / 37 * np.cos(east / 37 + 1))


def drive_along(street: Town, seed: int, receiver: str = "m8") -> SimulatedDrive:
    """A drive from the street's west end to its east end, at 1 Hz."""
    count = len(street.roads)
    route = Route(np.arange(count), np.ones(count, bool))
    return simulate_drive(
        street, seed, _LONGEST_S, receiver=receiver, route=route, driver=Driver(stop_chance=0.0)
    )


def truth_of(street: Town) -> Truth:
    """The true slopes of all segments, over their whole length."""
    roads = street.roads
    keys: list[Key] = list(
        zip(roads.osm_way_id.tolist(), roads.from_node.tolist(), roads.to_node.tolist(), strict=True)
    )
    rows = zip(keys, street.true_slope_percent.tolist(), street.length_m.tolist(), strict=True)
    return {key: TrueSlope(slope, length, length) for key, slope, length in rows}
