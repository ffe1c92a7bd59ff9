"""``one-sided``: positions from pseudoranges whose errors lean to the late side, over the whole drive."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from fusion.gnss.earth import geodetic
from fusion.gnss.measurements import Aids, Measurements, Solution, SolverOptions
from fusion.gnss.solvers import one_sided_motion as motions
from fusion.gnss.solvers import state
from fusion.gnss.solvers.likelihood import Law, reflected
from fusion.gnss.solvers.one_sided_filter import Problem, forward
from fusion.gnss.solvers.smoother import Pass, empty_pass, smooth
from fusion.types import LONGEST_BRIDGED_GAP_S, Floats, Progress


class OneSidedOptions(SolverOptions):
    """What helps, and how."""

    smooth: bool = Field(True, description="each epoch knows the whole drive")
    odometer: bool = Field(True, description="use odometer and yaw rate")
    doppler: bool = Field(True, description="use range rates")
    height: bool = Field(True, description="use heights from map and elevation model")


TAU_S = 3.0
RATE_TAU_S = 1.0
PASSES = 5


class OneSided:
    name = "one-sided"
    options_model = OneSidedOptions

    def solve(self, measured, aids, options, seed, progress):
        frame = state.Frame.around(measured)
        rows = frame.rows(measured, state.cn0_variance(measured.cn0_dbhz, measured.elevation_rad))
        n = state.states(measured) + options.odometer
        law = Law()
        m = len(measured)
        drive = motions.drive(measured.time_s, aids, options.odometer, n - 1 if options.odometer else -1)
        dt = np.maximum(drive.dt_s, 1e-3); dt[0] = np.median(dt)
        tau = np.where(drive.led, 1/(1/STAND_S + drive.speed_mps/LENGTH_M), TAU_S)
        infl = np.maximum(1, tau / dt)
        cn0 = np.where(np.isfinite(measured.cn0_dbhz), measured.cn0_dbhz, 35.0)
        rate_sigma = 0.2 * 10 ** (np.maximum(0, 40 - cn0) / 20)
        if not options.doppler: rate_sigma[:] = np.nan
        rate_sigma = np.where(np.isfinite(measured.range_rate_mps), rate_sigma, np.nan)
        h = aids.height_m if options.height else np.full(m, np.nan)
        _, _, h0 = geodetic(measured.rough_m[None])
        problem = Problem(rows, law.errors(measured.cn0_dbhz), drive, rate_sigma, h - h0, aids.height_sigma_m,
                          np.array([0.5 / 6.37e6, .5 / 6.38e6]), infl, np.maximum(1, RATE_TAU_S / dt), LONGEST_BRIDGED_GAP_S)
        self.problem=problem
        about = np.full((m, n), np.nan)
        out = empty_pass(m, n)
        forward(problem, about, out)
        mean, cov = out.mean, out.covariance
        if options.smooth:
            for _ in range(PASSES):
                mean, cov = np.empty_like(mean), np.empty_like(cov)
                smooth(out, mean, cov)
                about = mean
                forward(problem, about, out)
            mean, cov = np.empty_like(mean), np.empty_like(cov)
            smooth(out, mean, cov)
        self.out = out
        return mean, cov, frame
STAND_S, LENGTH_M = 60.0, 20.0
