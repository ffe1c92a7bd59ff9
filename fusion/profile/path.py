"""Where along the matched path a vehicle was at any time. Knows positions and speeds, but no heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fusion.arrays import nearest
from fusion.frames import wrap_angle
from fusion.matching.drive import DriveMatcher, MatchOptions
from fusion.matching.path import PathMatch
from fusion.network.joints import grade_change_sigma
from fusion.roads.network import RoadNetwork
from fusion.types import (
    LONGEST_BRIDGED_OUTAGE_S,
    Bools,
    DriveLog,
    Floats,
    GnssFix,
    Ints,
    Progress,
    no_progress,
    within,
)

FIX_PERIOD_S = 0.5
"""Positions closer together than this are thinned before matching."""
POSITION_SIGMA_M = 1.0
"""Error of a matched position along the road that is not shared with its neighbours."""
SPEED_SIGMA_MPS = 0.2
"""Error of the ground speed over a second; it is taken for independent from second to second."""
CORNER_M = 5.0
"""How much a right angle of the map is cut short by a vehicle, and how far around it, m."""
ACCELERATION_MPS2 = 1.0
"""Usual change of speed, where the log has no speeds."""
OUTAGE_S = 3.0
"""Positions farther apart than this leave the matcher to the speeds in between."""

Speeds = tuple[Floats, Floats]
"""Times and ground speeds, m/s."""


@dataclass(frozen=True, eq=False)
class DrivenPath:
    """The matched path of a drive, with the distance along it as a function of time.

    ``time_s``, ``along_m`` and ``run`` have one entry a knot of that function; ``run`` is the number of the connected
    stretch. ``fix_time_s`` are the times of the positions used, ``matched`` says which of them lie on the path.
    """

    match: PathMatch
    network: RoadNetwork
    fix_time_s: Floats
    matched: Bools
    time_s: Floats
    along_m: Floats
    run: Ints
    outages_s: Floats
    """(n, 2) begin and end of the outages that the log states: nobody knows what was driven then"""

    def at(self, time_s: Floats) -> tuple[Floats, Ints]:
        """Distance along the path (m) and run at times; NaN and -1 off the path and in outages of the recording."""
        right = np.searchsorted(self.time_s, time_s, side="left")
        after = np.clip(right, 0, len(self.time_s) - 1)
        exact = self.time_s[after] == time_s
        before = np.where(exact, after, np.clip(right - 1, 0, len(self.time_s) - 1))
        inside = (time_s >= self.time_s[0]) & (time_s <= self.time_s[-1])
        inside &= (self.run[before] == self.run[after]) & (
            self.time_s[after] - self.time_s[before] <= LONGEST_BRIDGED_OUTAGE_S
        )
        along = np.interp(time_s, self.time_s, self.along_m)
        return np.where(inside, along, np.nan), np.where(inside, self.run[before], -1)

    def direction_rad(self, along_m: Floats) -> Floats:
        """Heading of the path (from east, anticlockwise) at distances along it; NaN off the path."""
        row, _ = self.match.position_on(along_m)
        heading = self.network.heading_rad[self.match.segment[row]]
        turned = wrap_angle(heading + np.where(self.match.forward[row], 0.0, np.pi))
        return np.where(row >= 0, turned, np.nan)

    def grade_change_variance(self) -> Floats:
        """Variance of the grade's change at the entry of each traversal (0 at the first of a run), shape (m,)."""
        match, table = self.match, self.network.table
        if len(match) < 2:
            return np.zeros(len(match))
        heading = self.network.heading_rad[match.segment] + np.where(match.forward, 0.0, np.pi)
        cosine = np.cos(np.diff(heading))
        _, inverse, arms = np.unique(
            np.concatenate([table.from_node, table.to_node]), return_inverse=True, return_counts=True
        )
        entry = np.where(match.forward, inverse[match.segment], inverse[len(table) + match.segment])
        kind = (2 * table.bridge.astype(int) + table.tunnel)[match.segment]
        sigma = grade_change_sigma(cosine, arms[entry[1:]], np.diff(kind) != 0)
        return np.concatenate([[0.0], np.where(np.diff(match.run) == 0, sigma**2, 0.0)])


def thinned(table: GnssFix, period_s: float) -> GnssFix:
    """The positions at least 0.95 ``period_s`` apart."""
    time = table.time_s
    if len(time) < 2 or np.median(np.diff(time)) >= 0.95 * period_s:
        return table
    slot = np.floor((time - time[0]) / period_s + 1e-6)
    return table.take(np.concatenate([[True], np.diff(slot) > 0]))


