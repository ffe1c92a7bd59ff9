"""Places onto a line: which part of a reference each place of a profile belongs to.

The nearest part alone would do on a line that meets itself nowhere. Where a road is driven twice, or comes near itself,
the order decides: the distances along the line grow as the places go, or fall all the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from fusion.errors import NoMatchError
from fusion.frames import LocalProjection
from fusion.messages import say
from fusion.scoring.profiles import PROFILE_GAP_M, REFERENCE_GAP_M, Heights, Profile, Reference, along_of
from fusion.types import Bools, Floats

RADIUS_M = 30.0
"""As far beside the line a place may lie."""
STEP_M = 1.0
"""Of the line between two points that places are compared with; places nearer to each other are one."""
LEAST_SHARE = 0.1
"""What has less than this of its places on the reference, and covers less of it, is a profile of another road."""
BACK_M = 5.0
"""So far places may go back: what receivers scatter."""
BESIDE_SIGMA_M, ALONG_SIGMA_M, ALONG_SHARE = 5.0, 5.0, 0.1
"""One sigma of how far places lie beside the line, and of steps along it against those between the places."""
BREAK_COST = 50.0
"""Of steps that fit the line nowhere: the profile leaves it, and comes back."""


@dataclass(frozen=True)
class Placed:
    """Places on a reference: metres along it, (n,), NaN beside it. ``backwards``: they go against its direction.

    ``share`` of them that lie on it, 0..1, and the median of how far beside it these lie, metres.
    """

    along_m: Floats
    backwards: bool
    share: float
    beside_m: float

    def heights(self, height_m: Floats, gap_m: float) -> Heights:
        """Heights at the places, (n,), as heights along the reference."""
        return Heights.of(self.along_m, height_m, gap_m)


def placed(reference: Reference, profile: Profile, name: str, radius_m: float = RADIUS_M) -> Placed:
    """Lay a profile onto a reference: by places where both have them, else by the distances that both state.

    Places without a height count for nothing. Raises ``NoMatchError`` where hardly any of it lies there, and it covers
    hardly any of the reference.
    """
    known = np.isfinite(profile.height_m)

    if reference.places_deg is None or profile.places_deg is None:
        along = np.array(along_of(profile))
        along[~known | (along < reference.along_m[0]) | (along > reference.along_m[-1])] = np.nan
        share = float(np.mean(np.isfinite(along[known]))) if known.any() else 0.0
        found = Placed(along, backwards=False, share=share, beside_m=np.nan)
    else:
        places = np.where(known[:, None], profile.places_deg, np.nan)
        found = _by_places(reference.along_m, reference.places_deg, places, radius_m)
    covered = found.heights(found.along_m, PROFILE_GAP_M).known_m
    if max(found.share, covered / max(reference.heights.known_m, STEP_M)) < LEAST_SHARE:
        raise NoMatchError(say("scoring.not_there", name=name, reference=reference.name, radius=radius_m))
    return found


def _by_places(along_m: Floats, line_deg: Floats, places_deg: Floats, radius_m: float) -> Placed:
    plane = LocalProjection.around(*line_deg.T)
    line = _Line.of(along_m, np.column_stack(plane.to_xy(*line_deg.T)))
    places = np.column_stack(plane.to_xy(*places_deg.T))
    known = np.flatnonzero(np.isfinite(places).all(axis=1))
    rows = known[_apart(places[known])]
    along = np.full(len(places), np.nan)
    if not len(rows):
        return Placed(along, backwards=False, share=0.0, beside_m=np.nan)
    chosen = places[rows]
    ways = [_follow(line, chosen[::way], radius_m) for way in (1, -1)]
    backwards = bool(ways[1].cost < ways[0].cost)
    best = ways[backwards]
    way = -1 if backwards else 1
    along[rows] = best.along_m[::way]
    on = np.isfinite(best.along_m)
    beside = float(np.median(best.beside_m[on])) if on.any() else np.nan
    return Placed(along, backwards, float(np.mean(on)), beside)


def _apart(places: Floats) -> Bools:
    """Which places to take: those that are ``STEP_M`` from the one before that is taken."""
    keep = np.zeros(len(places), bool)
    last = np.full(2, np.inf)
    for k, place in enumerate(places):
        if not np.hypot(*(place - last)) < STEP_M:
            keep[k], last = True, place
    return keep


@dataclass(frozen=True)
class _Line:
    """A reference as points about ``STEP_M`` apart: metres along it and place, with the direction there."""

    along_m: Floats
    place_m: Floats
    direction: Floats
    tree: KDTree

    @classmethod
    def of(cls, along_m: Floats, place_m: Floats) -> _Line:
        """Between the points of a reference, where these are near enough to each other."""
        step = np.hypot(*np.diff(place_m, axis=0).T)
        parts = []
        for k in np.flatnonzero((step > 0) & (step <= REFERENCE_GAP_M)):
            share = np.arange(max(1, int(np.ceil(step[k] / STEP_M)))) / max(1, int(np.ceil(step[k] / STEP_M)))
            there = place_m[k] + share[:, None] * (place_m[k + 1] - place_m[k])
            unit = np.broadcast_to((place_m[k + 1] - place_m[k]) / step[k], there.shape)
            parts.append(np.column_stack([along_m[k] + share * (along_m[k + 1] - along_m[k]), there, unit]))
        rows = np.vstack(parts) if parts else np.empty((0, 5))
        return cls(rows[:, 0], rows[:, 1:3], rows[:, 3:], KDTree(rows[:, 1:3]))

    def candidates(self, place_m: Floats, radius_m: float) -> tuple[Floats, Floats]:
        """Where a place may lie: metres along and metres beside, where the line within reach comes nearest to it."""
        near = np.sort(np.array(self.tree.query_ball_point(place_m, radius_m), np.int64))
        if not len(near):
            return np.empty(0), np.empty(0)
        offset = place_m - self.place_m[near]
        beside = np.hypot(*offset.T)
        apart = np.diff(self.along_m[near]) > 2 * STEP_M
        before = np.r_[np.inf, np.where(apart, np.inf, beside[:-1])]
        after = np.r_[np.where(apart, np.inf, beside[1:]), np.inf]
        best = np.flatnonzero((beside < before) & (beside <= after))
        ahead = np.sum(offset[best] * self.direction[near[best]], axis=1)
        return self.along_m[near[best]] + np.clip(ahead, -STEP_M, STEP_M), beside[best]


@dataclass(frozen=True)
class _Way:
    along_m: Floats
    beside_m: Floats
    cost: float


def _follow(line: _Line, places: Floats, radius_m: float) -> _Way:
    """The likeliest places on the line that never go back (Viterbi); what would is left out."""
    along, beside = np.full(len(places), np.nan), np.full(len(places), np.nan)
    choices = [line.candidates(place, radius_m) for place in places]
    rows = [k for k, (where, _) in enumerate(choices) if len(where)]
    if not rows:
        return _Way(along, beside, np.inf)
    driven = np.r_[0.0, np.cumsum(np.hypot(*np.diff(places, axis=0).T))]
    cost = (choices[rows[0]][1] / BESIDE_SIGMA_M) ** 2
    origins = []
    for before, here in pairwise(rows):
        step = driven[here] - driven[before]
        ahead = choices[here][0][:, None] - choices[before][0]
        misfit = ((ahead - step) / (ALONG_SIGMA_M + ALONG_SHARE * step)) ** 2
        total = cost + np.where(ahead >= -BACK_M, np.minimum(misfit, BREAK_COST), 2 * BREAK_COST)
        origins.append(np.argmin(total, axis=1))
        cost = np.min(total, axis=1) + (choices[here][1] / BESIDE_SIGMA_M) ** 2
    last = int(np.argmin(cost))
    whole = float(cost[last])
    for here, origin in zip(reversed(rows), [*reversed(origins), None], strict=True):
        along[here], beside[here] = choices[here][0][last], choices[here][1][last]
        last = last if origin is None else int(origin[last])
    reached = np.fmax.accumulate(along)
    along[along < reached - BACK_M] = np.nan
    return _Way(np.where(np.isfinite(along), reached, np.nan), beside, whole)
