"""Errors of grade by length: heights are compared at both ends of stretches of one length, all along the reference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.scoring.profiles import Heights, Reference
from fusion.types import Floats

LENGTHS_M = (50.0, 100.0, 200.0, 500.0, 1000.0)
OVERLAP = 2
"""Stretches begin every so-manieth part of their length."""


@dataclass(frozen=True)
class GradeScore:
    """Errors of the mean grade of stretches of one length, of the profile less the reference; NaN where there are none.

    ``stretches`` were compared of the ``possible`` ones that the reference knows. Of the errors, percent: root mean
    square, median of the absolute, mean, and the absolute that 95 % do not exceed; ``rise_rms_m`` is the root mean
    square error of the height difference over the length, metres.
    """

    length_m: float
    stretches: int
    possible: int
    rms_percent: float
    median_percent: float
    bias_percent: float
    p95_percent: float
    rise_rms_m: float

    @property
    def coverage(self) -> float:
        """Share of the reference's stretches that were compared."""
        return self.stretches / self.possible if self.possible else np.nan


def grade_scores(
    reference: Reference, heights: Heights | None, lengths_m: Sequence[float] = LENGTHS_M
) -> Iterator[GradeScore]:
    """The score for each length; heights None: of a road that is level."""
    for length_m in lengths_m:
        begin, true_m = _rises(reference, length_m)
        rise_m = np.zeros(len(begin)) if heights is None else heights.at(begin + length_m) - heights.at(begin)
        error_m = (rise_m - true_m)[np.isfinite(rise_m)]
        yield _score(length_m, error_m, len(begin))


def height_offset_m(reference: Reference, heights: Heights) -> float:
    """Median of the heights less the reference's at its points: mostly that of the datums. NaN where none is known."""
    difference = heights.at(reference.along_m) - reference.heights.height_m
    known = np.isfinite(difference)
    return float(np.median(difference[known])) if known.any() else np.nan


def _rises(reference: Reference, length_m: float) -> tuple[Floats, Floats]:
    """Where each stretch begins whose ends the reference knows, and how much it rises, metres."""
    first, last = reference.along_m[[0, -1]]
    begin = np.arange(first, last - length_m + 1e-9, length_m / OVERLAP)
    rise = reference.heights.at(begin + length_m) - reference.heights.at(begin)
    known = np.isfinite(rise)
    return begin[known], rise[known]


def _score(length_m: float, error_m: Floats, possible: int) -> GradeScore:
    if not len(error_m):
        return GradeScore(length_m, 0, possible, *[np.nan] * 5)
    percent = 100 * error_m / length_m
    return GradeScore(
        length_m,
        len(error_m),
        possible,
        rms_percent=float(np.sqrt(np.mean(percent**2))),
        median_percent=float(np.median(np.abs(percent))),
        bias_percent=float(np.mean(percent)),
        p95_percent=float(np.quantile(np.abs(percent), 0.95)),
        rise_rms_m=float(np.sqrt(np.mean(error_m**2))),
    )
