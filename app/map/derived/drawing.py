"""Lines of road cut into pieces, as many as a tile has room for. Where the stretches come from is not known here.

What is drawn at which level: how important a class of road is, and how coarse each level is. All in metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from app.core.tables import SRID_TILES
from app.core.tables.served import DRAWN_LEVELS
from app.map.derived.chains import Course
from app.map.derived.lines import HALF_WORLD
from app.network import ZOOM
from fusion.types import Bools, Floats, Ints

_RANKS = {
    "motorway": 0,
    "trunk": 1,
    "primary": 2,
    "secondary": 3,
    "tertiary": 4,
    "unclassified": 5,
    "residential": 6,
    "living_street": 7,
    "road": 7,
    "service": 8,
    "track": 9,
}
LEAST = max(_RANKS.values()) + 1
"""The rank of what has none."""
_LINK = "_link"
_EXTENT = 4096


def rank(highway: str) -> int:
    """0 for motorways, then less and less important; ramps as what they belong to."""
    return _RANKS.get(highway.removesuffix(_LINK), LEAST)


def is_link(highway: str) -> bool:
    """Whether it is a ramp."""
    return highway.endswith(_LINK)


@dataclass(frozen=True)
class Level:
    """One of ``DRAWN_LEVELS``: drawn at this zoom and at the one below."""

    zoom: int
    least_rank: int
    """Classes up to this rank are drawn whether driven or not."""
    links: bool
    """Ramps as well; where they are not, they go as the least important."""
    most_m: float
    """No piece is longer, unless one segment is."""
    mixed_m: float
    """Of a piece, shorter stretches may be measured or not as the rest is not."""
    driven_m: float
    """Of roads of lesser classes those are drawn that were driven and hang together for so much."""

    @property
    def tile_zoom(self) -> int:
        """Of the tiles in which pieces of the level are drawn; those of the finest level are cells."""
        return self.zoom + 2

    @property
    def tolerance_m(self) -> float:
        """Metres of EPSG:3857: two units of a tile of the level's zoom, a quarter of what a screen shows of it."""
        return 2 * (2 * HALF_WORLD / (1 << self.zoom)) / _EXTENT

    def chosen(self, highway: str) -> bool:
        """Whether roads of the class are drawn whether driven or not."""
        return rank(highway) <= self.least_rank and (self.links or not is_link(highway))


LEVELS = {
    level.zoom: level
    for level in (
        Level(12, LEAST, links=True, most_m=300.0, mixed_m=30.0, driven_m=0.0),
        Level(10, 4, links=True, most_m=1200.0, mixed_m=120.0, driven_m=300.0),
        Level(8, 2, links=False, most_m=5000.0, mixed_m=500.0, driven_m=1200.0),
        Level(6, 1, links=False, most_m=20_000.0, mixed_m=2000.0, driven_m=5000.0),
    )
}
assert tuple(LEVELS) == DRAWN_LEVELS  # noqa: S101 - each has its index

FINEST, BLOCK = DRAWN_LEVELS[:2]
"""The two that are drawn from segments: a tile of the second, a block, is drawn together with those of the first
inside it."""
ABOVE = dict(pairwise(DRAWN_LEVELS[1:]))
"""The level that is drawn from the pieces of another."""
BELOW = {above: below for below, above in ABOVE.items()}

CHOSEN = tuple(
    name + suffix for name in _RANKS for suffix in ("", _LINK) if LEVELS[BLOCK].chosen(name + suffix)
)
"""The classes that blocks show whether driven or not."""


def tile_of(cell: int, level: int) -> int:
    """The tile of a level that a cell lies in."""
    by = ZOOM - LEVELS[level].tile_zoom
    x, y = cell >> ZOOM, cell & ((1 << ZOOM) - 1)
    return (x >> by) << LEVELS[level].tile_zoom | y >> by


def parent(level: int, tile: int) -> int:
    """The tile of the level above ``level``, two zooms below, that one of it lies in."""
    zoom = LEVELS[level].tile_zoom
    x, y = tile >> zoom, tile & ((1 << zoom) - 1)
    return (x >> 2) << (zoom - 2) | y >> 2


def children(level: int, tile: int) -> list[int]:
    """The sixteen tiles of the level below, two zooms above, inside one of ``level``."""
    zoom = LEVELS[level].tile_zoom
    x, y = tile >> zoom, tile & ((1 << zoom) - 1)
    return [(4 * x + dx) << (zoom + 2) | (4 * y + dy) for dx in range(4) for dy in range(4)]


SLOPE_DIGITS = 2
"""Of slopes and sigmas: what is alike is stored once in a tile."""
_LENGTH_DIGITS = 1

