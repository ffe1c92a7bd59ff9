"""How the particle cloud and its sums lie in arrays, and what the sums of all blocks say of the whole cloud.

The cloud is an array (blocks, CHUNK) of single precision. A chunk holds ``BLOCK`` particles in ``ROWS`` rows that lie
``ROW`` numbers apart: the nine states, then what one loop leaves for the next. So a block stays in a core's own cache
from its first loop to its last, and its parts lie at distances known at compile time, without which the loops could not
be turned into vector instructions. Positions count from an origin that keeps up with the vehicle: single precision
resolves them to a hundredth of a millimetre within 100 m of it.

Each of the two passes over the cloud (``sense_pass``, ``locate_pass``) leaves one row of sums a block, which are added
here in block order. How a sum comes about is theirs.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.published.nine_state.motion import STATES, X, Y, Z
from fusion.types import Floats

# Particles in a chunk of 99 kB; `benchmarks/particle_speed.py --profile N` shows the time of the loops over one.
BLOCK = 2048
ROW = BLOCK + 16  # rows that lie a power of two apart would share few places in the cache
LOGW, TURN, PITCH = STATES, STATES + 1, STATES + 2
ROWS = STATES + 3
CHUNK = ROWS * ROW

# Columns of the sensing pass's sums, over x, y and heading.
A_LOGMAX, A_W, A_X, A_Y, A_T, A_XX, A_YY, A_TT, A_XY, A_XT, A_YT = range(11)
A_COLUMNS = 11
# Columns of the locating pass's sums; B_WLOGW holds w log w, and the states' means stand at B_STATE + row.
B_LOGMAX, B_W, B_WW, B_WLOGW, B_COS, B_SIN, B_PITCH, B_PITCH2, B_XX, B_YY, B_ZZ, B_STATE = range(12)
B_COLUMNS = B_STATE + STATES

_NO_COLUMN = -1


def blocks_of(particles: int) -> int:
    """Number of chunks that hold ``particles``."""
    return -(-particles // BLOCK)


@compiled
def predicted_map(sums: Floats, origin: Floats, heading: float) -> tuple[float, float, float, Floats]:
    """Zhat (2.26), x, y and heading, and its covariance (2.30), shape (3, 3), from the sensing pass's sums."""
    total = _merged(sums, _NO_COLUMN, _NO_COLUMN)
    total /= total[A_W]
    x, y, t = total[A_X], total[A_Y], total[A_T]
    xx, yy, tt = total[A_XX] - x * x, total[A_YY] - y * y, total[A_TT] - t * t
    xy, xt, yt = total[A_XY] - x * y, total[A_XT] - x * t, total[A_YT] - y * t
    covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
    turned = (heading + t + math.pi) % (2.0 * math.pi) - math.pi
    return origin[X] + x, origin[Y] + y, turned, covariance


@compiled
def weights_summary(sums: Floats, particles: int) -> tuple[float, float, float, float]:
    """Greatest log weight, sum of weights on its scale, N_eff (1.50), entropy S_w (1.49): of the locating pass."""
    total = _merged(sums, B_WW, B_WLOGW)
    w = total[B_W]
    entropy = math.log(particles) + total[B_WLOGW] / w - math.log(w)
    return total[B_LOGMAX], w, w * w / total[B_WW], entropy


@compiled
def state_summary(sums: Floats, origin: Floats) -> tuple[Floats, float, float, float, float, float]:
    """State (9,), heading, pitch and its sigma, horizontal and vertical sigma, from the locating pass's sums."""
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


@compiled
def _merged(sums: Floats, squares: int, logs: int) -> Floats:
    """The blocks' sums (blocks, columns) added in block order on the scale of the greatest log weight, column 0.

    Column ``squares`` holds w^2 and scales with the square, column ``logs`` w log w (``_NO_COLUMN``: there is none).
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
        if logs != _NO_COLUMN:
            total[logs] += scale * below * sums[b, B_W]
    total[0] = top
    return total


@compiled
def _spread(square: float, mean: float) -> float:
    return max(square - mean * mean, 0.0)
