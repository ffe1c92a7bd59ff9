"""A drive's elevation profile: height and slope over the distance driven, as columns.

Knows no database, no route, no picture and no file (``profile_document``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fusion.roads.table import RoadTable
from fusion.types import PAUSE_S, Floats, Ints, Track

EARTH_RADIUS_M = 6_371_008.8
"""Mean radius of the ellipsoid: the distance driven is off by less than 0.6 % anywhere."""
LEAST_COSINE = 0.5
"""Cosine between a vehicle's heading and its road below which the heading says nothing of the direction."""


@dataclass(frozen=True)
class RoadFacts:
    """What a profile uses of a segment: its ends, (lon, lat) in degrees, and what it is.

    ``dem_heights_m`` are the elevation model's at equal distances over its ``length_m``; empty where there are none;
    ``name`` is None where it has none.
    """

    from_deg: tuple[float, float]
    to_deg: tuple[float, float]
    bridge: bool
    tunnel: bool
    length_m: float = math.nan
    dem_heights_m: Sequence[float] = ()
    name: str | None = None

    @property
    def bearing_rad(self) -> float:
        """Clockwise from north, from from_node to to_node."""
        (lon0, lat0), (lon1, lat1) = self.from_deg, self.to_deg
        turn = math.remainder(lon1 - lon0, 360.0) * math.cos(math.radians((lat0 + lat1) / 2))
        return math.atan2(turn, lat1 - lat0)


def table_facts(table: RoadTable, segment: Ints) -> dict[int, RoadFacts]:
    """The facts of the segments of a table that occur in ``segment``, by row; -1 is none."""
    return {
        int(s): RoadFacts(
            (float(table.lon0_deg[s]), float(table.lat0_deg[s])),
            (float(table.lon1_deg[s]), float(table.lat1_deg[s])),
            bridge=bool(table.bridge[s]),
            tunnel=bool(table.tunnel[s]),
        )
        for s in np.unique(segment[segment >= 0])
    }


@dataclass(frozen=True)
class Profile:
    """Columns of one length, one row per epoch with a position; unknown is NaN (segment_id: -1).

    ``distance_m`` is driven since the first epoch; ``forward`` is +1 where the vehicle went from from_node
    to to_node, -1 against it, 0 unknown. ``slope_percent`` is the drive's estimate of the segment **in the
    direction of travel**, ``grade_percent`` that of the road at the very epoch; ``gap`` marks the first epoch after
    an interruption. ``bridge`` and ``tunnel`` are False where that is not known. ``dem_height_m`` is the elevation
    model's height of the ground at that place of the segment, on the model's own datum; ``road_name`` the segment's,
    or None.
    """

    time_s: Floats
    lon_deg: Floats
    lat_deg: Floats
    distance_m: Floats
    alt_m: Floats
    alt_sigma_m: Floats
    slope_percent: Floats
    slope_sigma_percent: Floats
    grade_percent: Floats
    grade_sigma_percent: Floats
    segment_id: Ints
    forward: Ints
    gap: NDArray[np.bool_]
    has_gnss: NDArray[np.bool_]
    bridge: NDArray[np.bool_]
    tunnel: NDArray[np.bool_]
    dem_height_m: Floats
    road_name: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: Ints) -> Profile:
        """These rows alone."""
        return Profile(**{spec.name: getattr(self, spec.name)[rows] for spec in fields(self)})


def build_profile(
    track: Track,
    segment_id: Ints,
    slopes: Mapping[int, tuple[float, float]],
    roads: Mapping[int, RoadFacts] | None = None,
) -> Profile:
    """The profile of a track; ``slopes`` maps a segment's id to slope and sigma, percent, from -> to.

    ``roads`` says which segments are bridges and tunnels, and which way the vehicle went over one that holds but
    one epoch.
    """
    placed = np.isfinite(track.lat_deg) & np.isfinite(track.lon_deg)
    segment, along_m = segment_id[placed], track.distance_m[placed]
    # What is known of each segment once: a drive of hours has tens of thousands of epochs.
    each, row = np.unique(segment, return_inverse=True)
    facts = [(roads or {}).get(int(s), _UNKNOWN) for s in each]
    estimates = [slopes.get(int(s), (math.nan, math.nan)) for s in each]
    slope, slope_sigma = np.array(estimates, float).reshape(-1, 2).T[:, row]
    properties = [(f.bearing_rad, f.bridge, f.tunnel) for f in facts]
    bearing, bridge, tunnel = np.array(properties, float).reshape(-1, 3).T[:, row]
    forward = _directions(segment, along_m)
    forward = np.where(forward == 0, _headed(track.heading_rad[placed], bearing), forward)
    grade, grade_sigma = _grade_percent(track)
    return Profile(
        time_s=track.time_s[placed],
        lon_deg=track.lon_deg[placed],
        lat_deg=track.lat_deg[placed],
        distance_m=_driven_m(track.lat_deg[placed], track.lon_deg[placed]),
        alt_m=track.alt_m[placed],
        alt_sigma_m=track.alt_sigma_m[placed],
        slope_percent=slope * np.where(forward == 0, np.nan, forward),
        slope_sigma_percent=slope_sigma,
        grade_percent=grade[placed],
        grade_sigma_percent=grade_sigma[placed],
        segment_id=segment,
        forward=forward,
        gap=(np.diff(track.time_s[placed], prepend=-np.inf) > PAUSE_S) | track.after_outage[placed],
        has_gnss=track.has_gnss[placed],
        bridge=bridge > 0,
        tunnel=tunnel > 0,
        dem_height_m=_dem_heights_m(facts, row, along_m),
        road_name=np.array([f.name for f in facts], object)[row],
    )


