"""Whether two logs hold the same."""

from __future__ import annotations

import numpy as np

from fusion.types import DriveLog


def same(a: DriveLog, b: DriveLog) -> bool:
    return all(
        np.array_equal(getattr(x, c), getattr(b.tables()[name], c), equal_nan=True)
        for name, x in a.tables().items()
        for c in ("time_s", *x.columns())
    )
