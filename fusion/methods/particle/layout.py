"""How the particle cloud and its sums are laid out in arrays, for the kernels and those who call them.

The cloud is an array (blocks, CHUNK) of single precision. A chunk holds ``BLOCK`` particles in ``ROWS`` rows that lie
``ROW`` numbers apart: the nine states, then what one loop leaves for the next. So a block stays in a core's own cache
from its first loop to its last, and its parts lie at distances known at compile time, without which the loops could not
be turned into vector instructions. Positions count from an origin that keeps up with the vehicle: single precision
resolves them to a hundredth of a millimetre within 100 m of it.
"""

from __future__ import annotations

from fusion.methods.nine_state.motion import STATES

BLOCK = 2048
ROW = BLOCK + 16  # rows that lie a power of two apart would share few places in the cache
LOGW, TURN, PITCH = STATES, STATES + 1, STATES + 2
ROWS = STATES + 3
CHUNK = ROWS * ROW

# What the draw of one state needs: the measured value, the gain, the spread of the draw, and half the inverse variances
# by which the measurement weighs the particle before and after it is drawn.
D_Z, D_GAIN, D_SPREAD, D_BEFORE, D_AFTER = range(5)
D_COLUMNS = 5

# Columns of the first pass's sums, over x, y and heading.
A_LOGMAX, A_W, A_X, A_Y, A_T, A_XX, A_YY, A_TT, A_XY, A_XT, A_YT = range(11)
A_COLUMNS = 11
# Columns of the second pass's sums; B_WLOGW holds w log w, and the states' means stand at B_STATE + row.
B_LOGMAX, B_W, B_WW, B_WLOGW, B_COS, B_SIN, B_PITCH, B_PITCH2, B_XX, B_YY, B_ZZ, B_STATE = range(12)
B_COLUMNS = B_STATE + STATES


def blocks_of(particles: int) -> int:
    """Number of chunks that hold ``particles``."""
    return -(-particles // BLOCK)
