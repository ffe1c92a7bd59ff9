"""The rungs of a ladder of poor logs: what is left of a receiver's log when sensors are missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np

from accuracy.logs import (
    ALTITUDES,
    POSITIONS,
    Columns,
    drifting,
    low_passed,
    only,
    read_columns,
    thinned,
    with_barometer,
    write_columns,
)
from accuracy.sequences import NOISE_FREE, Sequence, make_log
from fusion.types import Floats


class Rung(NamedTuple):
    """The columns left of a log (None: all), what is done to its heights, and whether the tiles are there."""

    columns: tuple[str, ...] | None
    dem: bool = False
    barometer: bool = False
    altimeter: bool = False
    low_pass_s: float = 0.0


GPX = tuple(name for name in POSITIONS if name != "h_acc_m")
RUNGS = {
    "everything": Rung(None, dem=True),
    "barometer": Rung(POSITIONS, barometer=True),
    "altitude": Rung((*GPX, *ALTITUDES)),
    "altitude and SRTM": Rung((*GPX, *ALTITUDES), dem=True),
    "filtered altitude": Rung((*GPX, *ALTITUDES), low_pass_s=2.0),
    "altimeter": Rung((*GPX, *ALTITUDES), altimeter=True),
    "positions and SRTM": Rung(GPX, dem=True),
}


def poor_log(
    tool: ModuleType,
    sequence: Sequence,
    seed: int,
    folder: Path,
    rung: Rung,
    *,
    every_s: float | None = None,
    receiver: str = "m8",
) -> Path:
    """What a receiver recorded, with a rung's columns and heights; ``NOISE_FREE`` has exact ones. ``every_s`` None: as
    often as it was recorded. Each sequence and seed has one file in ``folder``, which the next rung overwrites.
    """
    full_log = make_log(tool, sequence, seed, folder, receiver)
    if rung.columns is None and every_s is None:
        return full_log
    columns = read_columns(full_log)
    left = columns if rung.columns is None else only(columns, rung.columns)
    if rung.barometer or rung.altimeter:
        exact_m = read_columns(make_log(tool, sequence, seed, folder, NOISE_FREE))["alt_msl_m"]
        rng = None if receiver == NOISE_FREE else np.random.default_rng([seed, 2])
        left = with_barometer(left, exact_m, rng) if rung.barometer else _with_altimeter(left, exact_m, rng)
    if rung.low_pass_s:
        left = {**left, "alt_msl_m": low_passed(left["time_s"], left["alt_msl_m"], rung.low_pass_s)}
    left = left if every_s is None else thinned(left, every_s)
    return write_columns(left, folder / f"poor_{sequence.name}_{seed}.csv")


def road_of(sequence: Sequence, rung: Rung) -> Sequence:
    """The sequence with its tiles, or without where a rung has none."""
    return sequence if rung.dem else replace(sequence, dem=None)


def _with_altimeter(columns: Columns, height_m: Floats, rng: np.random.Generator | None) -> Columns:
    """A bicycle computer's heights: FIT states them in fifths of a metre."""
    shown_m = drifting(columns["time_s"], height_m, rng)
    return {**columns, "alt_msl_m": np.round(5 * shown_m) / 5}
