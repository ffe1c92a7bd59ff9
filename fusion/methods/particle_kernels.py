"""Compiled loops of the particle method: one pass per block of particles, parallel over blocks.

The cloud is an array (9, n): ax vx x ay vy y az vz z in rows. Two passes touch it at each epoch. The first
predicts and weighs by GNSS, acceleration and pitch, and gathers what the map match needs; the second weighs
by map and terrain, and gathers the estimate. Between them one resampling gather, when it is due. Sums are
kept per block and added in block order, so results do not depend on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from fusion.compiled import compiled, compiled_parallel
from fusion.filters.random import Stream, fill_normals, seed_stream
from fusion.types import Floats, Ints

BLOCK = 2048

# Rows of the cloud, equations (2.1)-(2.6).
AX, VX, X, AY, VY, Y, AZ, VZ, Z = range(9)
STATES = 9

# Columns of the first pass's sums.
A_LOGMAX, A_W, A_X, A_Y, A_T, A_XX, A_YY, A_TT, A_XY, A_XT, A_YT = range(11)
# Columns of the second pass's sums: the states' means stand at B_STATE + row.
B_LOGMAX, B_W, B_WW, B_COS, B_SIN, B_PITCH, B_PITCH2, B_XX, B_YY, B_ZZ, B_STATE = range(11)
B_COLUMNS = B_STATE + STATES


@compiled
def _wrap(
    angle: float,
) -> float:
    """Wrap a difference of two angles of (-pi, pi] back to that range."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    if angle <= -math.pi:
        return angle + 2.0 * math.pi
    return angle


