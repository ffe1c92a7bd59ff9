"""The list that Strava puts beside the files of an export: which sport each of them is of.

``activities.csv`` has its header in the language of the account. So its columns are known by what is in them: the
name of the file is what reads like ``activities/123.fit.gz``, the sport stands in the fourth column, or else in the one
before the name that holds the most sports.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from io import StringIO

from fusion.formats.archives.sports import family

MOST_BYTES = 64 << 20
NAME = re.compile(r"activities/[^/]+\.(gpx|fit|tcx)(\.gz)?$", re.IGNORECASE)
FOURTH = 3
SAMPLE_ROWS = 200
MARK = re.compile(rb"[,;\"]activities/[^/,;\"]+\.(gpx|fit|tcx)", re.IGNORECASE)


def is_list(head: bytes) -> bool:
    """Whether a file that begins so names files of an export."""
    first = head[: 1 << 20]
    return b"\n" in first and not first.startswith((b"<", b"{")) and MARK.search(first) is not None


def sports_of(data: bytes) -> dict[str, str]:
    """The sport of each file by its name in the list, as the list calls it; empty where that is not found."""
    csv.field_size_limit(1 << 24)
    text = data.decode("utf-8-sig", "replace")
    try:
        rows = list(csv.reader(StringIO(text), delimiter=";" if text[:500].count(";") > 10 else ","))
    except csv.Error:
        return {}
    body = rows[1:]
    files = _best(body, lambda cell: NAME.search(cell) is not None)
    if files is None:
        return {}
    sports = FOURTH if _share(body, FOURTH, _is_sport) > 0.5 else _best(body, _is_sport, before=files)
    if sports is None:
        return {}
    width = max(files, sports)
    return {row[files]: row[sports] for row in body if len(row) > width and row[files]}


def _is_sport(cell: str) -> bool:
    return len(cell) <= 60 and bool(family(cell)) and not cell.strip().isdigit()


def _share(rows: list[list[str]], column: int, wanted: Callable[[str], bool]) -> float:
    cells = [row[column] for row in rows[:SAMPLE_ROWS] if len(row) > column]
    return sum(map(wanted, cells)) / max(len(cells), 1)


def _best(rows: list[list[str]], wanted: Callable[[str], bool], before: int | None = None) -> int | None:
    """The column that holds the most of what is wanted; None where none holds any."""
    width = max(map(len, rows[:SAMPLE_ROWS]), default=0)
    shares = [_share(rows, k, wanted) for k in range(width if before is None else before)]
    return max(range(len(shares)), key=shares.__getitem__) if any(shares) else None
