"""Which of several files are one drive, and which are drives of their own. Arrays and times only: knows no format.

The rule. A file with positions, or with raw measurements of which they are computed, makes a drive. Two of these are
one drive where their times overlap, unless their positions at the same times are more than ``APART_M`` apart: then two
vehicles were on their way. Where their times do not overlap, they are drives of their own, but for a recorder that
begins a new file every few minutes: the same format, a gap of at most ``CONTINUED_WITHIN_S``, and positions that go on
within ``NEAR_M``. Files of sensors alone go with every drive that they overlap with, navigation data with all raw
measurements within a day of them.

Where the rule joins two files that could each be a drive, that is *unclear*, and is said; ``Rule.APART`` decides these
cases the other way.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fusion.formats.glance import Glance
from fusion.messages import say
from fusion.types import Floats

CONTINUED_WITHIN_S = 300.0
NEAR_M = 500.0
APART_M = 1000.0
SAME_TIME_S = 30.0
"""Between positions that are farther from each other in time it is not known where a vehicle was."""
CLOCKS_S = 60.0
"""By so much the clocks of a recording's sensors may differ."""
NAVIGATION_WITHIN_S = 86400.0


class Rule(StrEnum):
    """How files become drives."""

    AUTO = "auto"
    """By the rule above."""
    APART = "apart"
    """As ``AUTO``, but what is unclear are drives of their own."""
    ONE = "one"
    """All are one drive."""


class Why(StrEnum):
    """Why it is not sure that files are one drive."""

    CONTINUES = "continues"
    OVERLAPS = "overlaps"


@dataclass(frozen=True)
class Unclear:
    """Files of one drive, by number, that could be several."""

    files: tuple[int, ...]
    why: Why


@dataclass(frozen=True)
class Grouping:
    """Files by number: of each drive, in their order; of none, because they make no drive and belong to none."""

    drives: tuple[tuple[int, ...], ...]
    left: tuple[int, ...] = ()
    unclear: tuple[Unclear, ...] = ()


def grouped(files: Sequence[Glance], rule: Rule = Rule.AUTO) -> Grouping:
    """Tell which files are one drive. Every file that makes a drive is in exactly one; others may be in several.

    A file whose ends cannot be read is a drive of its own: whoever reads all of it will say what is wrong. Without any
    that makes a drive, all are one.
    """
    everything = tuple(range(len(files)))
    makers = [k for k in everything if files[k].makes_a_drive]
    unread = [k for k in everything if files[k].is_unread]
    if rule is Rule.ONE or (not makers and not unread):
        return Grouping((everything,) if files else ())
    joined, doubts = _joined(files, makers, rule)
    if len(joined) == 1 and not unread:
        return Grouping((everything,), (), _unclear(joined, doubts))
    left = []
    for k in everything:
        if k in makers or k in unread:
            continue
        homes = _homes(files, k, [[i for i in drive if files[i].makes_a_drive] for drive in joined])
        for home in homes:
            joined[home].append(k)
        if not homes:
            left.append(k)
    drives = sorted(sorted(drive) for drive in [*joined, *([k] for k in unread)])
    return Grouping(tuple(map(tuple, drives)), tuple(left), _unclear(drives, doubts))


def why_left(file: Glance) -> str:
    """Why a file is in no drive, as a sentence."""
    if file.has_navigation:
        return say("grouping.navigation")
    if not file.is_known:
        return say("grouping.unknown")
    return say("grouping.no_positions_then")


def why_repeated(same: str) -> str:
    """The sentence for a file of which another one, called ``same``, holds the same bytes."""
    return say("grouping.same", same=same)


def _joined(
    files: Sequence[Glance], makers: Iterable[int], rule: Rule
) -> tuple[list[list[int]], list[tuple[int, int, Why]]]:
    """The drives that ``makers`` make, and the pairs of them that are joined though they could be two."""
    drive_of = {k: [k] for k in makers}
    doubts = []
    for a, b in _near_in_time(files, drive_of):
        together, why = _relation(files[a], files[b])
        if not together or (why is not None and rule is Rule.APART):
            continue
        if why is not None:
            doubts.append((a, b, why))
        if drive_of[a] is not drive_of[b]:
            drive_of[a].extend(drive_of[b])
            for k in drive_of[b]:
                drive_of[k] = drive_of[a]
    drives = {id(drive): drive for drive in drive_of.values()}
    return list(drives.values()), doubts


