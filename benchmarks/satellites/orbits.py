"""Satellites by broadcast ephemerides: beside an independent library, and beside precise products of the same time.

    PYTHONPATH=.:benchmarks python -m satellites.orbits DATA_DIR [--json FILE]

DATA_DIR holds navigation files (``brdc*``, ``BRDC*``), precise orbits (``*.SP3``) and clocks (``*.CLK``).

First table: every record of a file against pyrtklib, every 5 minutes, while it is valid and over a whole day each way
(GLONASS: while valid, since states are not meant to be carried farther). The goal is 1 m and 1 ns.

Second table: satellites of broadcast records that the program itself selects, at every epoch of a precise product that
any record is valid for. The goal is 3 m and 10 ns. What is compared:

- Precise places are the centres of mass, broadcast ones the antennas, which look at the earth 0.5 to 2.5 m nearer. No
  antenna file is used. ``3-D`` is the difference as it is; ``3-D'`` is without the system's median radial one, which is
  printed as ``radial``. What single satellites' antennas differ from the median by is left in it.
- Precise clocks are of the pair of signals that is free of the ionosphere, and so are broadcast ones of GPS (L1, L2)
  and Galileo (E1, E5a or E5b) without the group delay, which is therefore not taken off. GLONASS broadcasts the clock
  of L1: what it differs by from the pair is left in. Precise clocks are without relativity; -2 r v / c^2 is added.
- Time scales differ by an offset that users' own clocks absorb: the median over a system's satellites is taken off at
  each epoch. With two satellites that halves their difference; with one there is nothing left to compare.

``in 3 m`` is the share of the latter differences within the goal, ``worst`` the satellite of the largest, ``others``
the largest of all others. Where the library agrees to micrometres and a precise product does not, the broadcast itself
is off: uploads age, and single satellites go wrong.
Products without any record of their time are named below the tables.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyrtklib

from accuracy.arguments import data_parser_of
from accuracy.scoring import Row, rms, show_progress, text_table, write_json
from fusion.gnss.orbits.glonass import glonass_states
from fusion.gnss.orbits.kepler import kepler_states
from fusion.gnss.orbits.satellites import LIMIT_S, states_at
from fusion.signals import GLONASS, LIGHT_MPS, SYSTEMS, Navigation, satellite_name
from fusion.types import Floats, Ints
from satellites.library import glonass_records, kepler_records, library_state, navigation_of
from satellites.precise import Precise, read_clk, read_sp3

EVERY_S = 300.0
DAY_S = 86_400.0
FEWEST_OF_A_SYSTEM = 2
GOAL_M = 3.0
NS = 1e9
"""Nanoseconds a second."""
LIBRARY_COLUMNS = {
    "file": ("navigation", ""),
    "system": ("system", ""),
    "records": ("records", ""),
    "span": ("span", ""),
    "states": ("states", ""),
    "position_m": ("position max m", ".1e"),
    "clock_ns": ("clock max ns", ".1e"),
}
PRECISE_COLUMNS = {
    "file": ("precise product", ""),
    "system": ("system", ""),
    "satellites": ("satellites", ""),
    "epochs": ("epochs", ""),
    "rms_m": ("3-D rms m", ".2f"),
    "max_m": ("max m", ".2f"),
    "radial_m": ("radial m", ".2f"),
    "rms_level_m": ("3-D' rms m", ".2f"),
    "max_level_m": ("max m", ".2f"),
    "within_goal": ("in 3 m", ".1%"),
    "worst": ("worst", ""),
    "others_max_m": ("others m", ".2f"),
    "clock_rms_ns": ("clock rms ns", ".2f"),
    "clock_max_ns": ("max ns", ".2f"),
}


def beside_library(path: Path) -> list[Row]:
    """Rows of one navigation file: each system's worst differences."""
    navigation = navigation_of(path)
    kepler, moving = navigation.kepler, navigation.glonass
    rows: list[Row] = []
    for span in ("valid", "day"):
        worst: dict[int, list[Floats]] = {}
        for row, record in enumerate(kepler_records(path)):
            system = int(kepler.system[row])
            reach_s = DAY_S if span == "day" else LIMIT_S[system]
            gps_s = kepler.toe_s[row] + np.arange(-reach_s, reach_s + 1.0, EVERY_S)
            position, _, clock, _ = kepler_states(kepler, np.full(len(gps_s), row), gps_s)
            worst.setdefault(system, []).append(_apart(pyrtklib.eph2pos, record, gps_s, position, clock))
        for row, record in enumerate(glonass_records(path) if span == "valid" else ()):
            reach_s = LIMIT_S[GLONASS]
            gps_s = moving.toe_s[row] + np.arange(-reach_s, reach_s + 1.0, EVERY_S)
            position, _, clock, _ = glonass_states(moving, np.full(len(gps_s), row), gps_s)
            worst.setdefault(GLONASS, []).append(_apart(pyrtklib.geph2pos, record, gps_s, position, clock))
        rows += [_library_row(path, system, span, errors) for system, errors in sorted(worst.items())]
    return rows


def _library_row(path: Path, system: int, span: str, errors: list[Floats]) -> Row:
    apart = np.concatenate(errors, axis=1)
    return {
        "file": path.name,
        "system": SYSTEMS[system],
        "records": len(errors),
        "span": span,
        "states": apart.shape[1],
        "position_m": float(apart[0].max()),
        "clock_ns": float(apart[1].max()) * NS,
    }


