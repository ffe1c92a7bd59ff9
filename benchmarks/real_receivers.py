#!/usr/bin/env python3
"""Slopes from logs that real receivers recorded, whole and with a third of their epochs missing.

    python benchmarks/real_receivers.py DATA_DIR [--method NAME] [--seeds 5] [--json FILE]

DATA_DIR holds ``nagoya`` (single-point GNSS with Doppler between high buildings) and ``comma2k19`` (a receiver of the
M8 class, 58 s), or is one of them; each has ``log.csv``, ``roads.osm`` and the precise track ``ref.csv``, of which the
tool ``roadtruth.py`` makes the true slopes where there is no ``truth.csv``. Holes are blocks of 20 to 60 s that begin
at random, until a third of the log is gone, for each of ``--seeds``; only a log of ten minutes or more is treated so.

Printed for the method and for the baseline ``raw``: RMSE (with its spread over the seeds) and 90th percentile of
|error| in percent of slope, the share of the true slopes that have an estimate, the share of errors within 1.96 sigma,
the root mean square of error over sigma, the RMSE of taking 0 everywhere, and that of a log without noise with as many
holes. No constant of the library may be fitted to these logs: they are a check.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from accuracy.arguments import data_parser_of, plain_errors
from accuracy.logs import outside_blocks, read_columns, rows_of, write_columns
from accuracy.scoring import Errors, Row, figures, rms, show_progress, text_table, write_json
from accuracy.sequences import (
    NOISE_FREE,
    Sequence,
    estimate,
    find_sequences,
    folder_of,
    load_tool,
    make_log,
    tool_beside,
)
from fusion.registry import DEFAULT_METHOD

FOLDERS = ("nagoya", "comma2k19")
MISSING_SHARE = 1 / 3
BLOCKS_S = (20.0, 60.0)
LONG_S = 600.0
"""Shorter logs would lose a third of their epochs in a single hole."""
COLUMNS = {
    "sequence": ("log", ""),
    "epochs": ("epochs", ""),
    "method": ("method", ""),
    "rmse_percent": ("RMSE %", ".3f"),
    "rmse_spread": ("(spread)", ".3f"),
    "p90_percent": ("p90 %", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "flat_rmse_percent": ("RMSE of 0", ".3f"),
    "noise_free_rmse_percent": ("noise-free RMSE %", ".3f"),
}


@dataclass(frozen=True)
class Setup:
    """One recorded log, and the same drive without noise."""

    sequence: Sequence
    tool: ModuleType
    folder: Path

    def with_holes(self, log: Path, seed: int | None) -> Path:
        """A log without the epochs in the holes of a seed; whole where there is none."""
        if seed is None:
            return log
        columns = read_columns(log)
        keep = outside_blocks(columns["time_s"], MISSING_SHARE, BLOCKS_S, np.random.default_rng([seed, 1]))
        return write_columns(rows_of(columns, keep), self.folder / f"holes_{seed}_{log.name}")

    @property
    def log(self) -> Path:
        """The recorded log."""
        if self.sequence.log is None:
            raise ValueError(f"{self.sequence.name} is no recorded log")
        return self.sequence.log

    def errors(self, log: Path, method: str, seeds: list[int | None]) -> list[list[Errors]]:
        """Errors of a log, by seed of its holes."""
        rows = []
        for seed in seeds:
            show_progress(f"{self.sequence.name}, {method}, holes {seed}")
            path = self.with_holes(log, seed)
            rows.append([Errors.of(self.sequence.truth, estimate(self.sequence, [path], method))])
        return rows

    def rows(self, label: str, methods: list[str], seeds: list[int | None]) -> list[Row]:
        """A row a method; the first is the one that is tested."""
        log_without_noise = make_log(self.tool, self.sequence, 0, self.folder, NOISE_FREE)
        clean = figures(self.errors(log_without_noise, methods[0], seeds))
        flat = rms(np.array([true.slope_percent for true in self.sequence.truth.values()]))
        rows = []
        for method in methods:
            scores = figures(self.errors(self.log, method, seeds))
            if scores is not None:
                rows.append({"sequence": self.sequence.name, "epochs": label, "method": method, **scores})
        if rows and rows[0]["method"] == methods[0]:
            rows[0]["flat_rmse_percent"] = flat
            rows[0]["noise_free_rmse_percent"] = clean["rmse_percent"] if clean else None
        return rows


def run(args: Namespace) -> list[Row]:
    """Every log that is there, whole and with holes."""
    named = [args.data_dir] if args.data_dir.resolve().name in FOLDERS else None
    folders = named or [folder_of(args.data_dir, name) for name in FOLDERS]
    tool = load_tool(args.roadtruth or tool_beside(folders[0]))
    methods = [args.method, *(m for m in ("raw",) if m != args.method)]
    rows: list[Row] = []
    for folder in folders:
        with tempfile.TemporaryDirectory() as temporary:
            for sequence in find_sequences(folder, tool):
                setup = Setup(sequence, tool, Path(temporary))
                rows += setup.rows("all", methods, [None])
                if np.ptp(read_columns(setup.log)["time_s"]) >= LONG_S:
                    rows += setup.rows("two thirds", methods, list(range(args.seeds)))
    show_progress("")
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--seeds", type=int, default=5, help="draws of the holes (default 5)")
    args = parser.parse_args()
    with plain_errors():
        rows = run(args)
    print(text_table(rows, COLUMNS))
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