ROOM_BYTES = 3600.0
"""What the pieces of one tile may take of a compressed vector tile, which shows 64 of them at most: 230 of 250 kB."""
_PIECE_BYTES, _SLOPE_BYTES, _POINT_BYTES = 9.0, 6.5, 2.0
"""What a piece takes, what more if it has a slope, and for each point; as it is in tiles of towns."""
_DRIVEN_RANKS = 3
"""A driven road stays where there is no room as long as one that is so much more important."""


@dataclass(frozen=True, eq=False)
class Stretches:
    """n stretches of road between two places: segments, or pieces of a finer level; columns of shape (n,)."""

    ids: Ints
    highway: NDArray[np.object_]
    oneway: Ints
    length_m: Floats
    slope_percent: Floats
    """Along the line; NaN where nothing is measured."""
    sigma_percent: Floats
    drives: Ints
    points: Floats
    """Of all lines, one after the other, EPSG:3857, shape (N, 2)."""
    first: Ints
    """Where each begins in ``points``, and the end: (n + 1,)."""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def measured(self) -> Bools:
        """Whether anything is."""
        return np.isfinite(self.slope_percent)

    @property
    def end_points(self) -> Floats:
        """Where each begins, then where each ends, (2n, 2)."""
        return np.asarray(self.points[np.concatenate([self.first[:-1], self.first[1:] - 1])], float)

    def subset(self, rows: Ints) -> Stretches:
        """These rows in this order."""
        columns = {k: v[rows] for k, v in vars(self).items() if k not in ("points", "first")}
        count = np.diff(self.first)[rows]
        first = np.concatenate([[0], np.cumsum(count)])
        at = np.arange(first[-1]) + np.repeat(self.first[:-1][rows] - first[:-1], count)
        return Stretches(**columns, points=self.points[at], first=first)

    def one_way_forward(self) -> Stretches:
        """The same with those that may only be driven against their direction turned round."""
        back = np.flatnonzero(self.oneway < 0)
        if not len(back):
            return self
        turned = {
            "oneway": np.abs(self.oneway),
            "slope_percent": np.where(self.oneway < 0, -self.slope_percent, self.slope_percent),
        }
        points = self.points.copy()
        for row in back.tolist():
            a, b = self.first[row], self.first[row + 1]
            points[a:b] = self.points[a:b][::-1]
        return Stretches(**(vars(self) | turned | {"points": points}))


class Piece(NamedTuple):
    """A row of ``drawn_pieces`` but for its level and tile."""

    segment_id: int
    rank: int
    highway: str
    oneway: int
    slope_percent: float | None
    slope_sigma_percent: float | None
    drives: int
    length_m: float
    geom_3857: bytes


def pieces_of(level: Level, courses: Sequence[Course], stretches: Stretches) -> list[Piece]:
    """The pieces of these lines that there is room for, by the lowest id of their stretches.

    Slopes are means over what was measured of a piece, by length, along its line: a stretch that is gone through
    against its direction counts with the other sign. Errors of neighbours go together, so the mean's sigma is theirs,
    by length. ``drives`` are the fewest over what was measured.
    """
    parts = list(_parts(level, courses, stretches))
    if not parts:
        return []
    rows = np.array([row for part in parts for row in part.rows])
    turned = np.array([t for part in parts for t in part.turned])
    begins = np.cumsum([0, *(len(part.rows) for part in parts)])[:-1]
    number = np.repeat(np.arange(len(parts)), np.diff(begins, append=len(rows)))
    line = _lines(stretches, rows, turned, number, level.tolerance_m)
    length = np.asarray(np.bincount(number, stretches.length_m[rows]), float)
    weight = np.where(stretches.measured & (stretches.drives > 0), stretches.length_m, 0.0)[rows]
    # A measured part may be a gap alone: a short one that goes with what is beside it, cut off there for its length.
    measured = np.array([part.measured for part in parts]) & (np.bincount(number, weight) > 0)
    signed = np.where(turned, -1.0, 1.0) * stretches.slope_percent[rows]
    with np.errstate(invalid="ignore", divide="ignore"):
        slope, sigma = (
            np.bincount(number, np.where(weight > 0, weight * value, 0.0)) / np.bincount(number, weight)
            for value in (signed, stretches.sigma_percent[rows])
        )
    most = np.iinfo(np.int64).max
    drives = np.minimum.reduceat(np.where(weight > 0, stretches.drives[rows], most), begins)
    ids = np.minimum.reduceat(stretches.ids[rows], begins)
    head = rows[begins]
    ranks = np.array([rank(highway) for highway in stretches.highway[head].tolist()])
    order = _with_room(stretches, head, ranks, measured, length, ids, shapely.get_num_coordinates(line))
    columns = (
        ids,
        ranks,
        stretches.highway[head],
        stretches.oneway[head],
        np.round(slope, SLOPE_DIGITS) + 0.0,
        np.round(sigma, SLOPE_DIGITS),
        np.where(measured, drives, 0),
        np.round(length, _LENGTH_DIGITS),
        shapely.to_wkb(shapely.set_srid(line, SRID_TILES), include_srid=True),
    )
    rows_of_pieces = zip(
        *(column[order].tolist() for column in columns), measured[order].tolist(), strict=True
    )
    return [Piece(*row) if known else Piece(*row)._replace(**_UNKNOWN) for *row, known in rows_of_pieces]


