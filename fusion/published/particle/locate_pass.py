"""Second of the two compiled passes over the particles of an epoch: weigh by map and terrain, and estimate.

It is ``EpochFilter.locate``, after ``sense_pass`` and the map match between them. It gathers the moments of the
estimate and, where the cloud is to be resampled, the weights. It moves no particle. Sums are written in the order of
``layout``'s columns.
"""

from __future__ import annotations

import math

from numba import prange

from fusion.compiled import compiled_parallel, compiled_vector
from fusion.filters.single_precision import (
    LEAST_RANK,
    Single,
    Singles,
    cos_quarters,
    exp_negative,
    from_rank,
    rank_of,
)
from fusion.published.nine_state.motion import AX, AY, AZ, STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.published.particle.layout import B_XX, BLOCK, LOGW, PITCH, ROW, TURN
from fusion.types import Floats

_ZERO, _TINY = Single(0.0), Single(1e-12)
_PI, _CIRCLE = Single(math.pi), Single(2.0 * math.pi)
_STEEPEST, _QUARTERS_PER_RAD = Single(STEEPEST_RAD), Single(2.0 / math.pi)


@compiled_parallel
def weigh_and_estimate(
    cloud: Singles,
    n: int,
    sums: Floats,
    road: Floats,
    inv_var_road: Floats,
    ground: float,
    inv_var_ground: float,
    antenna: float,
) -> None:
    """The locating pass: map and terrain corrections; moments of the estimate, ``sums`` (blocks, B_COLUMNS).

    ``road`` is the matched (x, y, heading) and ``ground`` the terrain's height under the vehicle, both from the
    cloud's origin and heading, headings within a turn; inverse variances of 0 leave a correction out. ``antenna`` is
    the antenna's height above the road.
    """
    for b in prange(cloud.shape[0]):
        m = min(n - b * BLOCK, BLOCK)
        top = _weigh_road(cloud[b], m, road, inv_var_road, ground, inv_var_ground, antenna)
        _attitude_moments(cloud[b], m, top, sums[b])
        _state_moments(cloud[b], m, top, sums[b])


@compiled_parallel
def fill_weights(cloud: Singles, top: float, total: float, weights: Floats) -> None:
    """Fill ``weights`` (n,), which sum to 1; ``total`` is their sum on the scale of the greatest, e^top."""
    n = len(weights)
    for b in prange(cloud.shape[0]):
        part = weights[b * BLOCK : min(n, (b + 1) * BLOCK)]
        _fill_block(cloud[b, LOGW * ROW :], Single(top), Single(1.0 / total), part)


@compiled_vector
def _weigh_road(
    chunk: Singles,
    n: int,
    road: Floats,
    inv_var_road: Floats,
    ground: float,
    inv_var_ground: float,
    antenna: float,
) -> Single:
    """Map correction (2.13)-(2.15) and terrain correction (2.16)-(2.18), h = z - H / cos(pitch).

    Returns the greatest log weight.
    """
    x, y, turn = Single(road[0]), Single(road[1]), Single(road[2])
    h_x, h_y, h_t = (
        Single(0.5 * inv_var_road[0]),
        Single(0.5 * inv_var_road[1]),
        Single(0.5 * inv_var_road[2]),
    )
    level, height, h_z = Single(ground), Single(antenna), Single(0.5 * inv_var_ground)
    top = LEAST_RANK
    for i in range(min(n, BLOCK)):
        dx = x - chunk[X * ROW + i]
        dy = y - chunk[Y * ROW + i]
        dt = chunk[TURN * ROW + i] - turn
        dt = dt - _CIRCLE if dt > _PI else dt
        dt = dt + _CIRCLE if dt < -_PI else dt
        pitch = min(abs(chunk[PITCH * ROW + i]), _STEEPEST)
        dz = level - chunk[Z * ROW + i] + height / cos_quarters(pitch * _QUARTERS_PER_RAD)
        logw = chunk[LOGW * ROW + i] - (dx * dx * h_x + dy * dy * h_y + dt * dt * h_t + dz * dz * h_z)
        chunk[LOGW * ROW + i] = logw
        top = max(top, rank_of(logw))
    return from_rank(top)


@compiled_vector
def _attitude_moments(chunk: Singles, n: int, top: Single, row: Floats) -> None:
    """Sums over the weights; circular moments of the heading (2.38, on the circle), moments of the pitch (2.37)."""
    s_w = s_ww = s_wl = s_cos = s_sin = s_p = s_pp = _ZERO
    for i in range(min(n, BLOCK)):
        below = chunk[LOGW * ROW + i] - top
        w = exp_negative(below)
        vx, vy, pitch = chunk[VX * ROW + i], chunk[VY * ROW + i], chunk[PITCH * ROW + i]
        over = w / math.sqrt(vx * vx + vy * vy + _TINY)
        wp = w * pitch
        s_w += w
        s_ww += w * w
        s_wl += w * below
        s_cos += over * vx
        s_sin += over * vy
        s_p += wp
        s_pp += wp * pitch
    row[:B_XX] = top, s_w, s_ww, s_wl, s_cos, s_sin, s_p, s_pp


@compiled_vector
def _state_moments(chunk: Singles, n: int, top: Single, row: Floats) -> None:
    """Weighted sums of the states, and of the squares of positions."""
    s_ax = s_vx = s_x = s_ay = s_vy = s_y = s_az = s_vz = s_z = s_xx = s_yy = s_zz = _ZERO
    for i in range(min(n, BLOCK)):
        w = exp_negative(chunk[LOGW * ROW + i] - top)
        x, y, z = chunk[X * ROW + i], chunk[Y * ROW + i], chunk[Z * ROW + i]
        wx, wy, wz = w * x, w * y, w * z
        s_ax += w * chunk[AX * ROW + i]
        s_ay += w * chunk[AY * ROW + i]
        s_az += w * chunk[AZ * ROW + i]
        s_vx += w * chunk[VX * ROW + i]
        s_vy += w * chunk[VY * ROW + i]
        s_vz += w * chunk[VZ * ROW + i]
        s_x += wx
        s_y += wy
        s_z += wz
        s_xx += wx * x
        s_yy += wy * y
        s_zz += wz * z
    row[B_XX:] = s_xx, s_yy, s_zz, s_ax, s_vx, s_x, s_ay, s_vy, s_y, s_az, s_vz, s_z


@compiled_vector
def _fill_block(logw: Singles, top: Single, scale: Single, weights: Floats) -> None:
    for i in range(len(weights)):
        weights[i] = scale * exp_negative(logw[i] - top)
