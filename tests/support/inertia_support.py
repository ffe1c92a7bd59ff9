"""A vehicle on winding, hilly roads, seen by GNSS and by inertial sensors that are late or are misaligned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.frames import GRAVITY_MPS2
from fusion.profile.inertia import Changes, Cue, Signal, changes_of
from fusion.types import Floats

START_S = 1.7e9


@dataclass(frozen=True, eq=False)
class Ride:
    """GNSS velocities at ``gnss_s`` (n,), and forces and turning at ``inertial_s`` (m,) of a sensor late by a lag."""

    gnss_s: Floats
    north_mps: Floats
    east_mps: Floats
    down_mps: Floats
    inertial_s: Floats
    forward_mps2: Floats
    left_mps2: Floats
    turning_radps: Floats

    def changes(self) -> Changes:
        return changes_of(self.gnss_s, self.north_mps, self.east_mps, self.down_mps)

    def cues(self, changes: Changes) -> list[Cue]:
        one = np.ones(len(changes))
        return [
            Cue(Signal(self.inertial_s, self.forward_mps2), changes.forward_mps, one),
            Cue(Signal(self.inertial_s, self.left_mps2), changes.left_mps, one),
            Cue(Signal(self.inertial_s, self.turning_radps), changes.left_mps, changes.speed_mps),
        ]

    def forces(self) -> tuple[Signal, Signal]:
        return Signal(self.inertial_s, self.forward_mps2), Signal(self.inertial_s, self.left_mps2)


def ride(
    seed: int,
    *,
    lag_s: float = 0.0,
    yaw_deg: float = 0.0,
    duration_s: float = 600.0,
    inertial_hz: float = 10.0,
    noise: float = 1.0,
) -> Ride:
    """Speeds about 12 m/s, changes of 0.7 m/s^2, bends of 1 m/s^2, grades of 3 %; squat and roll beside it."""
    rng = np.random.default_rng(seed)
    fine = np.arange(-5.0, duration_s + 5.0, 0.02)
    speed = 12 + _wave(rng, fine, 1.2, (4.0, 30.0))
    turning = _wave(rng, fine, 0.08, (4.0, 25.0))
    grade = _wave(rng, fine, 0.03, (10.0, 60.0))
    course = np.cumsum(turning) * 0.02
    forward, left = np.gradient(speed, fine) + GRAVITY_MPS2 * grade, speed * turning
    forward = forward + 0.08 * np.gradient(speed, fine)  # squat
    left = left * 1.1  # roll
    angle = np.radians(yaw_deg)
    gnss = np.arange(0.0, duration_s, 1.0)
    inertial = np.arange(0.0, duration_s, 1 / inertial_hz)

    def seen(value: Floats, sigma: float) -> Floats:
        return np.interp(inertial - lag_s, fine, value) + noise * sigma * rng.normal(size=len(inertial))

    def doppler(value: Floats) -> Floats:
        return np.asarray(np.interp(gnss, fine, value) + noise * 0.05 * rng.normal(size=len(gnss)))

    return Ride(
        START_S + gnss,
        doppler(speed * np.sin(course)),
        doppler(speed * np.cos(course)),
        doppler(-speed * grade),
        START_S + inertial,
        seen(np.cos(angle) * forward + np.sin(angle) * left, 0.1),
        seen(np.cos(angle) * left - np.sin(angle) * forward, 0.1),
        seen(turning, 0.01),
    )


def _wave(rng: np.random.Generator, time: Floats, sigma: float, periods_s: tuple[float, float]) -> Floats:
    """Smooth changes of so many seconds, of standard deviation ``sigma``."""
    periods = rng.uniform(*periods_s, size=40)
    phases = rng.uniform(0, 2 * np.pi, size=40)
    total = sum(np.sin(2 * np.pi * time / p + f) for p, f in zip(periods, phases, strict=True))
    return np.asarray(sigma * total / np.sqrt(20))
