"""From altitudes along a road to the slopes of its segments: the line of Al Assaad 2020, 3.4.3, with a true sigma.

A filter's track goes in by ``line_slopes`` with what share of its spreads a slope keeps; ``segment_slopes`` takes any
track with any covariance of its altitudes. Which method made the track is not known here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.network.combine import combine
from fusion.types import Floats, SegmentSlope, Track

_MIN_SPAN_M = 5.0  # between the first and the last altitude of a line
_MAX_BREAK_S = 5.0  # epochs further apart belong to two passes
_MIN_SPEED_MPS = 1.0  # slower epochs are left out: a standing vehicle's estimates wander
_MAX_SLOPE_PERCENT = 50.0  # a steeper line is no road

Index = NDArray[np.intp]
AltitudeCovariance = Callable[[Index], Floats]
"""Covariance (k, k), m^2, of the altitude errors at k epochs of a track."""


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
    track: Track, shares: ErrorShares, mount_sigma: float, min_epochs: int, receiver_m: Floats | float = 0.0
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
    return segment_slopes(track, errors.covariance, min_epochs, shares.floor_percent)


@dataclass(frozen=True)
class AltitudeErrors:
    """A model of how altitude errors hang together along a drive, per epoch of a track (arrays of shape (n,)).

    White error ``white_m``; Gauss-Markov error ``correlated_m`` with ``correlation_s``; and the height that a
    grade error ``grade`` (Gauss-Markov in time, ``grade_correlation_s``) adds up to along the way.
    """

    time_s: Floats
    speed_mps: Floats
    white_m: Floats
    correlated_m: Floats
    correlation_s: float
    grade: Floats
    grade_correlation_s: float

    def covariance(self, epochs: Index) -> Floats:
        """Covariance of the altitude errors at ``epochs``, shape (k, k), m^2."""
        covariance: Floats = _altitude_covariance(
            self.time_s[epochs],
            self.white_m[epochs],
            self.correlated_m[epochs],
            self.correlation_s,
            self.grade[epochs] * self.speed_mps[epochs],
            self.grade_correlation_s,
        )
        return covariance


def segment_slopes(
    track: Track, covariance: AltitudeCovariance, min_epochs: int = 4, floor_percent: float = 0.2
) -> tuple[SegmentSlope, ...]:
    """The slope of every segment that the track stays on long enough, passes combined, ordered by segment.

    ``distance_m`` grows from from_node to to_node, so the sign is right whichever way the vehicle went. A pass needs
    ``min_epochs`` altitudes on the segment (thesis 3.4.3: 3, its experiment 4). ``floor_percent`` is what a line can't
    know about a segment (its curvature, where within it the epochs lie).
    """
    lines: dict[int, list[tuple[float, float, Index]]] = {}
    known = np.isfinite(track.alt_m) & np.isfinite(track.distance_m) & ~(track.speed_mps < _MIN_SPEED_MPS)
    for segment, epochs in passes(track, _MAX_BREAK_S):
        usable = epochs[known[epochs]]
        if len(usable) < min_epochs or np.ptp(track.distance_m[usable]) < _MIN_SPAN_M:
            continue
        weights = line_weights(track.distance_m[usable])
        slope = 100.0 * float(weights @ track.alt_m[usable])
        if abs(slope) > _MAX_SLOPE_PERCENT:
            continue
        variance = float(weights @ covariance(usable) @ weights)
        sigma = float(np.hypot(100.0 * np.sqrt(max(variance, 0.0)), floor_percent))
        lines.setdefault(segment, []).append((slope, sigma, usable))
    return tuple(_joined(segment, lines[segment], track.time_s) for segment in sorted(lines))


def passes(track: Track, max_break_s: float) -> Iterator[tuple[int, Index]]:
    """Yield (segment, epochs) for each uninterrupted stay on a segment.

    A stay ends where the estimate begins anew, and after a break of ``max_break_s``, or of 2.5 times the usual time
    between epochs where a log is sparser than that.
    """
    segment, step = track.segment, np.diff(track.time_s)
    if not len(segment):
        return
    longest = max(max_break_s, 2.5 * float(np.median(step))) if len(step) else max_break_s
    cuts = np.flatnonzero((np.diff(segment) != 0) | (step > longest) | track.after_outage[1:]) + 1
    for part in np.split(np.arange(len(segment)), cuts):
        if segment[part[0]] >= 0:
            yield int(segment[part[0]]), part


def line_weights(distance_m: Floats) -> Floats:
    """Weights h with least-squares slope = h @ altitude, for at least two different distances."""
    centred = distance_m - distance_m.mean()
    weights: Floats = centred / float(centred @ centred)
    return weights


def _joined(segment: int, parts: list[tuple[float, float, Index]], time_s: Floats) -> SegmentSlope:
    observations = np.array([len(epochs) for _, _, epochs in parts])
    total = combine(np.array([p[0] for p in parts]), np.array([p[1] for p in parts]), observations)
    return SegmentSlope(
        segment=segment,
        slope_percent=total.slope_percent,
        slope_sigma_percent=total.slope_sigma_percent,
        observations=total.observations,
        passes=len(parts),
        first_time_s=float(time_s[parts[0][2][0]]),
        last_time_s=float(time_s[parts[-1][2][-1]]),
    )


@compiled
def _altitude_covariance(
    time_s: Floats, white: Floats, level: Floats, level_tau_s: float, rate: Floats, rate_tau_s: float
) -> Floats:
    """Covariance (k, k) of white noise, a Gauss-Markov height and the climb that a Gauss-Markov rate adds up to."""
    n = len(time_s)
    # Trapezoidal sums of the rate: the height error at epoch k is the sum of the climbs before it.
    climbs = np.zeros((n, n))
    for k in range(1, n):
        half = 0.5 * (time_s[k] - time_s[k - 1])
        for a in range(n):
            lag = abs(time_s[a] - time_s[k - 1])
            other = abs(time_s[a] - time_s[k])
            step = rate[k - 1] * math.exp(-lag / rate_tau_s) + rate[k] * math.exp(-other / rate_tau_s)
            climbs[a, k] = climbs[a, k - 1] + half * rate[a] * step
    out = np.zeros((n, n))
    for k in range(n):
        for b in range(n):
            if k:
                half = 0.5 * (time_s[k] - time_s[k - 1])
                out[k, b] = out[k - 1, b] + half * (climbs[k - 1, b] + climbs[k, b])
    for a in range(n):
        for b in range(n):
            out[a, b] += level[a] * level[b] * math.exp(-abs(time_s[a] - time_s[b]) / level_tau_s)
        out[a, a] += white[a] ** 2
    return out
