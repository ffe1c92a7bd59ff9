"""What solvers take and give: corrected measurements, what else helps, and a solution.

Everything is in ECEF and SI units, in flat rows that compiled loops can run over.

``aids_of`` takes from a log's other sensors what helps at the epochs: speed along the ground and yaw rate.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from fusion.arrays import nearest
from fusion.options import Named, OptionsModel
from fusion.types import Bools, DriveLog, Floats, Ints, Progress


@dataclass(frozen=True)
class Measurements:
    """Corrected measurements of a drive, (n,) rows in (m,) epochs; rows ``first[k]:first[k + 1]`` belong to epoch k.

    ``time_s`` are UTC Unix seconds. ``pseudorange_m`` is free of satellite clock, group delay, ionosphere and
    troposphere, and of the receiver clock's jumps: it is |satellite - user| + clock(``group``) + error, where
    ``satellite_m`` (n, 3) is in the frame of the moment of reception (turned by the earth's rotation meanwhile).
    ``range_rate_mps`` (NaN where not measured) is (satellite velocity - user velocity) . sight + clock drift + error,
    free of the satellite clock's drift, the sight being the unit vector from user to satellite. ``group`` numbers the
    systems that share one clock (0: the reference, its name ``groups[0]``); others have one bias beside it.
    ``satellite`` numbers satellites through the drive, 0 to s - 1 (named in ``names``). ``sigma_m`` is the receiver's
    own of the pseudorange, NaN where not stated. ``rough_m`` (3,) is a place near the drive.
    """

    time_s: Floats
    first: Ints
    satellite: Ints
    group: Ints
    pseudorange_m: Floats
    range_rate_mps: Floats
    cn0_dbhz: Floats
    sigma_m: Floats
    elevation_rad: Floats
    azimuth_rad: Floats
    satellite_m: Floats
    satellite_mps: Floats
    names: tuple[str, ...]
    groups: tuple[str, ...]
    rough_m: Floats
    warnings: tuple[str, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    """What was left out or repaired, by reason: for the drive's report."""
    clock_anew: Bools = field(default_factory=lambda: np.zeros(0, bool))
    """(m,): epochs where the receiver's clock begins anew, all biases with it; False throughout where not given."""

    def __post_init__(self) -> None:
        if not len(self.clock_anew):
            object.__setattr__(self, "clock_anew", np.zeros(len(self.time_s), bool))

    def __len__(self) -> int:
        """How many epochs there are."""
        return len(self.time_s)

    @property
    def epoch(self) -> Ints:
        """The epoch of each row, (n,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    def take_rows(self, keep: Bools) -> Measurements:
        """The rows that a mask (n,) selects; epochs stay, if without rows."""
        counts = np.bincount(self.epoch[keep], minlength=len(self))
        columns = {name: getattr(self, name)[keep] for name in _OF_ROWS}
        return replace(self, first=np.append(0, np.cumsum(counts)), **columns)


_OF_ROWS = (
    "satellite", "group", "pseudorange_m", "range_rate_mps", "cn0_dbhz", "sigma_m", "elevation_rad", "azimuth_rad",
    "satellite_m", "satellite_mps",
)  # fmt: skip


@dataclass(frozen=True)
class Aids:
    """What other sensors and the map know at each epoch, (m,) each; NaN where nothing is known.

    ``speed_mps`` along the ground from the odometer with its sigma; ``yaw_rate_radps`` clockwise seen from above;
    ``height_m`` above the ellipsoid, of the antenna, from road and elevation model, with ``height_sigma_m``.
    """

    speed_mps: Floats
    speed_sigma_mps: Floats
    yaw_rate_radps: Floats
    height_m: Floats
    height_sigma_m: Floats

    @classmethod
    def none(cls, epochs: int) -> Aids:
        """No help at all."""
        return cls(*(np.full(epochs, np.nan) for _ in range(5)))


@dataclass(frozen=True)
class Solution:
    """Where the receiver was, (m,) epochs; rows of ``nlos`` and ``residual_m`` are those of the measurements.

    ``position_m`` and ``velocity_mps`` (m, 3) in ECEF, NaN where the epoch has none. ``covariance`` (m, 6, 6) of both,
    position first; a solver without velocity leaves NaN there. ``clock_m`` is the reference clock. ``nlos`` is each
    row's probability of having been reflected, NaN where the solver says nothing; ``residual_m`` is measured minus
    predicted at the solution. ``predicted`` marks epochs that rest on the motion alone, for want of satellites.
    """

    position_m: Floats
    velocity_mps: Floats
    covariance: Floats
    clock_m: Floats
    nlos: Floats
    residual_m: Floats
    predicted: Bools
    report: dict[str, Any] = field(default_factory=dict)

    @property
    def solved(self) -> Bools:
        """Epochs that have a position, (m,)."""
        return np.asarray(np.isfinite(self.position_m).all(axis=1))


class SolverOptions(OptionsModel):
    """Base of every solver's options: immutable, unknown names refused, each field described with its unit."""


class Solver(Named, Protocol):
    """A named way from measurements to positions."""

    def solve(
        self, measured: Measurements, aids: Aids, options: Any, seed: int, progress: Progress
    ) -> Solution:
        """Positions of all epochs; the same arguments give the same digits.

        An epoch that cannot be known is NaN, or predicted with a sigma that says so; never wrong with a small one.
        ``options`` is an instance of ``options_model``.
        """
        ...


NEAR_S = 0.6
"""A reading farther from an epoch than this says nothing of it: sensors of cars come once a second or more often."""
SPEED_SIGMA_MPS, SPEED_SCALE = 0.1, 0.01
"""Of a vehicle's speed signal: its steps, and the error of its scale (tyres)."""
HEIGHT_SIGMA_M = 3.0
"""Of the height of a road in an elevation model (notes 6)."""


def aids_of(log: DriveLog, time_s: Floats) -> Aids:
    """What the log's odometer and gyroscope say at times (m,)."""
    speed = _at(log.odometry.time_s, log.odometry.speed_mps, time_s)
    return replace(
        Aids.none(len(time_s)),
        speed_mps=speed,
        speed_sigma_mps=np.hypot(SPEED_SIGMA_MPS, SPEED_SCALE * speed),
        yaw_rate_radps=-_at(log.rate.time_s, log.rate.gyr_z_radps, time_s),
    )


def with_heights(aids: Aids, height_m: Floats) -> Aids:
    """The same with heights of the road above the ellipsoid, (m,), NaN where there is none."""
    sigma = np.where(np.isfinite(height_m), HEIGHT_SIGMA_M, np.nan)
    return replace(aids, height_m=np.asarray(height_m, float), height_sigma_m=sigma)


def _at(time_s: Floats, value: Floats, at_s: Floats) -> Floats:
    """Values at times, interpolated between readings that are near."""
    measured = np.isfinite(value)
    time_s, value = time_s[measured], value[measured]
    if not len(time_s):
        return np.full(len(at_s), np.nan)
    near = np.abs(time_s[nearest(time_s, at_s)] - at_s) <= NEAR_S
    return np.where(near, np.interp(at_s, time_s, value), np.nan)
