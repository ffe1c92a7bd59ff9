"""Times as nearly all logs write them, ``2018-05-04T15:34:20.25Z``, read by the column instead of one by one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fusion.arrays import Floats

_WIDTH = 31
"""The longest such time with nine decimals, and one more, which must be empty."""
_DIGITS = (0, 1, 2, 3, 5, 6, 8, 9, 11, 12, 14, 15, 17, 18)
_SEPARATORS = ((4, "-"), (7, "-"), (10, "T"), (13, ":"), (16, ":"))
_YEARS = (1678, 2261)
"""Within what libraries count in nanoseconds; others are theirs to judge."""


def plain_seconds(texts: Sequence[str | None]) -> Floats:
    """Unix seconds (n,) to the microsecond; NaN for every text that is not exactly so, or no time of any day."""
    try:
        cells = np.array([text or "" for text in texts], dtype=f"S{_WIDTH}")
    except UnicodeEncodeError:
        return np.full(len(texts), np.nan)
    grid = cells.view(np.uint8).reshape(len(texts), _WIDTH)
    digit = grid[:, _DIGITS] - np.uint8(ord("0"))  # what is no digit wraps to more than 9
    plain = (digit <= 9).all(axis=1)
    for at, sign in _SEPARATORS:
        plain &= grid[:, at] == ord(sign)
    micros, ends_well = _fraction(grid)
    d = digit.astype(np.int64).T
    year, month, day = d[0] * 1000 + d[1] * 100 + d[2] * 10 + d[3], d[4] * 10 + d[5], d[6] * 10 + d[7]
    hour, minute, second = d[8] * 10 + d[9], d[10] * 10 + d[11], d[12] * 10 + d[13]
    plain &= ends_well & (year >= _YEARS[0]) & (year <= _YEARS[1]) & (month >= 1) & (month <= 12)
    months = np.where(plain, (year - 1970) * 12 + month - 1, 0)
    first, following = (
        m.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) for m in (months, months + 1)
    )
    plain &= (day >= 1) & (day <= following - first) & (hour < 24) & (minute < 60) & (second < 60)
    seconds = (first + day - 1) * 86400 + hour * 3600 + minute * 60 + second
    return np.where(plain, (seconds * 1_000_000 + micros) / 1e6, np.nan)


def _fraction(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Microseconds, and whether the text ends as it should: by Z, or by a point, digits and Z."""
    end = (grid == ord("Z")).argmax(axis=1)
    last = np.minimum(end + 1, _WIDTH - 1)
    ends_well = (end == 19) | ((end > 20) & (grid[:, 19] == ord(".")))
    ends_well &= grid[np.arange(len(grid)), last] == 0
    micros = np.zeros(len(grid), np.int64)
    for k, column in enumerate(range(20, _WIDTH - 2)):
        inside = column < end
        value = grid[:, column] - np.uint8(ord("0"))
        ends_well &= ~inside | (value <= 9)
        micros += np.where(inside, value.astype(np.int64) * (10 ** (5 - k) if k < 6 else 0), 0)
    return micros, ends_well


def unix_seconds(texts: Sequence[str | None]) -> Floats:
    """Unix seconds (n,) of RFC 3339 / ISO 8601 times; without offset taken as UTC; NaN where unreadable."""
    out = plain_seconds(texts)
    others = [(k, text) for k in np.flatnonzero(np.isnan(out)).tolist() if (text := texts[k]) is not None]
    if not others:
        return out
    import pandas as pd  # noqa: PLC0415 - it takes longer to load than most logs to read

    parsed = pd.to_datetime(
        pd.Series([text for _, text in others], dtype="object"), utc=True, format="ISO8601", errors="coerce"
    )
    micros = parsed.dt.tz_localize(None).to_numpy().astype("datetime64[us]")
    out[[k for k, _ in others]] = np.where(np.isnat(micros), np.nan, micros.astype(np.int64) / 1e6)
    return out
