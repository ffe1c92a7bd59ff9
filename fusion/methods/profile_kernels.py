"""The compiled loop that turns a pass's measurements into a factor."""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats, Ints


@compiled
def accumulate(  # noqa: C901 (one loop nest)
    information: Floats,
    vector: Floats,
    design: Floats,
    kind: Ints,
    value: Floats,
    variance: Floats,
    clock: Floats,
) -> None:
    """Add rows in the order of time, the last two unknowns drifting in between; then marginalise the last five.

    ``kind`` is 1 for rows that see the first drifting unknown, 2 for the second, 0 for neither; ``clock``
    (2, m) is the variance that each has moved by.
    """
    n = len(vector)
    last = np.full(2, np.nan)
    for i in range(len(value)):
        if kind[i] > 0:
            which = kind[i] - 1
            if np.isfinite(last[which]):
                _walk(information, vector, n - 2 + which, clock[which, i] - last[which])
            last[which] = clock[which, i]
        for a in range(n):
            if design[i, a] != 0.0:
                weight = design[i, a] / variance[i]
                vector[a] += weight * value[i]
                for b in range(n):
                    information[a, b] += weight * design[i, b]
    for gone in range(n - 1, n - 6, -1):
        pivot = information[gone, gone]
        if pivot > 0.0:
            for a in range(gone):
                share = information[a, gone] / pivot
                if share != 0.0:
                    vector[a] -= share * vector[gone]
                    for b in range(gone):
                        information[a, b] -= share * information[gone, b]


@compiled
def _walk(information: Floats, vector: Floats, e: int, variance: float) -> None:
    """Let unknown e take a random step: information about where it was before becomes weaker."""
    n = len(vector)
    pivot = information[e, e]
    left = 1.0 / (1.0 + variance * pivot)
    share = variance * left
    for a in range(n):
        if a != e and information[a, e] != 0.0:
            pull = share * information[a, e]
            vector[a] -= pull * vector[e]
            for b in range(n):
                if b != e:
                    information[a, b] -= pull * information[e, b]
    for a in range(n):
        if a != e:
            information[a, e] *= left
            information[e, a] = information[a, e]
    vector[e] *= left
    information[e, e] = pivot * left
