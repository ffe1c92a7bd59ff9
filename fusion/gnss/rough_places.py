"""Where a receiver roughly was, without any start: good for directions, flight times and the atmosphere.

A kilometre beside the truth turns a satellite's elevation by 0.003 degrees and its flight's turn of the earth by 1 cm.
"""

from __future__ import annotations

import numpy as np

from fusion.frames import geodetic
from fusion.gnss.corrections import turned_by_earth
from fusion.signals import LIGHT_MPS
from fusion.types import MAX_SPEED_MPS, Bools, Floats, Ints

PLACE_EVERY_S = 60.0
"""A place is computed this often; a car goes 3 km meanwhile, and places between are interpolated."""
FEWEST = 4
_TRIES = 3  # epochs of a minute, richest in satellites first
_FREE_STEPS = 8  # Gauss-Newton from the earth's centre comes to the metre in six
_ROBUST_STEPS = 25
_NOISE_M = 10.0  # residuals below this are not told apart
_BIAS_M = 3_000.0  # 10 us, more than clocks of two systems or a receiver's filters differ by
_ARRIVED_M = 1.0
_AGREED_M = 500.0  # reflections in streets stay below, wrong satellites do not
_HEIGHTS_M = (-1_000.0, 15_000.0)
_AROUND = 2  # neighbours on each side that a place is compared with
_BESIDE_M = 5_000.0


def rough_places(
    gps_s: Floats, first: Ints, group: Ints, pseudorange_m: Floats, satellite_m: Floats
) -> Floats:
    """ECEF places of all epochs (m, 3), NaN throughout where none could be found.

    Rows (n,) of epochs ``first``: pseudoranges free of satellite clocks, ``satellite_m`` (n, 3) in the frame of
    transmission, ``group`` numbers systems that share a clock. Of each minute the richest epochs are tried.
    """
    minutes = np.floor((gps_s - gps_s[0]) / PLACE_EVERY_S) if len(gps_s) else gps_s
    counts = np.diff(first)
    when, where = [], []
    for epochs in np.split(np.arange(len(gps_s)), np.flatnonzero(np.diff(minutes)) + 1):
        for epoch in epochs[np.argsort(-counts[epochs], kind="stable")][:_TRIES]:
            rows = slice(first[epoch], first[epoch + 1])
            place = solve_place(pseudorange_m[rows], satellite_m[rows], group[rows])
            if place is not None:
                when.append(gps_s[epoch])
                where.append(place)
                break
    times, places = np.array(when), np.array(where).reshape(-1, 3)
    keep = _plausible(times, places)
    if not keep.any():
        return np.full((len(gps_s), 3), np.nan)
    return np.column_stack([np.interp(gps_s, times[keep], places[keep, axis]) for axis in range(3)])


def solve_place(pseudorange_m: Floats, satellite_m: Floats, group: Ints) -> Floats | None:
    """The place (3,) of one epoch from anywhere on earth, or None where satellites do not agree on any.

    Gauss-Newton from the earth's centre, then the least sum of absolute residuals by reweighting, which reflected
    signals and wrong rows pull little. Biases of groups are held to 10 us, so that a group with a single satellite
    says nothing and breaks nothing.
    """
    if len(pseudorange_m) < FEWEST:
        return None
    others = np.unique(group)[1:]
    guess = np.zeros(4 + len(others))
    prior = np.diag(np.append(np.full(4, 1e-12), np.full(len(others), _BIAS_M**-2)))
    weight = np.full(len(group), _NOISE_M**-2)
    residual = pseudorange_m
    for step in range(_FREE_STEPS + _ROBUST_STEPS):
        sight, residual = _linearised(guess, pseudorange_m, satellite_m, group, others)
        if step >= _FREE_STEPS:
            weight = 1.0 / (_NOISE_M * np.maximum(np.abs(residual), _NOISE_M))
        normal = sight.T @ (weight[:, None] * sight) + prior
        held = prior.diagonal() * guess
        held[:4] = 0.0
        change = np.linalg.lstsq(normal, sight.T @ (weight * residual) - held, rcond=None)[0]
        guess += change
        if step >= _FREE_STEPS and np.linalg.norm(change[:3]) < _ARRIVED_M:
            break
    good = np.isfinite(guess).all() and np.median(np.abs(residual)) < _AGREED_M
    return guess[:3].copy() if good else None


def _linearised(
    guess: Floats, pseudorange_m: Floats, satellite_m: Floats, group: Ints, others: Ints
) -> tuple[Floats, Floats]:
    """The design (n, 4 + biases) and the residuals (n,) at a place, a clock and the groups' biases."""
    flight_s = np.linalg.norm(satellite_m - guess[:3], axis=1) / LIGHT_MPS
    away = turned_by_earth(satellite_m, flight_s) - guess[:3]
    far = np.linalg.norm(away, axis=1)
    clocks = np.column_stack([np.ones(len(group)), group[:, None] == others])
    design = np.column_stack([-away / far[:, None], clocks])
    return design, pseudorange_m - far - clocks @ guess[3:]


def _plausible(times: Floats, places: Floats) -> Bools:
    """Places near the ground that can be reached from those around them."""
    if not len(times):
        return np.zeros(0, bool)
    _, _, height = geodetic(places)
    keep = (height > _HEIGHTS_M[0]) & (height < _HEIGHTS_M[1])
    some = np.flatnonzero(keep)
    for k, index in enumerate(some):
        near = some[max(0, k - _AROUND) : k + _AROUND + 1]
        reach = MAX_SPEED_MPS * np.ptp(times[near]) + _BESIDE_M
        keep[index] = np.linalg.norm(places[index] - np.median(places[near], axis=0)) <= reach
    return np.asarray(keep)
