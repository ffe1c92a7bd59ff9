"""What residuals say of satellites and of reception: how large they are, which law they follow, window by window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.gnss.measurements import Measurements, Solution
from fusion.gnss.reception import LOS, NLOS, THRESHOLDS_DBHZ, states_by_threshold
from fusion.published.positioning.laws import LEAST_SAMPLES, LawTest, law_tests, window_distances
from fusion.types import Bools, Floats, Ints

STATES = {LOS: "direct", NLOS: "reflected"}
WINDOWS = (120, 200, 240)
"""Samples of a window: Table 3.8."""
PAIRS = (("2 normals", "normal"), ("2 normals", "laplace"), ("normal", "laplace"))
"""Which law is compared with which, as in Table 3.8."""
MOST_SAMPLES = 4000
"""Residuals that laws are tested with; of more, so many, spread evenly: neighbours in time say little new."""
_MOST_WINDOWS = 40
"""Windows looked at of each satellite, spread evenly: a mixture is fitted in each."""


@dataclass(frozen=True)
class ResidualRow:
    """Residuals of a satellite or of a state: metres; ``spread_m`` is 1.4826 times the median distance from the median.

    ``nlos`` is the mean probability of having been reflected, by the solver; NaN where it says nothing.
    """

    name: str
    count: int
    mean_m: float
    median_m: float
    spread_m: float
    most_m: float
    cn0_dbhz: float
    nlos: float


@dataclass(frozen=True)
class WinRate:
    """Share of windows in which ``law`` is nearer than ``other``, over all satellites; NaN without any window."""

    window: int
    law: str
    other: str
    share: float


@dataclass(frozen=True)
class Study:
    """All that is found out about a solution's residuals; ``laws`` is empty with fewer than 20 residuals."""

    satellites: list[ResidualRow]
    states: list[ResidualRow]
    laws: list[LawTest]
    wins: list[WinRate]


def reception_states(measured: Measurements, solution: Solution) -> Ints:
    """The state of each row, (n,): by the solver's probability where it gives one, else by a C/N0 of 40 dB-Hz."""
    by_cn0 = states_by_threshold(measured.cn0_dbhz, THRESHOLDS_DBHZ["u-blox"])
    by_solver = np.where(solution.nlos > 0.5, NLOS, LOS)
    return np.where(np.isfinite(solution.nlos), by_solver, by_cn0)


def study(measured: Measurements, solution: Solution) -> Study:
    """Look at the residuals of a solution; rows without one are left out."""
    known = np.isfinite(solution.residual_m)
    state = reception_states(measured, solution)
    parts = {name: known & (measured.satellite == k) for k, name in enumerate(measured.names)}
    by_state = {name: known & (state == s) for s, name in STATES.items()}
    satellites, states = (
        [_row(name, measured, solution, rows) for name, rows in some.items() if rows.any()]
        for some in (parts, by_state)
    )
    residual = solution.residual_m[known]
    spread = np.unique(np.linspace(0, len(residual) - 1, MOST_SAMPLES).astype(np.int64))
    laws = law_tests(residual[spread]) if len(residual) >= LEAST_SAMPLES else []
    return Study(satellites, states, laws, _win_rates([solution.residual_m[rows] for rows in parts.values()]))


def _row(name: str, measured: Measurements, solution: Solution, rows: Bools) -> ResidualRow:
    residual = solution.residual_m[rows]
    median = float(np.median(residual))
    return ResidualRow(
        name=name,
        count=int(rows.sum()),
        mean_m=float(residual.mean()),
        median_m=median,
        spread_m=float(1.4826 * np.median(np.abs(residual - median))),
        most_m=float(np.abs(residual).max()),
        cn0_dbhz=_mean(measured.cn0_dbhz[rows]),
        nlos=_mean(solution.nlos[rows]),
    )


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _win_rates(series: list[Floats]) -> list[WinRate]:
    """Over the windows of all satellites together."""
    names = tuple(dict.fromkeys(name for pair in PAIRS for name in pair))
    out = []
    for window in WINDOWS:
        tests = [
            window_distances(s, window, names, max(1, (len(s) - window) // _MOST_WINDOWS)) for s in series
        ]
        distance = dict(zip(names, np.concatenate([np.empty((0, len(names))), *tests]).T, strict=True))
        for law, other in PAIRS:
            wins = distance[law] < distance[other]
            out.append(WinRate(window, law, other, float(wins.mean()) if len(wins) else float("nan")))
    return out
