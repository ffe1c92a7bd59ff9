"""The compiled loops over road segments.

They share this file because numba's cache on disk watches only the file of the function itself: a change of
one kernel must recompile those that call it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.types import Floats, Ints

NOT_POSITIVE = -2
"""Stands for a segment where the covariance is not positive definite."""

_SLACK_M = 1e-6  # far above the rounding of coordinates, far below anything that matters
_Match = tuple[int, float, float, float, float, float, bool]


class SegmentGrid(NamedTuple):
    """n segments and their grid, as plain arrays for compiled loops.

    ``x0 y0 x1 y1`` are metres, ``oneway`` as in ``RoadTable``. Cell (column, row) has the number
    ``row * columns + column``; ``items[start[cell]:start[cell + 1]]`` are the segments that pass through it.
    """

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats
    oneway: NDArray[np.int8]
    west: float
    south: float
    cell_m: float
    columns: int
    rows: int
    start: Ints
    items: Ints


@compiled
def clamp_cell(offset_m: float, cell_m: float, count: int) -> int:
    """The cell of an offset from the grid's edge, clamped to 0 .. count - 1."""
    return int(min(max(np.floor(offset_m / cell_m), 0.0), count - 1.0))


@compiled
def fill_cells(
    x0: Floats,
    y0: Floats,
    x1: Floats,
    y1: Floats,
    west: float,
    south: float,
    cell: float,
    columns: int,
    rows: int,
    cursor: Ints,
    items: Ints,
    counting: bool,
) -> None:
    """Visit every cell that each segment touches: count into cursor[cell + 1], or write at cursor[cell]."""
    for s in range(len(x0)):
        xa, ya, xb, yb = x0[s] - west, y0[s] - south, x1[s] - west, y1[s] - south
        if xa > xb:
            xa, ya, xb, yb = xb, yb, xa, ya
        first, last = clamp_cell(xa - _SLACK_M, cell, columns), clamp_cell(xb + _SLACK_M, cell, columns)
        for column in range(first, last + 1):
            ta, tb = 0.0, 1.0
            if xb > xa:
                ta = min(max((column * cell - _SLACK_M - xa) / (xb - xa), 0.0), 1.0)
                tb = min(max(((column + 1) * cell + _SLACK_M - xa) / (xb - xa), 0.0), 1.0)
            yl, yh = ya + ta * (yb - ya), ya + tb * (yb - ya)
            low = clamp_cell(min(yl, yh) - _SLACK_M, cell, rows)
            high = clamp_cell(max(yl, yh) + _SLACK_M, cell, rows)
            for row in range(low, high + 1):
                at = row * columns + column
                if counting:
                    cursor[at + 1] += 1
                else:
                    items[cursor[at]] = s
                    cursor[at] += 1


@compiled
def project_point(
    x0: float, y0: float, x1: float, y1: float, x: float, y: float
) -> tuple[float, float, float]:
    """Share along the segment (0..1) and position of the point of the segment nearest to (x, y)."""
    dx, dy = x1 - x0, y1 - y0
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(max(((x - x0) * dx + (y - y0) * dy) / square, 0.0), 1.0)
    return share, x0 + share * dx, y0 + share * dy


@compiled
def cells_around(grid: SegmentGrid, x: float, y: float, radius: float) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the cells that meet the square around a point."""
    reach = radius + _SLACK_M
    return (
        clamp_cell(x - reach - grid.west, grid.cell_m, grid.columns),
        clamp_cell(x + reach - grid.west, grid.cell_m, grid.columns),
        clamp_cell(y - reach - grid.south, grid.cell_m, grid.rows),
        clamp_cell(y + reach - grid.south, grid.cell_m, grid.rows),
    )


@compiled
def segments_within(grid: SegmentGrid, x: float, y: float, radius: float) -> Ints:
    """Indices, ascending, of the segments no farther than ``radius`` from (x, y)."""
    first, last, low, high = cells_around(grid, x, y, radius)
    total = 0
    for row in range(low, high + 1):
        total += grid.start[row * grid.columns + last + 1] - grid.start[row * grid.columns + first]
    found = np.empty(total, np.int64)
    count = 0
    for row in range(low, high + 1):
        begin, end = grid.start[row * grid.columns + first], grid.start[row * grid.columns + last + 1]
        for k in range(begin, end):
            s = grid.items[k]
            _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
            if (px - x) ** 2 + (py - y) ** 2 <= radius * radius:
                found[count] = s
                count += 1
    return np.unique(found[:count])


class _Precision(NamedTuple):
    """The inverse of a covariance over x, y, heading; not positive definite: nothing else counts."""

    positive: bool
    xx: float
    xy: float
    yy: float
    xh: float
    yh: float
    hh: float


@compiled
def _wrap(angle: float) -> float:
    """To (-pi, pi]."""
    return angle - 2 * math.pi * math.ceil((angle - math.pi) / (2 * math.pi))


@compiled
def _invert(c: Floats, with_heading: bool) -> _Precision:
    """Invert a 3 x 3 covariance, or its x, y block where the heading does not count."""
    minor = c[0, 0] * c[1, 1] - c[0, 1] * c[0, 1]
    if not (c[0, 0] > 0 and minor > 0 and np.isfinite(minor)):
        return _Precision(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if not with_heading:
        return _Precision(True, c[1, 1] / minor, -c[0, 1] / minor, c[0, 0] / minor, 0.0, 0.0, 0.0)
    xh = c[0, 1] * c[1, 2] - c[1, 1] * c[0, 2]
    yh = c[0, 1] * c[0, 2] - c[0, 0] * c[1, 2]
    det = c[0, 2] * xh + c[1, 2] * yh + c[2, 2] * minor
    if not (det > 0 and np.isfinite(det)):
        return _Precision(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    xx = (c[1, 1] * c[2, 2] - c[1, 2] * c[1, 2]) / det
    yy = (c[0, 0] * c[2, 2] - c[0, 2] * c[0, 2]) / det
    xy = (c[0, 2] * c[1, 2] - c[0, 1] * c[2, 2]) / det
    return _Precision(True, xx, xy, yy, xh / det, yh / det, minor / det)


@compiled
def _reach(c: Floats, gate: float) -> float:
    """Gate times the largest standard deviation of x, y: the position's part alone is a lower bound of d."""
    mean = (c[0, 0] + c[1, 1]) / 2
    return gate * math.sqrt(mean + math.hypot((c[0, 0] - c[1, 1]) / 2, c[0, 1])) * (1 + 1e-9)


