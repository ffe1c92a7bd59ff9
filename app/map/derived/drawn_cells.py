"""The pieces of whole tiles: a block with the cells inside it from segments, one of a higher level from pieces."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from sqlalchemy.orm import Session

from app.map.derived import drawn_store as store
from app.map.derived.chains import chains_of, places
from app.map.derived.drawn_store import Drawn, Ends
from app.map.derived.levels import BELOW, BLOCK, FINEST, LEVELS, Level, children, is_link, rank
from app.map.derived.lines import Course, courses, together_m
from app.map.derived.pieces import Piece, Stretches, pieces_of
from fusion.types import Bools, Ints


@dataclass
class Redrawn:
    """Of each level the pieces of some tiles, as they are and as they ought to be."""

    before: dict[int, Drawn] = field(default_factory=dict)
    after: dict[int, Drawn] = field(default_factory=dict)

    def add(self, session: Session, level: int, tile: int, pieces: Collection[Piece]) -> None:
        """What a tile ought to have."""
        self.before.setdefault(level, {}).update(store.drawn(session, level, [tile]))
        self.after.setdefault(level, {})[tile] = {piece.segment_id: piece for piece in pieces}

    def changed(self, level: int) -> set[int]:
        """The tiles of which that differs."""
        before, after = self.before.get(level, {}), self.after.get(level, {})
        return {tile for tile in after if after[tile] != before[tile]}


def draw_block(session: Session, block: int, tiles: Collection[int]) -> Redrawn:
    """A tile of the level ``BLOCK``, and those of ``FINEST`` inside it that are named."""
    cells = children(BLOCK, block)
    stretches, ends = store.segments_in(session, cells, tiles)
    redrawn = Redrawn()
    for tile in tiles:
        rows = np.flatnonzero(ends.cell == tile)
        one = stretches.subset(rows)
        redrawn.add(session, FINEST, tile, all_roads(one, Ends(*(column[rows] for column in ends))))
    level = LEVELS[BLOCK]
    # Of tiles that are drawn as a whole, all is there; of the others what the level shows.
    if not any(level.chosen(highway) for highway in set(stretches.highway.tolist())):
        classes = store.most_important_in(session, cells)
        stretches, _ = store.segments_in(session, cells, (), classes)
    redrawn.add(session, BLOCK, block, greater_roads(level, stretches))
    return redrawn


def draw_above(session: Session, level: int, tile: int) -> Redrawn:
    """A tile of a level that is made of the pieces of the level below."""
    below = store.drawn(session, BELOW[level], children(level, tile))
    stretches = store.stretches_of(piece for pieces in below.values() for piece in pieces.values())
    redrawn = Redrawn()
    redrawn.add(session, level, tile, greater_roads(LEVELS[level], stretches))
    return redrawn


def all_roads(stretches: Stretches, ends: Ends) -> list[Piece]:
    """The pieces of the finest level: all roads of a tile, each way for itself, in its direction."""
    key = _numbers(ends.osm_way_id, stretches.oneway, _kinds(stretches))
    n = len(stretches)
    points = np.concatenate(
        [stretches.points[stretches.first[:-1]], stretches.points[stretches.first[1:] - 1]]
    )
    place = places(np.tile(key, 2), np.concatenate([ends.from_node, ends.to_node]), points)
    chains = chains_of(key, stretches.ids, place[:n], place[n:])
    rows, first = chains.rows.tolist(), chains.first.tolist()
    lines = [Course(rows[a:b], [False] * (b - a)) for a, b in pairwise(first)]
    return pieces_of(LEVELS[FINEST], lines, stretches)


def greater_roads(level: Level, stretches: Stretches) -> list[Piece]:
    """The pieces of another level: its classes, or the most important that there is, and what of others was driven."""
    chosen = _chosen(level, stretches)
    driven = np.flatnonzero(~chosen & stretches.measured)
    start, end = _ends(stretches)
    far = together_m(start[driven], end[driven], stretches.length_m[driven]) >= level.driven_m
    chosen_rows = np.sort(np.concatenate([np.flatnonzero(chosen), driven[far]]))
    roads = stretches.subset(chosen_rows).one_way_forward()
    start, end = _ends(roads)
    return pieces_of(level, courses(roads.ids, start, end, _kinds(roads), roads.oneway > 0), roads)


def _chosen(level: Level, stretches: Stretches) -> Bools:
    of_class = {highway: level.chosen(highway) for highway in set(stretches.highway.tolist())}
    if of_class and not any(of_class.values()):
        best = min((is_link(highway), rank(highway)) for highway in of_class)
        of_class = {highway: (is_link(highway), rank(highway)) == best for highway in of_class}
    return np.array([of_class[highway] for highway in stretches.highway.tolist()], bool)


def _kinds(stretches: Stretches) -> Ints:
    numbers: dict[str, int] = {}
    return np.array(
        [numbers.setdefault(highway, len(numbers)) for highway in stretches.highway.tolist()], np.int64
    )


def _numbers(*columns: Ints) -> Ints:
    """A number for each combination that there is."""
    if not len(columns[0]):
        return np.empty(0, np.int64)
    return np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _ends(stretches: Stretches) -> tuple[Ints, Ints]:
    """Numbers of the places where stretches begin and end; those that meet share coordinates to the last digit."""
    n = len(stretches)
    if not n:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    ends = np.concatenate([stretches.points[stretches.first[:-1]], stretches.points[stretches.first[1:] - 1]])
    place = np.unique(ends[:, 0] + 1j * ends[:, 1], return_inverse=True)[1].reshape(-1).astype(np.int64)
    return place[:n], place[n:]