def _headed(heading_rad: Floats, bearing_rad: Floats) -> Ints:
    """+1, -1 or 0 per epoch: whether the vehicle heads along its segment, against it, or unknown."""
    cosine = np.nan_to_num(np.cos(heading_rad - bearing_rad))
    return np.where(np.abs(cosine) > LEAST_COSINE, np.sign(cosine), 0).astype(np.int64)


def _dem_heights_m(facts: Sequence[RoadFacts], row: Ints, along_m: Floats) -> Floats:
    """The elevation model's height at each epoch; ``row`` is that of its segment in ``facts``, ``along_m`` the distance
    from the segment's from_node."""
    length_m = np.array([f.length_m for f in facts], float)
    knots = np.array([len(f.dem_heights_m) for f in facts], np.int64)
    knots_m = np.fromiter((h for f in facts for h in f.dem_heights_m), float)
    heights = np.full(len(row), np.nan)
    share = np.clip(along_m / length_m[row], 0.0, 1.0)
    usable = np.flatnonzero(np.isfinite(share) & (knots[row] > 1))
    row = row[usable]
    at = share[usable] * (knots[row] - 1)
    before = np.minimum(at.astype(np.int64), knots[row] - 2)
    first = np.cumsum(knots)[row] - knots[row] + before
    rest = at - before
    start, end = knots_m[first], knots_m[first + 1]
    # At a knot its own height counts alone, also where the model does not know the next one.
    between = start + rest * (end - start)
    heights[usable] = np.where(rest <= 0, start, np.where(rest >= 1, end, between))
    return heights


_NOWHERE = (math.nan, math.nan)
_UNKNOWN = RoadFacts(_NOWHERE, _NOWHERE, bridge=False, tunnel=False)


def _directions(segment: Ints, distance_m: Floats) -> Ints:
    """+1, -1 or 0 per epoch: whether each run of epochs on one segment goes up or down its distance.

    A run of a single epoch, or of a standing vehicle, says nothing about itself and is 0.
    """
    out = np.zeros(len(segment), np.int64)
    if not len(segment):
        return out
    run = np.cumsum(np.diff(segment, prepend=segment[0]) != 0)
    placed = np.flatnonzero(np.isfinite(distance_m) & (segment >= 0))
    if not len(placed):
        return out
    begins = np.diff(run[placed], prepend=-1) != 0
    first = placed[begins]
    last = placed[np.r_[np.flatnonzero(begins)[1:], len(placed)] - 1]
    moved = np.zeros(run[-1] + 1, np.int64)
    moved[run[first]] = np.sign(distance_m[last] - distance_m[first])
    return np.asarray(moved[run])


def _grade_percent(track: Track) -> tuple[Floats, Floats]:
    """The grade at each epoch and its sigma, from the pitch of the road."""
    grade = np.tan(track.pitch_rad)
    return 100 * grade, 100 * track.pitch_sigma_rad * (1 + grade**2)


def _driven_m(lat_deg: Floats, lon_deg: Floats) -> Floats:
    """Great-circle distance driven up to each position, metres."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    half = np.sin(np.diff(lat) / 2) ** 2 + np.cos(lat[:-1]) * np.cos(lat[1:]) * np.sin(np.diff(lon) / 2) ** 2
    steps = 2 * EARTH_RADIUS_M * np.arcsin(np.sqrt(np.minimum(half, 1)))
    driven: Floats = np.r_[0.0, np.cumsum(steps)][: len(lat)]
    return driven
