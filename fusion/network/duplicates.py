"""Which drives are duplicates of others, maybe in another format, by times and places.

A receiver writes the same epochs into all of its logs, and a vehicle enters its segments at the same moments whichever
log says so. Neither logs nor what drives say of slopes is known here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fusion.arrays import nearest
from fusion.types import Floats, Ints

SAME_SHARE = 0.75
"""Of the shorter drive's segments and epochs, more than this share must be the other's too. A log in two formats shares
nearly all; two receivers in one vehicle, each 1.5 m wrong, a third of the entries."""
ENTRY_S = 0.1
"""Moments of entering a segment that differ by less are one: formats round positions to a metre, which a vehicle covers
in a tenth of a second (karlsruhe 09, one log in two formats: 0.005 s, 0.04 s with five decimals). Two vehicles, or one
vehicle twice, are that near to each other now and then, not all along."""
ENTRY_SHARE, LONGEST_ENTRY_S = 0.1, 3.0
"""The same, as a share of the time between epochs, and its bound: between positions far apart the entry is
interpolated. Who looks for drives that may be the same one need not look farther than the bound."""
EPOCH_S = 0.01
"""Epochs that differ by less are one: NMEA states hundredths of a second."""


@dataclass(frozen=True, eq=False)
class DriveTrace:
    """What tells a drive from others: its passes (p,) with the segment of each and when it was entered, the times of
    its positions (e,), ascending (none: unknown, and only entries count), and how many measurements it has.

    The times are the receiver's as logged: those of an estimated track are also other sensors', set right.
    """

    segment: Ints
    enter_s: Floats
    epoch_s: Floats
    measurements: int


def find_duplicates(traces: Mapping[int, DriveTrace]) -> dict[int, int]:
    """Drives that another one duplicates, each with the other: the one with more measurements.

    The order and the names of the drives have no part in it, unless two are alike to the last digit.
    """
    best_first = sorted(traces, key=lambda k: _rank(traces[k]))
    place = {k: at for at, k in enumerate(best_first)}
    together = _met_somewhere({place[k]: one for k, one in traces.items()})
    duplicates: dict[int, int] = {}
    for at, k in enumerate(best_first):
        better = (best_first[other] for other in together.get(at, ()))
        original = next(
            (o for o in better if o not in duplicates and is_duplicate(traces[k], traces[o])), None
        )
        if original is not None:
            duplicates[k] = original
    return duplicates


def _met_somewhere(traces: Mapping[int, DriveTrace]) -> dict[int, list[int]]:
    """For each drive those of smaller numbers, ascending, that entered some segment at about its time: no others can
    be the same drive."""
    drive = np.repeat(np.array([*traces], np.int64), [len(one.segment) for one in traces.values()])
    segment = np.concatenate([np.empty(0, np.int64), *(one.segment for one in traces.values())])
    enter_s = np.concatenate([np.empty(0), *(one.enter_s for one in traces.values())])
    order = np.lexsort((enter_s, segment))
    drive, segment, enter_s = drive[order], segment[order], enter_s[order]
    found = [np.empty((0, 2), np.int64)]
    first, apart = np.arange(len(order)), 0
    # Neighbours in the order of entering first, then those one farther, as long as any is near.
    while len(first):
        apart += 1
        first = first[first < len(order) - apart]
        second = first + apart
        near = (segment[first] == segment[second]) & (enter_s[second] - enter_s[first] < LONGEST_ENTRY_S)
        first, second = first[near], second[near]
        pairs = np.sort(np.column_stack([drive[first], drive[second]]), axis=1)
        found.append(np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0))
    together: dict[int, list[int]] = {}
    for smaller, larger in np.unique(np.concatenate(found), axis=0).tolist():
        together.setdefault(larger, []).append(smaller)
    return together


def _rank(one: DriveTrace) -> tuple[float, ...]:
    return -one.measurements, -len(one.segment), -len(one.epoch_s), float(one.enter_s.sum())


def is_duplicate(one: DriveTrace, other: DriveTrace) -> bool:
    """Whether two logs are of one drive; laps within a log are never compared."""
    if not _overlap(one.enter_s, other.enter_s):
        return False
    few, many = sorted((one, other), key=lambda w: len(np.unique(w.segment)))
    spacing = max(_spacing(one.epoch_s), _spacing(other.epoch_s))
    tolerance = float(np.clip(ENTRY_SHARE * spacing, ENTRY_S, LONGEST_ENTRY_S))
    if _met(few, many, tolerance) <= SAME_SHARE * len(np.unique(few.segment)):
        return False
    few, many = sorted((one, other), key=lambda w: len(w.epoch_s))
    return not len(few.epoch_s) or bool(np.mean(_nearest_s(few.epoch_s, many.epoch_s) < EPOCH_S) > SAME_SHARE)


def _overlap(one_s: Floats, other_s: Floats) -> bool:
    if not len(one_s) or not len(other_s):
        return False
    return bool(max(one_s.min(), other_s.min()) <= min(one_s.max(), other_s.max()) + ENTRY_S)


def _met(few: DriveTrace, many: DriveTrace, tolerance_s: float) -> int:
    """On how many segments of ``few`` both enter at one moment."""
    both = np.concatenate([few.enter_s, many.enter_s])
    _, segment = np.unique(np.concatenate([few.segment, many.segment]), return_inverse=True)
    # One axis for all segments, so far apart on it that none has a neighbour on another.
    place = segment * (np.ptp(both) + 2 * tolerance_s) + (both - both.min())
    n = len(few.segment)
    near = _nearest_s(place[:n], np.sort(place[n:])) < tolerance_s
    return len(np.unique(segment[:n][near]))


def _spacing(epoch_s: Floats) -> float:
    return float(np.median(np.diff(epoch_s))) if len(epoch_s) > 1 else 0.0


def _nearest_s(times: Floats, others: Floats) -> Floats:
    """How far each of ``times`` is from the nearest of ``others`` (ascending), s."""
    return np.asarray(np.abs(others[nearest(others, times)] - times))
