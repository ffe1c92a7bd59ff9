#!/usr/bin/env python3
"""Simulation-based calibration: do slopes err as their sigmas say, on data drawn from the very model?

    python benchmarks/calibration.py [--seeds 10] [--first 0] [--segments 24] [--drives 1,3,10,40]
                                     [--sets all,altitude only] [--lags] [--json FILE]

Each seed is a road (``accuracy.model_draws``): segments of random lengths, a grade that walks at random with random
roughness, changes of grade at plain nodes as ``fusion.network.joints`` believes in. As many drives as the largest
of ``--drives`` go over it, with exact positions and horizontal velocities and with sensors that err as method
``profile`` assumes, at random levels; half of them have Gaussian noise in pitch and force, half Student's t. For each
set of sensors each log goes through ``run_drive``, with the others switched off by the method's options, and groups of
drives through ``solve_network``; a draw is one such group, and a road gives ``GROUPS`` of each size at most.

What the network believes in beyond that and the data do not have: steps of height at nodes, and a lag of altimeters
of some seconds (``--lags`` draws lags from that belief). The network also adds an uncertainty for the map's place
along the road, which exact places do not have: it is SET TO 0 here (``exact_places``).

Printed for each set, number of drives and class of length: slopes, RMSE, mean stated sigma, share within 1.96 sigma and
the root mean square of error over sigma; ``low`` and ``high`` mark shares outside 93 to 97 % of at least 300 slopes.
Then whether the ranks Phi((true - slope) / sigma) are uniform: chi-square over 20 bins and its p, once of all slopes
(whose errors hang together within a draw, so that p is too small) and once of one random slope a draw. Last the noise
levels that drives learned over the true ones: geometric mean, and after the x the factor by which they scatter. The
method's white levels are scales of Student's t with 5 degrees of freedom, for which Gaussian noise of sigma 1 has
``GAUSSIAN_SCALE``; truths of Gaussian noise have been multiplied by that.
"""

from __future__ import annotations

import argparse
import contextlib
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from accuracy.model_draws import FREEDOM, DrawnDrive, DrawnRoad, draw_drive, draw_road
from accuracy.scoring import TWO_SIDED_95, Row, length_classes, rms, show_progress, text_table, write_json
from fusion.errors import FusionError
from fusion.methods.base import DriveResult
from fusion.network import adjust
from fusion.pipeline import run_drive, solve_network
from fusion.roads.table import rows_of
from fusion.types import Floats, Ints

SENSORS = ("altitude", "doppler", "pitch", "force", "barometer")
SENSOR_SETS: dict[str, tuple[str, ...]] = {
    "all": SENSORS,
    **{f"no {one}": tuple(s for s in SENSORS if s != one) for one in SENSORS},
    **{f"{one} only": (one,) for one in ("altitude", "barometer", "doppler")},
}
GROUPS = 4
"""So many draws of each number of drives a road gives at most."""
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


class _Fused(NamedTuple):
    rows: Ints
    result: DriveResult


@contextlib.contextmanager
def exact_places() -> Iterator[None]:
    """Within this the network takes places along the road for exact: it changes a constant of ``fusion.network``."""
    before = adjust.PLACE_SIGMA_M
    adjust.PLACE_SIGMA_M = 0.0
    try:
        yield
    finally:
        adjust.PLACE_SIGMA_M = before


