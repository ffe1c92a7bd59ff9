"""Compiled second pass of the particle method: map, terrain, the estimate, resampling."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from fusion.compiled import compiled, compiled_parallel, compiled_vector
from fusion.methods.kinematics import AX, AY, AZ, STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.methods.particle_kernels import fill_weights
from fusion.methods.particle_layout import (
    B_COS,
    B_LOGMAX,
    B_PITCH,
    B_PITCH2,
    B_SIN,
    B_STATE,
    B_W,
    B_WW,
    B_XX,
    B_YY,
    B_ZZ,
    BLOCK,
)
from fusion.types import Floats

_STEEPEST_TAN2 = math.tan(STEEPEST_RAD) ** 2


@compiled_vector
def _weigh_road(
    part: Floats,
    logw: Floats,
    angles: Floats,
    turn: float,
    road: Floats,
    inv_var_road: Floats,
    ground_m: float,
    antenna_m: float,
    inv_var_ground: float,
) -> None:
    """Map correction (2.13)-(2.15) and terrain correction (2.16)-(2.18), h = z - H / cos(pitch)."""
    for i in range(len(logw)):
        dx = road[0] - part[X, i]
        dy = road[1] - part[Y, i]
        dt = angles[0, i] - turn
        dt -= 2.0 * math.pi * math.floor((dt + math.pi) / (2.0 * math.pi))
        across2 = part[VX, i] * part[VX, i] + part[VY, i] * part[VY, i] + 1e-12
        lift = antenna_m * math.sqrt(1.0 + min(part[VZ, i] * part[VZ, i] / across2, _STEEPEST_TAN2))
        dz = ground_m - part[Z, i] + lift
        logw[i] -= 0.5 * (
            dx * dx * inv_var_road[0]
            + dy * dy * inv_var_road[1]
            + dt * dt * inv_var_road[2]
            + dz * dz * inv_var_ground
        )


@compiled_vector
def _attitude_moments(part: Floats, w: Floats, pitch: Floats, row: Floats) -> None:
    """Weighted circular moments of the heading (2.38, on the circle), moments of the pitch (2.37), sums of w."""
    s_w = s_ww = s_cos = s_sin = s_p = s_pp = 0.0
    for i in range(len(w)):
        wi = w[i]
        vx = part[VX, i]
        vy = part[VY, i]
        over = wi / math.sqrt(vx * vx + vy * vy + 1e-12)
        s_w += wi
        s_ww += wi * wi
        s_cos += over * vx
        s_sin += over * vy
        s_p += wi * pitch[i]
        s_pp += wi * pitch[i] * pitch[i]
    row[B_W], row[B_WW], row[B_COS], row[B_SIN], row[B_PITCH], row[B_PITCH2] = (
        s_w,
        s_ww,
        s_cos,
        s_sin,
        s_p,
        s_pp,
    )


@compiled_vector
def _moments(state: Floats, w: Floats, about: float) -> tuple[float, float]:
    """Weighted sums of a state and of its square, about a point near its mean."""
    first = second = 0.0
    for i in range(len(w)):
        d = state[i] - about
        first += w[i] * d
        second += w[i] * d * d
    return first, second


@compiled_parallel
def weigh_and_estimate(
    cloud: Floats,
    logw: Floats,
    angles: Floats,
    weights: Floats,
    sums: Floats,
    ref: Floats,
    road: Floats,
    inv_var_road: Floats,
    ground_m: float,
    antenna_m: float,
    inv_var_ground: float,
) -> None:
    """Second pass: map and terrain corrections; moments of the estimate, ``sums`` (blocks, 19).

    ``road`` is the matched (x, y, heading), ``inv_var_road`` its inverse variances (0 leaves out);
    ``ground_m`` the terrain's height under the vehicle, ``antenna_m`` the antenna's above the road.
    ``weights`` (n,) receives weights on the scale of each block's greatest.
    """
    n = cloud.shape[1]
    turn = road[2] - ref[2]
    for b in prange((n + BLOCK - 1) // BLOCK):
        part = cloud[:, b * BLOCK : min(n, (b + 1) * BLOCK)]
        lw = logw[b * BLOCK : min(n, (b + 1) * BLOCK)]
        an = angles[:, b * BLOCK : min(n, (b + 1) * BLOCK)]
        w = weights[b * BLOCK : min(n, (b + 1) * BLOCK)]
        _weigh_road(part, lw, an, turn, road, inv_var_road, ground_m, antenna_m, inv_var_ground)
        row = sums[b]
        row[B_LOGMAX] = fill_weights(lw, w)
        _attitude_moments(part, w, an[1], row)
        row[B_STATE + X], row[B_XX] = _moments(part[X], w, ref[0])
        row[B_STATE + Y], row[B_YY] = _moments(part[Y], w, ref[1])
        row[B_STATE + Z], row[B_ZZ] = _moments(part[Z], w, ref[3])
        for k in (AX, VX, AY, VY, AZ, VZ):
            row[B_STATE + k] = _moments(part[k], w, 0.0)[0]


@compiled
def merge_sums(sums: Floats, squared: int, out: Floats) -> Floats:
    """Add the blocks' sums in block order on the scale of the greatest log weight.

    Column ``squared`` (-1: none) holds squared weights and scales with the square.
    """
    top = -np.inf
    for b in range(sums.shape[0]):
        top = max(top, sums[b, 0])
    out[:] = 0.0
    out[0] = top
    for b in range(sums.shape[0]):
        scale = math.exp(sums[b, 0] - top)
        for c in range(1, sums.shape[1]):
            out[c] += (scale * scale if c == squared else scale) * sums[b, c]
    return out


@compiled_vector
def normalise_blocks(weights: Floats, sums: Floats, top: float, total: float) -> None:
    """Bring the blocks' weights to one scale, on which they sum to 1."""
    n = len(weights)
    for b in range(sums.shape[0]):
        scale = math.exp(sums[b, B_LOGMAX] - top) / total
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            weights[i] *= scale
