"""Samples brought to a common rate."""

from __future__ import annotations

import numpy as np

from fusion.types import Floats, Ints


def binned(time: Floats, period_s: float, *columns: Floats) -> tuple[Floats, ...]:
    """Means of columns over slots of ``period_s``, at their mean times; columns as given where they are sparser."""
    known = np.all(np.isfinite(columns), axis=0)
    time, values = time[known], [c[known] for c in columns]
    if len(time) < 2 or np.median(np.diff(time)) >= 0.95 * period_s:
        return (time, *values)
    slot = np.floor((time - time[0]) / period_s + 1e-6).astype(np.int64)
    _, start, count = np.unique(slot, return_index=True, return_counts=True)
    return tuple(np.add.reduceat(c, start) / count for c in (time, *values))


def spaced(time: Floats, period_s: float) -> Ints:
    """Indices of times at least ``period_s`` apart, the first included."""
    keep, last = [], -np.inf
    for k, t in enumerate(time.tolist()):
        if t - last >= period_s:
            keep.append(k)
            last = t
    return np.array(keep, np.int64)
