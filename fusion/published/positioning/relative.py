"""Relative positioning as printed: a base's error of place is added to the rover's (Saadaoui 2011, 1.3.1).

The base knows its place and computes one from the satellites. What it is wrong by is taken for the rover's error too,
which holds as far as both use the same satellites. ``fusion.gnss.differential`` corrects each satellite instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.arrays import nearest
from fusion.gnss.differential import OLDEST_S
from fusion.gnss.measurements import Solution
from fusion.types import Floats


def relative_positions(
    rover: Solution, time_s: Floats, base: Solution, base_time_s: Floats, place_m: Floats
) -> Solution:
    """The rover's solution (m,) at ``time_s``, moved by what a base at ``place_m`` (3,) was wrong by then.

    Times are UTC Unix seconds, places ECEF. Epochs at which the base has no place within ``OLDEST_S`` are NaN.
    """
    known = base.solved
    if not known.any():
        return replace(rover, position_m=np.full(rover.position_m.shape, np.nan))
    then_s, error_m = base_time_s[known], place_m - base.position_m[known]
    apart_s = np.abs(then_s[nearest(then_s, time_s)] - time_s)
    moved = np.column_stack([np.interp(time_s, then_s, error_m[:, axis]) for axis in range(3)])
    moved[apart_s > OLDEST_S] = np.nan
    return replace(rover, position_m=rover.position_m + moved)
