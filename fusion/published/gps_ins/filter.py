"""GPS positions fused with the speed and heading of an INS, epoch by epoch: Saadaoui 2011, chapter 4.

Arrays in, arrays out: the methods and the benchmark of the thesis's experiments run the same code. It knows no log, no
road and no height.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.filters import kalman
from fusion.published.gps_ins.models import HEADING, Model, Moments, Step
from fusion.published.gps_ins.options import HeadingPolicy
from fusion.types import Floats

_STANDING_SHARE = 0.1  # a vehicle that stands keeps its place: this share of the process noise is left


@dataclass(frozen=True)
class DriveReadings:
    """What GPS and INS say at n epochs; every array has shape (n,).

    ``x_m``, ``y_m``: position in the local plane, NaN without a fix; ``fix_sigma_m`` its accuracy per axis.
    ``speed_mps``: speed over the step to the next epoch, negative backwards, finite; ``heading_rad``: heading over
    that step, from east, anticlockwise, NaN where unknown (0 as a command, no measurement else);
    ``heading_sigma_rad`` its accuracy. ``spread_m``: what the INS leaves open of that step beside the process noise,
    one sigma per axis.
    ``restart``: nothing may be carried over from the epoch before.
    """

    time_s: Floats
    x_m: Floats
    y_m: Floats
    fix_sigma_m: Floats
    speed_mps: Floats
    heading_rad: Floats
    heading_sigma_rad: Floats
    spread_m: Floats
    restart: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True)
class Settings:
    """How GPS and INS are put together; the options of the same names say more.

    Filters of two states do not look at what concerns the heading.

    ``gate``: the largest normalised square of an innovation that is believed, infinite for all.
    """

    heading: HeadingPolicy = "measurement"
    heading_reset: bool = True
    process_sigma_m: float = 0.5
    heading_walk_rad: float = 0.3
    drift_share: float = 0.0
    fix_correlation_s: float = 0.0
    gate: float = math.inf
    restart_after: int = 3
    min_speed_mps: float = 1.0

    @property
    def states(self) -> int:
        """2 for [x, y], 3 with the heading."""
        return 2 if self.heading == "command" else 3


@dataclass(frozen=True)
class Filtered:
    """The estimate at each epoch: ``mean`` (n, k), ``covariance`` (n, k, k), NaN before the first fix; k is 2 or 3.

    ``nis`` (n,): normalised square of the innovation of each fix that was predicted (two degrees of freedom where
    the filter is consistent), else NaN. ``gated``: fixes that were not believed; ``starts``: epochs at which the
    estimate begins anew.
    """

    mean: Floats
    covariance: Floats
    nis: Floats
    gated: NDArray[np.bool_]
    starts: NDArray[np.bool_]

    @property
    def h_sigma_m(self) -> Floats:
        """Horizontal sigma (2-D), shape (n,)."""
        sigma: Floats = np.sqrt(self.covariance[:, 0, 0] + self.covariance[:, 1, 1])
        return sigma


def chi_square_gate(probability: float) -> float:
    """The bound below which a chi-square variable of two degrees of freedom lies with this probability."""
    return math.inf if probability >= 1.0 else -2.0 * math.log1p(-probability)


def run(
    drive: DriveReadings,
    model: Model,
    settings: Settings,
    progress: Callable[[float], None] = lambda share: None,
) -> Filtered:
    """Take a drive through a filter. It starts at the first fix, with P0 = diag(R, R, sigma_heading^2)."""
    return _Run(drive, model, settings).filter(progress)


@dataclass
class _Run:
    """The state of one run between its epochs."""

    drive: DriveReadings
    model: Model
    settings: Settings
    moments: Moments | None = None
    rejected: int = 0
    fix_s: float = 0.0  # when the last fix came that was believed
    way_m: float = 0.0  # driven since then
    out: Filtered = field(init=False)

    def __post_init__(self) -> None:
        n, k = len(self.drive), self.settings.states
        self.out = Filtered(
            mean=np.full((n, k), np.nan),
            covariance=np.full((n, k, k), np.nan),
            nis=np.full(n, np.nan),
            gated=np.zeros(n, bool),
            starts=np.zeros(n, bool),
        )
        self._position = np.eye(2, k)
        self._heading = np.eye(k)[HEADING:]

    def filter(self, progress: Callable[[float], None]) -> Filtered:
        drive = self.drive
        for e in range(len(drive)):
            progress(e / len(drive))
            if drive.restart[e]:
                self.moments = None
            has_fix = math.isfinite(drive.x_m[e])
            if self.moments is not None:
                self._step(e, self.moments, has_fix)
            if self.moments is None and has_fix:
                self._start(e)
            if self.moments is not None:
                self.out.mean[e], self.out.covariance[e] = self.moments
        return self.out

    def _start(self, e: int) -> None:
        drive, k = self.drive, self.settings.states
        known = math.isfinite(drive.heading_rad[e])
        heading = float(drive.heading_rad[e]) if known else 0.0
        sigma = float(drive.heading_sigma_rad[e]) if known else math.pi
        mean = np.array([drive.x_m[e], drive.y_m[e], heading])
        variance = np.array([drive.fix_sigma_m[e], drive.fix_sigma_m[e], sigma]) ** 2
        self.moments = mean[:k], np.diag(variance[:k])
        self._believe(e)
        self.out.starts[e] = True

    def _step(self, e: int, moments: Moments, has_fix: bool) -> None:
        """From the epoch before to epoch ``e``: predict, correct by the fix if it is believed, then by the heading.

        Ends without moments where too many fixes in a row were not believed, or where a printed form ran away.
        """
        drive = self.drive
        dt = float(drive.time_s[e] - drive.time_s[e - 1])
        step = Step(dt, float(drive.speed_mps[e - 1]), float(np.nan_to_num(drive.heading_rad[e - 1])))
        noise = self._noise(e, step)
        late = noise if self.model.late_noise else np.zeros_like(noise)
        mean, covariance = self.model.predict(*moments, step, noise - late)
        self.way_m += abs(step.speed_mps) * dt
        if has_fix:
            mean, covariance = self._fix(e, mean, covariance)
        if self.rejected >= self.settings.restart_after or not np.isfinite(mean).all():
            self.moments = None
            return
        mean, covariance = self._head(e, mean, covariance)
        self.moments = mean, covariance + late

    def _noise(self, e: int, step: Step) -> Floats:
        """Q of the step that ends at epoch ``e``."""
        s = self.settings
        moving = abs(step.speed_mps) >= s.min_speed_mps
        way = abs(step.speed_mps) * step.dt_s
        # An INS that is off by a share of the way is off to the same side all along: the error grows with the way
        # itself, so its variance grows by more with every step.
        drift = s.drift_share**2 * ((self.way_m + way) ** 2 - self.way_m**2)
        place = s.process_sigma_m**2 * step.dt_s * (1.0 if moving else _STANDING_SHARE**2)
        place += float(self.drive.spread_m[e - 1]) ** 2 + drift
        turn = s.heading_walk_rad**2 * step.dt_s if moving else 0.0
        return np.diag(np.array([place, place, turn])[: s.states])

    def _believe(self, e: int) -> None:
        self.rejected, self.way_m, self.fix_s = 0, 0.0, float(self.drive.time_s[e])

    def _fix(self, e: int, mean: Floats, covariance: Floats) -> Moments:
        """Judged by what a fix may be off by; weighted by what one more of them tells."""
        drive, H = self.drive, self._position
        measured = np.array([drive.x_m[e], drive.y_m[e]])
        R = np.eye(2) * float(drive.fix_sigma_m[e]) ** 2
        nis = kalman.normalised_square(covariance, measured - H @ mean, H, R)
        self.out.nis[e] = nis
        if nis > self.settings.gate:
            self.out.gated[e] = True
            self.rejected += 1
            return mean, covariance
        since_s = float(drive.time_s[e]) - self.fix_s
        self._believe(e)
        counted = R * (1.0 + 2.0 * self.settings.fix_correlation_s / since_s)
        return self.model.correct(mean, covariance, measured, H, counted)

    def _head(self, e: int, mean: Floats, covariance: Floats) -> Moments:
        """The heading of the step ahead, as a measurement of the third state or in its place."""
        heading, policy = float(self.drive.heading_rad[e]), self.settings.heading
        if policy == "command" or not math.isfinite(heading):
            return mean, covariance
        sigma = float(self.drive.heading_sigma_rad[e])
        near = mean[HEADING] + math.remainder(heading - mean[HEADING], math.tau)
        if policy == "measurement":
            return self.model.correct(
                mean, covariance, np.array([near]), self._heading, np.array([[sigma**2]])
            )
        mean = np.array([mean[0], mean[1], near])
        if self.settings.heading_reset:
            covariance = covariance.copy()
            covariance[HEADING, :] = covariance[:, HEADING] = 0.0
            covariance[HEADING, HEADING] = sigma**2
        return mean, covariance
