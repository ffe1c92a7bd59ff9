"""How a line goes up and down: the slopes of the roads that it follows, seen in the direction in which it goes.

Slopes are taken on each road by itself, never as differences between two: where a measured road meets one of the
elevation model, the step between their datums is no hill.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from app.map.heights.places import distances_along_m
from app.map.heights.road_heights import MEASURED, OnRoad, RoadHeight, directions, heights_of, unit
from fusion.types import Floats

HALF_M = 5.0
"""A slope is that of so much of the road before and after a place."""
LEAST_ALONG = 0.5
"""Cosine between a line and a road below which the line crosses the road, and has no slope of it."""
LEAST_RISE = 1e-4
"""What rises by less of its length is level: it goes neither up nor down."""
RELATIVE_SIGMA_M = 1.5
"""Of differences of heights that were not measured, one standard deviation at each end: neighbouring heights of an
elevation model err alike, so that is less than of each height."""


class Climb(BaseModel):
    """What a line goes up and down in all. What is unknown counts as level: see `known_share`."""

    ascent_m: float
    ascent_sigma_m: float = Field(description="One standard deviation, metres.")
    descent_m: float
    descent_sigma_m: float = Field(description="One standard deviation, metres.")
    measured_share: float = Field(description="Share of the length on roads that were measured, 0..1.")
    known_share: float = Field(description="Share of the length on roads whose slope is known at all, 0..1.")


@dataclass(frozen=True)
class Grades:
    """Percent at each place, upwards in the line's direction, and one standard deviation; NaN unknown, shapes (n,)."""

    slope_percent: Floats
    sigma_percent: Floats


def moved(places: Sequence[OnRoad | None], by_m: float) -> list[OnRoad | None]:
    """The places so much farther from ``from_node`` of their roads, at most to the road's end."""
    return [
        place
        and replace(place, share=min(1.0, max(0.0, place.share + by_m / max(place.road.length_m, 1e-6))))
        for place in places
    ]


def grades_of(
    places: Floats,
    before: Sequence[OnRoad | None],
    heights_before: Sequence[RoadHeight | None],
    after: Sequence[OnRoad | None],
    heights_after: Sequence[RoadHeight | None],
    ways: Floats | None = None,
) -> Grades:
    """The slopes at ``places``, shape (n, 2), between what lies ``before`` and ``after`` each of them on its road.

    ``ways`` (n, 2) are the line's directions there where they are known better than by the places themselves.
    """
    slope, sigma = np.full(len(places), np.nan), np.full(len(places), np.nan)
    ways = directions(places) if ways is None else ways
    for n, (low, high, start, end) in enumerate(
        zip(before, after, heights_before, heights_after, strict=True)
    ):
        if low is None or high is None or start is None or end is None:
            continue
        along_m = (high.share - low.share) * low.road.length_m
        cosine = float(np.dot(unit(low.road), ways[n]))
        if along_m <= 0 or not abs(cosine) >= LEAST_ALONG:
            continue
        slope[n] = math.copysign(100.0, cosine) * (end.height_m - start.height_m) / along_m
        guessed = 100 * math.sqrt(2) * RELATIVE_SIGMA_M / max(low.road.length_m, 2 * HALF_M)
        known = low.road.slope_sigma_percent if start.source == MEASURED else None
        sigma[n] = guessed if known is None else known
    return Grades(slope, sigma)


def heights_and_grades(
    session: Session, places: Floats, on: Sequence[OnRoad | None]
) -> tuple[list[RoadHeight | None], Grades]:
    """The heights of a line's ``places``, shape (n, 2), each of which is ``on`` a road, and the slopes there."""
    before, after = moved(on, -HALF_M), moved(on, HALF_M)
    # In one look: what lies at the ends of bridges is the same.
    heights = heights_of(session, [*on, *before, *after])
    n = len(places)
    return heights[:n], grades_of(places, before, heights[n : 2 * n], after, heights[2 * n :])


def climb_of(
    places: Floats, on: Sequence[OnRoad | None], heights: Sequence[RoadHeight | None], grades: Grades
) -> Climb:
    """What the line goes up and down: errors of places on one road are one error, those of two roads independent."""
    along_m = distances_along_m(places)
    # Each place stands for what is nearer to it than to the others.
    weight_m = np.gradient(along_m) if len(along_m) > 1 else np.zeros(len(along_m))
    if len(along_m) > 1:
        weight_m[[0, -1]] /= 2
    known = np.isfinite(grades.slope_percent)
    rise_m = np.where(known, grades.slope_percent, 0) / 100 * weight_m
    doubt_m = np.where(known, grades.sigma_percent, 0) / 100 * weight_m
    measured = np.array([one is not None and one.source == MEASURED for one in heights], bool)
    roads = [None if one is None else one.road.id for one in on]
    runs = [list(rows) for _, rows in groupby(range(len(roads)), key=lambda n: roads[n])]

    def total(way: int) -> tuple[float, float]:
        goes = way * rise_m > LEAST_RISE * weight_m
        each = [float(np.sum(doubt_m[rows][goes[rows]])) for rows in runs]
        return float(np.sum(np.abs(rise_m[goes]))), math.hypot(*each)

    whole_m = float(np.sum(weight_m)) or 1.0
    (ascent_m, ascent_sigma_m), (descent_m, descent_sigma_m) = total(1), total(-1)
    return Climb(
        ascent_m=ascent_m,
        ascent_sigma_m=ascent_sigma_m,
        descent_m=descent_m,
        descent_sigma_m=descent_sigma_m,
        measured_share=float(np.sum(weight_m[measured & known])) / whole_m,
        known_share=float(np.sum(weight_m[known])) / whole_m,
    )