@compiled
def _direction(grid: SegmentGrid, s: int, forward: bool) -> float:
    """The heading along a segment, in or against the direction in which it is drawn."""
    theta = math.atan2(grid.y1[s] - grid.y0[s], grid.x1[s] - grid.x0[s])
    return _wrap(theta if forward else theta + math.pi)


@compiled
def _best_direction(grid: SegmentGrid, s: int, heading: float, cross: float, hh: float) -> tuple[float, bool]:
    """What the heading adds to d squared at the better of the directions in which s may be driven."""
    if np.isnan(heading):
        return 0.0, grid.oneway[s] >= 0
    added = np.empty(2)
    for turn in range(2):
        dh = _wrap(_direction(grid, s, turn == 0) - heading)
        added[turn] = 2 * dh * cross + hh * dh * dh
    if grid.oneway[s] > 0 or (grid.oneway[s] == 0 and added[0] <= added[1]):
        return added[0], True
    return added[1], False


@compiled
def nearest(
    grid: SegmentGrid, x: float, y: float, heading: float, c: Floats, gate: float, radius: float
) -> _Match:
    """The columns of a ``PointMatch``; the segment is -1 for none, or NOT_POSITIVE."""
    heading = heading if np.isfinite(heading) else np.nan
    p = _invert(c, not np.isnan(heading))
    if not (p.positive and np.isfinite(x) and np.isfinite(y)):
        return -1 if p.positive else NOT_POSITIVE, np.nan, np.nan, np.nan, np.nan, np.nan, False
    reach = radius if radius >= 0 else _reach(c, gate)
    best, best_d2, best_forward = -1, gate * gate, False
    first, last, low, high = cells_around(grid, x, y, reach)
    for row in range(low, high + 1):
        begin = grid.start[row * grid.columns + first]
        end = grid.start[row * grid.columns + last + 1]
        for k in range(begin, end):
            s = grid.items[k]
            _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
            dx, dy = px - x, py - y
            if dx * dx + dy * dy > reach * reach:
                continue
            d2 = p.xx * dx * dx + 2 * p.xy * dx * dy + p.yy * dy * dy
            added, forward = _best_direction(grid, s, heading, p.xh * dx + p.yh * dy, p.hh)
            d2 += added
            if d2 < best_d2 or (d2 == best_d2 and (best < 0 or s < best)):
                best, best_d2, best_forward = s, d2, forward
    if best < 0:
        return -1, np.nan, np.nan, np.nan, np.nan, np.nan, False
    share, px, py = project_point(grid.x0[best], grid.y0[best], grid.x1[best], grid.y1[best], x, y)
    length = np.hypot(grid.x1[best] - grid.x0[best], grid.y1[best] - grid.y0[best])
    angle = _direction(grid, best, best_forward)
    return best, px, py, share * length, angle, np.sqrt(max(best_d2, 0.0)), best_forward


@compiled
def nearest_each(
    grid: SegmentGrid, x: Floats, y: Floats, heading: Floats, c: Floats, gate: float, radius: float
) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    n = len(x)
    segment, columns, forward = np.empty(n, np.int64), np.empty((5, n)), np.empty(n, np.bool_)
    for i in range(n):
        m = nearest(grid, x[i], y[i], heading[i], c[i], gate, radius)
        segment[i], forward[i] = m[0], m[6]
        columns[0, i], columns[1, i], columns[2, i], columns[3, i], columns[4, i] = (
            m[1],
            m[2],
            m[3],
            m[4],
            m[5],
        )
    return segment, columns, forward
