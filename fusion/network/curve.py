"""Heights along a segment as a few numbers: height and grade at knots, a cubic between them.

Between two knots at distance d, with the grade a random walk of variance q per metre, the cubic of Hermite is the
conditional mean of the road's height, and what is left of it is known in closed form. Knots are so near that a grade
which goes back to level over a length (``grade_noise``) hardly differs between them. The knots depend on the
segment's length alone, so that everything which was ever said about a segment speaks of the same numbers. Neither
drives nor neighbouring segments are known here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fusion.types import Floats, Ints

SPACING_M = 20.0
"""Knots are at most so far apart, on segments that need no more than ``MAX_INTERVALS``."""
MAX_INTERVALS = 16
"""Bound on the size of a factor: on segments above 320 m knots lie farther apart."""
SHORTEST_M = 1.0
"""Shorter segments count as this long: their own equations would drown all others in rounding, and a grade over less
than a step says nothing."""

_GAUSS_NODES, _GAUSS_WEIGHTS = (v.tolist() for v in np.polynomial.legendre.leggauss(3))


def knot_length(length_m: ArrayLike) -> Floats:
    """The length that a segment's knots assume: at least ``SHORTEST_M``."""
    return np.asarray(np.maximum(np.asarray(length_m, float), SHORTEST_M))


def interval_count(length_m: ArrayLike) -> Ints:
    """Intervals between knots of segments of these lengths (metres, above 0), same shape."""
    wanted = np.ceil(np.asarray(length_m, float) / SPACING_M - 1e-9).astype(np.int64)
    return np.clip(wanted, 1, MAX_INTERVALS)


def variable_count(length_m: ArrayLike) -> Ints:
    """Knot variables of a segment: height (m) and grade (1) at each knot in turn, from from_node to to_node."""
    return np.asarray(2 * (interval_count(length_m) + 1))


def _locate(distance_m: Floats, length_m: ArrayLike) -> tuple[Ints, Floats, Floats]:
    """Interval, share of it (0..1) and spacing for distances from from_node (clamped to the segment)."""
    length = np.broadcast_to(np.asarray(length_m, float), np.shape(distance_m))
    intervals = interval_count(length)
    spacing = length / intervals
    along = np.clip(np.asarray(distance_m, float), 0.0, length) / spacing
    interval = np.minimum(along.astype(np.int64), intervals - 1)
    return interval, along - interval, spacing


