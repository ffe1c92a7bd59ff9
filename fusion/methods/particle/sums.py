"""What the sums of the particle cloud's blocks say of the whole of it."""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.methods.nine_state.motion import STATES, X, Y, Z
from fusion.methods.particle.layout import (
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
    B_COS,
    B_LOGMAX,
    B_PITCH,
    B_PITCH2,
    B_SIN,
    B_STATE,
    B_W,
    B_WLOGW,
    B_WW,
    B_XX,
    B_YY,
    B_ZZ,
)
from fusion.types import Floats

_NONE = -1


@compiled
def _merged(sums: Floats, squares: int, logs: int) -> Floats:
    """The blocks' sums (blocks, columns) added in block order on the scale of the greatest log weight, column 0.

    Column ``squares`` holds w^2 and scales with the square, column ``logs`` w log w (``_NONE``: there is none).
    """
    blocks, columns = sums.shape
    top = -np.inf
    for b in range(blocks):
        top = max(top, sums[b, 0])
    total = np.zeros(columns)
    for b in range(blocks):
        below = sums[b, 0] - top
        scale = math.exp(below)
        for c in range(1, columns):
            total[c] += (scale * scale if c == squares else scale) * sums[b, c]
        if logs != _NONE:
            total[logs] += scale * below * sums[b, B_W]
    total[0] = top
    return total


@compiled
def predicted_map(sums: Floats, origin: Floats, heading: float) -> tuple[float, float, float, Floats]:
    """Zhat (2.26), x, y and heading, and its covariance (2.30), shape (3, 3), from the first pass's sums."""
    total = _merged(sums, _NONE, _NONE)
    total /= total[A_W]
    x, y, t = total[A_X], total[A_Y], total[A_T]
    xx, yy, tt = total[A_XX] - x * x, total[A_YY] - y * y, total[A_TT] - t * t
    xy, xt, yt = total[A_XY] - x * y, total[A_XT] - x * t, total[A_YT] - y * t
    covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
    turned = (heading + t + math.pi) % (2.0 * math.pi) - math.pi
    return origin[X] + x, origin[Y] + y, turned, covariance


@compiled
def weights_summary(sums: Floats, particles: int) -> tuple[float, float, float, float]:
    """Greatest log weight, sum of weights on its scale, N_eff (1.50) and entropy S_w (1.49), from the second pass."""
    total = _merged(sums, B_WW, B_WLOGW)
    w = total[B_W]
    entropy = math.log(particles) + total[B_WLOGW] / w - math.log(w)
    return total[B_LOGMAX], w, w * w / total[B_WW], entropy


@compiled
def _spread(square: float, mean: float) -> float:
    return max(square - mean * mean, 0.0)


@compiled
def state_summary(sums: Floats, origin: Floats) -> tuple[Floats, float, float, float, float, float]:
    """State (9,), heading, pitch and its sigma, horizontal and vertical sigma, from the second pass's sums."""
    total = _merged(sums, B_WW, B_WLOGW)
    total /= total[B_W]
    mean = total[B_STATE:]
    xx, yy = _spread(total[B_XX], mean[X]), _spread(total[B_YY], mean[Y])
    pitch = total[B_PITCH]
    state = np.empty(STATES)
    for k in range(STATES):
        state[k] = origin[k] + mean[k]
    return (
        state,
        math.atan2(total[B_SIN], total[B_COS]),
        pitch,
        math.sqrt(_spread(total[B_PITCH2], pitch)),
        math.sqrt(xx + yy),
        math.sqrt(_spread(total[B_ZZ], mean[Z])),
    )