def gaussian_scale(freedom: float) -> float:
    """The scale of Student's t that fits Gaussian noise of sigma 1 best: it has the largest expected likelihood."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)

    def excess(scale: float) -> float:
        square = (nodes / scale) ** 2
        return float(weights @ ((freedom + 1) * square / (freedom + square)) / weights.sum()) - 1

    return float(optimize.brentq(excess, 0.3, 1.0))


GAUSSIAN_SCALE = gaussian_scale(FREEDOM)


def run_seed(
    seed: int, segments: int, counts: Sequence[int], sets: Sequence[str], lags: bool
) -> tuple[dict[Cell, list[Draw]], list[Ratio]]:
    """All draws on the road of a seed, and what its drives learned."""
    rng = np.random.default_rng([seed, 1])
    road = draw_road(rng, segments)
    fleet_s = rng.normal(*adjust.LAG_MEAN_S) if lags else 0.0
    drives = [
        draw_drive(rng, road, k, rng.normal(fleet_s, adjust.LAG_SIGMA_S) if lags else 0.0)
        for k in range(max(counts))
    ]
    draws: dict[Cell, list[Draw]] = {}
    ratios: list[Ratio] = []
    for name in sets:
        options = {sensor: sensor in SENSOR_SETS[name] for sensor in SENSORS}
        fused = []
        for drive in drives:
            try:
                network, result = run_drive(drive.log, road.table, None, options=options)
            except FusionError:
                continue
            fused.append(_Fused(rows_of(road.table, network.table), result))
            ratios += _ratios(name, drive, result)
        for count in counts:
            groups = [fused[k : k + count] for k in range(0, len(fused) - count + 1, count)]
            draws[Cell(name, count)] = [_draw(road, group, rng) for group in groups[:GROUPS]]
    return draws, ratios


def _ratios(name: str, drive: DrawnDrive, result: DriveResult) -> list[Ratio]:
    out = []
    for level, sensor in LEVELS.items():
        if sensor is not None and sensor not in SENSOR_SETS[name]:
            continue
        true, label = drive.level(level), level
        if level not in ("roughness", "drift", "baro_drift"):
            heavy = drive.heavy and level in ("pitch", "force")
            true *= 1.0 if heavy else GAUSSIAN_SCALE
            label += " (t)" if heavy else ""
        label += f", {drive.rate_hz:g} Hz"
        out.append(Ratio(name, label, result.report["noise"][level] / true))
    return out


def _draw(road: DrawnRoad, fused: Sequence[_Fused], rng: np.random.Generator) -> Draw:
    parts = solve_network(road.table, None, fused).parts
    rows = np.array(sorted(parts), np.int64)
    found = np.array([(parts[r][0].slope_percent, parts[r][0].slope_sigma_percent) for r in rows.tolist()])
    return Draw(
        road.table.length_m[rows],
        road.slopes_percent()[rows],
        found[:, 0],
        found[:, 1],
        int(rng.integers(len(rows))),
    )


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
    every, one = np.concatenate([d.z for d in draws]), np.array([d.z[d.one] for d in draws])
    row: Row = {"set": sensors, "drives": drives, "slopes": len(every), "draws": len(one)}
    row["chi_square"], row["p"] = uniformity(every)
    row["chi_square_of_one"], row["p_of_one"] = uniformity(one)
    row["bins"] = np.histogram(stats.norm.cdf(-every), RANK_BINS, (0.0, 1.0))[0].tolist()
    return row


def rank_rows(draws: dict[Cell, list[Draw]]) -> list[Row]:
    """By set of sensors, by number of drives, and of everything."""
    by_set, by_count = defaultdict(list), defaultdict(list)
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
    order = {name: k for k, name in enumerate(LEVELS)}
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


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--segments", type=int, default=24, help="of each road")
    parser.add_argument("--drives", default="1,3,10,40", metavar="N[,N...]")
    parser.add_argument("--sets", default=",".join(SENSOR_SETS), help="only these, separated by commas")
    parser.add_argument("--lags", action="store_true", help="altimeters lag, as the network believes")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    counts, sets = [int(n) for n in args.drives.split(",")], args.sets.split(",")
    unknown = [name for name in sets if name not in SENSOR_SETS]
    if unknown:
        parser.error(f"no such sets of sensors: {', '.join(unknown)}; there are: {', '.join(SENSOR_SETS)}")
    draws: dict[Cell, list[Draw]] = {Cell(name, count): [] for name in sets for count in counts}
    ratios: list[Ratio] = []
    with exact_places():
        for seed in range(args.first, args.first + args.seeds):
            show_progress(f"seed {seed}")
            of_seed, learned = run_seed(seed, args.segments, counts, sets, args.lags)
            for cell, of_cell in of_seed.items():
                draws[cell] += of_cell
            ratios += learned
    show_progress("")
    write_json(args.json, show(draws, ratios, sets))


if __name__ == "__main__":
    main()
