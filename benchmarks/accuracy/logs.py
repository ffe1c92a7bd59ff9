"""Logs made poorer: fewer epochs, fewer sensors, stretches without any, a barometer instead of a receiver's heights.

Works on the columns of a Versant CSV, so that every benchmark thins and strips logs in the same way.
"""

from __future__ import annotations

import csv
from collections.abc import Collection
from pathlib import Path

import numpy as np

from fusion.types import Bools, Floats

Columns = dict[str, Floats]
"""A log by column, NaN where nothing was measured; ``time_s`` is one of them."""
POSITIONS = ("time_s", "lat_deg", "lon_deg", "h_acc_m")
ALTITUDES = ("alt_msl_m",)
BAROMETER_WHITE_M = 0.1
BAROMETER_DRIFT_M, BAROMETER_DRIFT_S = 0.5, 600.0
"""One sigma of what a barometer's height is off by after so long: a random walk, as weather and draughts make it."""
_DIGITS = {"time_s": 3, "lat_deg": 9, "lon_deg": 9}
_OTHER_DIGITS = 4
_SEA_LEVEL_HPA, _SCALE_M, _EXPONENT = 1013.25, 44_330.77, 1 / 0.190263
"""The standard atmosphere, by which pressures are made of heights."""


def read_columns(path: Path) -> Columns:
    """The columns of a CSV of numbers, empty cells NaN."""
    with path.open(newline="") as file:
        head, *rows = csv.reader(file)
    table = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows]).reshape(
        -1, len(head)
    )
    return {name: table[:, k] for k, name in enumerate(head)}


def write_columns(columns: Columns, path: Path) -> Path:
    """Write a Versant CSV; returns its path."""
    cells = [
        ["" if np.isnan(v) else f"{v:.{_DIGITS.get(name, _OTHER_DIGITS)}f}" for v in values]
        for name, values in columns.items()
    ]
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(columns)
        out.writerows(zip(*cells, strict=True))
    return path


def drop_columns(log: Path, names: Collection[str], path: Path) -> Path:
    """A CSV without some of its columns, cells as they are; returns the path of the copy."""
    with log.open(newline="") as file:
        head, *rows = csv.reader(file)
    keep = [k for k, name in enumerate(head) if name not in names]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([row[k] for k in keep] for row in (head, *rows))
    return path


def rows_of(columns: Columns, keep: Bools) -> Columns:
    """Some of the epochs."""
    return {name: values[keep] for name, values in columns.items()}


def only(columns: Columns, names: Collection[str]) -> Columns:
    """Some of the columns, where they are there."""
    return {name: values for name, values in columns.items() if name in names}


def thinned(columns: Columns, every_s: float) -> Columns:
    """The first epoch of every ``every_s``, as a device keeps them that records less often."""
    time_s = columns["time_s"]
    slot = np.floor((time_s - time_s[0]) / every_s + 1e-6)  # clocks in milliseconds, not exact multiples
    return rows_of(columns, np.diff(slot, prepend=-1.0) > 0)


def outside_blocks(
    time_s: Floats, share: float, lengths_s: tuple[float, float], rng: np.random.Generator
) -> Bools:
    """Which epochs are left when blocks, of lengths drawn between two, are taken out until ``share`` of all is gone.

    Blocks begin at random epochs and may meet; the last is cut short, so that the share is kept to an epoch.
    """
    keep = np.ones(len(time_s), bool)
    missing_rows = int(share * len(time_s))
    while (missing := missing_rows - int(np.count_nonzero(~keep))) > 0:
        begin = rng.choice(time_s[keep])
        block = keep & (time_s >= begin) & (time_s < begin + rng.uniform(*lengths_s))
        keep[np.flatnonzero(block)[:missing]] = False
    return keep


def drifting(time_s: Floats, height_m: Floats, rng: np.random.Generator | None) -> Floats:
    """The heights that a drifting barometer shows, of true ones; ``rng`` is the source of its noise, None: no noise."""
    if rng is None:
        return height_m
    step_s = np.diff(time_s, prepend=time_s[0])
    walk = rng.normal(size=len(step_s)) * BAROMETER_DRIFT_M * np.sqrt(step_s / BAROMETER_DRIFT_S)
    return height_m + np.cumsum(walk) + BAROMETER_WHITE_M * rng.normal(size=len(step_s))


def with_barometer(columns: Columns, height_m: Floats, rng: np.random.Generator | None) -> Columns:
    """The columns with the pressures that a drifting barometer shows at the true heights of their epochs."""
    shown_m = drifting(columns["time_s"], height_m, rng)
    return {**columns, "pressure_hpa": _SEA_LEVEL_HPA * (1 - shown_m / _SCALE_M) ** _EXPONENT}


def low_passed(time_s: Floats, values: Floats, tau_s: float) -> Floats:
    """A low-pass of the first order with a time constant; nothing is shown where nothing was measured."""
    out, state, last_s = np.full(len(values), np.nan), np.nan, np.nan
    for k in np.flatnonzero(np.isfinite(values)):
        decay = np.exp(-(time_s[k] - last_s) / tau_s) if np.isfinite(state) else 0.0
        state = values[k] if decay == 0.0 else decay * state + (1 - decay) * values[k]
        out[k], last_s = state, time_s[k]
    return out
