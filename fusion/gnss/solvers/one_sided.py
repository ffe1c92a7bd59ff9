"""``one-sided``: positions from pseudoranges whose errors lean to the late side, over the whole drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import Field

from fusion.frames import geodetic
from fusion.gnss.error_models.likelihood import Law
from fusion.gnss.measurements import Aids, Measurements, Solution, SolverOptions
from fusion.gnss.solvers import one_sided_learning as learning
from fusion.gnss.solvers import one_sided_motion as motions
from fusion.gnss.solvers import state
from fusion.gnss.solvers.one_sided_filter import ENOUGH_SATELLITES, Problem, forward
from fusion.gnss.solvers.smoother import Pass, empty_pass, smooth
from fusion.types import Floats, Progress

TAU_S = 4.0
"""So long are errors of a satellite alike at the speed of traffic in a town (notes 6: 2 to 5 s); its range rate is
wrong for as long as its pseudorange is."""
_STANDING_TAU_S, _LIKE_WAY_M = 60.0, 30.0  # standing, reflections stay; moving, as long as a house is beside
_RATE_SIGMA_MPS, _RATE_CN0_DBHZ = 0.2, 40.0  # notes 6; below, the sigma doubles every 6 dB
_PASSES_WIDER = (4.0, 2.0, 1.0, 1.0, 1.0)
"""What sigmas of range rates are multiplied by in each pass of the smoother: from coarse to fine."""
_LOUDER = 1.05  # less more noise is not worth a new pass


class OneSidedOptions(SolverOptions):
    """What helps, and how."""

    smooth: bool = Field(
        True, description="let each epoch know the whole drive, not only what came before it"
    )
    odometer: bool = Field(True, description="use odometer speed and yaw rate where the log has them")
    doppler: bool = Field(True, description="use range rates from Doppler where the log has them")
    height: bool = Field(True, description="use heights from map and elevation model where they are known")


class OneSided:
    """A Kalman filter and smoother under the one-sided law of errors."""

    name = "one-sided"
    source = "notes 6 of the project: one-sided likelihood; Rauch, Tung and Striebel 1965"
    description = (
        "Takes into account that reflected signals are only ever late, with Doppler, odometer and height where they "
        "are known, and smooths the whole drive. The most accurate in towns."
    )
    options_model = OneSidedOptions

    def solve(
        self, measured: Measurements, aids: Aids, options: Any, seed: int, progress: Progress
    ) -> Solution:
        """Positions of all epochs; nothing is drawn, so ``seed`` plays no part.

        Epochs with fewer than four satellites are marked predicted, though what there is helps. Covariances hold what
        the log itself tells of how alike errors are in time, and errors that stay with a satellite.
        """
        if not len(measured.satellite):
            return _nothing(len(measured))
        frame = state.Frame.around(measured)
        progress("positions", 0.0)
        law = learning.receiver_law(measured)
        problem, n = problem_of(frame, measured, aids, options, law)
        track, mean = _solve(problem, n, options.smooth)
        level = learning.noise_level(problem.errors, learning.residuals(problem.rows, mean))
        if level > _LOUDER:
            law = replace(law, noise=level)
            problem = problem._replace(errors=law.errors(measured.cn0_dbhz))
            track, mean = _solve(problem, n, options.smooth)
        progress("positions", 0.5)
        mean, covariance, like_s = _honest(problem, measured, mean, options.smooth)
        progress("positions", 1.0)
        for k in range(len(mean)):
            motions.velocity(problem.motion, k, mean[k], covariance[k])
        report = {
            "midpoint_dbhz": round(law.midpoint_dbhz, 2),
            "noise": round(law.noise, 3),
            "errors_alike_s": round(like_s, 2),
            "runs": int(track.begins.sum()),
            "odometer": problem.motion.gyro >= 0,
        }
        return _solution(frame, problem, mean, covariance, measured, report)


def problem_of(
    frame: state.Frame, measured: Measurements, aids: Aids, options: OneSidedOptions, law: Law | None = None
) -> tuple[Problem, int]:
    """What a pass looks at, and how many numbers the state has, under a law (that of notes 6 if none is given)."""
    law = law or Law()
    n = state.states(measured)
    gyro = n if options.odometer and np.isfinite(aids.speed_mps).any() else -1
    motion = motions.motion_of(measured.time_s, aids, gyro)
    tau_s = np.where(
        motion.led, 1 / (1 / _STANDING_TAU_S + motion.speed_mps / _LIKE_WAY_M), np.full(len(measured), TAU_S)
    )
    cn0 = np.where(np.isfinite(measured.cn0_dbhz), measured.cn0_dbhz, law.midpoint_dbhz)
    weak_db = np.maximum(0.0, _RATE_CN0_DBHZ + law.midpoint_dbhz - Law().midpoint_dbhz - cn0)
    measured_rate = np.isfinite(measured.range_rate_mps) & np.isfinite(measured.satellite_mps).all(axis=1)
    rate_sigma = np.where(measured_rate & options.doppler, _RATE_SIGMA_MPS * 10 ** (weak_db / 20), np.nan)
    _, latitude_deg, height = geodetic(measured.rough_m[None])
    sine = np.sin(np.radians(latitude_deg[0]))
    flat = 1 - 0.00669438 * sine * sine  # first eccentricity squared, WGS 84
    radius = 6_378_137.0 / np.sqrt(flat)
    problem = Problem(
        rows=frame.rows(measured, state.cn0_variance(measured.cn0_dbhz, measured.elevation_rad)),
        errors=law.errors(measured.cn0_dbhz),
        motion=motion,
        rate_sigma_mps=rate_sigma,
        height_m=aids.height_m - height[0] if options.height else np.full(len(measured), np.nan),
        height_sigma_m=np.array(aids.height_sigma_m, float),
        bent_per_m=np.array([0.5 * flat / (radius * (1 - 0.00669438)), 0.5 / radius]),
        inflation=_inflation(measured.time_s, tau_s),
        rate_inflation=_inflation(measured.time_s, np.full(len(measured), TAU_S)),
        rate_wider=1.0,
    )
    return problem, n + (gyro >= 0)


def _inflation(time_s: Floats, tau_s: Floats) -> Floats:
    """How many epochs count as one, (m,), where errors stay alike for ``tau_s`` (m,)."""
    step_s = np.diff(time_s, prepend=time_s[:1])
    if len(step_s) > 1:
        step_s[0] = step_s[1]
    return np.asarray(np.maximum(1.0, tau_s / np.maximum(step_s, 1e-3)))


def _solve(problem: Problem, n: int, smoothed: bool) -> tuple[Pass, Floats]:
    """The forward pass and means (m, n): the filter's alone, or filter and smoother in turn, each about the last."""
    track = empty_pass(len(problem.motion.dt_s), n)
    forward(problem, np.full_like(track.mean, np.nan), track)
    mean = track.mean
    for wider in _PASSES_WIDER if smoothed else ():
        mean, _ = smooth(track)
        forward(problem._replace(rate_wider=wider), mean, track)
    return track, mean


