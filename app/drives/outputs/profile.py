"""A drive's elevation profile: height and slope over the distance driven, as columns and as JSON.

Knows no database, no route and no picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.core.text import LENGTH_DIGITS, SLOPE_DIGITS, rounded
from app.drives.outputs.track import time_text
from fusion.roads.table import RoadTable
from fusion.types import PAUSE_S, Floats, Ints, Track

EARTH_RADIUS_M = 6_371_008.8
"""Mean radius of the ellipsoid: the distance driven is off by less than 0.6 % anywhere."""
ASKEW = 0.5
"""Cosine between a vehicle's heading and its road below which the heading says nothing of the direction."""


@dataclass(frozen=True)
class RoadFacts:
    """What a profile uses of a segment: its bearing, clockwise from north, from from_node to to_node."""

    bearing_rad: float
    bridge: bool
    tunnel: bool

    @classmethod
    def between(
        cls, start_deg: tuple[float, float], end_deg: tuple[float, float], *, bridge: bool, tunnel: bool
    ) -> RoadFacts:
        """The facts of a segment from its ends, (lon, lat)."""
        (lon0, lat0), (lon1, lat1) = start_deg, end_deg
        turn = math.remainder(lon1 - lon0, 360.0) * math.cos(math.radians((lat0 + lat1) / 2))
        return cls(math.atan2(turn, lat1 - lat0), bridge, tunnel)


