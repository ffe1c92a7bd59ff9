"""Repairs a receiver's clock that jumps, so that filters see a continuous one.

Many receivers let their clock drift and set it back by a whole millisecond when it is too far off: every pseudorange of
the epoch steps by n x 299 792 m, with the time tag or without. What the satellites' motion and a rough place explain is
taken off first; what then steps in all satellites alike is the clock. Its drift is taken from the steps around, each
less the nearest whole millisecond, so that a clock that jumps every few seconds, or at every epoch, is known as such,
and a fast but steady drift is no jump. A step that is no whole millisecond, or a gap over which the drift leaves the
milliseconds in doubt, is a new clock: its step is taken off as well as it is known, and the epoch is marked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from fusion.compiled import compiled
from fusion.signals import LIGHT_MPS
from fusion.types import Bools, Floats, Ints

STEP_M = 1e-3 * LIGHT_MPS
"""What receivers' clocks jump by, or by multiples of it."""

_NOISE_M = 200.0  # reflections and the rough place move the median of an epoch by less
_NOISE_MPS = 100.0  # by this the drift and the user's speed may differ from the minute around
_STRANGERS_M = 1_000.0  # more, where no satellite was seen before: biases between systems
_DOUBT_M = 0.25 * STEP_M  # above this, whole steps are not told apart
_SURE_S = 30.0  # over so short a time no oscillator drifts by half a millisecond (17 ppm)
_AROUND = 21  # intervals that the drift is the median of
_FEW = 3  # with fewer satellites one's reflection might pass for a new clock


@dataclass(frozen=True)
class ClockJumps:
    """``step_m`` (m,): what to take off the pseudoranges of each epoch. Counts of epochs where they change.

    ``anew`` (m,) marks epochs where the clock begins anew.
    """

    step_m: Floats
    jumps: int
    anew: Bools


def find_clock_jumps(gps_s: Floats, first: Ints, satellite: Ints, excess_m: Floats) -> ClockJumps:
    """Jumps of the clock in ``excess_m`` (n,): pseudoranges less the distances from a rough place.

    ``satellite`` numbers satellites from 0; rows of epoch k are ``first[k]:first[k + 1]``.
    """
    observed = np.flatnonzero(np.diff(first) > 0)
    step_m, anew = np.zeros(len(gps_s)), np.zeros(len(gps_s), bool)
    if len(observed) < 2:
        return ClockJumps(step_m, 0, anew)
    clock, spread, common = (np.empty(len(observed)) for _ in range(3))
    _follow(first, observed, satellite, excess_m, np.full(satellite.max() + 1, np.nan), clock, spread, common)
    dt, spread, common = np.diff(gps_s[observed]), spread[1:], common[1:]
    rest = np.diff(clock) - _drift_mps(np.diff(clock), dt) * dt
    steps = np.round(rest / STEP_M)
    tolerance = _NOISE_M + _NOISE_MPS * dt + np.where(common == 0, _STRANGERS_M, 0.0)
    alike = spread <= tolerance
    certain = tolerance < _DOUBT_M
    fits = np.abs(rest - steps * STEP_M) <= tolerance
    jump = alike & certain & fits & (steps != 0)
    new = ~certain | (alike & ~fits & ((common >= _FEW) | (common == 0)))
    change = np.where(jump, steps * STEP_M, np.where(new, rest, 0.0))
    step_m[observed[1:]] = change
    anew[observed[1:]] = new
    return ClockJumps(np.cumsum(step_m), int(np.count_nonzero(jump)), anew)


def _drift_mps(steps_m: Floats, dt: Floats) -> Floats:
    """The clock's drift over each interval, (k,): the median of those around, less whole milliseconds."""
    short = np.flatnonzero(dt <= _SURE_S)
    if not len(short):
        return np.zeros(len(dt))
    rates = (steps_m[short] - STEP_M * np.round(steps_m[short] / STEP_M)) / dt[short]
    return np.asarray(np.interp(np.arange(len(dt)), short, median_filter(rates, _AROUND, mode="nearest")))


@compiled
def _follow(
    first: Ints,
    observed: Ints,
    satellite: Ints,
    excess_m: Floats,
    offset: Floats,
    clock: Floats,
    spread: Floats,
    common: Floats,
) -> None:
    """The clock at each epoch that has rows, chained by each satellite's offset from it when last seen.

    ``offset`` (NaN: not seen yet) is filled; ``spread`` is the median of what satellites differ by, ``common`` how
    many of the epoch's were seen before.
    """
    for k in range(len(observed)):
        rows = np.arange(first[observed[k]], first[observed[k] + 1])
        says = excess_m[rows] - offset[satellite[rows]]
        says = says[np.isfinite(says)]
        common[k] = len(says)
        if len(says) == 0:
            says = excess_m[rows]
        clock[k] = np.median(says)
        spread[k] = np.median(np.abs(says - clock[k]))
        offset[satellite[rows]] = excess_m[rows] - clock[k]
