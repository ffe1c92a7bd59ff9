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

from fusion.compiled import compiled, compiled_parallel, compiled_vector
from fusion.filters.random import Stream, fill_normals, seed_stream
from fusion.methods.fast_angles import fast_atan, fast_atan2
from fusion.types import Floats, Ints

BLOCK = 2048

# Rows of the cloud, equations (2.1)-(2.6).
AX, VX, X, AY, VY, Y, AZ, VZ, Z = range(9)
STATES = 9

# Columns of the first pass's sums.
A_LOGMAX, A_W, A_X, A_Y, A_T, A_XX, A_YY, A_TT, A_XY, A_XT, A_YT = range(11)
A_COLUMNS = 11
# Columns of the second pass's sums: the states' means stand at B_STATE + row.
B_LOGMAX, B_W, B_WW, B_COS, B_SIN, B_PITCH, B_PITCH2, B_XX, B_YY, B_ZZ, B_STATE = range(11)
B_COLUMNS = B_STATE + STATES


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
def _weights(logw: Floats, w: Floats) -> float:
    """Fill ``w`` with weights on the scale of the block's greatest, whose logarithm is returned."""
    top = -np.inf
    for i in range(len(logw)):
        top = max(top, logw[i])
    for i in range(len(logw)):
        w[i] = math.exp(logw[i] - top)
    return top


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
    point (x, y, heading, z) about which second moments are taken; ``sums`` (blocks, 11). ``dt`` below 0 leaves
    the dynamics out (the first epoch). ``q`` (3, 3) are process variances over ``dt`` by axis (east, north, up)
    and kind (acceleration, velocity, position).
    """
    n = cloud.shape[1]
    for b in prange((n + BLOCK - 1) // BLOCK):
        part = cloud[:, b * BLOCK : min(n, (b + 1) * BLOCK)]
        lw = logw[b * BLOCK : min(n, (b + 1) * BLOCK)]
        an = angles[:, b * BLOCK : min(n, (b + 1) * BLOCK)]
        w = np.empty(len(lw))
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
        sums[b, A_LOGMAX] = _weights(lw, w)
        _map_moments(part, w, an[0], ref, sums[b])


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
        lift = antenna_m * math.sqrt(1.0 + part[VZ, i] * part[VZ, i] / across2)
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
        row[B_LOGMAX] = _weights(lw, w)
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


@compiled_parallel
def gather(cloud: Floats, ancestors: Ints, out: Floats) -> None:
    """Replace the cloud by copies of its ancestors, into ``out``."""
    n = cloud.shape[1]
    for b in prange((n + BLOCK - 1) // BLOCK):
        for row in range(cloud.shape[0]):
            for i in range(b * BLOCK, min(n, b * BLOCK + BLOCK)):
                out[row, i] = cloud[row, ancestors[i]]


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