def _honest(
    problem: Problem, measured: Measurements, mean: Floats, smoothed: bool
) -> tuple[Floats, Floats, float]:
    """Means, covariances, and how long errors stay alike (s).

    The errors are as much alike as the residuals say, and the satellites' own come on top. The filter keeps its means,
    which follow fast; the smoother's are those of the longer time.
    """
    residual = learning.residuals(problem.rows, mean)
    like_s = learning.correlation_s(problem.rows, problem.errors, measured.time_s, residual, TAU_S)
    inflation = np.maximum(problem.inflation, _inflation(measured.time_s, np.full(len(measured), like_s)))
    wider = problem._replace(inflation=inflation)
    track = empty_pass(*mean.shape)
    forward(wider, mean, track)
    mean, covariance = smooth(track) if smoothed else (mean.copy(), track.covariance)
    covariance[:, :3, :3] += learning.common_errors(wider, track, mean, len(measured.names))
    return mean, covariance, like_s


def _solution(
    frame: state.Frame,
    problem: Problem,
    mean: Floats,
    covariance: Floats,
    measured: Measurements,
    report: dict[str, Any],
) -> Solution:
    position, velocity, spread = frame.to_ecef(mean, covariance)
    residual = learning.residuals(problem.rows, mean)
    few = np.diff(measured.first) < ENOUGH_SATELLITES
    return Solution(
        position_m=position,
        velocity_mps=velocity,
        covariance=spread,
        clock_m=mean[:, state.CLOCK],
        nlos=learning.posterior(problem.errors, residual),
        residual_m=residual,
        predicted=few & np.isfinite(mean[:, 0]),
        report=report,
    )


def _nothing(epochs: int) -> Solution:
    """For a log without any row."""
    place, rows = np.full((epochs, 3), np.nan), np.empty(0)
    square = np.full((epochs, 6, 6), np.nan)
    return Solution(place, place.copy(), square, place[:, 0].copy(), rows, rows, np.zeros(epochs, bool))
