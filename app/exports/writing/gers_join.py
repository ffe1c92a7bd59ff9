"""The rows that join segments to Overture's segments, and what a person is to know of the join.

Where the bridge file has ranges they decide; else a segment stands beside each Overture segment that its way went into.
Bridge files tell no directions. An Overture segment that is made of one way goes as that is drawn; one of several meets
its neighbours at nodes, which say how it goes along each of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple

from app.core.messages import say
from app.core.text import LENGTH_DIGITS, SLOPE_DIGITS, rounded
from app.exports.writing.gers import Bridge, Piece, Range
from app.exports.writing.way_places import Course, WayEnds, courses_of
from app.map.segment import Segment
from app.map.store import PAGE

if TYPE_CHECKING:
    from app.exports.source import Source

SNAP_M = 1.0
"""Overture cuts ways at nodes: an end of a range that lies so near to one is that node."""
SAME = 1e-6
"""Shares that differ by less are one place: files carry nine digits."""
SHARE_DIGITS = 9
COLUMNS = {
    "gers_id": "string",
    "gers_from": "double",
    "gers_to": "double",
    "candidates": "int32",
    "direction": "int32",
    "segment_id": "int64",
    "osm_way_id": "int64",
    "way_from": "double",
    "way_to": "double",
    "length_m": "double",
    "slope_percent": "double",
    "slope_sigma_percent": "double",
    "drives": "int32",
}
"""Column -> Arrow's name of its type."""


class _Part(NamedTuple):
    """A part of a segment in an Overture segment; None: not known."""

    gers_id: str | None
    on_gers: Range | None
    candidates: int
    direction: int | None
    on_way: Range | None
    share: float = 1.0
    """Of the segment's length."""


@dataclass
class Join:
    """The rows, and what is counted on the way."""

    source: Source
    bridge: Bridge | None
    ends: WayEnds
    ways: set[int] = field(default_factory=set)
    """All that have rows; of the same ..."""
    unknown: set[int] = field(default_factory=set)
    """... those that the bridge file does not know,"""
    changed: set[int] = field(default_factory=set)
    """those of which it knows another version,"""
    unplaced: set[int] = field(default_factory=set)
    """and those along which it is not known where a segment lies, or which part went where."""
    undirected: int = 0
    """Rows without a direction."""

    def rows(self) -> Iterator[tuple[Any, ...]]:
        """In the order of ``COLUMNS``."""
        segments = iter(self.source.asked_segments())
        while page := list(islice(segments, PAGE)):
            of_way: dict[int, list[Segment]] = {}
            for segment in page:
                of_way.setdefault(segment.osm_way_id, []).append(segment)
            courses = courses_of(self.source.whole_ways(sorted(self._with_neighbours(of_way))), self.ends)
            parts: dict[int, list[_Part]] = {}
            for way, some in of_way.items():
                parts |= self._parts(way, some, courses)
            for segment in page:
                for part in parts[segment.stored_id]:
                    self.undirected += part.gers_id is not None and part.direction is None
                    yield _row(segment, part)

    def notes(self) -> Iterator[str]:
        """What a person is to know of the join."""
        if self.bridge is None:
            yield say("export.gers_none")
        elif self.unknown:
            yield say("export.gers_unknown", n=len(self.unknown), all=len(self.ways))
        if self.changed:
            yield say("export.gers_changed", n=len(self.changed), all=len(self.ways))
        if self.unplaced:
            yield say("export.gers_unplaced", n=len(self.unplaced), all=len(self.ways))
        if self.undirected:
            yield say("export.gers_undirected", n=self.undirected)

    def _with_neighbours(self, ways: Iterable[int]) -> set[int]:
        """These ways, and those that Overture's segments of them consist of as well."""
        if self.bridge is None:
            return {*ways}
        gers = {piece.gers for way in ways for piece in self.bridge.of_way(way)}
        return {*ways} | {piece.way for one in gers for piece in self.bridge.of_gers(one)}

    def _parts(
        self, way: int, segments: Sequence[Segment], courses: Mapping[int, Course]
    ) -> dict[int, list[_Part]]:
        """The parts of some segments of a way, by their numbers."""
        pieces = [] if self.bridge is None else self.bridge.of_way(way)
        course = courses.get(way)
        told = _told(pieces)
        self._count(way, pieces, placed=course is not None and told)
        directions = [self._direction(piece, courses) for piece in pieces]
        if course is None or not told:
            names = {piece.gers_id: d for piece, d in zip(pieces, directions, strict=True)}
            return {one.stored_id: self._possible(one, names, course) for one in segments}
        ends = [_snapped(course, piece.on_way or (0.0, 1.0)) for piece in pieces]
        placed = list(zip(pieces, ends, directions, strict=True))
        return {one.stored_id: self._told(course.range_of(one), placed) for one in segments}

    @staticmethod
    def _told(on_way: Range, placed: Sequence[tuple[Piece, Range, int | None]]) -> list[_Part]:
        """The parts of a segment, by its range of the way and the pieces of that."""
        parts = []
        for piece, there, direction in placed:
            start, end = max(on_way[0], there[0]), min(on_way[1], there[1])
            if end > start:
                on_gers = _along(piece, (start, end), there, direction)
                share = (end - start) / (on_way[1] - on_way[0])
                parts.append(_Part(piece.gers_id, on_gers, 1, direction, (start, end), share))
        return parts or [_Part(None, None, 0, None, on_way)]

    @staticmethod
    def _possible(
        segment: Segment, directions: Mapping[str, int | None], course: Course | None
    ) -> list[_Part]:
        """A segment beside all that its way went into."""
        on_way = None if course is None else course.range_of(segment)
        if not directions:
            return [_Part(None, None, 0, None, on_way)]
        many = len(directions)
        return [_Part(gers_id, None, many, direction, on_way) for gers_id, direction in directions.items()]

    def _count(self, way: int, pieces: Sequence[Piece], *, placed: bool) -> None:
        self.ways.add(way)
        known = self.ends.of(way)
        versions = {piece.version for piece in pieces} - {0}
        if not pieces:
            self.unknown.add(way)
        if known is not None and known.version and versions - {known.version}:
            self.changed.add(way)
        if not placed:
            self.unplaced.add(way)

    def _direction(self, piece: Piece, courses: Mapping[int, Course]) -> int | None:
        """1 where its Overture segment goes as the way is drawn, else -1; None where the neighbours do not tell."""
        bridge = self.bridge
        if bridge is None:
            return None
        others = [one for one in bridge.of_gers(piece.gers) if one != piece]
        if piece.on_gers is None:
            return None if others else 1
        if _is_whole(piece.on_gers):
            return 1
        found = set()
        for end, (share, here) in enumerate(zip(piece.on_gers, (0, 1), strict=True)):
            ends = _nodes(piece, courses)
            for other in others:
                if other.on_gers is None or abs(other.on_gers[1 - end] - share) > SAME:
                    continue
                met = [node in _nodes(other, courses) for node in ends]
                if met in ([True, False], [False, True]):
                    found.add(1 if met[here] else -1)
        return found.pop() if len(found) == 1 else None