@compiled
def _move_row(
    cloud: Floats,
    logw: Floats,
    row: int,
    lo: int,
    hi: int,
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
        for i in range(lo, hi):
            k = i - lo
            d = z - mean[k]
            logw[i] -= 0.5 * d * d * inv_predictive
            cloud[row, i] = mean[k] + gain * d + spread * normals[k]
        return
    spread = math.sqrt(q)
    for i in range(lo, hi):
        k = i - lo
        cloud[row, i] = mean[k] + spread * normals[k]
    if inv_var > 0.0:
        _weigh_row(cloud, logw, row, lo, hi, z, inv_var)


@compiled
def _weigh_row(
    cloud: Floats,
    logw: Floats,
    row: int,
    lo: int,
    hi: int,
    z: float,
    inv_var: float,
) -> None:
    """Gaussian correction whose h(X) is a state itself."""
    for i in range(lo, hi):
        d = z - cloud[row, i]
        logw[i] -= 0.5 * d * d * inv_var


@compiled
def _move_axis(
    cloud: Floats,
    logw: Floats,
    axis: int,
    lo: int,
    hi: int,
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
    a = 3 * axis
    v = a + 1
    u = a + 2
    # Position first, acceleration last: each row's mean needs the old values of those after it.
    for i in range(lo, hi):
        mean[i - lo] = cloud[u, i] + cloud[v, i] * dt + cloud[a, i] * half_dt2
    fill_normals(stream, normals)
    _move_row(cloud, logw, u, lo, hi, mean, q[2], z[u], inv_var[u], optimal, normals)
    for i in range(lo, hi):
        mean[i - lo] = cloud[v, i] + cloud[a, i] * dt
    fill_normals(stream, normals)
    _move_row(cloud, logw, v, lo, hi, mean, q[1], z[v], inv_var[v], optimal, normals)
    for i in range(lo, hi):
        mean[i - lo] = cloud[a, i]
    fill_normals(stream, normals)
    _move_row(cloud, logw, a, lo, hi, mean, q[0], z[a], inv_var[a], optimal, normals)


@compiled_parallel
def predict_and_weigh(
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

    ``angles`` (2, n) receives each particle's heading relative to ``ref[2]`` and its pitch; ``ref`` holds the
    point (x, y, heading) about which second moments are taken; ``sums`` (blocks, 11). ``dt`` below 0 leaves
    the dynamics out (the first epoch). ``q`` (3, 3) are process variances over ``dt`` by axis (east, north, up)
    and kind (acceleration, velocity, position).
    """
    n = cloud.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    cos_ref = math.cos(ref[2])
    sin_ref = math.sin(ref[2])
    for b in prange(blocks):
        lo = b * BLOCK
        hi = min(n, lo + BLOCK)
        if dt >= 0.0:
            stream = np.empty(4, np.uint64)
            seed_stream(seed, step, b, stream)
            mean = np.empty(hi - lo)
            normals = np.empty(hi - lo)
            for axis in range(3):
                _move_axis(
                    cloud,
                    logw,
                    axis,
                    lo,
                    hi,
                    dt,
                    half_dt2,
                    q[axis],
                    z,
                    inv_var,
                    optimal,
                    stream,
                    mean,
                    normals,
                )
        else:
            for state in range(STATES):
                if inv_var[state] > 0.0:
                    _weigh_row(cloud, logw, state, lo, hi, z[state], inv_var[state])
        top = -np.inf
        for i in range(lo, hi):
            vx = cloud[VX, i]
            vy = cloud[VY, i]
            angles[0, i] = math.atan2(cos_ref * vy - sin_ref * vx, cos_ref * vx + sin_ref * vy)
            alpha = math.atan(cloud[VZ, i] / math.sqrt(vx * vx + vy * vy + 1e-12))
            angles[1, i] = alpha
            logw[i] -= 0.5 * (pitch - alpha) * (pitch - alpha) * inv_var_pitch
            top = max(top, logw[i])
        s_w = s_x = s_y = s_t = s_xx = s_yy = s_tt = s_xy = s_xt = s_yt = 0.0
        for i in range(lo, hi):
            w = math.exp(logw[i] - top)
            x = cloud[X, i] - ref[0]
            y = cloud[Y, i] - ref[1]
            t = angles[0, i]
            s_w += w
            s_x += w * x
            s_y += w * y
            s_t += w * t
            s_xx += w * x * x
            s_yy += w * y * y
            s_tt += w * t * t
            s_xy += w * x * y
            s_xt += w * x * t
            s_yt += w * y * t
        row = sums[b]
        row[A_LOGMAX] = top
        row[A_W], row[A_X], row[A_Y], row[A_T] = s_w, s_x, s_y, s_t
        row[A_XX], row[A_YY], row[A_TT] = s_xx, s_yy, s_tt
        row[A_XY], row[A_XT], row[A_YT] = s_xy, s_xt, s_yt


@compiled_parallel
def weigh_and_estimate(
    cloud: Floats,
    logw: Floats,
    angles: Floats,
    sums: Floats,
    ref: Floats,
    road: Floats,
    inv_var_road: Floats,
    ground_m: float,
    antenna_m: float,
    inv_var_ground: float,
) -> None:
    """Second pass: map (2.13)-(2.15) and terrain (2.16)-(2.18) corrections; moments of the estimate.

    ``road`` is the matched (x, y, heading), ``inv_var_road`` its inverse variances (0 leaves out);
    ``ground_m`` the terrain's height under the vehicle, ``antenna_m`` the antenna's above it.
    """
    n = cloud.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    turn = _wrap(road[2] - ref[2])
    for b in prange(blocks):
        lo = b * BLOCK
        hi = min(n, lo + BLOCK)
        top = -np.inf
        for i in range(lo, hi):
            dx = road[0] - cloud[X, i]
            dy = road[1] - cloud[Y, i]
            dt = _wrap(angles[0, i] - turn)
            lift = antenna_m / math.cos(angles[1, i]) if inv_var_ground > 0.0 else 0.0
            dz = ground_m - (cloud[Z, i] - lift)
            logw[i] -= 0.5 * (
                dx * dx * inv_var_road[0]
                + dy * dy * inv_var_road[1]
                + dt * dt * inv_var_road[2]
                + dz * dz * inv_var_ground
            )
            top = max(top, logw[i])
        row = sums[b]
        row[:] = 0.0
        row[B_LOGMAX] = top
        for i in range(lo, hi):
            w = math.exp(logw[i] - top)
            x = cloud[X, i] - ref[0]
            y = cloud[Y, i] - ref[1]
            z = cloud[Z, i] - ref[3]
            row[B_W] += w
            row[B_WW] += w * w
            row[B_COS] += w * math.cos(angles[0, i])
            row[B_SIN] += w * math.sin(angles[0, i])
            row[B_PITCH] += w * angles[1, i]
            row[B_PITCH2] += w * angles[1, i] * angles[1, i]
            row[B_XX] += w * x * x
            row[B_YY] += w * y * y
            row[B_ZZ] += w * z * z
            row[B_STATE + X] += w * x
            row[B_STATE + Y] += w * y
            row[B_STATE + Z] += w * z
            for k in (AX, VX, AY, VY, AZ, VZ):
                row[B_STATE + k] += w * cloud[k, i]


@compiled
def merge_sums(
    sums: Floats,
    squared: int,
    out: Floats,
) -> Floats:
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


@compiled_parallel
def normalised_weights(
    logw: Floats,
    top: float,
    total: float,
    out: Floats,
) -> None:
    """Weights that sum to 1 from log weights, their maximum and their sum on its scale."""
    for i in prange(logw.shape[0]):
        out[i] = math.exp(logw[i] - top) / total


@compiled_parallel
def gather(
    cloud: Floats,
    ancestors: Ints,
    out: Floats,
) -> None:
    """Replace the cloud by copies of its ancestors, into ``out``."""
    n = cloud.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    for b in prange(blocks):
        for row in range(cloud.shape[0]):
            for i in range(b * BLOCK, min(n, b * BLOCK + BLOCK)):
                out[row, i] = cloud[row, ancestors[i]]


@compiled_parallel
def draw_cloud(
    cloud: Floats,
    logw: Floats,
    seed: int,
    step: int,
    mean: Floats,
    sigma: Floats,
) -> None:
    """A new cloud around ``mean`` with standard deviations ``sigma`` (9,), all weights equal."""
    n = cloud.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    for b in prange(blocks):
        lo = b * BLOCK
        hi = min(n, lo + BLOCK)
        stream = np.empty(4, np.uint64)
        seed_stream(seed, step, b, stream)
        for row in range(cloud.shape[0]):
            fill_normals(stream, cloud[row, lo:hi])
            for i in range(lo, hi):
                cloud[row, i] = mean[row] + sigma[row] * cloud[row, i]
        logw[lo:hi] = 0.0
