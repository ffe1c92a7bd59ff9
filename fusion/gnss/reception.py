"""How a satellite's signal arrives: blocked, in line of sight, or by a reflection alone (Viandier 2011, 3.2.1.4, 4.2).

A threshold on C/N0 decides at once; a chain of three states, whose transitions are counted anew over a window that
ends with the epoch, smooths the decisions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.measurements import Measurements
from fusion.types import Floats, Ints

BLOCKED, LOS, NLOS = range(3)
"""The thesis's numbers of the states."""

THRESHOLDS_DBHZ = {"polarx2": 42.0, "u-blox": 40.0}
"""From where on a signal is taken for direct, by receiver (p. 87; p. 115)."""

WINDOW_S = 40.0
"""Longer than a large obstacle takes to appear and to go again at 30 to 50 km/h (p. 134)."""
PSEUDO_COUNT = 1.0
"""Added to each count of transitions: a state that was not met in the window has no row else (Laplace's rule)."""

_OPEN_SKY_DEG = np.array([0.0, 18.0, 59.0, 90.0])
_OPEN_SKY_DBHZ = np.array([41.25, 42.32, 48.95, 49.7])


class Reception(NamedTuple):
    """Probabilities (t, 3) of the states by epoch, and the most probable state (t,)."""

    probability: Floats
    state: Ints


def open_sky_dbhz(elevation_rad: Floats) -> Floats:
    """The mean C/N0 of a satellite under open sky by elevation, any shape: the three segments of Table 3.2."""
    return np.asarray(np.interp(np.degrees(elevation_rad), _OPEN_SKY_DEG, _OPEN_SKY_DBHZ))


def states_by_threshold(cn0_dbhz: Floats, threshold_dbhz: float | Floats) -> Ints:
    """The state of each C/N0, any shape: blocked where it is NaN, in line of sight from the threshold on."""
    cn0_dbhz = np.asarray(cn0_dbhz, float)
    return np.where(np.isnan(cn0_dbhz), BLOCKED, np.where(cn0_dbhz >= threshold_dbhz, LOS, NLOS))


def states_by_epoch(measured: Measurements, threshold_dbhz: float | None) -> Ints:
    """The states (m, s) of all satellites, blocked where one is not measured.

    ``threshold_dbhz`` None takes the line of Table 3.2 at the satellite's elevation. Signals with a pseudorange and
    without a C/N0 count as reflected: they arrived, and nothing speaks for them.
    """
    limit = open_sky_dbhz(measured.elevation_rad) if threshold_dbhz is None else threshold_dbhz
    out = np.full((len(measured), len(measured.names)), BLOCKED)
    of_row = states_by_threshold(measured.cn0_dbhz, limit)
    out[measured.epoch, measured.satellite] = np.where(of_row == BLOCKED, NLOS, of_row)
    return out


def smoothed(
    states: Ints, time_s: Floats, window_s: float = WINDOW_S, pseudo_count: float = PSEUDO_COUNT
) -> Reception:
    """The chain of one satellite over its states (t,) at ``time_s`` (t,), increasing.

    At each epoch the transitions of the last ``window_s`` are counted, P_xy = N_xy / N_x (4.3), and the probabilities
    go on by them (4.7), from the shares in the first window (4.9). (4.7) prints M alpha for rows that sum to one:
    probabilities stay such with the transposed M. Of equally probable states, the one at hand is taken.
    """
    time_s = np.ascontiguousarray(time_s, np.float64)
    if not len(time_s):
        return Reception(np.empty((0, 3)), np.empty(0, np.int64))
    begin = np.searchsorted(time_s, time_s - window_s)
    first = states[: int(np.searchsorted(time_s, time_s[0] + window_s))]
    share = np.bincount(first, minlength=3) / len(first)
    return Reception(*_chain(np.ascontiguousarray(states, np.int64), begin, share, pseudo_count))


@compiled
def _chain(states: Ints, begin: Ints, share: Floats, pseudo_count: float) -> tuple[Floats, Ints]:
    n = len(states)
    probability, best = np.empty((n, 3)), np.empty(n, np.int64)
    counts = np.full((3, 3), pseudo_count)
    oldest = 0
    for t in range(n):
        if t > 0:
            counts[states[t - 1], states[t]] += 1.0
        while oldest < begin[t]:
            counts[states[oldest], states[oldest + 1]] -= 1.0
            oldest += 1
        for y in range(3):
            total = 0.0
            for x in range(3):
                total += share[x] * counts[x, y] / counts[x].sum()
            probability[t, y] = total
        share = probability[t]
        best[t] = states[t]
        for y in range(3):
            if share[y] > share[best[t]] * (1.0 + 1e-12):
                best[t] = y
    return probability, best
