"""Points of a track out of XML, as columns: what GPX and TCX share. Knows neither.

By expat with handlers, since a tree, or even an event an element, costs several times as much: a point is a few numbers
in arrays from the moment that it is read. Prefixes of names are ignored, declared or not.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Mapping, MutableSequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import repeat
from typing import Any
from xml.parsers import expat

import numpy as np

from fusion.errors import MalformedLogError
from fusion.formats.base import Data, Notes, number_or_nan, refuse_many
from fusion.formats.glance import Ends
from fusion.formats.time_texts import unix_seconds
from fusion.messages import say
from fusion.types import Bools, Floats, Ints, Progress

CHUNK_BYTES = 1 << 18
TIMES_AT_ONCE = 1 << 14
LONGEST_TEXT = 64
"""Characters of a value that are looked at, beyond any number or time."""
DEEPEST = 100
"""Elements within each other, several times what any recorder writes: each that is open costs memory."""

MOST_NAMES = 1000
"""Names of elements that are remembered: a document may make them up without end."""

_START_TAG = re.compile(rb"<[A-Za-z][^<>]*>")

TIME, IGNORED, POINT, BREAK, OTHER = -1, -2, -3, -4, -5
"""What an element is, where it is no field, which are numbered from 0."""


@dataclass(frozen=True)
class Layout:
    """Local names of elements in a kind of document.

    ``point`` holds a point, with numbers in the ``attributes`` and elements named in ``fields`` (element -> column; the
    first of a column counts); ``time`` is the element of its time. ``breaks`` are elements that begin a new piece of
    track, ``others`` such as make a document of another purpose; both are counted.
    """

    what: str
    point: str
    time: str
    attributes: tuple[str, ...]
    fields: Mapping[str, str]
    breaks: tuple[str, ...]
    others: tuple[str, ...]


def excerpt(ends: Ends, layout: Layout) -> bytes:
    """A short document of the first and the last points of a long one; its end tags may be those of other elements."""
    tag = re.compile(rb"<(?:[\w.-]+:)?" + layout.point.encode() + rb"[\s>]")
    start, first = ends.start, tag.search(ends.head)
    if first is not None and first.start() > len(start) and (root := _START_TAG.search(start)):
        start = start[: root.end()] + ends.head[first.start() :][: ends.excerpt_bytes]
    points = [point.start() for point in tag.finditer(start)]
    again = tag.search(ends.end)
    if not points or again is None:
        return start
    return start[: points[-1]] + ends.end[again.start() :]


@dataclass
class Points:
    """Points in file order, ``count`` of them: ``columns`` (n,) by name, NaN where unknown.

    ``breaks`` are (element, index of the next point) in file order; ``others`` how often each of those came; ``timed``
    points have a time, readable or not.
    """

    time_s: Floats
    columns: dict[str, Floats]
    breaks: list[tuple[str, int]]
    others: dict[str, int]
    timed: int

    def __len__(self) -> int:
        return len(self.time_s)

    def column(self, name: str) -> Floats:
        """A column, all NaN where no point has it."""
        return self.columns.get(name, np.full(len(self), np.nan))

    def pieces(self, element: str) -> Ints:
        """By point, how many of these elements began before it."""
        starts = np.array([at for name, at in self.breaks if name == element], np.int64)
        return np.searchsorted(starts, np.arange(len(self)), side="right")


def read_points(data: Data, layout: Layout, notes: Notes, progress: Progress) -> Points:
    """The points of a document up to where it is broken, which is said.

    Raises ``MalformedLogError`` if it is broken before the first point, or an attack.
    """
    reader = _Reader(layout)
    view, what = memoryview(data), layout.what
    try:
        for at in range(0, len(view), CHUNK_BYTES):
            progress("read points", at / len(view))
            reader.feed(bytes(view[at : at + CHUNK_BYTES]))
            refuse_many(reader.count)
        reader.close()
    except (expat.ExpatError, ValueError, LookupError) as error:
        line = getattr(error, "lineno", 0)
        where = say("place.line", n=line) if line else "the beginning"
        if not reader.count:
            raise MalformedLogError(
                say("xml.broken_at_start", what=what, where=where),
                where=where,
            ) from error
        notes.repaired["broken XML: read up to the break"] += 1
        notes.warn(say("xml.broken", what=what, where=where, n=reader.count))
    return reader.points(notes)


class _Reader:
    """The handlers, and what they fill. They run for every tag: so there are few steps in each."""

    def __init__(self, layout: Layout) -> None:
        self._what = layout.what
        self.columns = {name: array("d") for name in (*layout.attributes, *layout.fields.values())}
        self._times: list[str | None] = []
        """Of the points that came since they were last read into numbers."""
        self._time_s: list[Floats] = []
        self._has_time: list[Bools] = []
        self._timed = 0
        """Of so many points the times are numbers already."""
        self._wrong: str | None = None
        """The first time that cannot be read."""
        self.count = 0
        """Points that are complete."""
        self._breaks: list[tuple[str, int]] = []
        self._others: dict[str, int] = {}
        kinds = (
            dict.fromkeys(layout.breaks, BREAK)
            | dict.fromkeys(layout.others, OTHER)
            | {element: k for k, element in enumerate(layout.fields)}
            | {layout.time: TIME, layout.point: POINT}
        )
        self._kind_of = lru_cache(MOST_NAMES)(lambda name: kinds.get(name.rpartition(":")[2], IGNORED))
        self._targets = [self.columns[column] for column in layout.fields.values()]
        self._attributes = [(name, self.columns[name]) for name in layout.attributes]
        self._depth = 0
        self._inside = 0
        """How deep the point is that the parser is in; 0: in none."""
        self._wanted = IGNORED
        """What the text that is read is: a field, ``TIME``, or nothing."""
        self._pieces: list[str] = []
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._pieces.append
        parser.EntityDeclHandler = self._refuse_entities
        self._parser = parser

    def feed(self, piece: bytes) -> None:
        """Read on."""
        self._parser.Parse(piece)
        if self._depth > DEEPEST:
            raise MalformedLogError(say("xml.nested", what=self._what, most=DEEPEST))
        if len(self._times) >= TIMES_AT_ONCE:
            self._read_times(self.count)
        # no number and no time is as long as what may have come together here
        self._pieces[:] = ["".join(self._pieces)[:LONGEST_TEXT]]

    def close(self) -> None:
        """Raises ``ExpatError`` if the document is not complete."""
        self._parser.Parse(b"", True)

    def _refuse_entities(self, *_: object) -> None:
        raise MalformedLogError(say("xml.entities", what=self._what))

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        kind = self._kind_of(name)
        if kind == IGNORED:
            return
        if self._inside:
            if kind >= TIME:
                self._wanted = kind
                self._pieces.clear()
        elif kind == POINT:
            self._inside = self._depth
            for attribute, column in self._attributes:
                column.append(number_or_nan(attributes.get(attribute, "")))
        elif kind == BREAK:
            self._breaks.append((name.rpartition(":")[2], self.count))
        elif kind == OTHER:
            local = name.rpartition(":")[2]
            self._others[local] = self._others.get(local, 0) + 1

    def _end(self, name: str) -> None:
        kind = self._wanted
        if kind != IGNORED:
            self._wanted = IGNORED
            pieces = self._pieces
            text = pieces[0] if len(pieces) == 1 else "".join(pieces)
            if kind == TIME:
                at = self.count - self._timed
                _put(self._times, at, text.strip()[:LONGEST_TEXT] or None, absent=None)
            else:
                _put(self._targets[kind], self.count, number_or_nan(text), absent=np.nan)
        elif self._depth == self._inside:
            self._inside = 0
            self.count += 1
        self._depth -= 1

    def points(self, notes: Notes) -> Points:
        """What was read, to be called once."""
        columns = {}
        for name, values in self.columns.items():
            if len(values):
                values.extend(repeat(np.nan, self.count - len(values)))
                column = np.frombuffer(values)[: self.count]
                column[~np.isfinite(column)] = np.nan
                columns[name] = column
        self._read_times(self.count)
        time_s, has_time = np.concatenate(self._time_s), np.concatenate(self._has_time)

        def tell(point: int) -> str:
            return say("xml.no_time", n=point + 1, text=self._wrong)

        notes.sift((("times that cannot be read", np.isnan(time_s) & has_time),), tell, position=True)
        return Points(time_s, columns, self._breaks, self._others, int(has_time.sum()))

    def _read_times(self, count: int) -> None:
        """Read the times of the first ``count`` points: as texts they take ten times the room."""
        missing = count - self._timed
        texts, self._times = self._times[:missing], self._times[missing:]
        texts += [None] * (missing - len(texts))
        time_s = unix_seconds(texts)
        has_time = np.array([text is not None for text in texts], bool)
        wrong = np.flatnonzero(np.isnan(time_s) & has_time)
        if len(wrong) and self._wrong is None:
            self._wrong = texts[wrong[0]]
        self._time_s.append(time_s)
        self._has_time.append(has_time)
        self._timed = count


def _put(column: MutableSequence[Any], point: int, value: object, *, absent: object) -> None:
    """Put the value of a point behind those of the points before, of which some have none; the first counts."""
    missing = point - len(column)
    if missing >= 0:
        column.extend(repeat(absent, missing))
        column.append(value)
