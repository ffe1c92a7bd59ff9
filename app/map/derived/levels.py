"""What is drawn at which level: how important a class of road is, and how coarse each level is. All in metres."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from app.core.tables.served import DRAWN_LEVELS
from app.network import ZOOM

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
HALF_WORLD = 20037508.342789244
"""Half the width of the world, EPSG:3857."""
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
