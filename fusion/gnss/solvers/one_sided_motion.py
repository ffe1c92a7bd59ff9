"""How the one-sided solver's state moves: freely, or led by an odometer and a yaw rate.

Where the odometer tells the speed S, the three numbers of the velocity become a direction: the velocity is S times
them, their horizontal length the odometer's scale (about 1), the third the slope. So the motion stays linear, a heading
outlives a standstill, and nothing moves there. A gyroscope's bias (rad/s) follows the biases of the groups. Where the
speed is unknown, S is 1 and they are the velocity itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.measurements import Aids
from fusion.gnss.solvers import state
from fusion.types import Bools, Floats

_DIRECTION_PER_S = 0.005**2
"""How direction and scale wander beside the gyroscope, 1/s: slip, and scale of the rate; 2 degrees in a minute."""
_TURN_ERROR = 0.02  # of the rate itself
_UNTOLD_TURN_PER_S = 0.3**2  # where no rate is known: a corner in a few seconds
_SLOPE_PER_M = 2.5e-6  # half a percent in ten metres
_GYRO_RADPS, _GYRO_PER_S = 0.005, 1e-9
_SLIDE_M2PS = 0.01  # sideways and by lag of the odometer
_NEW_DIRECTION, _NEW_SLOPE = 0.7, 0.05
_SLOWEST_MPS = 1.0  # below, a velocity tells no direction


class Motion(NamedTuple):
    """What moves the state, (m,): seconds since the epoch before, S with its sigma, yaw rate, whether S is known."""

    dt_s: Floats
    speed_mps: Floats
    sigma_mps: Floats
    yaw_radps: Floats
    led: Bools
    gyro: int
    """Where the gyroscope's bias stands in the state; -1 without odometer."""


def motion_of(time_s: Floats, aids: Aids, gyro: int) -> Motion:
    """The motion of (m,) epochs; a sigma that is not stated counts as 0.1 m/s."""
    dt = np.diff(time_s, prepend=time_s[:1])
    led = np.isfinite(aids.speed_mps) & (gyro >= 0)
    sigma = np.where(np.isfinite(aids.speed_sigma_mps), aids.speed_sigma_mps, 0.1)
    return Motion(
        dt, np.where(led, np.abs(aids.speed_mps), 1.0), sigma, np.array(aids.yaw_rate_radps), led, gyro
    )


@compiled
def begin(motion: Motion, epoch: int, mean: Floats, covariance: Floats) -> None:
    """Make the velocity of a fresh start a direction, where the odometer leads."""
    n = len(mean)
    if motion.led[epoch]:
        for i in range(3, 6):
            mean[i] = 0.0
            for j in range(n):
                covariance[i, j] = covariance[j, i] = 0.0
            covariance[i, i] = (_NEW_SLOPE if i == 5 else _NEW_DIRECTION) ** 2
    if motion.gyro >= 0:
        covariance[motion.gyro, :] = 0.0
        covariance[:, motion.gyro] = 0.0
        covariance[motion.gyro, motion.gyro] = _GYRO_RADPS**2
        mean[motion.gyro] = 0.0


@compiled
def step(motion: Motion, epoch: int, mean: Floats, moves: Floats, noise: Floats) -> None:
    """Fill ``moves`` and ``noise`` (n, n) from the epoch before; ``mean`` (n,) of there is where they are taken."""
    n, dt = len(mean), motion.dt_s[epoch]
    moves[:, :] = state.transition(dt, n)
    noise[:, :] = state.process_noise(dt, n)
    if motion.gyro >= 0:
        noise[motion.gyro, motion.gyro] = _GYRO_PER_S * dt
    if motion.led[epoch - 1] and motion.led[epoch]:
        _led(motion, epoch, mean, moves, noise)
    elif motion.led[epoch - 1] or motion.led[epoch]:
        _change(motion, epoch, moves, noise)


@compiled
def _led(motion: Motion, epoch: int, mean: Floats, moves: Floats, noise: Floats) -> None:
    dt = motion.dt_s[epoch]
    speed = 0.5 * (motion.speed_mps[epoch - 1] + motion.speed_mps[epoch])
    yaw = 0.5 * (motion.yaw_radps[epoch - 1] + motion.yaw_radps[epoch])
    has_yaw = np.isfinite(yaw)
    yaw = yaw if has_yaw else 0.0
    gyro = motion.gyro
    half = 0.5 * dt * (yaw - mean[gyro])
    way = speed * dt
    for i in range(3):
        moves[i, 3:6] = 0.0
        noise[i, :] = 0.0
        noise[:, i] = 0.0
        moves[i + 3, 3:6] = 0.0
        noise[i + 3, :] = 0.0
    sin, cos = np.sin(half), np.cos(half)
    moves[0, 3], moves[0, 4] = way * cos, way * sin
    moves[1, 3], moves[1, 4] = -way * sin, way * cos
    sin, cos = np.sin(2 * half), np.cos(2 * half)
    moves[3, 3], moves[3, 4] = cos, sin
    moves[4, 3], moves[4, 4] = -sin, cos
    moves[2, 5], moves[5, 5] = way, 1.0
    if has_yaw:
        east, north = cos * mean[3] + sin * mean[4], cos * mean[4] - sin * mean[3]
        moves[3, gyro], moves[4, gyro] = -dt * north, dt * east
        moves[0, gyro], moves[1, gyro] = -0.5 * dt * way * north, 0.5 * dt * way * east
    turn = dt * (_DIRECTION_PER_S + (_TURN_ERROR * yaw) ** 2) if has_yaw else dt * _UNTOLD_TURN_PER_S
    slide = (motion.sigma_mps[epoch] * dt) ** 2 + (_SLIDE_M2PS * dt if speed > 0 else 0.0)
    for i in range(2):
        noise[i, i] = slide + turn * way * way / 3
        noise[i, 3 + i] = noise[3 + i, i] = turn * way / 2
        noise[3 + i, 3 + i] = turn
    noise[5, 5] = _SLOPE_PER_M * way + 1e-12
    noise[2, 5] = noise[5, 2] = noise[5, 5] * way / 2
    noise[2, 2] = noise[5, 5] * way * way / 3 + 1e-4 * dt


@compiled
def _change(motion: Motion, epoch: int, moves: Floats, noise: Floats) -> None:
    """Between velocity and direction: where the odometer begins or ends to tell the speed."""
    before, after = motion.speed_mps[epoch - 1], motion.speed_mps[epoch]
    for i in range(3):
        moves[i, 3 + i] *= before
        if motion.led[epoch]:
            slow = after < _SLOWEST_MPS
            moves[3 + i, 3 + i] = 0.0 if slow else 1 / after
            noise[3 + i, :] = 0.0
            noise[:, 3 + i] = 0.0
            new = _NEW_SLOPE if i == 2 else _NEW_DIRECTION
            noise[3 + i, 3 + i] = new**2 if slow else (0.1 * new) ** 2
        else:
            moves[3 + i, 3 + i] = before


@compiled
def velocity(motion: Motion, epoch: int, mean: Floats, covariance: Floats) -> None:
    """Turn direction into velocity, in place, for what is given out."""
    speed, n = motion.speed_mps[epoch], len(mean)
    for i in range(3, 6):
        mean[i] *= speed
        for j in range(n):
            covariance[i, j] *= speed
        for j in range(n):
            covariance[j, i] *= speed
        if motion.led[epoch]:
            covariance[i, i] += motion.sigma_mps[epoch] ** 2
