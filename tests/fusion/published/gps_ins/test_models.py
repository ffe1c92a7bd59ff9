"""The forms that Saadaoui 2011 prints, each an option: what they do, and so why they are corrected (spec 2.6)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fusion.filters.unscented import Unscented
from fusion.published.gps_ins.filter import Settings, run
from fusion.published.gps_ins.models import ExtendedModel, KalmanModel, UnscentedModel
from gps_ins_support import COMMAND, EKF, KF, Truth, riccati, simulate

MEASURED = Settings(heading="measurement", heading_walk_rad=0.02, min_speed_mps=0.0)
OVERWRITTEN = replace(MEASURED, heading="overwrite")
PRINTED_ALPHA = UnscentedModel(Unscented(1e3, 2.0, -1.0))


def gains(steps: int) -> np.ndarray:
    """Gain of each of ``steps`` fixes after the first: P / R after the correction."""
    return riccati(steps, 225.0, 0.25)[1:] / 225.0


def silent(seed: int, **options: float) -> Truth:
    """A drive on which neither GPS nor INS err, filtered as if they did."""
    truth = simulate(seed, gps_sigma_m=15.0, walk_m=0.0, **options)
    return replace(truth, drive=replace(truth.drive, x_m=truth.x_m, y_m=truth.y_m))


@pytest.mark.parametrize("seed", range(3))
def test_the_printed_command_runs_away_by_what_it_leaves_out(seed: int) -> None:
    """B u with u = [v, heading] is off by d = (v - v cos, heading - v sin) each step: e = (1 - K)(e + d)."""
    truth = silent(seed)
    drive = truth.drive
    v, h = drive.speed_mps[:-1], drive.heading_rad[:-1]
    wrong = np.column_stack([v - v * np.cos(h), h - v * np.sin(h)])
    expected = np.zeros((101, 2))
    for k, gain in enumerate(gains(100)):
        expected[k + 1] = (1 - gain) * (expected[k] + wrong[k])
    filtered = run(drive, KalmanModel(printed=True), COMMAND)
    assert filtered.mean - np.column_stack([truth.x_m, truth.y_m]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
def test_the_printed_command_costs_hundreds_of_metres() -> None:
    """Spec 2.6: about 635 m against 4.3 m (100 s, 200 runs). Over headings all round |d| is 4 v / pi on average."""
    truths = [simulate(seed) for seed in range(40)]
    printed = np.mean([t.run(KalmanModel(printed=True), COMMAND).mean() for t in truths])
    corrected = np.mean([t.run(KF, COMMAND).mean() for t in truths])
    assert corrected < 5
    assert 300 < printed < 1200


@pytest.mark.parametrize("seed", range(3))
def test_an_innovation_without_the_measurement_grows_like_a_debt(seed: int) -> None:
    """K h(x) instead of K (Z - h(x)): the position itself is added in, x = (1 + K)(x + v dt), fixes or not."""
    drive = silent(seed).drive
    printed = run(drive, ExtendedModel(printed_innovation=True), COMMAND)
    expected = np.zeros((101, 2))
    expected[0] = drive.x_m[0], drive.y_m[0]
    step = drive.speed_mps * np.exp(1j * drive.heading_rad)
    for k, gain in enumerate(gains(100)):
        expected[k + 1] = (1 + gain) * (expected[k] + [step[k].real, step[k].imag])
    assert printed.mean == pytest.approx(expected, rel=1e-6, abs=1e-6)
    elsewhere = replace(drive, x_m=drive.x_m + 5.0, y_m=drive.y_m - 7.0)
    assert np.hypot(*(printed.mean[-1] - [drive.x_m[-1], drive.y_m[-1]])) > 1e3
    other = run(elsewhere, ExtendedModel(printed_innovation=True), COMMAND)
    grown = (other.mean - printed.mean)[-1] / [5.0, -7.0]
    assert grown == pytest.approx(np.full(2, np.prod(1 + gains(100))), rel=1e-6)


def test_a_filter_that_ran_beyond_all_numbers_starts_anew() -> None:
    """A long drive with the printed innovation would end in infinities, which no angle survives."""
    truth = simulate(1, steps=3000, dt_s=30.0)
    policy = replace(MEASURED, process_sigma_m=100.0)
    filtered = run(truth.drive, ExtendedModel(printed_innovation=True), policy)
    assert np.isfinite(filtered.mean).all()
    assert filtered.starts.sum() > 1


@pytest.mark.slow
def test_the_printed_jacobian_harms_where_the_heading_is_estimated() -> None:
    """Spec 2.6: 157 to 178 m where fixes alone correct the heading, harmless where the INS does."""
    wrong = ExtendedModel(printed_jacobian=True)
    blind, aided = {EKF: [], wrong: []}, {EKF: [], wrong: []}
    for seed in range(20):
        truth = simulate(seed, heading_sigma_rad=0.02)
        first = np.arange(len(truth.drive)) == 0
        alone = replace(
            truth, drive=replace(truth.drive, heading_rad=np.where(first, truth.drive.heading_rad, np.nan))
        )
        for model in (EKF, wrong):
            blind[model].append(alone.run(model, MEASURED).mean())
            aided[model].append(truth.run(model, OVERWRITTEN).mean())
    assert np.mean(blind[wrong]) > 5 * np.mean(blind[EKF])
    assert np.mean(aided[wrong]) < 1.2 * np.mean(aided[EKF])


def test_the_printed_jacobian_is_the_derivative_with_sine_and_cosine_exchanged_and_without_dt() -> None:
    """One step of 2 s at 10 m/s from a known place with a heading of variance s: P = M P M' + Q shows M."""
    drive = silent(0, dt_s=2.0).drive
    h, s = 0.3, 0.01
    drive = replace(
        drive,
        speed_mps=np.full(101, 10.0),
        heading_rad=np.where(drive.time_s == 0, h, np.nan),
        heading_sigma_rad=np.full(101, math.sqrt(s)),
        fix_sigma_m=np.full(101, 1e-6),
        x_m=np.where(drive.time_s == 0, 0.0, np.nan),
    )
    for model, column in (
        (EKF, [-20 * math.sin(h), 20 * math.cos(h)]),
        (ExtendedModel(printed_jacobian=True), [-10 * math.cos(h), 10 * math.sin(h)]),
    ):
        covariance = run(drive, model, MEASURED).covariance[1]
        spread = covariance[:2, :2] - 0.5 * np.eye(2)
        assert spread == pytest.approx(s * np.outer(column, column), rel=1e-6, abs=1e-9)


