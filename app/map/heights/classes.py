"""How much of a line lies in each class of grade, as the Highway Performance Monitoring System of the USA has them.

The classes are those of the items Grades_A to Grades_F of FHWA's HPMS Field Manual, in percent, up or down: 0.0-0.4,
0.5-2.4, 2.5-4.4, 4.5-6.4, 6.5-8.4, 8.5 and more. They are of grades to a tenth, so a class ends halfway to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from sqlalchemy.orm import Session

from app.map.heights.grades import Grades, heights_and_grades
from app.map.heights.places import MOST_PLACES, distances_along_m, spread
from app.map.heights.road_heights import MEASURED, along_line
from app.map.heights.store import roads_near
from fusion.types import Bools, Floats

CLASSES = "abcdef"
BOUNDS_PERCENT = np.array([0.45, 2.45, 4.45, 6.45, 8.45])
STEP_M = 10.0
"""A line is looked at in parts of about this length: a grade is that of 10 m of road around a place."""


@dataclass(frozen=True)
class ByClass:
    """Metres of a line in each of the ``CLASSES``, shape (6,), as far as it lies on measured roads; ``whole_m`` of all.

    ``sure``: the probability that a measured place is in the class that it counts in, by its sigma, a mean by length;
    NaN where nothing was measured.
    """

    length_m: Floats
    whole_m: float
    sure: float


def by_class(session: Session, line_deg: Floats, radius_m: float) -> ByClass:
    """Of a line of longitudes and latitudes, shape (n, 2), whose places lie within ``radius_m`` of their roads."""
    whole_m = float(distances_along_m(line_deg)[-1])
    parts = int(min(max(2, math.ceil(whole_m / STEP_M)), MOST_PLACES))
    places = spread(line_deg, 2 * parts + 1)[1::2]
    on = along_line(places, roads_near(session, places, radius_m), radius_m)
    heights, grades = heights_and_grades(session, places, on)
    measured = np.array([one is not None and one.source == MEASURED for one in heights], bool)
    measured &= np.isfinite(grades.slope_percent)
    return classed(grades, measured, whole_m)


def classed(grades: Grades, measured: Bools, whole_m: float) -> ByClass:
    """Of equal parts of a line by their grades, shapes (n,)."""
    slope, sigma = np.abs(grades.slope_percent[measured]), grades.sigma_percent[measured]
    number = np.searchsorted(BOUNDS_PERCENT, slope, side="right")
    part_m = whole_m / len(measured)
    low, high = np.append(0.0, BOUNDS_PERCENT)[number], np.append(BOUNDS_PERCENT, np.inf)[number]
    sure = [
        _within(*one) for one in zip(slope.tolist(), sigma.tolist(), low.tolist(), high.tolist(), strict=True)
    ]
    return ByClass(
        np.asarray(np.bincount(number, minlength=len(CLASSES)) * part_m, float),
        whole_m,
        float(np.mean(sure)) if sure else math.nan,
    )


def _within(mean: float, sigma: float, low: float, high: float) -> float:
    """The probability that the size of a normal number is between two sizes."""
    if not sigma > 0:
        return 1.0
    below = [
        0.5 * (1 + math.erf((bound - mean) / sigma / math.sqrt(2))) for bound in (-high, -low, low, high)
    ]
    return below[1] - below[0] + below[3] - below[2]
