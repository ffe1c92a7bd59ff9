"""Compiled first pass of the particle method: dynamics and sensors, one block of particles after another, in parallel.

The cloud is an array (9, n): ax vx x ay vy y az vz z in rows. Two passes touch it at each epoch: this one predicts
and weighs by GNSS, acceleration and pitch, and gathers what the map match needs; the second (``particle_estimate``)
weighs by map and terrain, and gathers the estimate. Sums are kept per block and added in block order, so results do
not depend on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from fusion.compiled import compiled, compiled_parallel, compiled_vector
from fusion.filters.random import Stream, fill_normals, seed_stream
from fusion.methods.fast_angles import fast_atan, fast_atan2
from fusion.methods.kinematics import STATES, VX, VY, VZ, X, Y
from fusion.methods.particle_layout import (
    A_LOGMAX,
    A_T,
    A_TT,
    A_W,
    A_X,
    A_XT,
    A_XX,
    A_XY,
    A_Y,
    A_YT,
    A_YY,
    BLOCK,
)
from fusion.types import Floats, Ints


@compiled_vector
def _weigh_row(state: Floats, logw: Floats, z: float, inv_var: float) -> None:
    """Gaussian correction whose h(X) is a state itself."""
    for i in range(len(state)):
        d = z - state[i]
        logw[i] -= 0.5 * d * d * inv_var


@compiled_vector
def _move_row(
    state: Floats,
    logw: Floats,
    mean: Floats,
    q: float,
    z: float,
    inv_var: float,
    optimal: bool,
    normals: Floats,
) -> None:
    """Draw one state of a block around its predicted ``mean`` with process variance ``q``, and correct it by ``z``.

    With the transition as importance density (the thesis's SIR) the draw ignores ``z`` and the weight is its
    likelihood. With the optimal one (Doucet 1998, closed here because noise and measurement are diagonal and
    Gaussian) the draw uses ``z`` and the weight is its predictive density: the same posterior from a cloud
    that collapses far less.
    """
    if inv_var > 0.0 and optimal:
        gain = q * inv_var / (1.0 + q * inv_var)
        inv_predictive = inv_var / (1.0 + q * inv_var)
        spread = math.sqrt(q * (1.0 - gain))
        for i in range(len(state)):
            d = z - mean[i]
            logw[i] -= 0.5 * d * d * inv_predictive
            state[i] = mean[i] + gain * d + spread * normals[i]
        return
    spread = math.sqrt(q)
    for i in range(len(state)):
        state[i] = mean[i] + spread * normals[i]
    if inv_var > 0.0:
        _weigh_row(state, logw, z, inv_var)


@compiled_vector
def _move_axis(
    acc: Floats,
    vel: Floats,
    pos: Floats,
    logw: Floats,
    dt: float,
    half_dt2: float,
    q: Floats,
    z: Floats,
    inv_var: Floats,
    optimal: bool,
    stream: Stream,
    mean: Floats,
    normals: Floats,
) -> None:
    """(2.1)-(2.6) for one axis of a block; ``half_dt2`` is 0 in the printed form, dt^2/2 in the exact one."""
    # Position first, acceleration last: each row's mean needs the old values of those after it.
    for i in range(len(pos)):
        mean[i] = pos[i] + vel[i] * dt + acc[i] * half_dt2
    fill_normals(stream, normals)
    _move_row(pos, logw, mean, q[2], z[2], inv_var[2], optimal, normals)
    for i in range(len(pos)):
        mean[i] = vel[i] + acc[i] * dt
    fill_normals(stream, normals)
    _move_row(vel, logw, mean, q[1], z[1], inv_var[1], optimal, normals)
    mean[:] = acc
    fill_normals(stream, normals)
    _move_row(acc, logw, mean, q[0], z[0], inv_var[0], optimal, normals)


@compiled_vector
def _weigh_pitch(
    part: Floats, logw: Floats, angles: Floats, pitch: float, inv_var: float, heading: float
) -> None:
    """Fill ``angles`` (2, m) with heading relative to ``heading`` and pitch; correct by the measured pitch (3.13)."""
    cos_ref = math.cos(heading)
    sin_ref = math.sin(heading)
    for i in range(len(logw)):
        vx = part[VX, i]
        vy = part[VY, i]
        angles[0, i] = fast_atan2(cos_ref * vy - sin_ref * vx, cos_ref * vx + sin_ref * vy)
        alpha = fast_atan(part[VZ, i] / math.sqrt(vx * vx + vy * vy + 1e-12))
        angles[1, i] = alpha
        logw[i] -= 0.5 * (pitch - alpha) * (pitch - alpha) * inv_var


@compiled_vector
def _map_moments(part: Floats, w: Floats, turn: Floats, ref: Floats, row: Floats) -> None:
    """Weighted first and second moments of x, y, heading about ``ref``, for (2.26) and (2.30)."""
    s_w = s_x = s_y = s_t = s_xx = s_yy = s_tt = s_xy = s_xt = s_yt = 0.0
    for i in range(len(w)):
        wi = w[i]
        x = part[X, i] - ref[0]
        y = part[Y, i] - ref[1]
        t = turn[i]
        s_w += wi
        s_x += wi * x
        s_y += wi * y
        s_t += wi * t
        s_xx += wi * x * x
        s_yy += wi * y * y
        s_tt += wi * t * t
        s_xy += wi * x * y
        s_xt += wi * x * t
        s_yt += wi * y * t
    row[A_W], row[A_X], row[A_Y], row[A_T] = s_w, s_x, s_y, s_t
    row[A_XX], row[A_YY], row[A_TT] = s_xx, s_yy, s_tt
    row[A_XY], row[A_XT], row[A_YT] = s_xy, s_xt, s_yt


@compiled_vector
def _inherit(source: Floats, ancestors: Ints, part: Floats) -> None:
    """Fill a block with copies of its ancestors: resampling, done where the block is needed next."""
    for row in range(part.shape[0]):
        for i in range(len(ancestors)):
            part[row, i] = source[row, ancestors[i]]


@compiled_parallel
def predict_and_weigh(
    source: Floats,
    ancestors: Ints,
    cloud: Floats,
    logw: Floats,
    angles: Floats,
    sums: Floats,
    seed: int,
    step: int,
    dt: float,
    half_dt2: float,
    q: Floats,
    z: Floats,
    inv_var: Floats,
    optimal: bool,
    pitch: float,
    inv_var_pitch: float,
    ref: Floats,
) -> None:
    """First pass: dynamics, then GNSS, acceleration and pitch corrections; moments of (x, y, heading).

    ``cloud`` (9, n) is moved in place; with ``ancestors`` (n,) it is first filled with copies of those columns of
    ``source``, with none (0,) it already holds the particles. ``angles`` (2, n) receives each particle's heading
    relative to ``ref[2]`` and its pitch; ``ref`` holds the point (x, y, heading, z) about which second moments are
    taken; ``sums`` (blocks, 11). ``dt`` below 0 leaves the dynamics out (the first epoch). ``q`` (3, 3) are process
    variances over ``dt`` by axis (east, north, up) and kind (acceleration, velocity, position).
    """
    n = cloud.shape[1]
    for b in prange((n + BLOCK - 1) // BLOCK):
        part = cloud[:, b * BLOCK : min(n, (b + 1) * BLOCK)]
        lw = logw[b * BLOCK : min(n, (b + 1) * BLOCK)]
        an = angles[:, b * BLOCK : min(n, (b + 1) * BLOCK)]
        w = np.empty(len(lw))
        if len(ancestors) > 0:
            _inherit(source, ancestors[b * BLOCK : min(n, (b + 1) * BLOCK)], part)
        if dt >= 0.0:
            stream = np.empty(4, np.uint64)
            seed_stream(seed, step, b, stream)
            normals = np.empty(len(lw))
            for axis in range(3):
                rows = slice(3 * axis, 3 * axis + 3)
                acc, vel, pos = part[3 * axis], part[3 * axis + 1], part[3 * axis + 2]
                _move_axis(
                    acc,
                    vel,
                    pos,
                    lw,
                    dt,
                    half_dt2,
                    q[axis],
                    z[rows],
                    inv_var[rows],
                    optimal,
                    stream,
                    w,
                    normals,
                )
        else:
            for state in range(STATES):
                if inv_var[state] > 0.0:
                    _weigh_row(part[state], lw, z[state], inv_var[state])
        _weigh_pitch(part, lw, an, pitch, inv_var_pitch, ref[2])
        sums[b, A_LOGMAX] = fill_weights(lw, w)
        _map_moments(part, w, an[0], ref, sums[b])


@compiled_vector
def fill_weights(logw: Floats, w: Floats) -> float:
    """Fill ``w`` with weights on the scale of the block's greatest, whose logarithm is returned."""
    top = -np.inf
    for i in range(len(logw)):
        top = max(top, logw[i])
    for i in range(len(logw)):
        w[i] = math.exp(logw[i] - top)
    return top


@compiled
def draw_cloud(cloud: Floats, logw: Floats, seed: int, step: int, mean: Floats, sigma: Floats) -> None:
    """A new cloud around ``mean`` with standard deviations ``sigma`` (9,), all weights equal."""
    stream = np.empty(4, np.uint64)
    seed_stream(seed, step, 0, stream)
    for row in range(cloud.shape[0]):
        fill_normals(stream, cloud[row])
        for i in range(cloud.shape[1]):
            cloud[row, i] = mean[row] + sigma[row] * cloud[row, i]
    logw[:] = 0.0
