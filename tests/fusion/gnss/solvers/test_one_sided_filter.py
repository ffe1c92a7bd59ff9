"""The filter and the smoother, beside dense least squares where errors are normal and motion linear."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.gnss.error_models.likelihood import Errors
from fusion.gnss.measurements import Aids
from fusion.gnss.solvers import state
from fusion.gnss.solvers.one_sided import OneSidedOptions, problem_of
from fusion.gnss.solvers.one_sided_filter import Problem, forward
from fusion.gnss.solvers.one_sided_motion import step
from fusion.gnss.solvers.smoother import Pass, empty_pass, smooth
from fusion.types import Floats
from town_drives import TownDrive, town_drive


def normal_problem(drive: TownDrive, odometer: bool) -> tuple[Problem, int]:
    """All errors normal, no range rates: about a given track everything is linear."""
    measured = drive.measured
    aids = Aids.none(len(measured))
    if odometer:
        aids.speed_mps[:], aids.speed_sigma_mps[:], aids.yaw_rate_radps[:] = (
            drive.speed_mps,
            0.05,
            drive.yaw_radps,
        )
    frame = state.Frame.around(measured)
    problem, n = problem_of(frame, measured, aids, OneSidedOptions(doppler=False, odometer=odometer))
    rows = len(measured.satellite)
    errors = Errors(np.zeros(rows), np.full(rows, 25.0), np.full(rows, 30.0), np.zeros(rows))
    return problem._replace(errors=errors), n


def dense(problem: Problem, about: Floats, out: Pass) -> tuple[Floats, Floats]:
    """All states of all epochs at once, (m, n) and (m, n, n), by the normal equations."""
    epochs, n = about.shape
    matrix, right = np.zeros((epochs * n, epochs * n)), np.zeros(epochs * n)
    first = np.linalg.inv(out.ahead_covariance[0])
    matrix[:n, :n] += first
    right[:n] += first @ out.ahead[0]
    moves, noise, row = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    for k in range(epochs):
        here = slice(k * n, (k + 1) * n)
        if k:
            before = slice((k - 1) * n, k * n)
            step(problem.motion, k, about[k - 1], moves, noise)
            shift = np.zeros(n)
            if problem.motion.gyro >= 0:
                shift = -moves[:, problem.motion.gyro] * about[k - 1, problem.motion.gyro]
                shift[problem.motion.gyro] = 0.0
            weight = np.linalg.inv(noise)
            both = np.hstack([-moves, np.eye(n)])
            span = slice(before.start, here.stop)
            matrix[span, span] += both.T @ weight @ both
            right[span] += both.T @ weight @ shift
        for r in range(problem.rows.first[k], problem.rows.first[k + 1]):
            predicted = state.range_row(about[k], problem.rows.place_m[r], problem.rows.group[r], row)
            variance = 25.0 * problem.inflation[k]
            matrix[here, here] += np.outer(row, row) / variance
            right[here] += row * (problem.rows.range_m[r] - predicted + row @ about[k]) / variance
    # Units differ by ten powers of ten: a diagonal of ones first.
    scale = 1 / np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix * scale * scale[:, None]) * scale * scale[:, None]
    blocks = np.array([inverse[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(epochs)])
    return (inverse @ right).reshape(epochs, n), blocks


@pytest.fixture(scope="module")
def drive() -> TownDrive:
    return town_drive(5, epochs=25, reflected=0.0)


def test_filter_and_smoother_are_dense_least_squares(drive: TownDrive) -> None:
    problem, n = normal_problem(drive, odometer=False)
    out = empty_pass(len(drive.measured), n)
    forward(problem, np.full_like(out.mean, np.nan), out)
    about = out.mean.copy()
    forward(problem, about, out)
    mean, covariance = smooth(out)
    expected, spread = dense(problem, about, out)
    np.testing.assert_allclose(out.mean[-1, :3], expected[-1, :3], atol=1e-5)
    np.testing.assert_allclose(mean[:, :6], expected[:, :6], atol=1e-5)
    np.testing.assert_allclose(covariance[:, :6, :6], spread[:, :6, :6], rtol=1e-5, atol=1e-6)


def test_a_long_pass_keeps_covariances_sound(drive: TownDrive) -> None:
    problem, n = normal_problem(drive, odometer=True)
    out = empty_pass(len(drive.measured), n)
    forward(problem, np.full_like(out.mean, np.nan), out)
    _, covariance = smooth(out)
    for table in (out.covariance, covariance):
        scale = np.sqrt(np.einsum("kii->ki", table))
        assert np.isfinite(scale).all()
        assert np.linalg.eigvalsh(table / scale[:, :, None] / scale[:, None]).min() > -1e-7
    assert np.all(
        np.trace(covariance, axis1=1, axis2=2) <= np.trace(out.covariance, axis1=1, axis2=2) * (1 + 1e-6)
    )


def test_dead_reckoning_is_a_circle() -> None:
    """Ten metres a second, a tenth of a radian a second to the right, from north: a circle of 100 m to the east."""
    drive = town_drive(1, epochs=60, step_s=0.2)
    aids = Aids.none(60)
    aids.speed_mps[:], aids.speed_sigma_mps[:], aids.yaw_rate_radps[:] = 10.0, 0.05, 0.1
    problem, n = problem_of(state.Frame.around(drive.measured), drive.measured, aids, OneSidedOptions())
    mean = np.zeros(n)
    mean[4] = 1.0
    moves, noise = np.zeros((n, n)), np.zeros((n, n))
    for k in range(1, 60):
        step(problem.motion, k, mean, moves, noise)
        mean = moves @ mean
        assert np.linalg.eigvalsh(noise).min() > -1e-12
    angle = 0.1 * 59 * 0.2
    np.testing.assert_allclose(mean[:2], [100 * (1 - np.cos(angle)), 100 * np.sin(angle)], atol=0.01)
    np.testing.assert_allclose(mean[3:5], [np.sin(angle), np.cos(angle)], atol=1e-9)