def _near_in_time(files: Sequence[Glance], makers: Iterable[int]) -> list[tuple[int, int]]:
    """The pairs that can be one drive by their times, in the order of numbers: of thousands of files few."""
    near, going_on = list[tuple[int, int]](), list[int]()
    for k in sorted((k for k in makers if files[k].is_known), key=lambda k: files[k].first_s):
        begins_s = files[k].first_s - CONTINUED_WITHIN_S
        going_on = [other for other in going_on if files[other].last_s >= begins_s]
        near += [(min(k, other), max(k, other)) for other in going_on]
        going_on.append(k)
    return sorted(near)


def _relation(a: Glance, b: Glance) -> tuple[bool, Why | None]:
    """Whether two files that make drives are one, and why that is not sure."""
    if not (a.is_known and b.is_known):
        return False, None
    gap_s = max(a.first_s, b.first_s) - min(a.last_s, b.last_s)
    alike = a.has_positions == b.has_positions
    if gap_s < 0:
        if not alike or (a.is_of_several and a.source_format == b.source_format):
            return True, None
        return _distance_m(a.track, b.track) <= APART_M, Why.OVERLAPS
    if gap_s > CONTINUED_WITHIN_S or a.source_format != b.source_format or not alike:
        return False, None
    earlier, later = (a, b) if a.last_s <= b.last_s else (b, a)
    goes_on = not a.has_positions or bool(_metres(earlier.track[-1], later.track[0]) <= NEAR_M)
    return goes_on, Why.CONTINUES


def _homes(files: Sequence[Glance], k: int, drives: list[list[int]]) -> list[int]:
    """The drives, by number, that a file goes with which makes none itself; ``drives`` are of files that do."""
    file = files[k]
    gaps_s = [_gap_s(file, [files[i] for i in drive]) for drive in drives]
    if not file.has_navigation:  # of a file without times the gap is no number, and it goes with none
        return [n for n, gap_s in enumerate(gaps_s) if gap_s <= CLOCKS_S]
    measured = [n for n, drive in enumerate(drives) if any(files[i].has_signals for i in drive)]
    if len(measured) == 1 or not file.is_known:
        return measured
    return [n for n in measured if not gaps_s[n] > NAVIGATION_WITHIN_S]


def _gap_s(file: Glance, others: Sequence[Glance]) -> float:
    """Between a file and those of a drive, negative where they overlap; NaN where times are not known."""
    first_s = min(other.first_s for other in others)
    last_s = max(other.last_s for other in others)
    return max(file.first_s, first_s) - min(file.last_s, last_s)


def _distance_m(a: Floats, b: Floats) -> float:
    """How far two vehicles are from each other at the same times (median), 0 where that is not known."""
    if len(a) < 2 or len(b) < 1:
        return 0.0
    a = a[np.argsort(a[:, 0], kind="stable")]
    after = np.clip(np.searchsorted(a[:, 0], b[:, 0]), 1, len(a) - 1)
    inside = (a[after - 1, 0] <= b[:, 0]) & (b[:, 0] <= a[after, 0])
    shared = inside & (a[after, 0] - a[after - 1, 0] <= SAME_TIME_S)
    if not shared.any():
        return 0.0
    return float(np.median(_metres(a[after[shared]].T, b[shared].T)))


def _metres(a: Floats, b: Floats) -> Floats:
    """Between times and places (3,) or (3, n)."""
    turn = np.remainder(b[2] - a[2] + 180.0, 360.0) - 180.0
    return np.asarray(111_320.0 * np.hypot(b[1] - a[1], turn * np.cos(np.radians(a[1]))))


def _unclear(drives: Iterable[Sequence[int]], doubts: Sequence[tuple[int, int, Why]]) -> tuple[Unclear, ...]:
    out = []
    for drive in drives:
        for why in Why:
            files = sorted({k for a, b, w in doubts if w is why and a in drive for k in (a, b)})
            if files:
                out.append(Unclear(tuple(files), why))
    return tuple(out)