def ground_speed(log: DriveLog) -> tuple[Floats, Floats, float]:
    """(time_s, speed_mps, scale): Doppler speed, and the vehicle's own where that is missing.

    The vehicle's own speed is multiplied by ``scale``, the median ratio of the two where both are known (1 where not).
    """
    velocity, odometry = log.velocity, log.odometry
    doppler = np.hypot(velocity.vel_n_mps, velocity.vel_e_mps)
    time, speed = velocity.time_s[np.isfinite(doppler)], doppler[np.isfinite(doppler)]
    own = np.isfinite(odometry.speed_mps)
    own_time, own_speed, scale = odometry.time_s[own], odometry.speed_mps[own], 1.0
    if not len(own_time):
        return time, speed, scale
    if len(time):
        near = np.abs(time[nearest(time, own_time)] - own_time)
        both = (near < 0.3) & (own_speed > 3.0)
        if both.sum() >= 10:
            scale = float(np.median(np.interp(own_time[both], time, speed) / own_speed[both]))
        alone = near > 1.0
        own_time, own_speed = own_time[alone], own_speed[alone]
    merged = np.concatenate([time, own_time])
    order = np.argsort(merged, kind="stable")
    return merged[order], np.concatenate([speed, scale * own_speed])[order], scale


def find_path(
    log: DriveLog, network: RoadNetwork, options: MatchOptions, progress: Progress = no_progress
) -> DrivenPath | None:
    """Match the drive and smooth its way along the path; None where nothing lies on a road."""
    fix = thinned(log.fix, FIX_PERIOD_S)
    speed_time, speed, _ = ground_speed(log)
    x, y = network.projection.to_xy(fix.lon_deg, fix.lat_deg)
    # In an outage the speeds go on: they say how far it is to where the positions come back.
    place = np.interp(speed_time, fix.time_s, np.arange(len(fix)))
    before = np.minimum(place.astype(np.int64), max(len(fix) - 2, 0))
    in_outage = (place % 1 > 0) & (np.diff(fix.time_s)[before] > OUTAGE_S)
    time = np.concatenate([fix.time_s, speed_time[in_outage]])
    order = np.argsort(time, kind="stable")
    unknown = np.full(int(in_outage.sum()), np.nan)

    def merged(column: Floats) -> Floats:
        return np.concatenate([column, unknown])[order]

    time = time[order]
    match = DriveMatcher(network, options).match(
        time,
        merged(x),
        merged(y),
        heading_rad=_course(log, time),
        speed_mps=_known_near(speed_time, speed, time),
        sigma_m=merged(fix.h_acc_m),
        progress=within(progress, 0.0, 0.7),
    )
    matched = match.traversal >= 0
    if matched.sum() < 2:
        return None
    corners = corner_variance(match, network)
    numbers, parts = np.unique(match.run[match.traversal[matched]]).tolist(), []
    for number in numbers:
        progress("match", 0.7 + 0.3 * number / (numbers[-1] + 1))
        parts.append(_smoothed_run(match, corners, time, matched, number, (speed_time, speed)))
    knots, along, run = (np.concatenate(column) for column in zip(*parts, strict=True))
    outages = _outages(log.outages_s, fix.time_s)
    on_path = matched[np.argsort(order)][: len(fix)]
    return DrivenPath(match, network, fix.time_s, on_path, knots, along, run, outages)


def _outages(stated_s: Floats, fix_time: Floats) -> Floats:
    """Last position before and first after each stated outage, shape (n, 2)."""
    after = np.searchsorted(fix_time, stated_s)
    inner = (after > 0) & (after < len(fix_time))
    return np.column_stack([fix_time[after[inner] - 1], fix_time[after[inner]]])


def _known_near(known_time: Floats, value: Floats, time: Floats, reach_s: float = 1.0) -> Floats:
    """The nearest known value at each time, NaN where there is none within ``reach_s``."""
    if not len(known_time):
        return np.full(len(time), np.nan)
    near = nearest(known_time, time)
    return np.where(np.abs(known_time[near] - time) < reach_s, value[near], np.nan)


def _course(log: DriveLog, time: Floats) -> Floats:
    """Course by Doppler (from east, anticlockwise) at times, NaN unknown."""
    v = log.velocity
    angle = np.arctan2(v.vel_n_mps, v.vel_e_mps)
    known = np.isfinite(angle)
    return _known_near(v.time_s[known], angle[known], time, 0.6)


