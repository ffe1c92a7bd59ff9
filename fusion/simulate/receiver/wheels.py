"""Rotation of the two rear wheels: what the motion turns them by, and what an ABS ring makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.simulate.motion.vehicle import Motion
from fusion.types import Floats

_STEP_S = 0.02


@dataclass(frozen=True)
class WheelSet:
    """Two rear wheels at ``track_m`` / 2 left and right of the axle's middle, and their sensors.

    ``radius_m`` is what a user would enter; each wheel's true radius differs from it by a relative error of one sigma
    ``radius_error``, drawn once per drive (pressure, load, wear). Between two readings the wheels turn too far or too
    little by a share drawn anew for each reading: ``slip`` (one sigma) is common to both wheels (driving, braking),
    ``slip_each`` belongs to each (bends, bumps). Sensors count ``ticks_per_turn`` ticks, 0 for no quantisation; 96
    stands for an ABS ring of 48 teeth whose two edges count.
    """

    track_m: float = 1.5
    radius_m: float = 0.3
    radius_error: float = 0.003
    slip: float = 0.002
    slip_each: float = 0.001
    ticks_per_turn: int = 96

    def __post_init__(self) -> None:
        if self.track_m <= 0 or self.radius_m <= 0:
            raise ValueError(f"track and radius must be positive, not {self.track_m} m and {self.radius_m} m")
        if min(self.radius_error, self.slip, self.slip_each, self.ticks_per_turn) < 0:
            raise ValueError("radius error, slip and ticks of wheels must not be negative")

    @property
    def tick_rad(self) -> float:
        """Rotation from one tick to the next, 0 without quantisation."""
        return 2 * np.pi / self.ticks_per_turn if self.ticks_per_turn else 0.0


@dataclass(frozen=True)
class WheelReadings:
    """Cumulative rotation at the epochs, radians, forwards positive, and the radii that turned."""

    left_rad: Floats
    right_rad: Floats
    left_radius_m: float
    right_radius_m: float


def observe_wheels(
    motion: Motion, elapsed_s: Floats, wheels: WheelSet, rng: np.random.Generator
) -> WheelReadings:
    """Readings at increasing instants ``elapsed_s`` of a motion; both wheels stand at zero when it begins.

    A wheel runs the way of the axle's middle, along the road's surface, plus (left) or minus (right) half the track
    times the turn to the right.
    """
    way_m, turn_rad = _travelled(motion, elapsed_s)
    share = wheels.slip * rng.normal(size=len(elapsed_s))
    readings: list[Floats] = []
    radii: list[float] = []
    for side in (0.5, -0.5):
        radius = wheels.radius_m * (1.0 + wheels.radius_error * float(rng.normal()))
        rolled = np.diff(way_m + side * wheels.track_m * turn_rad) / radius
        slipped = 1.0 + share + wheels.slip_each * rng.normal(size=len(elapsed_s))
        readings.append(_counted(np.cumsum(rolled * slipped), wheels.tick_rad, float(rng.random())))
        radii.append(radius)
    return WheelReadings(readings[0], readings[1], radii[0], radii[1])


def _travelled(motion: Motion, elapsed_s: Floats) -> tuple[Floats, Floats]:
    """Way along the surface, metres, and turn to the right, radians: at the beginning (0), then at the instants."""
    instants = np.concatenate([[0.0], elapsed_s])
    grid = np.union1d(np.arange(0.0, instants[-1], _STEP_S), instants)
    speed = motion.at(grid).speed_mps
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(grid))])
    yaw = motion.attitude(instants)[:, 0]
    return way[np.searchsorted(grid, instants)], yaw - yaw[0]


def _counted(rotation_rad: Floats, tick_rad: float, phase: float) -> Floats:
    """The last tick passed; ``phase`` 0..1 is where between two ticks the wheel stood at zero."""
    if not tick_rad:
        return rotation_rad
    return np.asarray(tick_rad * np.floor(rotation_rad / tick_rad + phase))
