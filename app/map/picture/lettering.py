"""Text on maps: what the font can write, how wide it gets, lines that fit a width, and where names of streets stand.

Names stand beside the longest measured streets, along them, on nothing else; lengths are metres of the ground, which
the map's scale turns into paper. Importing this imports matplotlib: import it where a picture is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.textpath import text_to_path
from numpy.typing import NDArray

from fusion.types import Floats

MISSING = "?"
"""Stands for what the font has no glyph of."""


@cache
def _glyphs() -> frozenset[int]:
    return frozenset(get_font(findfont(FontProperties())).get_charmap())


def is_writable(text: str) -> bool:
    """Whether the font has a glyph for every character."""
    return all(character.isprintable() and ord(character) in _glyphs() for character in text)


def writable(text: str) -> str:
    """Anyone's text on one line, with ``MISSING`` for what the font cannot write; control characters are spaces."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return "".join(c if is_writable(c) else MISSING for c in " ".join(printable.split()))


def width_pt(text: str, size_pt: float) -> float:
    """How wide a line is, points, in the font that pictures are written in."""
    width, _, _ = text_to_path.get_text_width_height_descent(text, FontProperties(size=size_pt), ismath=False)
    return float(width)


def wrapped(text: str, size_pt: float, room_pt: float) -> list[str]:
    """The text, made ``writable``, as lines that fit; a word longer than a line is broken."""
    lines = [""]
    for word in writable(text).split(" "):
        rest = word
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if width_pt(longer, size_pt) <= room_pt:
            lines[-1] = longer
            continue
        while rest:
            fits = _fitting(rest, size_pt, room_pt)
            lines.append(rest[:fits])
            rest = rest[fits:]
    return [line for line in lines if line] or [""]


def _fitting(word: str, size_pt: float, room_pt: float) -> int:
    """How many characters of a word fit, at least one."""
    low, high = 1, len(word)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if width_pt(word[:middle], size_pt) <= room_pt else (low, middle - 1)
    return low


MOST_NAMES = 14
"""Streets that are named, at most."""
PLACES_TRIED = 32
"""Along each street."""
STRAIGHT_SHARE = 0.85
"""Of the text's length, how much of its street lies along it, else it would stand beside a bend."""
CROSSED_SHARE = 0.3
"""Of the text's length, how much of other roads it may stand on: side streets are narrower than most names."""


class StreetName(NamedTuple):
    """A name with its middle, metres, and its direction, radians anticlockwise from east, readable from below."""

    text: str
    x_m: float
    y_m: float
    angle_rad: float


class _Box(NamedTuple):
    """A text's place: middle (2,), direction (2,), half of length and height."""

    middle: Floats
    along: Floats
    half_m: Floats

    def holds(self, points: Floats) -> NDArray[np.bool_]:
        """Which of the points (k, 2) lie inside."""
        away = points - self.middle
        across = np.array([-self.along[1], self.along[0]])
        inside: NDArray[np.bool_] = (np.abs(away @ self.along) <= self.half_m[0]) & (
            np.abs(away @ across) <= self.half_m[1]
        )
        return inside

    def grid(self) -> Floats:
        """Points all over the box, its corners among them."""
        across = np.array([-self.along[1], self.along[0]])
        u, v = np.meshgrid(np.linspace(-1, 1, 25) * self.half_m[0], np.linspace(-1, 1, 5) * self.half_m[1])
        grid: Floats = self.middle + u.reshape(-1, 1) * self.along + v.reshape(-1, 1) * across
        return grid


