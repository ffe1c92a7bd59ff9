"""The factor of a pass (``factors``, ``likelihood``) against one dense Gaussian over knots and nuisances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from factor_support import street
from fusion.methods.profile.factors import LONE_ROUGHNESS, MIN_CONFIDENCE, pass_factors
from fusion.methods.profile.measurements import ALTITUDE, BARO, FORCE, PITCH, TERRAIN
from fusion.methods.profile.model import BIAS, DRIFT, JUMP_SIGMA, MOUNT, SQUAT, decorrelated
from fusion.network.curve import (
    grade_rows,
    grade_variance,
    height_rows,
    height_variance,
    knot_length,
    slope_row,
    variable_count,
)
from fusion.network.pass_factor import PassFactor
from fusion.types import DriveLog
from profile_support import Levels, Smoothed, hills, pressure_of, smoothed, street_log

TABLE = street(55, 8, 70, 120, 0.6, 43, 390, 60, 25, 90)
CONSTANTS = [MOUNT, BIAS, SQUAT]
TIME_S = 1.7e9 + np.arange(107.0)
ALONG_M = 5 + 8 * (TIME_S - TIME_S[0])


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
        # Heights that are worth more than slopes: factors become conditional on what was before.
        return street_log(TIME_S, ALONG_M, hills, rng, levels=Levels(altitude_m=0.05, drift=1e-4))
    log = street_log(TIME_S, ALONG_M, hills, rng)
    pressure = pressure_of(TIME_S, hills(ALONG_M) + np.cumsum(0.03 * rng.normal(size=len(TIME_S))))
    return {
        "everything": log,
        "positions and heights": DriveLog("gpx", log.fix),
        "barometer as well": replace(log, pressure=pressure),
    }[kind]


KINDS = (
    "everything",
    "positions and heights",
    "barometer as well",
    "steady heights",
    "back again",
    "jump",
    "outage",
)


@pytest.fixture(scope="module", params=KINDS)
def drive(request: pytest.FixtureRequest) -> tuple[Smoothed, list[PassFactor]]:
    one = smoothed(drive_log(request.param), TABLE)
    return one, pass_factors(one.measured, one.epochs, one.learned, one.path)


def traversals(one: Smoothed) -> list[int]:
    """Those that have a factor, in driving order."""
    match = one.path.match
    sure = (match.confidence >= MIN_CONFIDENCE) & (match.enter_m != match.leave_m)
    return [int(k) for k in np.flatnonzero(sure)]


def constants(one: Smoothed, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of mount, bias and squat in the middle of a traversal, by the whole drive."""
    match, epochs = one.path.match, one.epochs
    middle = 0.5 * (match.enter_time_s[k] + match.leave_time_s[k])
    at = min(int(np.searchsorted(epochs.time_s, middle)), len(epochs.time_s) - 1)
    covariance = one.learned.smoothed.covariance[at][np.ix_(CONSTANTS, CONSTANTS)].copy()
    for step, state in one.learned.jumps:
        near = match.enter_time_s[k] - 1 <= epochs.time_s[step] <= match.leave_time_s[k] + 1
        if state == MOUNT and near:
            covariance[0, 0] = covariance[0, 0] + JUMP_SIGMA[MOUNT] ** 2
            break
    return one.learned.smoothed.mean[at, CONSTANTS], covariance


