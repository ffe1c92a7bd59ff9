#!/usr/bin/env python3
"""Accuracy of road slopes against precise reference drives, beside the baselines in the same run.

    python benchmarks/slope_accuracy.py DATA_DIR [--method NAME] [--seeds N] [--profile m8|phone|f9p]
                                        [--cut 60:40] [--drives N[,N...]] [--sequences 09,10] [--option name=value]
                                        [--json FILE]

DATA_DIR holds sequences: ``ref_XX.csv`` (precise track) with ``truth_XX.csv`` (slope per segment), a road file
whose name contains XX, and DEM tiles (``*.hgt``, ``*.tif``) if there are any; or one real log, ``log.csv`` with
``roads.osm``, ``truth.csv`` and its precise track ``ref.csv`` (one of the two is enough). From each ``ref_XX.csv`` the
tool ``roadtruth.py`` (``--roadtruth PATH``, by default ``../tools`` beside DATA_DIR's parent) makes receiver logs, one
a seed. With ``--drives N`` each score is of N drives put together as ``versant fuse`` does, seeds s*N .. s*N+N-1;
several numbers give a block of tables each, and the baselines are run for the first of them. ``--sequences`` takes
only some.

For each sequence and method, means over the seeds (spread of the RMSE in brackets): RMSE, RMSE with segments weighted
by their length, and 90th percentile of |error| in percent of slope, coverage (share of truth segments with an
estimate), share of errors within 1.96 sigma and the root mean square of error over sigma (both pooled over the seeds),
share of wrong signs among true slopes steeper than 1 %. Sigma is that of estimate and truth together: where the
reference passed a segment more than once, its passes differ, on road 00 by 0.2 % (``accuracy.truth``). ``whole`` is of
the segments that it passed once and as a whole: there logs and truth hold the same heights. Then the RMSE's ratio to
the ``dem`` baseline (``raw`` where there is no DEM), and the RMSE of logs without noise: the same drives, as a receiver
records them that errs by millimetres (about as many drives as there are seeds, one set of N at least). The
rows ``all`` are means over the sequences, errors pooled. The second table has the method's errors of all sequences by
length of segment.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from accuracy.arguments import data_parser_of, numbers, plain_errors
from accuracy.scoring import (
    LENGTH_COLUMNS,
    Errors,
    Row,
    by_length,
    figures,
    show_progress,
    text_table,
    write_json,
)
from accuracy.sequences import (
    NOISE_FREE,
    RECEIVERS,
    Sequence,
    estimate,
    find_sequences,
    load_tool,
    make_log,
    tool_beside,
)
from fusion.registry import DEFAULT_METHOD

BASELINES = ("raw", "dem")
COLUMNS = {
    "sequence": ("sequence", ""),
    "method": ("method", ""),
    "rmse_percent": ("RMSE %", ".3f"),
    "rmse_spread": ("(spread)", ".3f"),
    "weighted_rmse_percent": ("per metre", ".3f"),
    "p90_percent": ("p90 %", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "whole_within_95": ("whole: in 1.96s", ".1%"),
    "wrong_sign": ("wrong", ".1%"),
    "ratio": ("ratio", ".2f"),
    "noise_free_rmse_percent": ("noise-free RMSE %", ".3f"),
}


@dataclass(frozen=True)
class Setup:
    """What does not change from one number of drives to the next."""

    args: Namespace
    tool: ModuleType | None
    folder: Path
    options: dict[str, str]

    def sets(self, sequence: Sequence, drives: int, noise_free: bool) -> int:
        """How many sets of drives are scored."""
        if noise_free:
            repeatable = self.tool is not None and sequence.reference is not None
            return max(1, self.args.seeds // drives) if repeatable else 0
        return self.args.seeds if sequence.log is None else 1

    def logs(self, sequence: Sequence, drives: int, number: int, profile: str) -> list[Path]:
        """The logs of one set."""
        count = drives if sequence.log is None or profile == NOISE_FREE else 1
        return [
            make_log(self.tool, sequence, number * count + k, self.folder, profile, self.args.cut)
            for k in range(count)
        ]

    def errors(self, sequence: Sequence, drives: int, methods: list[str]) -> dict[str, list[Errors]]:
        """Errors by method, one a set of drives; ``NOISE_FREE`` is the tested method on logs without noise."""
        errors: dict[str, list[Errors]] = {method: [] for method in (*methods, NOISE_FREE)}
        for name, of_name in errors.items():
            clean = name == NOISE_FREE
            method, profile = (self.args.method, NOISE_FREE) if clean else (name, self.args.profile)
            chosen = self.options if method == self.args.method else {}
            for number in range(count := self.sets(sequence, drives, clean)):
                show_progress(f"{sequence.name}, {drives} drive(s), {name}: {number + 1}/{count}")
                logs = self.logs(sequence, drives, number, profile)
                of_name.append(Errors.of(sequence.truth, estimate(sequence, logs, method, chosen)))
        show_progress("")
        return errors


def run(args: Namespace) -> list[Row]:
    """Score every sequence and method for every number of drives."""
    path = args.roadtruth or tool_beside(args.data_dir)
    # A real log with its truth can be scored without the tool, but for logs without noise.
    tool = load_tool(path) if path.exists() or any(args.data_dir.glob("ref_*.csv")) else None
    sequences = find_sequences(args.data_dir, tool, args.sequences)
    baselines = [m for m in BASELINES if m != args.method]
    rows: list[Row] = []
    base: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        setup = Setup(args, tool, Path(folder), dict(item.split("=", 1) for item in args.option))
        for drives in args.drives:
            methods = [args.method] if rows else [args.method, *baselines]
            errors = {s.name: setup.errors(s, drives, methods) for s in sequences}
            block = [row for name, of in errors.items() for row in summarise(name, {m: [of[m]] for m in of})]
            if len(errors) > 1:
                together = {m: [of[m] for of in errors.values()] for m in (*methods, NOISE_FREE)}
                block += summarise("all", together)
            base = base or base_of(block)
            block = [{"drives": drives, **row, "ratio": ratio(row, base)} for row in block]
            show(block, drives)
            rows += block
    return rows


def summarise(name: str, errors: dict[str, list[list[Errors]]]) -> list[Row]:
    """One row a method from its errors by sequence and set; methods that yielded nothing are left out.

    The first is the tested method: beside its figures stand those without noise, and those by length of segment.
    """
    runs = {method: list(map(list, zip(*parts, strict=False))) for method, parts in errors.items()}
    clean = figures(runs.pop(NOISE_FREE))
    rows = [
        {"sequence": name, "method": method, **scores}
        for method, of_method in runs.items()
        if (scores := figures(of_method)) is not None
    ]
    tested = next(iter(runs))
    for row in rows:
        if row["method"] == tested:
            parts = [
                Errors.pooled([e for of_sequence in errors[m] for e in of_sequence])
                for m in (tested, NOISE_FREE)
            ]
            row["noise_free_rmse_percent"] = clean["rmse_percent"] if clean else None
            row["by_length"] = by_length(*parts)
    return rows


def base_of(rows: list[Row]) -> dict[str, float]:
    """By sequence the RMSE of the baseline that others are compared with: the DEM's, else the raw altitudes'."""
    return {
        row["sequence"]: row["rmse_percent"] for m in BASELINES for row in rows if row["method"] == m
    }  # the later, the DEM, stays


def ratio(row: Row, base: dict[str, float]) -> float | None:
    """A row's RMSE over the baseline's."""
    return row["rmse_percent"] / base[row["sequence"]] if row["sequence"] in base else None


def show(rows: list[Row], drives: int) -> None:
    """The tables a person reads."""
    print(f"{drives} drive{'s' if drives > 1 else ''}")
    print(text_table(rows, COLUMNS))
    tested = [row for row in rows if "by_length" in row]
    if tested:
        print(f"\n{tested[-1]['method']}, {tested[-1]['sequence']}, by length of segment")
        print(text_table(tested[-1]["by_length"], LENGTH_COLUMNS), flush=True)
    print()


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--profile", default="m8", choices=RECEIVERS)
    parser.add_argument("--cut", action="append", metavar="START:LENGTH", help="seconds without GNSS")
    parser.add_argument("--drives", type=numbers, default=[1], metavar="N[,N...]", help="drives in each set")
    parser.add_argument("--sequences", help="only these, separated by commas")
    parser.add_argument(
        "--option", action="append", default=[], metavar="NAME=VALUE", help="option of the method"
    )
    args = parser.parse_args()
    with plain_errors():
        rows = run(args)
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
