"""Whether two logs hold the same."""

from __future__ import annotations

import numpy as np

from fusion.signals import Signals
from fusion.types import DriveLog


def _signals(log: DriveLog) -> Signals:
    return log.raw.signals if log.raw is not None else Signals.empty()


def same(a: DriveLog, b: DriveLog) -> bool:
    """Whether tables and raw measurements are the same to the last bit."""
    if (a.raw is None) != (b.raw is None):
        return False
    return all(
        np.array_equal(x, getattr(_signals(b), name), equal_nan=True) for name, x in vars(_signals(a)).items()
    ) and all(
        np.array_equal(getattr(x, c), getattr(b.tables()[name], c), equal_nan=True)
        for name, x in a.tables().items()
        for c in ("time_s", *x.columns())
    )
