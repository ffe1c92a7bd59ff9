"""Drives with everything a vehicle may carry along one street of ten segments, and their factors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from factor_support import street
from fusion.network.pass_factor import PassFactor
from fusion.profile.factors import MIN_CONFIDENCE, DrivenPasses, place_sigma
from fusion.profile.measurements import TERRAIN
from fusion.profile.traversals import (
    Altimeter,
    OnTraversals,
    on_traversals,
)
from fusion.types import DriveLog
from model_drives import gusts
from profile_support import Levels, Smoothed, hills, pressure_of, street_log

TABLE = street(55, 8, 70, 120, 0.6, 43, 390, 60, 25, 90)
EDGES_M = np.concatenate([[0.0], np.cumsum(TABLE.length_m)])
TIME_S = 1.7e9 + np.arange(107.0)
SPEED_MPS = 8.0
ALONG_M = 5 + SPEED_MPS * (TIME_S - TIME_S[0])
NONE = Altimeter()


def drive_log(kind: str, seed: int = 3) -> DriveLog:
    rng = np.random.default_rng(seed)
    if kind == "back again":
        along = np.r_[ALONG_M, ALONG_M[::-1]]
        time = TIME_S[0] + np.arange(float(len(along)))
        return street_log(time, along, hills, rng, nose=np.where(time < TIME_S[-1] + 0.5, 1.0, -1.0))
    if kind == "outage":
        log = street_log(TIME_S, ALONG_M, hills, rng)
        outside = np.abs(np.arange(len(TIME_S)) - 22.5) > 12.5
        return replace(log, fix=log.fix.take(outside), velocity=log.velocity.take(outside))
    if kind == "jump":
        log = street_log(TIME_S, ALONG_M, hills, rng)
        late = np.arange(len(TIME_S)) > 50
        return replace(log, fix=replace(log.fix, alt_msl_m=log.fix.alt_msl_m + 40.0 * late))
    if kind == "steady heights":
        return street_log(TIME_S, ALONG_M, hills, rng, levels=Levels(altitude_m=0.05, drift=1e-4))
    log = street_log(TIME_S, ALONG_M, hills, rng)
    n = len(TIME_S)
    drift = np.cumsum(0.03 * rng.normal(size=n))
    pressure = pressure_of(TIME_S, hills(ALONG_M) + drift + gusts(rng, n, SPEED_MPS))
    return {
        "everything": log,
        "positions and heights": DriveLog("gpx", log.fix),
        "barometer as well": replace(log, pressure=pressure),
    }[kind]


def factors_of(one: Smoothed, altimeter: Altimeter = NONE) -> list[PassFactor]:
    return list(DrivenPasses.of(replace(one, altimeter=altimeter), one.fix).factors())


def data_of(one: Smoothed, altimeter: Altimeter = NONE) -> OnTraversals:
    return on_traversals(replace(one, altimeter=altimeter), *place_sigma(one.path, one.fix))


def traversals(one: Smoothed) -> list[int]:
    """Those that have a factor, in driving order."""
    match = one.path.match
    sure = (match.confidence >= MIN_CONFIDENCE) & (match.enter_m != match.leave_m)
    return [int(k) for k in np.flatnonzero(sure)]


def own_measurements(one: Smoothed, k: int) -> np.ndarray:
    """Rows of the drive's measurements on traversal ``k``, in the order of time, without terrain."""
    traversal, _ = one.path.match.position_on(one.measured.along_m)
    mine = np.flatnonzero((traversal == k) & (one.measured.sensor != TERRAIN))
    return mine[np.argsort(one.measured.time_s[mine], kind="stable")]