@pytest.mark.slow
def test_the_printed_alpha_ruins_an_estimated_heading_and_spares_a_given_one() -> None:
    """Spec 2.6: sigma points a thousand sigma apart see the sine average out; with the heading given it is the KF."""
    fine = UnscentedModel(Unscented(1e-3, 2.0, -1.0))
    for turn_rad, walk_rad, worse in ((0.0, 0.01, 1.2), (0.05, 0.05, 3.0)):
        blind, given = {fine: [], PRINTED_ALPHA: []}, []
        for seed in range(15):
            truth = simulate(seed, turn_rad=turn_rad, heading_sigma_rad=0.02)
            first = np.arange(len(truth.drive)) == 0
            alone = replace(
                truth,
                drive=replace(truth.drive, heading_rad=np.where(first, truth.drive.heading_rad, np.nan)),
            )
            for model, errors in blind.items():
                errors.append(alone.run(model, replace(MEASURED, heading_walk_rad=walk_rad)).mean())
            given.append(truth.run(PRINTED_ALPHA, OVERWRITTEN).mean() - truth.run(KF, COMMAND).mean())
        assert np.mean(blind[PRINTED_ALPHA]) > worse * np.mean(blind[fine])
        assert np.abs(given).max() < 0.2


def algorithm_3(truth: Truth, unscented: Unscented, walk_rad: float) -> np.ndarray:
    """Positions (n, 2) by Algorithm 3 to the letter: one draw an epoch, the noise added to P but not to the points."""
    drive = truth.drive
    a, b, k, n = unscented.alpha, unscented.beta, unscented.kappa, 3
    scale = a**2 * (n + k)
    of_mean = np.full(7, 0.5 / scale)
    of_mean[0] = (scale - n) / scale
    weights = of_mean.copy()
    weights[0] += 1 - a**2 + b
    x = np.array([drive.x_m[0], drive.y_m[0], drive.heading_rad[0]])
    P = np.diag([225.0, 225.0, drive.heading_sigma_rad[0] ** 2])
    out = [x[:2]]
    for e in range(1, len(drive)):
        root = np.linalg.cholesky(scale * P)
        points = np.concatenate([x[:, None], x[:, None] + root, x[:, None] - root], axis=1)
        v = drive.speed_mps[e - 1]
        points[0] += v * np.cos(points[2])
        points[1] += v * np.sin(points[2])
        x = points @ of_mean
        P = (points - x[:, None]) * weights @ (points - x[:, None]).T + np.diag([0.25, 0.25, walk_rad**2])
        z = points[:2] @ of_mean
        off = points[:2] - z[:, None]
        Pzz = off * weights @ off.T + 225.0 * np.eye(2)
        K = (points - x[:, None]) * weights @ off.T @ np.linalg.inv(Pzz)
        x = x + K @ (np.array([drive.x_m[e], drive.y_m[e]]) - z)
        P = P - K @ Pzz @ K.T
        out.append(x[:2])
    return np.array(out)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("alpha", [0.1, 0.7, 1.0])
def test_without_a_redraw_the_filter_is_algorithm_3_to_the_letter(alpha: float, seed: int) -> None:
    unscented = Unscented(alpha, 2.0, -1.0)
    truth = simulate(seed, turn_rad=0.03)
    blind = np.where(np.arange(len(truth.drive)) == 0, truth.drive.heading_rad, np.nan)
    policy = replace(MEASURED, heading_walk_rad=0.03)
    drive = replace(truth.drive, heading_rad=blind)
    filtered = run(drive, UnscentedModel(unscented, late_noise=True), policy)
    assert filtered.mean[:, :2] == pytest.approx(algorithm_3(truth, unscented, 0.03), abs=1e-6)
    redrawn = run(drive, UnscentedModel(unscented), policy)
    assert np.abs(redrawn.mean - filtered.mean).max() > 1e-3
