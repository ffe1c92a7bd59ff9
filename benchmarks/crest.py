#!/usr/bin/env python3
"""A long segment over a crest that some drives leave early: what is said of the whole by those who saw a part.

    python benchmarks/crest.py [--seeds 5] [--grade 6] [--length 400] [--part 100] [--receiver m8] [--json FILE]

One segment of ``--length`` metres is a parabola whose grade goes from ``+grade`` % to ``-grade`` %, so that its true
slope is 0; a road leads up to it and away from it without a kink. Drives are simulated at 1 Hz and no elevation model
is there. Some end after ``--part`` metres of the crest, where the mean grade is far from 0. The rows:

    part            one drive over the part
    whole           one drive over all of it
    3 parts + whole three drives over the part, then a whole one: they do not contradict each other
    3 wholes + part three whole drives, then one over the part

Printed are means over the seeds: the slope of the segment (its spread in brackets), its sigma, root mean square error
and the share of errors within 1.96 sigma; the share of the segment that was driven, where the result says it; of the
drives those that are accepted on the segment, and the share of seeds in which the odd one, named last, is thrown out.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accuracy.logs import Columns, rows_of, write_columns
from accuracy.scoring import TWO_SIDED_95, Row, rms, show_progress, text_table, write_json
from accuracy.streets import drive_along, make_street
from app.cli.fuse_files import Fusion
from fusion.errors import FusionError
from fusion.pipeline import parse_options
from fusion.registry import DEFAULT_METHOD
from fusion.simulate.receiver.profiles import RECEIVERS
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns

APPROACH_M = 150.0
CREST = 1
"""The crest's row among the three segments."""
PART, WHOLE = "part", "whole"
CASES = {
    "part": (PART,),
    "whole": (WHOLE,),
    "3 parts + whole": (PART, PART, PART, WHOLE),
    "3 wholes + part": (WHOLE, WHOLE, WHOLE, PART),
}
COLUMNS = {
    "drives": ("drives", ""),
    "slope_percent": ("slope %", "+.2f"),
    "slope_spread": ("(spread)", ".2f"),
    "sigma_percent": ("sigma %", ".2f"),
    "rmse_percent": ("RMSE %", ".2f"),
    "within_95": ("in 1.96s", ".0%"),
    "driven_share": ("driven share", ".2f"),
    "passes": ("passes", "d"),
    "accepted": ("accepted", ".1f"),
    "last_rejected": ("last thrown out", ".0%"),
}


def make_crest(length_m: float, grade: float) -> Town:
    """Three segments in a row eastwards: up at a constant grade, over the crest, down at a constant grade."""
    east = np.cumsum([0.0, APPROACH_M, length_m, APPROACH_M])
    height = 200.0 + grade * APPROACH_M * np.array([0.0, 1.0, 1.0, 0.0])
    return make_street(east, height, grade * np.array([1.0, 1.0, -1.0, -1.0]))


def drive_over(town: Town, seed: int, receiver: str, part_m: float | None) -> Columns:
    """The log of a drive over the crest, to its end or over its first ``part_m`` only."""
    drive = drive_along(town, seed, receiver)
    columns, at = csv_columns(drive), drive.truth
    if part_m is None:
        return columns
    return rows_of(columns, (at.segment < CREST) | ((at.segment == CREST) & (at.distance_m <= part_m)))


@dataclass(frozen=True)
class Bench:
    """The road, and what drives over it are made with."""

    town: Town
    args: Namespace
    folder: Path

    def row(self, name: str) -> Row:
        """The figures of one case."""
        kinds = CASES[name]
        found = []
        for seed in range(self.args.seeds):
            show_progress(f"{name}: {seed + 1}/{self.args.seeds}")
            found.append(
                self.outcome([self.log(len(CASES) * 10 * seed + k, kind) for k, kind in enumerate(kinds)])
            )
        known = [one for one in found if one["slope_percent"] is not None]
        row: Row = {"drives": name, "passes": len(kinds), "runs": found}
        if not known:
            return row
        slope, sigma = (np.array([one[c] for one in known]) for c in ("slope_percent", "sigma_percent"))
        error = slope - self.town.true_slope_percent[CREST]
        shares = [one["driven_share"] for one in known if one["driven_share"] is not None]
        return row | {
            "slope_percent": float(slope.mean()),
            "slope_spread": float(slope.std()),
            "sigma_percent": float(sigma.mean()),
            "rmse_percent": rms(error),
            "within_95": float(np.mean(np.abs(error) <= TWO_SIDED_95 * sigma)),
            "driven_share": float(np.mean(shares)) if shares else None,
            "accepted": float(np.mean([one["accepted"] for one in known])),
            "last_rejected": float(np.mean([one["last_rejected"] for one in known]))
            if len(kinds) > 1
            else None,
        }

    def log(self, seed: int, kind: str) -> Path:
        """A drive as a file."""
        part_m = self.args.part if kind == PART else None
        columns = drive_over(self.town, seed, self.args.receiver, part_m)
        return write_columns(columns, self.folder / f"{kind}_{seed}.csv")

    def outcome(self, logs: list[Path]) -> Row:
        """What is said of the crest by drives together."""
        fusion = Fusion(self.args.method, parse_options(self.args.method), self.town.roads, None)
        for log in logs:
            fusion.add(log)
        together = fusion.solve()
        crest = int(self.town.roads.from_node[CREST])
        feature = next((f for f in together.features if f.from_node == crest), None)
        return {
            "slope_percent": feature and feature.slope_percent,
            "sigma_percent": feature and feature.slope_sigma_percent,
            "driven_share": getattr(feature, "driven_share", None),
            "accepted": feature.drives if feature else 0,
            # Counted over all segments; on the others a drive has no cause to contradict the rest.
            "last_rejected": together.rejected[-1] > 0,
        }


def run(args: Namespace) -> list[Row]:
    """Every case."""
    town = make_crest(args.length, args.grade / 100)
    with tempfile.TemporaryDirectory() as folder:
        rows = [Bench(town, args, Path(folder)).row(name) for name in CASES]
    show_progress("")
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument(
        "--grade", type=float, default=6.0, help="where the crest begins, percent (default 6)"
    )
    parser.add_argument("--length", type=float, default=400.0, help="of the crest, m (default 400)")
    parser.add_argument("--part", type=float, default=100.0, help="where some drives end, m (default 100)")
    parser.add_argument("--receiver", default="m8", choices=tuple(RECEIVERS))
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    try:
        rows = run(args)
    except FusionError as error:
        sys.exit(str(error))
    print(text_table(rows, COLUMNS))
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