def _apart(read: Callable[..., None], record: Any, gps_s: Floats, position: Floats, clock: Floats) -> Floats:
    """Differences of places (m) and clocks (s) from the library's, (2, n)."""
    theirs = [library_state(read, record, t) for t in gps_s]
    places = np.array([place for place, _ in theirs])
    return np.array(
        [np.linalg.norm(position - places, axis=1), np.abs(clock - np.array([lead for _, lead in theirs]))]
    )


def beside_precise(
    path: Path, clocks: dict[tuple[int, int, float], float], navigation: Navigation
) -> list[Row]:
    """Rows of one precise product, a system each; none where no record is of its time."""
    true = _with_clocks(read_sp3(path), clocks)
    without_delay = replace(
        navigation, kepler=replace(navigation.kepler, group_delay_s=np.zeros(len(navigation.kepler)))
    )
    computed = states_at(without_delay, true.system, true.number, true.gps_s)
    usable = computed.known & computed.healthy
    up = true.position_m / np.linalg.norm(true.position_m, axis=1, keepdims=True)
    apart = computed.position_m - true.position_m
    relativity = -2.0 * np.sum(computed.position_m * computed.velocity_mps, axis=1) / LIGHT_MPS**2
    clock = computed.clock_s - relativity - true.clock_s
    systems = np.unique(true.system[usable]).tolist()
    return [
        {
            "file": path.name,
            **_differences(true, np.flatnonzero(usable & (true.system == s)), apart, up, clock),
        }
        for s in systems
    ]


def _differences(true: Precise, some: Ints, apart: Floats, up: Floats, clock: Floats) -> Row:
    """The figures of a system's rows ``some``."""
    number, system = true.number[some], int(true.system[some[0]])
    error_m = np.linalg.norm(apart[some], axis=1)
    radial = np.sum(apart[some] * up[some], axis=1)
    level = np.linalg.norm(apart[some] - np.median(radial) * up[some], axis=1)
    left = (clock[some] - _median_by_epoch(clock[some], true.gps_s[some])) * NS
    left = left[np.isfinite(left)]
    worst = int(number[level.argmax()])
    return {
        "system": SYSTEMS[system],
        "satellites": len(np.unique(number)),
        "epochs": len(np.unique(true.gps_s[some])),
        "rms_m": rms(error_m),
        "max_m": float(error_m.max()),
        "radial_m": float(np.median(radial)),
        "rms_level_m": rms(level),
        "max_level_m": float(level.max()),
        "within_goal": float(np.mean(level <= GOAL_M)),
        "worst": satellite_name(system, worst),
        "others_max_m": float(level[number != worst].max(initial=0.0)),
        "clock_rms_ns": rms(left) if len(left) else None,
        "clock_max_ns": float(np.abs(left).max()) if len(left) else None,
    }


def _with_clocks(product: Precise, clocks: dict[tuple[int, int, float], float]) -> Precise:
    """With the clocks of clock files where they have them: those are finer than those of orbits."""
    keys = zip(product.system.tolist(), product.number.tolist(), product.gps_s.tolist(), strict=True)
    finer = np.array([clocks.get(key, np.nan) for key in keys])
    return replace(product, clock_s=np.where(np.isfinite(finer), finer, product.clock_s))


def _median_by_epoch(clock: Floats, gps_s: Floats) -> Floats:
    """The median of an epoch's clocks for each of them, NaN where there are too few."""
    out = np.full(len(clock), np.nan)
    for t in np.unique(gps_s):
        rows: Ints = np.flatnonzero((gps_s == t) & np.isfinite(clock))
        if len(rows) >= FEWEST_OF_A_SYSTEM:
            out[rows] = np.median(clock[rows])
    return out


def run(args: Namespace) -> tuple[list[Row], list[Row], list[str]]:
    """Rows beside the library, rows beside precise products, and products without any record of their time."""
    files = [path for path in sorted(args.data_dir.iterdir()) if path.name.lower().startswith("brdc")]
    if not files:
        sys.exit(f"{args.data_dir}: no navigation file (brdc*, BRDC*)")
    library: list[Row] = []
    for path in files:
        show_progress(path.name)
        library += beside_library(path)
    navigation = navigation_of(*files)
    clocks: dict[tuple[int, int, float], float] = {}
    for path in sorted(args.data_dir.glob("*.CLK")):
        clocks |= read_clk(path)
    precise: list[Row] = []
    alone = []
    for path in sorted(args.data_dir.glob("*.SP3")):
        show_progress(path.name)
        rows = beside_precise(path, clocks, navigation)
        precise += rows
        if not rows:
            alone.append(f"{path.name}: no navigation record is of the time of its epochs")
    show_progress("")
    return library, precise, alone


def main() -> None:
    """Parse the command line, run, print."""
    args = data_parser_of(__doc__).parse_args()
    library, precise, alone = run(args)
    print(text_table(library, LIBRARY_COLUMNS), end="\n\n")
    print(text_table(precise, PRECISE_COLUMNS))
    print("\n".join(alone))
    write_json(args.json, {"library": library, "precise": precise, "alone": alone})


if __name__ == "__main__":
    main()
