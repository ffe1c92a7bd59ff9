"""Slopes from the altitudes that a filter estimated: the line of the thesis, with a sigma from the filter's spreads.

A filter states the spread of one epoch; how much of it survives in a slope depends on how long its errors hang
together. ``ErrorShares`` says so, fitted once for each method on many kinds of drives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.slopes import AltitudeErrors, LineRule, segment_slopes
from fusion.types import Floats, SegmentSlope, Track


@dataclass(frozen=True)
class ErrorShares:
    """Of a filter's own spread in pitch and in height, what share a slope keeps and how long errors hang together.

    ``receiver`` is the share that it keeps of the receiver's own vertical accuracy: of errors that wander for minutes a
    filter's spread knows nothing where it takes them as white.
    """

    grade: float
    grade_correlation_s: float
    height: float
    height_correlation_s: float
    white_m: float
    floor_percent: float
    receiver: float = 0.0


def line_slopes(
    track: Track,
    shares: ErrorShares,
    mount_sigma: float,
    min_epochs: int,
    receiver_m: Floats | float = 0.0,
) -> tuple[SegmentSlope, ...]:
    """Slopes of the segments of a filtered track; ``mount_sigma`` is a grade error that all of them share.

    ``receiver_m`` is the receiver's vertical accuracy, one for all epochs or one for each.
    """
    errors = AltitudeErrors(
        time_s=track.time_s,
        speed_mps=np.nan_to_num(track.speed_mps),
        white_m=np.full(len(track), shares.white_m),
        correlated_m=np.hypot(shares.height * np.nan_to_num(track.alt_sigma_m), shares.receiver * receiver_m),
        correlation_s=shares.height_correlation_s,
        grade=np.hypot(shares.grade * np.nan_to_num(track.pitch_sigma_rad), mount_sigma),
        grade_correlation_s=shares.grade_correlation_s,
    )
    rule = LineRule(min_epochs=min_epochs, floor_percent=shares.floor_percent)
    return segment_slopes(track, errors.covariance, rule)
