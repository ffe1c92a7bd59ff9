"""What slopes may take from positions that were computed from raw signals, and what the road gives back to these.

Such heights are wrong by metres that come and go within a hundred metres of street, and a smoother makes them look far
better than they are. So slopes take the places alone; what knows grades are Doppler, attitude, force, pressure and
elevation models. A drive that has none of these is laid on its roads and says nothing of slopes (notes 6).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.matching.drive import DriveMatcher
from fusion.matching.path import PathMatch
from fusion.messages import say
from fusion.methods.base import DriveResult
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Ints

NO_GRADE = say("drive.no_grade")


def knows_grade(log: DriveLog) -> bool:
    """Whether anything in the log but its positions knows how steep the road is."""
    sensed = log.velocity.has("vel_d_mps") or log.attitude.has("pitch_rad") or log.force.has("acc_x_mps2")
    return bool(sensed or log.pressure.has("pressure_pa"))


def without_heights(log: DriveLog) -> DriveLog:
    """The same log with places alone."""
    unknown = np.full(len(log.fix), np.nan)
    return replace(log, fix=replace(log.fix, alt_msl_m=unknown, height_ell_m=unknown, v_acc_m=unknown))


def places_alone(result: DriveResult) -> DriveResult:
    """A result without anything that came from heights: the track on its roads, and a warning why there is no slope."""
    track, unknown = result.track, np.full(len(result.track), np.nan)
    track = replace(track, alt_m=unknown, alt_sigma_m=unknown, pitch_rad=unknown, pitch_sigma_rad=unknown)
    report = {**result.report, "warnings": [NO_GRADE]}
    return DriveResult(track, (), report)


def heights_under(log: DriveLog, network: RoadNetwork, dem: Dem) -> Floats:
    """The elevation model's heights (n,), m above its datum, at the places of the road that the fixes are matched to.

    NaN off the road, on bridges and in tunnels, where the ground is not the road.
    """
    x, y = network.projection.to_xy(log.fix.lon_deg, log.fix.lat_deg)
    match = DriveMatcher(network).match(log.fix.time_s, x, y, sigma_m=log.fix.h_acc_m)
    segment, along = _places(match)
    on = segment >= 0
    table = network.table
    on[on] &= ~(table.bridge | table.tunnel)[segment[on]]
    out = np.full(len(log.fix), np.nan)
    if on.any():
        s = segment[on]
        share = along[on] / np.maximum(network.length_m[s], 1e-9)
        lon = table.lon0_deg[s] + share * (table.lon1_deg[s] - table.lon0_deg[s])
        lat = table.lat0_deg[s] + share * (table.lat1_deg[s] - table.lat0_deg[s])
        out[on] = dem.heights(lon, lat)
    return out


def above_ellipsoid(height_m: Floats, solved_ell_m: Floats) -> Floats:
    """The same heights above the ellipsoid, with the antenna's above the road: shifted to solved heights by the median.

    No grid of the geoid comes with the library. What a whole drive's heights are off by stays in the shift: so the road
    tells a drive how its height changes, and not how high it is.
    """
    both = np.isfinite(height_m) & np.isfinite(solved_ell_m)
    if not both.any():
        return np.full(len(height_m), np.nan)
    return height_m + float(np.median(solved_ell_m[both] - height_m[both]))


def _places(match: PathMatch) -> tuple[Ints, Floats]:
    """The segment (-1 off the road) and the distance from its from_node of each sample."""
    row, along = match.position_on(match.distance_m)
    row = np.where(match.traversal >= 0, row, -1)
    segment = np.where(row >= 0, match.segment[row] if len(match) else -1, -1)
    return segment, along