_UNKNOWN: dict[str, Any] = {"slope_percent": None, "slope_sigma_percent": None}


class _Part(NamedTuple):
    rows: list[int]
    turned: list[bool]
    measured: bool


def _parts(level: Level, courses: Sequence[Course], stretches: Stretches) -> Iterator[_Part]:
    length, measured = stretches.length_m.tolist(), stretches.measured.tolist()
    for rows, turned in courses:
        for start, end, known in cut(
            [length[row] for row in rows], [measured[row] for row in rows], level.most_m, level.mixed_m
        ):
            yield _Part(rows[start:end], turned[start:end], known)


def cut(
    length_m: Sequence[float], measured: Sequence[bool], most_m: float, mixed_m: float
) -> list[tuple[int, int, bool]]:
    """Where to cut a line of stretches: (first, last + 1, whether the piece is measured) of each piece.

    It is cut where measured becomes unmeasured or the other way round; what would be shorter than ``mixed_m`` for
    itself goes with what is beside it, the shortest first. What is left is cut before it gets longer than ``most_m``.
    """
    runs: list[tuple[float, int, bool]] = []  # length, end, measured
    for k, (long, known) in enumerate(zip(length_m, measured, strict=True)):
        if runs and runs[-1][2] == known:
            runs[-1] = (runs[-1][0] + long, k + 1, known)
        else:
            runs.append((long, k + 1, known))
    while len(runs) > 1:
        k = min(range(len(runs)), key=lambda k: runs[k][0])
        if runs[k][0] >= mixed_m:
            break
        near = runs[max(k - 1, 0) : k + 2]
        runs[max(k - 1, 0) : k + 2] = [(sum(run[0] for run in near), near[-1][1], not runs[k][2])]
    pieces, start = [], 0
    for _, end, known in runs:
        so_far = 0.0
        for k in range(start, end):
            if so_far and so_far + length_m[k] > most_m:
                pieces.append((start, k, known))
                start, so_far = k, 0.0
            so_far += length_m[k]
        pieces.append((start, end, known))
        start = end
    return pieces


def _with_room(
    s: Stretches, head: Ints, ranks: Ints, measured: Bools, length_m: Floats, ids: Ints, points: Ints
) -> Ints:
    """Which pieces stay, by their ids: least go those of important classes, that were driven, and long ones."""
    takes = _PIECE_BYTES + _SLOPE_BYTES * measured + _POINT_BYTES * points
    ramp = np.array([is_link(highway) for highway in s.highway[head].tolist()])
    order = np.lexsort((ids, -length_m, ramp, ranks - _DRIVEN_RANKS * measured))
    room = np.cumsum(takes[order]) <= ROOM_BYTES
    room[0] = True
    staying = order[room]
    return staying[np.argsort(ids[staying])]


def _lines(s: Stretches, rows: Ints, turned: Bools, number: Ints, tolerance_m: float) -> NDArray[np.object_]:
    """The course of each piece, no more exact than a tile can show; one that would be a point stays as it is."""
    count = np.diff(s.first)[rows]
    offset = np.cumsum(count) - count
    along = np.arange(count.sum()) - np.repeat(offset, count)
    begin, end = np.repeat(s.first[:-1][rows], count), np.repeat(s.first[1:][rows] - 1, count)
    points = s.points[np.where(np.repeat(turned, count), end - along, begin + along)]
    of = np.repeat(number, count)
    # Where two stretches meet, one point is enough.
    again = np.concatenate([[False], (np.diff(of) == 0) & np.all(np.diff(points, axis=0) == 0, axis=1)])
    exact = shapely.linestrings(points[~again], indices=of[~again])
    simple = shapely.simplify(exact, tolerance_m, preserve_topology=False)
    return np.asarray(np.where(shapely.length(simple) > 0, simple, exact), object)
