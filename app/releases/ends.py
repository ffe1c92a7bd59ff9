"""Where a drive began, ended and stood, and which of its passes are so near that they are told to nobody. Knows no SQL.

Where a trip begins is where somebody lives. What lies within a radius around it is left out, and what follows as far
as the next junction: a cut in the middle of a road would tell the radius.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.frames import METRES_PER_DEGREE
from fusion.types import Bools, Floats, Ints

STOP_S = 120.0
"""Who is not farther away after so long has stopped, and so has a recording that pauses for so long."""
STOP_M = 40.0
SAME_PLACE_M = 100.0
"""Ends that are nearer to each other are one place: a car park, and two sides of a street."""
NEAREST_M, FARTHEST_M = 150.0, 400.0
"""Between these the radius around a place is drawn."""
ON_FROM_THERE_M = 600.0
"""No junction is looked for farther from the place than the radius and so much more."""


@dataclass(frozen=True)
class Circle:
    """Around a place."""

    lon_deg: float
    lat_deg: float
    radius_m: float

    @classmethod
    def drawn(cls, lon_deg: float, lat_deg: float, share: float) -> Circle:
        """Around a place for which this share, 0 to 1, was drawn."""
        return cls(lon_deg, lat_deg, NEAREST_M + (FARTHEST_M - NEAREST_M) * share)

    def offsets_m(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """East and north of the middle; shape (n, 2)."""
        scale = METRES_PER_DEGREE * np.array([np.cos(np.radians(self.lat_deg)), 1.0])
        return np.asarray((np.stack([lon_deg, lat_deg], 1) - (self.lon_deg, self.lat_deg)) * scale, float)

    def beyond_m(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """How far outside of the circle places are; below 0 inside, NaN where a place is not known."""
        return np.asarray(np.hypot(*self.offsets_m(lon_deg, lat_deg).T) - self.radius_m, float)


@dataclass(frozen=True, eq=False)
class Driven:
    """The passes of one drive in the order of driving; every column has shape (n,)."""

    sequence: Ints
    segment: Ints
    from_node: Ints
    to_node: Ints
    lon0_deg: Floats
    lat0_deg: Floats
    lon1_deg: Floats
    lat1_deg: Floats
    entered_s: Floats

    def __len__(self) -> int:
        return len(self.sequence)

    def distance_m(self, circle: Circle) -> Floats:
        """From the middle of a circle to each segment, a straight line; shape (n,)."""
        start = circle.offsets_m(self.lon0_deg, self.lat0_deg)
        along = circle.offsets_m(self.lon1_deg, self.lat1_deg) - start
        share = -np.sum(start * along, 1) / np.maximum(np.sum(along**2, 1), 1e-9)
        return np.asarray(np.hypot(*(start + np.clip(share, 0, 1)[:, None] * along).T), float)

    def ends(self) -> Floats:
        """Where the first pass and the last one are, degrees, shape (2, 2): of a drive without a track."""
        return np.array([(self.lon0_deg[0], self.lat0_deg[0]), (self.lon1_deg[-1], self.lat1_deg[-1])])


@dataclass(frozen=True, eq=False)
class Timed:
    """Where a drive was when: every column has shape (n,)."""

    time_s: Floats
    lon_deg: Floats
    lat_deg: Floats


def ends_of(track: Timed) -> Floats:
    """Longitude and latitude of where a drive began, stopped and ended, degrees, shape (m, 2)."""
    known = np.isfinite(track.lon_deg) & np.isfinite(track.lat_deg) & np.isfinite(track.time_s)
    time_s = track.time_s[known]
    if not len(time_s):
        return np.empty((0, 2))
    at = np.stack([track.lon_deg[known], track.lat_deg[known]], 1)
    stands = np.flatnonzero(_stands(time_s, at))
    # Of a stop its first moment is enough; a crawl through a car park has several.
    begins = stands[np.diff(stands, prepend=-2) > 1]
    pauses = np.flatnonzero(np.diff(time_s) >= STOP_S)
    rows = np.unique(np.concatenate([[0, len(time_s) - 1], begins, pauses, pauses + 1]).astype(np.int64))
    return np.asarray(at[rows], float)


def ends_of_drive(track: Timed | None, driven: Driven | None) -> Floats:
    """The same by its track, or, where that knows no place, by its passes."""
    ends = np.empty((0, 2)) if track is None else ends_of(track)
    return ends if len(ends) or driven is None else driven.ends()


def _stands(time_s: Floats, at: Floats) -> Bools:
    """From which rows on nobody gets away for ``STOP_S``; shape (n,)."""
    later = np.searchsorted(time_s, time_s + STOP_S)
    there = later < len(time_s)
    scale = METRES_PER_DEGREE * np.array([np.cos(np.radians(at[0, 1])), 1.0])
    away = np.full(len(time_s), np.inf)
    away[there] = np.hypot(*((at[later[there]] - at[there]) * scale).T)
    return np.asarray(away <= STOP_M, bool)


def apart(ends: Floats) -> Iterator[tuple[float, float]]:
    """Those of the ends that are not one place with a former one."""
    kept: list[tuple[float, float]] = []
    for lon, lat in ends.tolist():
        if not any(distance_m(lon, lat, *other) <= SAME_PLACE_M for other in kept):
            kept.append((lon, lat))
            yield lon, lat


def distance_m(lon_deg: float, lat_deg: float, other_lon_deg: float, other_lat_deg: float) -> float:
    """Between two places that are near each other."""
    east = (lon_deg - other_lon_deg) * np.cos(np.radians(lat_deg))
    return float(np.hypot(east, lat_deg - other_lat_deg) * METRES_PER_DEGREE)


def near(drive: Driven, circles: Sequence[Circle]) -> set[int]:
    """The segments at whose nodes a cut may have to be looked for: those near the circles."""
    rows = np.zeros(len(drive), bool)
    for circle in circles:
        rows |= drive.distance_m(circle) <= circle.radius_m + ON_FROM_THERE_M
    return set(drive.segment[rows].tolist())


def hidden(drive: Driven, circles: Sequence[Circle], roads_at: Mapping[int, int]) -> Ints:
    """The sequence numbers of the passes that are told to nobody; ``roads_at``: how many segments meet at each node of
    the segments near the circles (``near``)."""
    inside = np.zeros(len(drive), bool)
    for circle in circles:
        inside |= drive.distance_m(circle) <= circle.radius_m
    out = inside.copy()
    goes_on = _goes_on(drive, roads_at)
    for k in range(1, len(out)):
        out[k] |= out[k - 1] and goes_on[k - 1]
    for k in range(len(out) - 2, -1, -1):
        out[k] |= out[k + 1] and goes_on[k]
    return drive.sequence[out]


def _goes_on(drive: Driven, roads_at: Mapping[int, int]) -> Bools:
    """Whether between each pass and the next one no other road branches off; shape (n - 1,)."""
    pairs = zip(
        drive.from_node[:-1].tolist(),
        drive.to_node[:-1].tolist(),
        drive.from_node[1:].tolist(),
        drive.to_node[1:].tolist(),
        strict=True,
    )
    shared = [next(iter({a, b} & {c, d}), None) for a, b, c, d in pairs]
    return np.array([node is not None and roads_at.get(node) == 2 for node in shared], bool)
