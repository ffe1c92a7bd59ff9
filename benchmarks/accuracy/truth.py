"""True slopes of segments by a precise track: what a file states, and how sure such a truth is of itself.

The truth of a segment is the mean of what the track's passes over it say, each a line through its heights over the
distance along it, weighted by the distance. Passes differ: the track's heights drift between them, and it follows
another lane. How much they differ tells the sigma of one pass, and that the sigma of the mean.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from accuracy.logs import read_columns, rows_of
from fusion.frames import LocalProjection
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

Key = tuple[int, int, int]
"""A segment: way, from node, to node."""
NEAR_M, TURN_M = 12.0, 10.0
"""A place of the track is on the segment with the least offset, below ``NEAR_M``; a right angle counts ``TURN_M``."""
OVERSHOOT_SHARE = 0.05
"""A segment goes on for this share of its length beyond its ends."""
LEAST_PLACES, LEAST_M = 5, 10.0
"""A shorter pass is none."""
LEAST_SHARE = 0.5
"""Passes over less of a segment are not compared: two of them may be of different parts."""
SAME_PERCENT = 0.02
"""So near to the slope that the truth states, passes are the passes that it was made of; it is rounded to 0.001."""
_COURSE_OVER = 5


class TrueSlope(NamedTuple):
    """What is known of a segment; ``driven_m`` is the part over which the slope was measured.

    ``sigma_percent`` is of the truth as a measure of what a log says: 0 where the two cannot differ, or it is unknown.
    """

    slope_percent: float
    driven_m: float
    length_m: float
    passes: int = 1
    sigma_percent: float = 0.0


Truth = dict[Key, TrueSlope]


class Passes(NamedTuple):
    """The passes of a track over one segment: the slope of each in the direction of drawing, and its length, (n,)."""

    slope_percent: Floats
    length_m: Floats

    @property
    def mean_percent(self) -> float:
        """The segment's slope, longer passes counting more."""
        return float(np.average(self.slope_percent, weights=self.length_m))

    def mean_sigma_percent(self, sigma_percent: float) -> float:
        """Sigma of the mean where each pass has ``sigma_percent``, however long it is."""
        return sigma_percent * float(np.linalg.norm(self.length_m) / np.sum(self.length_m))


def read_truth(path: Path) -> Truth:
    """The true slopes of a file that ``roadtruth.py truth`` wrote, without sigmas."""
    with path.open(newline="") as file:
        return {
            (int(r["osm_way_id"]), int(r["from_node"]), int(r["to_node"])): TrueSlope(
                float(r["slope_percent"]), float(r["driven_m"]), float(r["length_m"]), int(r["passes"])
            )
            for r in csv.DictReader(file)
        }


def with_sigmas(truth: Truth, passes: Mapping[Key, Passes], *, made_log: bool) -> Truth:
    """The truth with sigmas by the scatter of the passes that it was made of; as it is where there is none to see.

    ``made_log``: logs are made of the track that gave the truth. Where it passed once, they hold the very heights of
    the truth, and the two differ by nothing; where it passed more often, a log may weigh the passes otherwise.
    """
    same = {key: of for key, of in passes.items() if key in truth and _made_of(truth[key], of)}
    sigma = scatter_percent(same)
    if sigma is None:
        return truth
    return {
        key: true._replace(sigma_percent=same[key].mean_sigma_percent(sigma))
        if key in same and (true.passes > 1 or not made_log)
        else true
        for key, true in truth.items()
    }


def scatter_percent(passes: Mapping[Key, Passes]) -> float | None:
    """Sigma of one pass, pooled over all segments with several; None where there is none.

    It is taken to be the same for all: on the surveyed roads long segments differ as much as short ones.
    """
    several = [of.slope_percent for of in passes.values() if len(of.slope_percent) > 1]
    if not several:
        return None
    square = sum(float(np.sum((slopes - slopes.mean()) ** 2)) for slopes in several)
    return float(np.sqrt(square / sum(len(slopes) - 1 for slopes in several)))


def passes_of(reference: Path, roads: RoadTable) -> dict[Key, Passes]:
    """The passes of a precise track over each segment."""
    track = read_columns(reference)
    if "valid" in track:
        track = rows_of(track, track["valid"] == 1)
    plane = LocalProjection.around(track["lon_deg"], track["lat_deg"])
    place = np.column_stack(plane.to_xy(track["lon_deg"], track["lat_deg"]))
    start = np.column_stack(plane.to_xy(roads.lon0_deg, roads.lat0_deg))
    along = np.column_stack(plane.to_xy(roads.lon1_deg, roads.lat1_deg)) - start
    driven_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(place, axis=0).T)))
    row = _rows_at(place, start, along)
    found: dict[Key, list[tuple[float, float]]] = {}
    for run in np.split(np.arange(len(row)), np.flatnonzero(np.diff(row)) + 1):
        r, length = int(row[run[0]]), float(driven_m[run[-1]] - driven_m[run[0]])
        if r >= 0 and len(run) >= LEAST_PLACES and length >= LEAST_M:
            ahead = np.sign((place[run[-1]] - place[run[0]]) @ along[r])
            slope = 100 * ahead * np.polyfit(driven_m[run] - driven_m[run[0]], track["alt_m"][run], 1)[0]
            key = (int(roads.osm_way_id[r]), int(roads.from_node[r]), int(roads.to_node[r]))
            found.setdefault(key, []).append((float(slope), length))
    return {key: Passes(*np.array(of).T) for key, of in found.items()}


def _rows_at(place: Floats, start: Floats, along: Floats) -> Ints:
    """The segment on which each place is, shape (n,), -1 where none is near; (n, 2) places, (m, 2) segments."""
    x, y = (_smooth(axis) for axis in place.T)
    course = np.arctan2(np.gradient(y), np.gradient(x))
    least, row = np.full(len(place), NEAR_M), np.full(len(place), -1)
    length = np.hypot(*along.T)
    for r in np.flatnonzero(length > 0):
        ends = np.sort([start[r], start[r] + along[r]], axis=0)
        near = np.flatnonzero(np.all((place > ends[0] - NEAR_M) & (place < ends[1] + NEAR_M), axis=1))
        dx, dy = (place[near] - start[r]).T
        share = (dx * along[r, 0] + dy * along[r, 1]) / length[r] ** 2
        aside = np.abs(along[r, 0] * dy - along[r, 1] * dx) / length[r]
        turn = np.abs(np.sin(course[near] - np.arctan2(along[r, 1], along[r, 0])))
        offset = aside + TURN_M * turn
        on = (np.abs(share - 0.5) <= 0.5 + OVERSHOOT_SHARE) & (offset < least[near])
        least[near[on]], row[near[on]] = offset[on], r
    return row


def _smooth(values: Floats) -> Floats:
    padded = np.pad(values, _COURSE_OVER // 2, mode="edge")
    return np.convolve(padded, np.full(_COURSE_OVER, 1 / _COURSE_OVER), "valid")


def _made_of(true: TrueSlope, passes: Passes) -> bool:
    """Whether the truth is the mean of these passes, and several are not parts of one."""
    return (
        len(passes.slope_percent) == true.passes
        and abs(passes.mean_percent - true.slope_percent) < SAME_PERCENT
        and (true.passes == 1 or bool(np.all(passes.length_m > LEAST_SHARE * true.length_m)))
    )
