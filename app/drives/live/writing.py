"""Points as a log: a Versant CSV of the columns that something was measured of, and back."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

from app.drives.live.points import US, LivePoint

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