def place_names(
    lines_m: Floats,
    names: NDArray[np.object_],
    measured: NDArray[np.bool_],
    *,
    frame_m: tuple[float, float, float, float],
    height_m: float,
    length_m: Callable[[str], float],
) -> list[StreetName]:
    """The names of the longest measured streets that have a place, longest first.

    ``lines_m`` (n, 2, 2) are the ends of all segments, ``names`` those of their streets or None, ``frame_m`` the map's
    (left, bottom, right, top); ``height_m`` and ``length_m`` are those of text on the ground.
    """
    roads = points_along(lines_m, height_m)[0]
    taken: list[_Box] = []
    out: list[StreetName] = []
    for text, rows in _longest(lines_m, names, measured, frame_m):
        half = 0.5 * np.array([length_m(text), height_m])
        points, directions = points_along(lines_m[rows], height_m)
        free = (
            (float(box.holds(roads).sum()) * height_m / (2 * half[0]), box)
            for box in _candidates(points, directions, half)
            if _inside(box, frame_m) and not any(_overlap(box, other) for other in taken)
        )
        crossed, box = min(free, key=itemgetter(0), default=(math.inf, None))
        if box is not None and crossed <= CROSSED_SHARE:
            taken.append(box)
            (x, y), along = box.middle.tolist(), box.along
            out.append(StreetName(text, x, y, float(np.arctan2(along[1], along[0]))))
    return out


def _longest(
    lines_m: Floats,
    names: NDArray[np.object_],
    measured: NDArray[np.bool_],
    frame_m: tuple[float, float, float, float],
) -> list[tuple[str, NDArray[np.bool_]]]:
    """Names of measured streets and which segments are theirs, by their measured length in the frame."""
    left, bottom, right, top = frame_m
    middle = lines_m.mean(axis=1)
    shown = (middle[:, 0] > left) & (middle[:, 0] < right) & (middle[:, 1] > bottom) & (middle[:, 1] < top)
    length = np.hypot(*(lines_m[:, 1] - lines_m[:, 0]).T) * shown
    total: dict[str, float] = {}
    for row in np.flatnonzero(measured & shown):
        if names[row]:
            total[str(names[row])] = total.get(str(names[row]), 0.0) + float(length[row])
    ranked = sorted(total, key=lambda name: (-total[name], name))[:MOST_NAMES]
    return [(name, measured & shown & (names == name)) for name in ranked]


def points_along(lines_m: Floats, step_m: float) -> tuple[Floats, Floats]:
    """Points along segments, about ``step_m`` apart, (k, 2), and the unit vector of the segment of each."""
    along = lines_m[:, 1] - lines_m[:, 0]
    length = np.hypot(*along.T)
    count = np.ceil(length / step_m).astype(np.int64).clip(1)
    row = np.repeat(np.arange(len(lines_m)), count)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[row]
    return lines_m[row, 0] + share[:, None] * along[row], along[row] / np.maximum(length[row], 1e-9)[:, None]


def _candidates(points: Floats, directions: Floats, half_m: Floats) -> Iterator[_Box]:
    """Places on both sides of a street where it is straight for as long as the text is, the middle ones first."""
    order = np.argsort(np.hypot(*(points - points.mean(axis=0)).T), kind="stable")
    for k in order[:: max(len(order) // PLACES_TRIED, 1)]:
        away = points - points[k]
        near = np.hypot(*away.T) <= half_m[0]
        turned = np.exp(2j * np.arctan2(*directions[near].T[::-1])).sum()  # a street has no beginning
        angle = np.angle(turned) / 2  # -90 to 90 degrees: readable from below
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        beside = np.abs(away @ across) <= half_m[1]
        bins = np.floor((away[beside] @ along + half_m[0]) / (2 * half_m[1]))
        bins_of_text = np.ceil(half_m[0] / half_m[1])
        if len(np.unique(bins[(bins >= 0) & (bins < bins_of_text)])) < STRAIGHT_SHARE * bins_of_text:
            continue
        for side in (1.0, -1.0):
            yield _Box(points[k] + 2.0 * side * half_m[1] * across, along, half_m)


def _inside(box: _Box, frame_m: tuple[float, float, float, float]) -> bool:
    left, bottom, right, top = frame_m
    x, y = box.grid().T
    return bool(x.min() > left and x.max() < right and y.min() > bottom and y.max() < top)


def _overlap(one: _Box, other: _Box) -> bool:
    if np.hypot(*(one.middle - other.middle)) > np.hypot(*one.half_m) + np.hypot(*other.half_m):
        return False
    return bool(one.holds(other.grid()).any() or other.holds(one.grid()).any())