def dense(
    one: Smoothed, start: int, stop: int, mean: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information and vector over the stacked knots of traversals start .. stop - 1.

    Heights are the climb since the first entry, so that no segment's own level matters. The covariance of all
    measurements given the knots: white errors, what the cubics leave open, the constants, and two random walks in time
    whose level is not known (projected out).
    """
    measured, match, noise = one.measured, one.path.match, one.learned.noise
    traversal, distance = match.position_on(measured.along_m)
    clean, share = decorrelated(measured, noise)
    lengths = knot_length(one.path.network.table.length_m[match.segment[start:stop]])
    first = np.concatenate([[0], np.cumsum(variable_count(lengths))])
    mine = np.flatnonzero((traversal >= start) & (traversal < stop) & (measured.sensor != TERRAIN))
    climbs = [np.zeros(int(first[-1]))]
    for k in range(start, stop):
        entry, leave = first[k - start], first[k - start + 1] - 2
        climb = climbs[-1].copy()
        climb[leave] += 1.0 if match.forward[k] else -1.0
        climb[entry] -= 1.0 if match.forward[k] else -1.0
        climbs.append(climb)
    design, white = np.zeros((len(mine), int(first[-1]))), np.zeros(len(mine))
    for i, row in enumerate(mine):
        k = int(traversal[row]) - start
        length = float(lengths[k])
        stretched = length / float(one.path.network.length_m[match.segment[traversal[row]]])
        at, own = np.array([distance[row] * stretched]), slice(first[k], first[k + 1])
        if measured.sensor[row] in (ALTITUDE, BARO):
            design[i] = climbs[k]
            design[i, own] += height_rows(at, length)[0]
            design[i, first[k] if match.forward[traversal[row]] else first[k + 1] - 2] -= 1.0
            white[i] = height_variance(at, length, noise.roughness)[0]
        else:
            part = (1 - share[row]) * (1.0 if match.forward[traversal[row]] else -1.0)
            design[i, own] = part * grade_rows(at, length)[0]
            white[i] = part**2 * grade_variance(at, length, noise.roughness)[0]
    sensor, time, left = measured.sensor[mine], measured.time_s[mine], 1 - share[mine]
    felt = np.isin(sensor, (PITCH, FORCE))
    tilts = np.column_stack(
        [left * felt, (sensor == FORCE).astype(float), left * measured.acceleration_mps2[mine] * felt]
    )
    spread = np.diag(white + one.learned.variance[mine]) + tilts @ covariance @ tilts.T
    levels = []
    for kind, rate in ((ALTITUDE, noise.drift), (BARO, noise.baro_drift)):
        seen = (sensor == kind).astype(float)
        if seen.any():
            moved = rate * (time - time.min())
            for step, state in one.learned.jumps:
                if kind == ALTITUDE and state == DRIFT:
                    moved = moved + JUMP_SIGMA[DRIFT] ** 2 * (time >= one.epochs.time_s[step])
            spread += np.minimum.outer(moved, moved) * np.outer(seen, seen)
            levels.append(seen)
    weight = np.linalg.inv(spread)
    if levels:
        free = np.array(levels).T
        weight = weight - weight @ free @ np.linalg.solve(free.T @ weight @ free, free.T @ weight)
    return design.T @ weight @ design, design.T @ weight @ (clean.value[mine] - tilts @ mean)


def test_factors_are_the_dense_likelihoods(drive: tuple[Smoothed, list[PassFactor]]) -> None:
    one, factors = drive
    assert len(factors) == len(traversals(one)) >= len(TABLE) - 1
    for k, factor in zip(traversals(one), factors, strict=True):
        start = k - len(factor.segments) + 1
        assert factor.segments == tuple(one.path.match.segment[start : k + 1].tolist())
        about = constants(one, k)
        information, vector = dense(one, start, k + 1, *about)
        if start < k:
            known, said = dense(one, start, k, *about)
            information[: len(said), : len(said)] -= known
            vector[: len(said)] -= said
        weight = one.path.match.confidence[k]
        scale = max(np.abs(information).max(), 1.0)
        np.testing.assert_allclose(factor.information, weight * information, atol=1e-9 * scale)
        # Heights are some 200 m; the vector is what they weigh, less the free level.
        np.testing.assert_allclose(factor.vector, weight * vector, atol=1e-7 * scale)


def test_factors_know_no_level_and_no_negative(drive: tuple[Smoothed, list[PassFactor]]) -> None:
    """Lifting any segment as a whole changes nothing, and no information is less than none."""
    _, factors = drive
    for factor in factors:
        scale = max(np.abs(factor.information).max(), 1.0)
        np.testing.assert_allclose(factor.information, factor.information.T, atol=1e-12 * scale)
        values = np.linalg.eigvalsh(factor.information)
        assert values[0] > -1e-9 * max(values[-1], 1.0)
        counts = variable_count(knot_length(TABLE.length_m[list(factor.segments)]))
        for begin, count in zip(np.cumsum(counts) - counts, counts, strict=True):
            lifted = np.zeros(len(factor.vector))
            lifted[begin : begin + count : 2] = 1.0
            np.testing.assert_allclose(factor.information @ lifted, 0, atol=1e-9 * scale)


def test_a_factor_speaks_of_its_own_passage(drive: tuple[Smoothed, list[PassFactor]]) -> None:
    one, factors = drive
    match, lengths = one.path.match, TABLE.length_m
    for k, factor in zip(traversals(one), factors, strict=True):
        segment = factor.segments[-1]
        assert (factor.first_time_s, factor.last_time_s) == (match.enter_time_s[k], match.leave_time_s[k])
        assert 0 <= factor.start_m <= factor.end_m <= max(float(lengths[segment]), 1.0) + 1e-6
        assert factor.observations >= 1
        assert factor.roughness == one.learned.noise.roughness
        assert factor.slope_sigma_percent > 0
        assert len(set(factor.segments)) == len(factor.segments)
        assert len(factor.vector) == variable_count(knot_length(lengths[list(factor.segments)])).sum()


def test_its_slope_is_the_factor_s_alone(drive: tuple[Smoothed, list[PassFactor]]) -> None:
    """With the roughest of roads assumed, and nothing else: the mean of the likelihood times that prior."""
    _, factors = drive
    for factor in factors:
        length = float(knot_length(TABLE.length_m[factor.segments[-1]]))
        own = int(variable_count(length))
        if len(factor.segments) > 1 or factor.end_m - factor.start_m < 5:
            continue
        knots, d = own // 2, length / (own // 2 - 1)
        total = factor.information + 1e-7 * np.eye(own)
        walk = LONE_ROUGHNESS * np.array([[d**3 / 3, d**2 / 2], [d**2 / 2, d]])
        for j in range(knots - 1):
            step = np.zeros((2, own))
            step[:, 2 * j : 2 * j + 4] = np.array([[-1, -d, 1, 0], [0, -1, 0, 1]])
            total += step.T @ np.linalg.inv(walk) @ step
        total[1::2, 1::2] += np.eye(knots)
        weights = slope_row(factor.start_m, factor.end_m, length)
        covariance = np.linalg.inv(total)
        assert factor.slope_percent == pytest.approx(100 * weights @ covariance @ factor.vector, abs=1e-5)
        sigma = 100 * np.sqrt(weights @ covariance @ weights)
        assert factor.slope_sigma_percent == pytest.approx(sigma, rel=1e-4)


def test_histories_are_used_where_heights_outweigh_slopes() -> None:
    depth = {}
    for kind in ("everything", "positions and heights", "steady heights", "outage"):
        one = smoothed(drive_log(kind), TABLE)
        depth[kind] = max(
            len(f.segments) for f in pass_factors(one.measured, one.epochs, one.learned, one.path)
        )
    assert depth["positions and heights"] > 1
    assert depth["steady heights"] > 1
    assert depth["everything"] == 1
    assert depth["outage"] > 1, "the heights on both sides of an outage tell of all of it"


def test_slopes_of_factors_alone_are_honest() -> None:
    """What passes say by themselves lies within their own sigmas of the truth."""
    inside = []
    ends = np.concatenate([[0.0], np.cumsum(TABLE.length_m)])
    for seed in range(8):
        one = smoothed(drive_log("everything", seed), TABLE)
        for factor in pass_factors(one.measured, one.epochs, one.learned, one.path):
            length = factor.end_m - factor.start_m
            if length < 20:
                continue
            x = ends[factor.segments[-1]] + np.linspace(factor.start_m, factor.end_m, 100)
            true = 100 * np.polyfit(x, hills(x), 1)[0]
            inside.append(abs(factor.slope_percent - true) < 1.96 * factor.slope_sigma_percent)
    assert np.mean(inside) > 0.85
