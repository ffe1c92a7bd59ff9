"""Where one drive ends and the next begins, told by the points of a stream alone: not by when or how they came.

A drive ends before a gap in time or in space; once it has stood still for as long as that gap in time; and where it is
as long as a log may be. What has not moved is no drive, and waits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from app.drives.live.points import US, LivePoint

GAP_M = 20_000.0
"""Between two points one after the other: longer than any tunnel of a road but one."""
STANDS_M = 100.0
"""Within it of a place a vehicle stands still, as far as a phone between houses tells."""
MOVED_M = 200.0
"""From where it began: less is no drive."""
MOST_POINTS = 100_000
LONGEST_US = 24 * 3600 * US

_DEG_M = 111_195.0


class Piece(NamedTuple):
    """Points ``[begin, end)`` that belong together."""

    begin: int
    end: int
    moved: bool
    """Whether it is a drive."""
    is_over: bool
    """Whether nothing that comes later can belong to it."""


def distance_m(a: LivePoint, b: LivePoint) -> float:
    """Metres between two places, as the crow flies; true to some per mille where they are near."""
    east = (b.lon_deg - a.lon_deg + 180.0) % 360.0 - 180.0
    north = b.lat_deg - a.lat_deg
    return _DEG_M * math.hypot(east * math.cos(math.radians((a.lat_deg + b.lat_deg) / 2)), north)


def cut(points: Sequence[LivePoint], silence_us: int) -> list[Piece]:
    """The pieces of points in the order of time."""
    pieces: list[Piece] = []
    begin = anchor = 0
    moved = False
    for at in range(1, len(points) + 1):
        if at == len(points):
            if begin < at:
                pieces.append(Piece(begin, at, moved, is_over=False))
            break
        here, before = points[at], points[at - 1]
        if at > begin and (here.time_us - before.time_us > silence_us or distance_m(before, here) > GAP_M):
            pieces.append(Piece(begin, at, moved, is_over=True))
            begin, moved = at, False
        if at == begin:
            anchor = at
            continue
        if distance_m(points[anchor], here) > STANDS_M:
            anchor = at
        moved = moved or distance_m(points[begin], here) > MOVED_M
        stands = moved and here.time_us - points[anchor].time_us >= silence_us
        if stands or at + 1 - begin >= MOST_POINTS or here.time_us - points[begin].time_us >= LONGEST_US:
            pieces.append(Piece(begin, at + 1, moved, is_over=True))
            begin, moved = at + 1, False
    return pieces