def _cubic(u: Floats, d: float | Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Weights of h0, g0, h1, g1 in the height at share ``u`` of an interval of length ``d``."""
    return 1 - 3 * u**2 + 2 * u**3, d * (u - 2 * u**2 + u**3), 3 * u**2 - 2 * u**3, d * (u**3 - u**2)


def height_weights(distance_m: Floats, length_m: ArrayLike) -> tuple[Ints, Floats]:
    """The first of the four knot variables in the height at ``distance_m`` (m,), and their weights (m, 4)."""
    j, u, d = _locate(distance_m, length_m)
    return 2 * j, np.column_stack(_cubic(u, d))


def grade_weights(distance_m: Floats, length_m: ArrayLike) -> tuple[Ints, Floats]:
    """The same for the grade (from_node to to_node) at ``distance_m``."""
    j, u, d = _locate(distance_m, length_m)
    return 2 * j, np.column_stack(
        (6 * (u**2 - u) / d, 1 - 4 * u + 3 * u**2, 6 * (u - u**2) / d, 3 * u**2 - 2 * u)
    )


def height_rows(distance_m: Floats, length_m: float) -> Floats:
    """Rows (n, variables) that turn knot variables into heights (m) at ``distance_m``."""
    return _spread(*height_weights(distance_m, length_m), length_m)


def grade_rows(distance_m: Floats, length_m: float) -> Floats:
    """Rows (n, variables) that turn knot variables into grades (from_node to to_node) at ``distance_m``."""
    return _spread(*grade_weights(distance_m, length_m), length_m)


def _spread(first: Ints, weights: Floats, length_m: float) -> Floats:
    rows = np.zeros((len(first), int(variable_count(length_m))))
    np.put_along_axis(rows, first[:, None] + np.arange(4), weights, axis=1)
    return rows


def height_variance(distance_m: Floats, length_m: ArrayLike, roughness: Floats | float) -> Floats:
    """Variance (m^2) of the height between knots about the cubic; ``roughness`` is q in 1/m."""
    _, u, d = _locate(distance_m, length_m)
    return np.asarray(roughness * d**3 * (u * (1 - u)) ** 3 / 3)


def grade_variance(distance_m: Floats, length_m: ArrayLike, roughness: float) -> Floats:
    """Variance of the grade between knots about the cubic's: a Brownian bridge whose area is known."""
    _, u, d = _locate(distance_m, length_m)
    x = u * (1 - u)
    return np.asarray(roughness * d * np.maximum(x - 3 * x**2, 0.0))


def slope_rows(start_m: Floats, end_m: Floats, length_m: Floats) -> Floats:
    """Rows (m, variables) that yield slopes of the parts [start_m, end_m]: the regression of height on distance.

    All (m,), for segments with equal numbers of intervals. Exact for the cubics, by Gauss-Legendre quadrature.
    Raises ``ValueError`` unless every start_m < end_m.
    """
    start, end, length = (np.asarray(v, float) for v in (start_m, end_m, length_m))
    if not np.all(start < end):
        raise ValueError("a slope needs a part of positive length")
    intervals = int(interval_count(length[:1])[0]) if len(length) else 1
    d = length / intervals
    out = np.zeros((len(length), 2 * intervals + 2))
    middle, moment = 0.5 * (start + end), (end - start) ** 3 / 12
    for j in range(intervals):
        low, high = np.clip(start, j * d, (j + 1) * d), np.clip(end, j * d, (j + 1) * d)
        for node, weight in zip(_GAUSS_NODES, _GAUSS_WEIGHTS, strict=True):
            x = 0.5 * (low + high) + 0.5 * (high - low) * node
            share = 0.5 * (high - low) * weight * (x - middle) / moment
            out[:, 2 * j : 2 * j + 4] += share[:, None] * np.column_stack(_cubic((x - j * d) / d, d))
    return out


def place_rows(length_m: Floats) -> tuple[Floats, Floats]:
    """Rows (m, variables) that yield how the slopes of whole segments change when their start or their end moves, 1/m.

    For segments (m,) with equal numbers of intervals: with s the slope, L the length and h - h' the height above the
    mean, ds/dstart = 6 (h_start - h') / L^2 + 3 s / L and ds/dend = 6 (h_end - h') / L^2 - 3 s / L.
    """
    length = np.asarray(length_m, float)[:, None]
    slope = slope_rows(np.zeros(len(length)), length[:, 0], length[:, 0])
    intervals = slope.shape[1] // 2 - 1
    mean = np.zeros_like(slope)
    half, bend = np.full(len(length), 0.5), length[:, 0] / intervals / 12
    for j in range(intervals):  # the cubic's mean over an interval
        mean[:, 2 * j : 2 * j + 4] += np.column_stack([half, bend, half, -bend]) / intervals
    start, end = -mean, -mean.copy()
    start[:, 0] += 1
    end[:, -2] += 1
    return 6 * start / length**2 + 3 * slope / length, 6 * end / length**2 - 3 * slope / length


RANDOM_WALK_M = 1e9
"""A correlation length that is none: over any segment such a grade is a random walk."""
_NEAR = 0.03
"""Below this share of the correlation length series are exact to 1e-5, where the closed forms cancel."""


def grade_noise(spacing_m: ArrayLike, grade_length_m: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Variances over steps ds for q = 1: of the height (m^2), of height and grade (m), of the grade.

    The grade is an Ornstein-Uhlenbeck process: it goes back to level over a correlation length, dg = -g / length ds +
    sqrt(q) dW (van Kampen 2007, IV.3; the height is its integral). Far below that length it is a random walk: ds^3 / 3,
    ds^2 / 2 and ds. Shapes are broadcast.
    """
    d, length = np.asarray(spacing_m, float), np.asarray(grade_length_m, float)
    share = d / length
    near = share < _NEAR
    x = np.where(near, 1.0, share)
    a = np.exp(-x)
    height = np.where(
        near, 1 / 3 - share / 4 + 7 * share**2 / 60, (x - 2 * (1 - a) + 0.5 * (1 - a**2)) / (x * x * x)
    )
    both = np.where(near, 0.5 - share / 2 + 7 * share**2 / 24, 0.5 * ((1 - a) / x) ** 2)
    grade = np.where(near, 1 - share + 2 * share**2 / 3, 0.5 * (1 - a**2) / x)
    return height * (d * d * d), both * d**2, grade * d  # a power of 3 takes as long as all the rest


def grade_carried(spacing_m: ArrayLike, grade_length_m: ArrayLike) -> tuple[Floats, Floats]:
    """How far (m) a height follows the grade at the beginning of a step, and what is left of the grade at its end."""
    decay = np.expm1(-np.asarray(spacing_m, float) / grade_length_m)
    return -np.asarray(grade_length_m, float) * decay, 1 + decay


def smoothness_block(spacing_m: ArrayLike, grade_length_m: ArrayLike = RANDOM_WALK_M) -> Floats:
    """Information (..., 4, 4) over (h0, g0, h1, g1) of intervals of these spacings (...) for q = 1."""
    d, length = np.broadcast_arrays(np.asarray(spacing_m, float), np.asarray(grade_length_m, float))
    step, inverse = np.zeros((*d.shape, 2, 4)), np.empty((*d.shape, 2, 2))
    run, left = grade_carried(d, length)
    step[..., [0, 1], [0, 1]], step[..., [0, 1], [2, 3]] = -1.0, 1.0
    step[..., 0, 1], step[..., 1, 1] = -run, -left
    height, both, grade = grade_noise(d, length)
    determinant = height * grade - both**2
    inverse[..., 0, 0], inverse[..., 1, 1] = grade / determinant, height / determinant
    inverse[..., 0, 1] = inverse[..., 1, 0] = -both / determinant
    return np.asarray(step.swapaxes(-1, -2) @ inverse @ step)
