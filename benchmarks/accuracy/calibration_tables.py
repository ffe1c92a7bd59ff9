"""Tables of a simulation-based calibration: errors beside sigmas, uniformity of ranks, learned over true levels."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from accuracy.scoring import TWO_SIDED_95, Row, length_classes, rms, text_table
from fusion.types import Floats

ENOUGH, GOOD_SHARE = 300, (0.93, 0.97)
"""A cell of so many slopes is marked where the share within 1.96 sigma is outside of these."""
RANK_BINS = 20
LEVELS = {
    "roughness": None,
    "altitude_m": "altitude",
    "drift": "altitude",
    "doppler": "doppler",
    "pitch": "pitch",
    "force": "force",
    "wander": "pitch",
    "baro_m": "barometer",
    "baro_drift": "barometer",
}
"""The learned levels, and the sensor without which there is nothing to learn."""
COLUMNS = {
    "set": ("sensors", ""),
    "drives": ("drives", "d"),
    "length": ("length", ""),
    "slopes": ("slopes", "d"),
    "rmse_percent": ("RMSE %", ".3f"),
    "sigma_percent": ("sigma %", ".3f"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "mark": ("", ""),
}
RANK_COLUMNS = {
    "set": ("sensors", ""),
    "drives": ("drives", ""),
    "slopes": ("slopes", "d"),
    "chi_square": ("chi2(19)", ".1f"),
    "p": ("p", ".2g"),
    "draws": ("draws", "d"),
    "chi_square_of_one": ("chi2(19)", ".1f"),
    "p_of_one": ("p", ".2g"),
}


class Cell(NamedTuple):
    """What is pooled: a set of sensors and a number of drives."""

    sensors: str
    drives: int


@dataclass(frozen=True, eq=False)
class Draw:
    """The slopes of one solution beside the truth, one row a segment."""

    length_m: Floats
    true_percent: Floats
    slope_percent: Floats
    sigma_percent: Floats
    one: int
    """A row drawn at random"""

    @property
    def z(self) -> Floats:
        """Errors over sigma."""
        return (self.slope_percent - self.true_percent) / self.sigma_percent


class Ratio(NamedTuple):
    """A learned noise level over the true one."""

    sensors: str
    level: str
    value: float


def gaussian_scale(freedom: float) -> float:
    """The scale of Student's t that fits Gaussian noise of sigma 1 best: it has the largest expected likelihood."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)

    def excess(scale: float) -> float:
        square = (nodes / scale) ** 2
        return float(weights @ ((freedom + 1) * square / (freedom + square)) / weights.sum()) - 1

    return float(optimize.brentq(excess, 0.3, 1.0))


def cell_rows(cell: Cell, draws: Sequence[Draw]) -> list[Row]:
    """Figures of one cell by class of length, and of all lengths."""
    length, sigma = (np.concatenate([getattr(d, c) for d in draws]) for c in ("length_m", "sigma_percent"))
    z = np.concatenate([d.z for d in draws])
    classes = [*length_classes(length), ("all", np.ones(len(length), bool))]
    rows: list[Row] = []
    for name, inside in classes:
        if not inside.any():
            continue
        share = float(np.mean(np.abs(z[inside]) <= TWO_SIDED_95))
        marked = int(inside.sum()) >= ENOUGH
        row: Row = {"set": cell.sensors, "drives": cell.drives, "length": name, "slopes": int(inside.sum())}
        row |= {"rmse_percent": rms((z * sigma)[inside]), "sigma_percent": float(np.mean(sigma[inside]))}
        row |= {"within_95": share, "z_rms": rms(z[inside])}
        row["mark"] = "low" if marked and share < GOOD_SHARE[0] else ""
        row["mark"] = "high" if marked and share > GOOD_SHARE[1] else row["mark"]
        rows.append(row)
    return rows


def uniformity(z: Floats) -> tuple[float, float]:
    """Chi-square over ``RANK_BINS`` bins of the ranks of the truth, Phi(-z), and its p."""
    counts, _ = np.histogram(stats.norm.cdf(-z), RANK_BINS, (0.0, 1.0))
    tested = stats.chisquare(counts)
    return float(tested.statistic), float(tested.pvalue)


def rank_row(sensors: str, drives: str, draws: Sequence[Draw]) -> Row:
    """Whether ranks are uniform: of all slopes, and of one a draw."""
    all_z, one = np.concatenate([d.z for d in draws]), np.array([d.z[d.one] for d in draws])
    row: Row = {"set": sensors, "drives": drives, "slopes": len(all_z), "draws": len(one)}
    row["chi_square"], row["p"] = uniformity(all_z)
    row["chi_square_of_one"], row["p_of_one"] = uniformity(one)
    row["bins"] = np.histogram(stats.norm.cdf(-all_z), RANK_BINS, (0.0, 1.0))[0].tolist()
    return row


def rank_rows(draws: dict[Cell, list[Draw]]) -> list[Row]:
    """By set of sensors, by number of drives, and of everything."""
    by_set: dict[str, list[Draw]] = defaultdict(list)
    by_count: dict[int, list[Draw]] = defaultdict(list)
    for cell, of_cell in draws.items():
        by_set[cell.sensors] += of_cell
        by_count[cell.drives] += of_cell
    rows = [rank_row(name, "all", of_set) for name, of_set in by_set.items() if of_set]
    rows += [rank_row("every set", f"{count}", of_count) for count, of_count in by_count.items() if of_count]
    return [*rows, rank_row("every set", "all", [d for of_cell in draws.values() for d in of_cell])]


def level_rows(ratios: Sequence[Ratio], sets: Sequence[str]) -> list[Row]:
    """One row a level, with a cell for each set of sensors."""
    values = defaultdict(list)
    for ratio in ratios:
        values[ratio.level, ratio.sensors].append(np.log(ratio.value))
    order = {name: k for k, name in enumerate((*LEVELS, "1"))}
    labels = sorted({level for level, _ in values}, key=lambda s: (order[s.split(",")[0].split(" ")[0]], s))
    rows: list[Row] = []
    for label in labels:
        row: Row = {"level": label}
        for name in sets:
            logs = values.get((label, name))
            if logs:
                row["drives"] = len(logs)
                row[name] = f"{np.exp(np.mean(logs)):.2f} x{np.exp(np.std(logs)):.2f}"
        rows.append(row)
    return rows


def show(draws: dict[Cell, list[Draw]], ratios: Sequence[Ratio], sets: Sequence[str]) -> Row:
    """Print the tables; returns them."""
    cells = [row for cell, of_cell in draws.items() if of_cell for row in cell_rows(cell, of_cell)]
    ranks, levels = rank_rows(draws), level_rows(ratios, sets)
    print(text_table(cells, COLUMNS))
    print("\nUniformity of ranks: of all slopes, and of one slope a draw")
    print(text_table(ranks, RANK_COLUMNS))
    print("\nLearned over true noise levels: geometric mean x scatter")
    titles = {"level": ("level", ""), "drives": ("drives", "d"), **{name: (name, "") for name in sets}}
    print(text_table(levels, titles), flush=True)
    return {"slopes": cells, "ranks": ranks, "levels": levels}
