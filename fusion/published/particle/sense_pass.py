"""First of the two compiled passes over the particles of an epoch: predict, and weigh by the vehicle's own sensors.

It is ``EpochFilter.sense``: dynamics, then GNSS, acceleration and pitch, and the moments that the map match starts
from. ``locate_pass`` follows with the matched road and the terrain. Blocks of particles (``layout``) go through the
whole pass in parallel, and sums are kept per block and added in block order, so results do not depend on the number of
threads. It knows neither the map nor the terrain.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from fusion.compiled import compiled, compiled_parallel, compiled_vector
from fusion.filters.random import LANE_WORDS, fill_normals, seed_lanes
from fusion.filters.single_precision import (
    LEAST_RANK,
    Single,
    Singles,
    atan2_single,
    exp_negative,
    from_rank,
    rank_of,
)
from fusion.published.nine_state.motion import STATES, VX, VY, VZ, X, Y
from fusion.published.particle.layout import BLOCK, CHUNK, LOGW, PITCH, ROW, TURN
from fusion.types import Floats, Ints

_ZERO, _TINY = Single(0.0), Single(1e-12)
# Places that are known not to be negative need no check of their sign.
_BLOCK, _CHUNK, _ROW = np.uint64(BLOCK), np.uint64(CHUNK), np.uint64(ROW)
_Law = tuple[Single, Single, Single, Single, Single]


@compiled
def draw_cloud(cloud: Singles, seed: int, step: int, mean: Floats, sigma: Floats) -> None:
    """A new cloud around ``mean`` (9,), from the origin, with deviations ``sigma`` (9,), all weights equal."""
    lanes = np.empty(LANE_WORDS, np.uint64)
    for b in range(cloud.shape[0]):
        seed_lanes(seed, step, b, lanes)
        for state in range(STATES):
            row = cloud[b, state * ROW : (state + 1) * ROW]
            fill_normals(lanes, row)
            for i in range(len(row)):
                row[i] = mean[state] + sigma[state] * row[i]
    cloud[:, LOGW * ROW :] = _ZERO


@compiled
def follow(state: Floats, dt: float, origin: Floats, moved: Floats) -> None:
    """Bring ``origin`` (9,) to where ``state`` (9,) will be after ``dt``; ``moved`` (9,) receives how far that is.

    Only positions count from the origin. It moves by numbers of single precision, so that particles lose nothing when
    that is taken off them.
    """
    for position in range(2, STATES, 3):
        moved[position] = Single(state[position] + state[position - 1] * dt - origin[position])
        origin[position] += moved[position]


@compiled_parallel
def predict_and_weigh(
    source: Singles,
    ancestors: Ints,
    cloud: Singles,
    n: int,
    sums: Floats,
    seed: int,
    step: int,
    dt: float,
    half_dt2: float,
    moved: Floats,
    origin: Floats,
    q: Floats,
    z: Floats,
    inv_var: Floats,
    optimal: bool,
    heading: float,
    pitch: float,
    inv_var_pitch: float,
    settle: float,
) -> None:
    """The sensing pass: dynamics, then GNSS, acceleration and pitch corrections; moments of (x, y, heading).

    ``cloud`` of ``n`` particles is moved in place; with ``ancestors`` (n,) it is first filled with copies of those
    particles of ``source``, with none (0,) it already holds them. ``origin`` (9,) is where positions count from and
    ``moved`` (9,) how far it went since the last epoch; ``heading`` is the direction that headings count from. ``q``
    (9,) are process variances over ``dt``, all 0 where nothing moves. ``settle`` is taken off all log weights.
    ``sums`` (blocks, A_COLUMNS) receives the moments, with weights on the scale of each block's greatest.
    """
    draws = _importance_density(q, z, inv_var, origin, optimal)
    for b in prange(cloud.shape[0]):
        chunk, begin = cloud[b], b * BLOCK
        m = min(n - begin, BLOCK)
        if len(ancestors) > 0:
            _inherit(source.reshape(source.size), ancestors[begin : begin + m], chunk)
        _move(chunk, m, seed, step, b, dt, half_dt2, moved, draws)
        top = _weigh_pitch(chunk, m, heading, pitch, inv_var_pitch, settle)
        _map_moments(chunk, m, top, sums[b])


@compiled
def _importance_density(q: Floats, z: Floats, inv_var: Floats, origin: Floats, optimal: bool) -> Singles:
    """How each state is drawn around its prediction and weighed by its measurement, shape (9, 5).

    With the transition as importance density (the thesis's SIR) the draw ignores the measurement and the weight is
    its likelihood. With the optimal one (Doucet 1998, closed here because noise and measurement are diagonal and
    Gaussian) the draw uses the measurement and the weight is its predictive density: the same posterior from a
    cloud that collapses far less. ``q`` (9,) are process variances; ``inv_var`` 0 leaves a measurement out.

    The columns are the measured value, the gain, the spread of the draw, and half the inverse variances by which the
    measurement weighs the particle before and after it is drawn.
    """
    draws = np.zeros((STATES, 5), np.float32)
    for k in range(STATES):
        measured = z[k] - origin[k] if inv_var[k] > 0.0 else 0.0
        gain = q[k] * inv_var[k] / (1.0 + q[k] * inv_var[k]) if optimal else 0.0
        before = 0.5 * inv_var[k] / (1.0 + q[k] * inv_var[k]) if optimal else 0.0
        after = 0.0 if optimal else 0.5 * inv_var[k]
        draws[k] = measured, gain, math.sqrt(q[k] * (1.0 - gain)), before, after
    return draws


@compiled_vector
def _inherit(source: Singles, ancestors: Ints, chunk: Singles) -> None:
    """Fill a block with copies of its ancestors, all of the same weight: resampling, done where it is needed next."""
    for i in range(min(len(ancestors), BLOCK)):
        ancestor = np.uint64(ancestors[i])
        place = ancestor // _BLOCK * _CHUNK + ancestor % _BLOCK
        for state in range(STATES):
            chunk[state * ROW + i] = source[place + np.uint64(state) * _ROW]
    chunk[LOGW * ROW :] = _ZERO


@compiled_vector
def _move(
    chunk: Singles,
    n: int,
    seed: int,
    step: int,
    block: int,
    dt: float,
    half_dt2: float,
    moved: Floats,
    draws: Singles,
) -> None:
    """The dynamics of a block, axis by axis, and the corrections by what measures the states themselves."""
    lanes, normals = np.empty(LANE_WORDS, np.uint64), np.empty(3 * BLOCK, np.float32)
    seed_lanes(seed, step, block, lanes)
    logw = chunk[LOGW * ROW :]
    for first in range(0, STATES, 3):
        for kind in range(3):
            fill_normals(lanes, normals[kind * BLOCK : kind * BLOCK + n])
        rows, shift = chunk[first * ROW : (first + 3) * ROW], Single(moved[first + 2])
        _move_axis(rows, logw, normals, n, Single(dt), Single(half_dt2), shift, draws[first : first + 3])


@compiled_vector
def _move_axis(
    rows: Singles,
    logw: Singles,
    normals: Singles,
    n: int,
    dt: Single,
    half_dt2: Single,
    shift: Single,
    draws: Singles,
) -> None:
    """(2.1)-(2.6) for one axis of a block, and its corrections.

    ``half_dt2`` is 0 in the printed form, dt^2/2 in the exact one; ``shift`` is how far the origin moved.
    """
    law_a, law_v, law_u = _law(draws, 0), _law(draws, 1), _law(draws, 2)
    for i in range(min(n, BLOCK)):
        a, v, u = rows[i], rows[ROW + i], rows[2 * ROW + i]
        new_a, lost_a = _draw(a, normals[i], *law_a)
        new_v, lost_v = _draw(v + a * dt, normals[BLOCK + i], *law_v)
        new_u, lost_u = _draw(u + v * dt + a * half_dt2 - shift, normals[2 * BLOCK + i], *law_u)
        rows[i], rows[ROW + i], rows[2 * ROW + i] = new_a, new_v, new_u
        logw[i] -= lost_a + lost_v + lost_u


@compiled_vector
def _law(draws: Singles, state: int) -> _Law:
    """One row of ``draws`` as scalars: elements of an array would be loaded anew for each particle."""
    row = draws[state]
    return row[0], row[1], row[2], row[3], row[4]


@compiled_vector
def _draw(
    mean: Single, normal: Single, z: Single, gain: Single, spread: Single, before: Single, after: Single
) -> tuple[Single, Single]:
    """A state drawn around its predicted ``mean``, and what its measurement takes off the log weight."""
    away = z - mean
    value = mean + gain * away + spread * normal
    missed = z - value
    return value, away * away * before + missed * missed * after


@compiled_vector
def _weigh_pitch(
    chunk: Singles, n: int, heading: float, pitch: float, inv_var: float, settle: float
) -> Single:
    """Heading relative to ``heading``, and pitch, of each particle; correct by the measured pitch (3.13).

    ``settle`` is taken off every log weight. Returns the greatest of them.
    """
    cos_ref, sin_ref = Single(math.cos(heading)), Single(math.sin(heading))
    measured, half_inv_var, off = Single(pitch), Single(0.5 * inv_var), Single(settle)
    top = LEAST_RANK
    for i in range(min(n, BLOCK)):
        vx, vy, vz = chunk[VX * ROW + i], chunk[VY * ROW + i], chunk[VZ * ROW + i]
        chunk[TURN * ROW + i] = atan2_single(cos_ref * vy - sin_ref * vx, cos_ref * vx + sin_ref * vy)
        alpha = atan2_single(vz, Single(math.sqrt(vx * vx + vy * vy + _TINY)))
        chunk[PITCH * ROW + i] = alpha
        missed = measured - alpha
        logw = chunk[LOGW * ROW + i] - off - missed * missed * half_inv_var
        chunk[LOGW * ROW + i] = logw
        top = max(top, rank_of(logw))
    return from_rank(top)


@compiled_vector
def _map_moments(chunk: Singles, n: int, top: Single, row: Floats) -> None:
    """Weighted first and second moments of x, y and heading, for (2.26) and (2.30), in ``layout``'s order."""
    s_w = s_x = s_y = s_t = s_xx = s_yy = s_tt = s_xy = s_xt = s_yt = _ZERO
    for i in range(min(n, BLOCK)):
        w = exp_negative(chunk[LOGW * ROW + i] - top)
        x, y, t = chunk[X * ROW + i], chunk[Y * ROW + i], chunk[TURN * ROW + i]
        wx, wy, wt = w * x, w * y, w * t
        s_w += w
        s_x += wx
        s_y += wy
        s_t += wt
        s_xx += wx * x
        s_yy += wy * y
        s_tt += wt * t
        s_xy += wx * y
        s_xt += wx * t
        s_yt += wy * t
    row[:] = top, s_w, s_x, s_y, s_t, s_xx, s_yy, s_tt, s_xy, s_xt, s_yt
