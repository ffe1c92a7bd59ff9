"""Where one drive ends and the next begins, told by the points of a stream alone: not by when or how they came.

A drive ends before a gap in time or in space; once it has stood still for as long as that gap in time; and where it is
as long as a log may be. What has not moved is no drive, and waits. A drive becomes a Versant CSV of the columns that
something was measured of.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
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


_ALWAYS = 3
"""Of the fields of a point: time and place."""
_UNSAFE = str.maketrans(dict.fromkeys('/\\:*?"<>|', "-"))


def log_of(points: Sequence[LivePoint]) -> bytes:
    """The log of points, which are in the order of time: the same points give the same bytes."""
    names = LivePoint._fields
    kept = [at for at in range(1, len(names)) if at < _ALWAYS or any(p[at] is not None for p in points)]
    lines = [",".join(("time_s", *(names[at] for at in kept)))]
    for point in points:
        cells = ("" if point[at] is None else repr(float(point[at] or 0.0)) for at in kept)
        lines.append(",".join((_time_text(point.time_us), *cells)))
    return ("\n".join(lines) + "\n").encode()


def points_in(log: bytes) -> list[LivePoint]:
    """The points of such a log."""
    rows = csv.DictReader(io.StringIO(log.decode(), newline=""))
    return [_point(row) for row in rows]


def filename_of(sender: str, device: str, points: Sequence[LivePoint]) -> str:
    """What the log is called: program, device and the minute of its first point (UTC)."""
    began = datetime.fromtimestamp(points[0].time_us // US, UTC)
    named = f"-{device.translate(_UNSAFE)}" if device else ""
    return f"{sender}{named}-{began:%Y-%m-%dT%H-%M}Z.csv"


def merged(known: Iterable[LivePoint], more: Iterable[LivePoint]) -> list[LivePoint]:
    """All points in the order of time; of two of one time that which is known."""
    by_time = {point.time_us: point for point in more} | {point.time_us: point for point in known}
    return [by_time[time_us] for time_us in sorted(by_time)]


def _point(row: dict[str, str]) -> LivePoint:
    whole, _, part = row["time_s"].partition(".")
    values = {name: float(row[name]) for name in LivePoint._fields[1:] if row.get(name)}
    return LivePoint(int(whole) * US + int(part.ljust(6, "0")[:6] or 0), **values)


def _time_text(time_us: int) -> str:
    whole, part = divmod(time_us, US)
    return f"{whole}.{part:06d}".rstrip("0").rstrip(".")
