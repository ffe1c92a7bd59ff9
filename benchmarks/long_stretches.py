#!/usr/bin/env python3
"""Mean grades over about a kilometre from bicycle rides that know heights only, against heights by LiDAR.

    python benchmarks/long_stretches.py DATA_DIR [--rides 1-16] [--subsets 4] [--of 6] [--method NAME]
                                        [--stretches PATH] [--json FILE]

DATA_DIR is the folder ``storuman``, or the one that holds it: ``ride_XX.csv``, ``roads.osm`` and ``heights.csv``. The
rides are fused together as ``versant fuse`` does, and scored by the tool ``stretches.py`` (by default ``../tools``
beside the parent of the folder): RMSE and median of the absolute error of mean grades between neighbouring heights, of
the slopes added up along the way, and of the rides' own height differences, one by one, their mean and their median.
``--rides`` takes only some (``1-6,9``). Then the same of ``--subsets`` random sets of ``--of`` rides; the sets are the
same in every run.

``in 1.96s`` and ``z-rms`` are of the mean grades by the slopes: the share of errors within 1.96 sigma, and the root
mean square of error over sigma, of every stretch all of whose slopes are known (the tool leaves those out that no ride
passes as a whole). What a mean grade's sigma is, ``accuracy.stretches.grade_sigma_percent`` says. What the
rides' own repeats say of their sigmas is in them where there are ten rides or more (``fusion.network.repeats``).
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from accuracy.arguments import data_parser_of
from accuracy.scoring import TWO_SIDED_95, Row, rms, show_progress, text_table, write_json
from accuracy.sequences import (
    Slopes,
    folder_of,
    load_tool,
    quietly,
    slopes_among,
    tool_beside,
)
from accuracy.stretches import Stretch, find_stretches, grade_sigma_percent
from app.cli.logs.fusing import FusedLog, Fusion
from fusion.errors import FusionError
from fusion.pipeline import parse_options
from fusion.registry import DEFAULT_METHOD
from fusion.roads.osm import read_roads
from fusion.types import Floats

COLUMNS = {
    "rides": ("rides", ""),
    "stretches": ("stretches", "d"),
    "slopes_rmse": ("slopes RMSE %", ".3f"),
    "single_rmse": ("single", ".3f"),
    "mean_rmse": ("mean", ".3f"),
    "median_rmse": ("median", ".3f"),
    "slopes_median_abs": ("slopes |e| %", ".3f"),
    "single_median_abs": ("single", ".3f"),
    "mean_median_abs": ("mean", ".3f"),
    "median_median_abs": ("median", ".3f"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
}
FIGURES = tuple(name for name in COLUMNS if name not in ("rides", "within_95", "z_rms"))


@dataclass(frozen=True)
class Setup:
    """The rides, each fused by itself once, and what they are scored by."""

    folder: Path
    tool: ModuleType
    stretches: list[Stretch]
    fusion: Fusion
    rides: dict[int, FusedLog]

    def score(self, numbers: Sequence[int]) -> tuple[Row, Floats]:
        """The figures of some rides together, and errors over sigmas of the mean grades."""
        features = self._together(numbers).features()
        row = {"rides": ranges(numbers), **self._by_tool([f.geojson() for f in features], numbers)}
        errors = grade_errors(self.stretches, slopes_among(features))
        return row | coverage(errors), errors

    def _together(self, numbers: Sequence[int]) -> Fusion:
        together = Fusion(self.fusion.method, self.fusion.options, self.fusion.roads, None)
        together.fused = [self.rides[number] for number in numbers]
        return together

    def _by_tool(self, features: list[dict[str, object]], numbers: Sequence[int]) -> Row:
        with tempfile.TemporaryDirectory() as folder:
            slopes = Path(folder) / "slopes.geojson"
            slopes.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
            messages = quietly(
                self.tool.score,
                fix=str(self.folder / "heights.csv"),
                roads=str(self.folder / "roads.osm"),
                slopes=str(slopes),
                logs=[str(ride_file(self.folder, number)) for number in numbers],
            )
        return dict(json.loads(messages))


def grade_errors(stretches: Iterable[Stretch], slopes: Slopes) -> Floats:
    """Error over sigma of the mean grade of every stretch all of whose slopes are known."""
    graded = [(s, grade) for s in stretches if (grade := s.grade_percent(slopes)) is not None]
    errors = np.array([grade - s.true_grade_percent() for s, grade in graded])
    sigmas = np.array([grade_sigma_percent(s, slopes) for s, _ in graded])
    return np.asarray(errors / sigmas)


def coverage(z: Floats) -> Row:
    """Share within 1.96 sigma and root mean square of errors over sigmas."""
    if not len(z):
        return {"graded": 0, "within_95": None, "z_rms": None}
    return {"graded": len(z), "within_95": float(np.mean(np.abs(z) <= TWO_SIDED_95)), "z_rms": rms(z)}


def ride_file(folder: Path, number: int) -> Path:
    """The log of a ride."""
    return folder / f"ride_{number:02}.csv"


def parse_ranges(text: str) -> list[int]:
    """``1-3,7`` as 1, 2, 3, 7."""
    parts = [part.partition("-") for part in text.split(",")]
    return sorted({n for low, _, high in parts for n in range(int(low), int(high or low) + 1)})


def ranges(numbers: Sequence[int]) -> str:
    """1, 2, 3, 7 as ``1-3,7``."""
    starts = [n for n in numbers if n - 1 not in numbers]
    ends = [n for n in numbers if n + 1 not in numbers]
    return ",".join(f"{a}" if a == b else f"{a}-{b}" for a, b in zip(starts, ends, strict=True))


def subsets(numbers: Sequence[int], count: int, size: int) -> list[list[int]]:
    """Random sets of rides, ascending, the same in every run."""
    rng = np.random.default_rng(size)
    return [sorted(rng.choice(numbers, size, replace=False).tolist()) for _ in range(count)]


def prepare(folder: Path, tool: ModuleType, method: str, numbers: Sequence[int]) -> Setup:
    """Read and fuse every ride by itself."""
    fusion = Fusion(method, parse_options(method), read_roads(folder / "roads.osm"), None)
    rides = {}
    for number in numbers:
        show_progress(f"ride {number} of {numbers[-1]}")
        try:
            rides[number] = fusion.add(ride_file(folder, number))
        except FusionError as error:
            print(f"ride {number} is left out: {error}", file=sys.stderr)
    stretches = find_stretches(tool, folder / "heights.csv", folder / "roads.osm")
    return Setup(folder, tool, stretches, fusion, rides)


def run_subsets(setup: Setup, sets: Sequence[Sequence[int]]) -> list[Row]:
    """The figures of each set, then their means; shares within sigma pooled."""
    rows, every = [], []
    for number, rides in enumerate(sets, 1):
        show_progress(f"set {number}/{len(sets)}")
        row, errors = setup.score(rides)
        rows.append(row)
        every.append(errors)
    show_progress("")
    means = {name: float(np.mean([row[name] for row in rows if name in row])) for name in FIGURES}
    total = {"rides": "mean of sets", **means, "stretches": round(means["stretches"])}
    return [*rows, total | coverage(np.concatenate(every))]


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__, tool="stretches")
    parser.add_argument("--rides", type=parse_ranges, default=parse_ranges("1-16"), metavar="1-16")
    parser.add_argument(
        "--subsets", type=int, default=4, metavar="N", help="so many random sets of rides (default 4)"
    )
    parser.add_argument("--of", type=int, default=6, help="rides in each set (default 6)")
    parser.add_argument("--method", default=DEFAULT_METHOD)
    args = parser.parse_args()
    folder = folder_of(args.data_dir, "storuman")
    tool = load_tool(args.stretches or tool_beside(folder, "stretches.py"))
    setup = prepare(folder, tool, args.method, args.rides)
    show_progress("all rides together")
    rows = [setup.score(list(setup.rides))[0]]
    if args.subsets:
        rows += run_subsets(setup, subsets(list(setup.rides), args.subsets, args.of))
    show_progress("")
    print(text_table(rows, COLUMNS))
    better = sum(row["slopes_rmse"] < row["mean_rmse"] for row in rows[1:-1])
    if args.subsets:
        print(f"slopes are nearer than the mean of the same rides in {better} of {args.subsets} sets (RMSE)")
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