def _told(pieces: Sequence[Piece]) -> bool:
    """Whether it is told which part of a way went where; a whole way in two segments is told of neither."""
    several = len({piece.gers for piece in pieces}) > 1
    return len(pieces) < 2 or all(
        piece.on_way is not None and not (several and _is_whole(piece.on_way)) for piece in pieces
    )


def _is_whole(shares: Range) -> bool:
    return shares[1] - shares[0] > 1 - SAME


def _snapped(course: Course, on_way: Range) -> Range:
    nodes = [float(course.share[course.nearest(share)]) for share in on_way]
    near = [abs(node - share) * course.length_m <= SNAP_M for node, share in zip(nodes, on_way, strict=True)]
    start, end = (node if it else share for node, share, it in zip(nodes, on_way, near, strict=True))
    return (start, end) if start < end else on_way


def _nodes(piece: Piece, courses: Mapping[int, Course]) -> tuple[int, ...]:
    """The nodes in which the piece of a way begins and ends; none where that is not known."""
    course = courses.get(piece.way)
    if course is None or piece.on_way is None:
        return ()
    return tuple(course.node(course.nearest(share)) for share in piece.on_way)


def _along(piece: Piece, part: Range, whole: Range, direction: int | None) -> Range | None:
    """The range of the Overture segment that a part of the piece's range of the way is."""
    if piece.on_gers is None or direction is None:
        return None
    low, high = ((share - whole[0]) / (whole[1] - whole[0]) for share in part)
    if direction < 0:
        low, high = 1 - high, 1 - low
    start, end = piece.on_gers
    return start + low * (end - start), start + high * (end - start)


def _row(segment: Segment, part: _Part) -> tuple[Any, ...]:
    gers = part.on_gers or (None, None)
    way = part.on_way or (None, None)
    return (
        part.gers_id,
        *(rounded(share, SHARE_DIGITS) for share in gers),
        part.candidates,
        part.direction,
        segment.id,
        segment.osm_way_id,
        *(rounded(share, SHARE_DIGITS) for share in way),
        rounded(segment.length_m * part.share, LENGTH_DIGITS),
        rounded(segment.slope_percent, SLOPE_DIGITS),
        rounded(segment.slope_sigma_percent, SLOPE_DIGITS),
        segment.drives,
    )
