"""RFC 3339 text to Unix seconds, in bulk."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from fusion.types import Floats


def unix_seconds(texts: Sequence[str | None]) -> Floats:
    """Unix seconds (n,) of RFC 3339 / ISO 8601 times; without offset taken as UTC; NaN where unreadable."""
    if not len(texts):
        return np.empty(0)
    parsed = pd.to_datetime(
        pd.Series(list(texts), dtype="object"), utc=True, format="ISO8601", errors="coerce"
    )
    micros = parsed.dt.tz_localize(None).to_numpy().astype("datetime64[us]")
    out = micros.astype(np.int64) / 1e6
    out[np.isnat(micros)] = np.nan
    return out
