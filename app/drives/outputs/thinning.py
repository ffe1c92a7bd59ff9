"""Fewer points of long columns, for screens: peaks and bends stay.

The points are shared between a chart over the distance and a line on a map. For the chart the columns are cut into
stretches of equal length, and the highest and the lowest value of every column stay of each (min/max decimation, as
oscilloscopes draw): on as many columns of pixels the picture is the same as of all points. Largest-triangle-three-
buckets draws smoother lines from as few points, but drops a peak beside a higher one's triangle, and peaks of grade are
what a profile is read for. For the map, of each of shorter stretches the place stays that lies farthest off the
straight line between the stretch's ends: bends stay bends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fusion.types import Bools, Floats, Ints

LEAST, MOST = 2, 100_000
"""Points that may be asked for."""


def thinned(
    points: int,
    along_m: Floats,
    peaks: Sequence[Floats],
    starts: Bools,
    outage: Bools,
    place: tuple[Floats, Floats] | None = None,
) -> Ints:
    """Which rows stay of columns of one length, in order; all, where these are no more than ``points``.

    First the ends of all and of each gap (``starts`` is the first row after one), then half of the points that are
    left for ``place`` (x and y, any unit), but none that one stretch's peaks need, the rest for the highest and lowest
    of each of the ``peaks``; NaN is no peak. Ends of an ``outage`` stay unless they would take more than half. There
    are more than ``points`` only where ends and one stretch's peaks are more.
    """
    n = len(along_m)
    if n <= points:
        return np.arange(n)
    stays = _with_before(starts)
    stays[[0, -1]] = True
    with_outages = stays | _with_before(np.diff(outage, prepend=outage[:1]))
    if np.count_nonzero(with_outages) <= points // 2:
        stays = with_outages
    spare = max(points - int(np.count_nonzero(stays)), 0)
    least = 2 * len(peaks)  # of one stretch; a map's line has what is left beside it
    for_place = 0 if place is None else max(min(spare // 2, spare - least), 0)
    if place is not None and for_place:
        stays[_bends(_stretches(along_m, for_place), *place)] = True
    stretch = _stretches(along_m, max((spare - for_place) // max(least, 1), 1))
    for values in peaks:
        stays[_extremes(stretch, values)] = True
    return np.flatnonzero(stays)


def _with_before(starts: Bools) -> Bools:
    """The rows that start something, and the one before each."""
    both = starts.copy()
    both[:-1] |= starts[1:]
    return both


def _stretches(along_m: Floats, count: int) -> Ints:
    """The number of each row's stretch, of ``count`` of equal length; never falls."""
    length = float(along_m[-1] - along_m[0])
    if not length > 0:
        return np.asarray(np.arange(len(along_m)) * count // len(along_m))
    share = (along_m - along_m[0]) / length
    return np.asarray(np.minimum((share * count).astype(np.int64), count - 1))


def _extremes(stretch: Ints, values: Floats) -> Ints:
    """The row of the lowest and of the highest known value of each stretch, the first of equals."""
    finite = np.flatnonzero(np.isfinite(values))
    lowest = finite[np.lexsort((values[finite], stretch[finite]))]
    highest = finite[np.lexsort((-values[finite], stretch[finite]))]
    return np.concatenate([_first_of_each(stretch, lowest), _first_of_each(stretch, highest)])


def _bends(stretch: Ints, x: Floats, y: Floats) -> Ints:
    """The row of each stretch that lies farthest off the line between the stretch's ends."""
    first = np.flatnonzero(np.diff(stretch, prepend=-1))
    last = np.r_[first[1:], len(stretch)] - 1
    of = np.repeat(np.arange(len(first)), last - first + 1)
    run_x, run_y = (x[last] - x[first])[of], (y[last] - y[first])[of]
    off = np.abs(run_x * (y - y[first][of]) - run_y * (x - x[first][of]))
    return _first_of_each(stretch, np.lexsort((-np.nan_to_num(off), stretch)))


def _first_of_each(stretch: Ints, rows: Ints) -> Ints:
    """Of rows in the order of their stretches the first of each."""
    return np.asarray(rows[np.diff(stretch[rows], prepend=-1) != 0])