def table_facts(table: RoadTable, segment: Ints) -> dict[int, RoadFacts]:
    """The facts of the segments of a table that occur in ``segment``, by row; -1 is none."""
    return {
        int(s): RoadFacts.between(
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
    an interruption. ``bridge`` and ``tunnel`` are False where that is not known.
    """

    time_s: Floats
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

    def __len__(self) -> int:
        return len(self.time_s)


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
    known = np.isfinite(track.lat_deg) & np.isfinite(track.lon_deg)
    segment = segment_id[known]
    forward = _directions(segment, track.distance_m[known])
    facts = [(roads or {}).get(int(s)) for s in segment]
    forward = np.where(forward == 0, _headed(facts, track.heading_rad[known]), forward)
    estimates = np.array([slopes.get(int(s), (np.nan, np.nan)) for s in segment], float).reshape(-1, 2)
    signs = np.where(forward == 0, np.nan, forward)
    grade, sigma = _grade_percent(track)
    return Profile(
        time_s=track.time_s[known],
        distance_m=_driven_m(track.lat_deg[known], track.lon_deg[known]),
        alt_m=track.alt_m[known],
        alt_sigma_m=track.alt_sigma_m[known],
        slope_percent=estimates[:, 0] * signs,
        slope_sigma_percent=estimates[:, 1],
        grade_percent=grade[known],
        grade_sigma_percent=sigma[known],
        segment_id=segment,
        forward=forward,
        gap=(np.diff(track.time_s[known], prepend=-np.inf) > PAUSE_S) | track.after_gap[known],
        has_gnss=track.has_gnss[known],
        bridge=np.array([f is not None and f.bridge for f in facts], bool),
        tunnel=np.array([f is not None and f.tunnel for f in facts], bool),
    )


def profile_json(profile: Profile) -> dict[str, Any]:
    """The profile as columns, JSON-serialisable; unknown is null."""

    def column(values: Floats, digits: int) -> list[float | None]:
        return [rounded(float(v), digits) for v in values]

    return {
        "epochs": len(profile),
        "distance_m": column(profile.distance_m, LENGTH_DIGITS),
        "time": [time_text(float(t)) for t in profile.time_s],
        "alt_m": column(profile.alt_m, LENGTH_DIGITS),
        "alt_sigma_m": column(profile.alt_sigma_m, LENGTH_DIGITS),
        "slope_percent": column(profile.slope_percent, SLOPE_DIGITS),
        "slope_sigma_percent": column(profile.slope_sigma_percent, SLOPE_DIGITS),
        "grade_percent": column(profile.grade_percent, SLOPE_DIGITS),
        "grade_sigma_percent": column(profile.grade_sigma_percent, SLOPE_DIGITS),
        "segment_id": [int(s) if s >= 0 else None for s in profile.segment_id],
        "forward": [bool(f > 0) if f else None for f in profile.forward],
        "gap": [bool(g) for g in profile.gap],
        "has_gnss": [bool(g) for g in profile.has_gnss],
    }


def _directions(segment: Ints, distance_m: Floats) -> Ints:
    """+1, -1 or 0 per epoch: whether each run of epochs on one segment goes up or down its distance.

    A run of a single epoch, or of a standing vehicle, says nothing about itself and is 0.
    """
    out = np.zeros(len(segment), np.int64)
    if not len(segment):
        return out
    starts = [0, *(np.flatnonzero(np.diff(segment)) + 1).tolist()]
    for start, stop in pairwise([*starts, len(segment)]):
        run = distance_m[start:stop][np.isfinite(distance_m[start:stop])]
        if segment[start] >= 0 and len(run) > 1:
            out[start:stop] = np.sign(run[-1] - run[0])
    return out


def _headed(facts: Sequence[RoadFacts | None], heading_rad: Floats) -> Ints:
    """+1, -1 or 0 per epoch: whether the vehicle heads along its segment, against it, or nobody knows."""
    bearing = np.array([np.nan if f is None else f.bearing_rad for f in facts], float)
    cosine = np.nan_to_num(np.cos(heading_rad - bearing))
    return np.where(np.abs(cosine) > ASKEW, np.sign(cosine), 0).astype(np.int64)


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


def _column(kind: str, description: str, *, nullable: bool = False) -> dict[str, Any]:
    """The schema of a column: a value per epoch."""
    items = {"type": [kind, "null"] if nullable else kind}
    return {"type": "array", "items": items, "description": description}


# What the OpenAPI document says of ``profile_json``, to which the service adds ``drive_id``.
PROFILE_EXAMPLE: dict[str, Any] = {
    "drive_id": "3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11",
    "epochs": 2,
    "distance_m": [0.0, 11.2],
    "time": ["2026-11-20T07:55:10.000Z", "2026-11-20T07:55:11.000Z"],
    "alt_m": [143.21, 143.97],
    "alt_sigma_m": [0.9, 0.9],
    "slope_percent": [6.8214, 6.8214],
    "slope_sigma_percent": [0.3127, 0.3127],
    "grade_percent": [6.4318, 6.6027],
    "grade_sigma_percent": [0.5214, 0.5188],
    "segment_id": [17, 17],
    "forward": [True, True],
    "gap": [False, False],
    "has_gnss": [True, True],
}
PROFILE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": list(PROFILE_EXAMPLE),
    "properties": {
        "drive_id": {"type": "string", "format": "uuid"},
        "epochs": {"type": "integer", "description": "Length of every column."},
        "distance_m": _column("number", "Driven since the first epoch."),
        "time": _column("string", "UTC."),
        "alt_m": _column("number", "Height of the road.", nullable=True),
        "alt_sigma_m": _column("number", "One standard deviation.", nullable=True),
        "slope_percent": _column(
            "number", "The drive's slope of the whole segment, in the direction of travel.", nullable=True
        ),
        "slope_sigma_percent": _column("number", "One standard deviation.", nullable=True),
        "grade_percent": _column(
            "number", "The grade at this very place, in the direction of travel.", nullable=True
        ),
        "grade_sigma_percent": _column("number", "One standard deviation.", nullable=True),
        "segment_id": _column("integer", "The segment driven.", nullable=True),
        "forward": _column("boolean", "Whether from its from_node to its to_node.", nullable=True),
        "gap": _column("boolean", "Whether the recording was interrupted just before."),
        "has_gnss": _column("boolean", "Whether a position was measured there."),
    },
}
