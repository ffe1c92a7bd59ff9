"""Lines of roads as engineers lay them out, and the nodes by which a mapper draws them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from fusion.types import Floats

_STEP_M = 1.0
_SAGITTA_M = 0.5
"""How far a mapper lets the road bulge beyond a chord."""
_SHORTEST_M = 10.0
_EVEN_OUT_M = 25.0
"""Width over which node distances change: a mapper's last long chord ends before the bend begins."""


def rounded(
    corners: Sequence[tuple[float, float]], radii_m: Sequence[float], easing_m: float = 12.0
) -> Floats:
    """A line, shape (n, 2), about every metre: straights through ``corners`` with an arc at each inner one.

    ``radii_m`` has one radius per inner corner. Curvature sets in gradually: the line is blurred by a Gaussian of
    ``easing_m``, its ends kept. Raises ``ValueError`` where two arcs overlap.
    """
    points = [np.asarray(c, float) for c in corners]
    line = [points[0]]
    for before, corner, after, radius in zip(points, points[1:], points[2:], radii_m, strict=False):
        line += list(_fillet(line[-1], before, corner, after, radius))
    return eased(np.vstack([*line, points[-1]]), easing_m)


def _fillet(last: Floats, before: Floats, corner: Floats, after: Floats, radius: float) -> Floats:
    """Points of the arc that leads from the line ``before``-``corner`` to ``corner``-``after``."""
    u, v = _unit(corner - before), _unit(after - corner)
    turn = float(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))
    cut = radius * abs(np.tan(turn / 2))
    if cut > float(np.hypot(*(corner - last))) + 1e-6 or cut > float(np.hypot(*(after - corner))) + 1e-6:
        raise ValueError(f"an arc of {radius:.0f} m does not fit at {corner.round()}")
    left = np.sign(turn) * np.array([-u[1], u[0]])
    centre = corner - cut * u + radius * left
    return arc(centre, radius, float(np.arctan2(*(-left)[::-1])), turn)


def arc(centre: Floats, radius_m: float, start_rad: float, turn_rad: float) -> Floats:
    """Points of an arc, shape (n, 2), about every metre; ``start_rad`` is the direction of its first from the centre,
    ``turn_rad`` is positive anticlockwise."""
    count = max(2, int(np.ceil(radius_m * abs(turn_rad) / _STEP_M)) + 1)
    angle = start_rad + np.linspace(0.0, turn_rad, count)
    return np.asarray(centre + radius_m * np.column_stack([np.cos(angle), np.sin(angle)]))


def eased(line: Floats, width_m: float) -> Floats:
    """A line resampled to about a metre and blurred along itself; its ends, and the directions there, are kept."""
    s = distances(line)
    even = np.linspace(0.0, s[-1], max(3, round(s[-1] / _STEP_M) + 1))
    points = np.column_stack([np.interp(even, s, line[:, k]) for k in range(2)])
    pad = min(len(points) - 1, int(4 * width_m))
    wide = np.pad(points, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")
    return np.asarray(gaussian_filter1d(wide, width_m / _STEP_M, axis=0)[pad : pad + len(points)])


def distances(line: Floats) -> Floats:
    """Way along a line at each of its points, metres."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])


def node_places(line: Floats, longest_m: float, forced_m: Sequence[float] = ()) -> Floats:
    """Where along a line a mapper sets nodes, metres: its ends, ``forced_m``, and as many between as its bends ask for.

    Chords leave the line by half a metre at most, about, and are between 10 m and ``longest_m`` long, where what is
    forced allows it.
    """
    s = distances(line)
    chord = _chords(line, s, longest_m)
    chords = np.concatenate([[0.0], np.cumsum(np.diff(s) / ((chord[1:] + chord[:-1]) / 2))])
    stops = np.interp([0.0, *sorted(forced_m), s[-1]], s, chords)
    parts = [stops[:1]]
    for a, b in pairwise(stops):
        parts.append(np.linspace(a, b, max(1, round(b - a)) + 1)[1:])
    return np.asarray(np.interp(np.concatenate(parts), chords, s))


def _chords(line: Floats, s: Floats, longest_m: float) -> Floats:
    """Length of chord that the line's curvature allows at each point."""
    d1 = np.gradient(line, s, axis=0)
    heading = np.unwrap(np.arctan2(d1[:, 1], d1[:, 0]))
    curvature = np.abs(np.gradient(gaussian_filter1d(heading, 3.0), s))
    chord = np.clip(np.sqrt(8 * _SAGITTA_M / np.maximum(curvature, 1e-9)), _SHORTEST_M, longest_m)
    return np.asarray(np.exp(gaussian_filter1d(np.log(chord), _EVEN_OUT_M, mode="nearest")))


def at(line: Floats, places_m: Floats) -> Floats:
    """Points of a line at distances along it, shape (n, 2)."""
    s = distances(line)
    return np.column_stack([np.interp(places_m, s, line[:, k]) for k in range(2)])


def beside(line: Floats, right_m: float) -> Floats:
    """The line ``right_m`` to the right of another."""
    along = np.gradient(line, axis=0)
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    return np.asarray(line + right_m * np.column_stack([along[:, 1], -along[:, 0]]))


def nearest(line: Floats, point: tuple[float, float]) -> float:
    """Way along a line to its point nearest to ``point``, metres (to about half a step)."""
    return float(distances(line)[np.argmin(np.hypot(*(line - np.asarray(point, float)).T))])


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.hypot(*vector))