def _smoothed_run(
    match: PathMatch, corners: Floats, fix_time: Floats, matched: Bools, number: int, driven: Speeds
) -> tuple[Floats, Floats, Ints]:
    """Least squares over matched positions and speeds of one run: times, distances along the path, run."""
    mine = matched & (match.run[match.traversal] == number)
    rows = np.flatnonzero(match.run == number)
    low = float(match.start_m[rows[0]])
    high = float(match.start_m[rows[-1]] + abs(match.leave_m[rows[-1]] - match.enter_m[rows[-1]]))
    between = (driven[0] > fix_time[mine][0]) & (driven[0] < fix_time[mine][-1])
    time = np.union1d(fix_time[mine], driven[0][between])
    time = time[np.concatenate([[True], np.diff(time) > 1e-3])]
    n, placed = len(time), match.distance_m[mine]
    if n < 3:
        return time, np.maximum.accumulate(np.clip(placed[:n], low, high)), np.full(n, number)
    at = np.clip(np.searchsorted(time, fix_time[mine] - 1e-3), 0, n - 1)
    along = np.interp(time, fix_time[mine], placed)
    slack = np.zeros(n - 1)
    # Where the corners are passed is known only once the way has been laid along the path.
    for _ in range(2):
        bands, vector = np.zeros((3, n)), np.zeros(n)  # upper form: second and first off-diagonal, diagonal
        np.add.at(bands[2], at, POSITION_SIGMA_M**-2)
        np.add.at(vector, at, placed / POSITION_SIGMA_M**2)
        _add_speeds(bands, vector, time, slack, driven)
        _add_inertia(bands, np.diff(time), slack)
        bands[2] += 1e-9
        along = np.maximum.accumulate(np.clip(scipy.linalg.solveh_banded(bands, vector), low, high))
        slack = _corner_slack(along, match.start_m[rows], corners[rows])
    return time, along, np.full(n, number)


def corner_variance(match: PathMatch, network: RoadNetwork) -> Floats:
    """Variance (m^2) of the way that a vehicle cuts short at the entry of each traversal, shape (m,)."""
    heading = network.heading_rad[match.segment] + np.where(match.forward, 0.0, np.pi)
    turn = 1 - np.cos(np.diff(heading, prepend=heading[:1]))
    return np.asarray((CORNER_M * turn) ** 2)


def _corner_slack(along: Floats, corner_m: Floats, variance: Floats) -> Floats:
    """Variance of each step of the way for the corners near it, each shared by the epochs that may hold it."""
    slack = np.zeros(len(along) - 1)
    first = np.clip(np.searchsorted(along, corner_m - CORNER_M, side="right") - 1, 0, len(slack) - 1)
    last = np.clip(np.searchsorted(along, corner_m + CORNER_M, side="left"), first + 1, len(slack))
    for begin, end, total in zip(first.tolist(), last.tolist(), variance.tolist(), strict=True):
        slack[begin:end] += total / (end - begin)
    return slack


def _add_speeds(bands: Floats, vector: Floats, time: Floats, slack: Floats, driven: Speeds) -> None:
    """The way between two knots is mean speed times time, where speeds are known on both sides."""
    speed_time, speed = driven
    if not len(speed_time):
        return
    step = np.diff(time)
    near = np.abs(speed_time[nearest(speed_time, time)] - time) < 1.0
    known = near[1:] & near[:-1]
    at = np.interp(time, speed_time, speed)
    way = 0.5 * (at[1:] + at[:-1]) * step
    weight = np.where(known, 1 / (SPEED_SIGMA_MPS**2 * step * np.maximum(step, 1.0) + slack), 0.0)
    bands[2, 1:] += weight
    bands[2, :-1] += weight
    bands[1, 1:] -= weight
    vector[1:] += weight * way
    vector[:-1] -= weight * way


def _add_inertia(bands: Floats, step: Floats, slack: Floats) -> None:
    """Speeds change by ``ACCELERATION_MPS2`` a second: what holds a path without measured speeds together."""
    a, b = 1 / step[:-1], 1 / step[1:]
    middle = 0.5 * (step[:-1] + step[1:])
    jump = slack[:-1] / step[:-1] ** 2 + slack[1:] / step[1:] ** 2
    weight = 1 / (ACCELERATION_MPS2**2 * middle * np.maximum(middle, 1.0) + jump)
    rows = np.array([a, -(a + b), b])
    n = len(step) + 1
    for i in range(3):
        for j in range(i, 3):
            bands[2 - (j - i), j : n - 2 + j] += weight * rows[i] * rows[j]
