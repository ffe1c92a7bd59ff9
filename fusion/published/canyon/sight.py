"""What fronts do to a ray: it comes directly, by one reflection, or not at all.

A front is a mirror: a reflected ray runs as if it came straight to the antenna's image behind the front. Rays are
parallel (satellites are far away), so that the detour is that of Viandier 2011, equation (3.1):
b = 2 w cos(Az) cos(E), Az being the azimuth against the front's normal. Walls are thin and roofs sharp; diffraction,
scattering and second reflections are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.reception import BLOCKED, LOS, NLOS
from fusion.published.canyon.fronts import Fronts
from fusion.types import Floats, Ints

_REACH_M = 400.0
"""Fronts farther away are not looked at: a roof 30 m up stands 4 degrees above the horizon there."""
_NEAR_M = 1e-6
"""A ray that leaves a front does not meet that front again."""


@dataclass(frozen=True)
class Sight:
    """Of each row (n,): the reception ``state``, numbered as in ``fusion.gnss.reception``, and the shortest reflection.

    A reflection is looked for whether or not the direct ray comes too.

    ``detour_m`` is how much longer it is than the direct ray, ``detour_mps`` how fast that grows, ``front`` on which
    front it is reflected: NaN, NaN and -1 where there is none.
    """

    state: Ints
    detour_m: Floats
    detour_mps: Floats
    front: Ints


def trace(
    fronts: Fronts,
    epoch: Ints,
    antenna_m: Floats,
    antenna_mps: Floats,
    elevation_rad: Floats,
    azimuth_rad: Floats,
) -> Sight:
    """Follow rays (n,) to antennas (m, 3) on the plane, ``epoch`` being each row's antenna, in increasing order."""
    flat = np.cos(elevation_rad)
    ray = np.column_stack([flat * np.sin(azimuth_rad), flat * np.cos(azimuth_rad), np.sin(elevation_rad)])
    first = np.searchsorted(epoch, np.arange(len(antenna_m) + 1))
    return Sight(*_trace(fronts.ends_m, fronts.top_m, first, antenna_m, antenna_mps, ray))


@compiled
def _meeting(ends: Floats, x: float, y: float, dx: float, dy: float) -> float:
    """How far along the horizontal direction (dx, dy), of unit length, a front is met; infinite if it is not."""
    ex, ey = ends[2] - ends[0], ends[3] - ends[1]
    cross = dx * ey - dy * ex
    if abs(cross) < 1e-12:
        return np.inf
    px, py = ends[0] - x, ends[1] - y
    share = (px * dy - py * dx) / cross
    way = (px * ey - py * ex) / cross
    return way if 0.0 <= share <= 1.0 and way > _NEAR_M else np.inf


@compiled
def _free(
    ends: Floats, top: Floats, near: Ints, start: Floats, direction: Floats, until_m: float, but: int
) -> bool:
    """Whether a ray passes over all fronts but one on its first ``until_m`` (horizontally)."""
    run = np.hypot(direction[0], direction[1])
    if run < 1e-9:
        return True
    dx, dy, climb = direction[0] / run, direction[1] / run, direction[2] / run
    for j in near:
        if j == but:
            continue
        way = _meeting(ends[j], start[0], start[1], dx, dy)
        if way < until_m and start[2] + way * climb < top[j]:
            return False
    return True


@compiled
def _reflection(
    ends: Floats, top: Floats, near: Ints, j: int, antenna: Floats, ray: Floats
) -> tuple[float, float, float]:
    """The detour by front ``j`` and its normal (x, y), which points away from the antenna; NaN if no ray comes so."""
    none = (np.nan, np.nan, np.nan)
    ex, ey = ends[j, 2] - ends[j, 0], ends[j, 3] - ends[j, 1]
    length = np.hypot(ex, ey)
    if length < _NEAR_M:
        return none
    nx, ny = ey / length, -ex / length
    away = nx * (ends[j, 0] - antenna[0]) + ny * (ends[j, 1] - antenna[1])
    if away < 0:
        nx, ny, away = -nx, -ny, -away
    towards = nx * ray[0] + ny * ray[1]
    if away < _NEAR_M or towards >= -1e-9:  # the satellite is on the front's far side
        return none
    mirrored = np.array([ray[0] - 2 * towards * nx, ray[1] - 2 * towards * ny, ray[2]])
    run = np.hypot(mirrored[0], mirrored[1])
    way = _meeting(ends[j], antenna[0], antenna[1], mirrored[0] / run, mirrored[1] / run)
    if way == np.inf:
        return none
    hit = antenna + mirrored * (way / run)
    if hit[2] > top[j] or not _free(ends, top, near, antenna, mirrored, way, j):
        return none
    if not _free(ends, top, near, hit, ray, np.inf, j):
        return none
    return -2 * away * towards, nx, ny


@compiled
def _trace(
    ends: Floats, top: Floats, first: Ints, antenna: Floats, speed: Floats, ray: Floats
) -> tuple[Ints, Floats, Floats, Ints]:
    rows = len(ray)
    state = np.full(rows, BLOCKED, np.int64)
    detour, rate = np.full(rows, np.inf), np.full(rows, np.nan)
    front = np.full(rows, -1, np.int64)
    half = 0.5 * np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    x, y = 0.5 * (ends[:, 0] + ends[:, 2]), 0.5 * (ends[:, 1] + ends[:, 3])
    for k in range(len(antenna)):
        near = np.flatnonzero(np.hypot(x - antenna[k, 0], y - antenna[k, 1]) - half < _REACH_M)
        for i in range(first[k], first[k + 1]):
            for which in near:
                j = int(which)
                longer, nx, ny = _reflection(ends, top, near, j, antenna[k], ray[i])
                if longer < detour[i]:
                    detour[i], front[i] = longer, j
                    towards = nx * ray[i, 0] + ny * ray[i, 1]
                    rate[i] = 2 * (nx * speed[k, 0] + ny * speed[k, 1]) * towards
            if _free(ends, top, near, antenna[k], ray[i], np.inf, -1):
                state[i] = LOS
            elif front[i] >= 0:
                state[i] = NLOS
    detour[front < 0] = np.nan
    return state, detour, rate, front
