#!/usr/bin/env python3
"""Clean logs against the same logs of which a tenth of the epochs is bad.

    python benchmarks/dirty_logs.py DATA_DIR [--sequences 00,05,08,09,10] [--profiles m8,phone] [--drives 1,10]
                                    [--sets 1] [--share 0.1] [--only TEXT] [--method NAME] [--json FILE]

DATA_DIR holds the folders ``karlsruhe``, on whose roads the tool ``roadtruth.py`` makes logs, and ``nagoya``, a real
receiver between high buildings, whose errors beyond four robust sigmas give the sizes of bad velocities and altitudes.
Where that is absent, these kinds are left out. Kinds of dirt, stated accuracies unchanged:

    Doppler             velocities, bursts of 1 to 5 s, its errors over its robust sigma times the receiver's sigma
    altitude multipath  altitudes, bursts of 1 to 5 s, its errors in metres
    altitude steps      altitudes 20 m higher or lower for the tenth in one piece, as cars' black boxes have them
    late positions      positions, altitudes and velocities repeated, or late by 1 s, for 2 to 8 s
    late sensors        inertial sensors and odometer late or early by 1 s against the receiver, for 10 to 30 s
    knocks              pitch (8 degrees) and accelerations (3 m/s2) are nobody's for 1 or 2 s
    all of these        each with its part of the share

For each receiver and number of drives: RMSE in percent of slope of the clean and the dirty logs, their ratio, share of
errors within 1.96 sigma of both, and share of the true slopes that the dirty logs gave; means over the roads and sets,
shares within sigma pooled. A set is of as many logs as the largest number of drives; all of them count as single ones.
The dirt of a log is the same in every run. No constant may be fitted to ``nagoya``: its errors are a check.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from accuracy.arguments import data_parser_of, numbers, plain_errors
from accuracy.dirt import KINDS, GrossErrors, Kind, Receiver, read_gross_errors, spoilt
from accuracy.logs import read_columns, write_columns
from accuracy.scoring import Errors, Row, figures, show_progress, text_table, write_json
from accuracy.sequences import (
    Sequence,
    among,
    find_sequences,
    folder_of,
    fuse,
    load_tool,
    make_log,
    slopes_of,
    tool_beside,
)
from fusion.registry import DEFAULT_METHOD

CLEAN, TOGETHER = "clean", "all of these"
MEASURED = "nagoya"
COLUMNS = {
    "dirt": ("dirt", ""),
    "receiver": ("receiver", ""),
    "drives": ("drives", "d"),
    "clean_rmse_percent": ("clean RMSE %", ".3f"),
    "rmse_percent": ("dirty RMSE %", ".3f"),
    "ratio": ("ratio", ".2f"),
    "clean_within_95": ("clean in 1.96s", ".1%"),
    "within_95": ("dirty in 1.96s", ".1%"),
    "z_rms": ("dirty z-rms", ".2f"),
    "coverage": ("cover", ".1%"),
}
Runs = dict[int, list[Errors]]
"""Errors of one road by number of drives, one for each group of so many drives."""


@dataclass(frozen=True)
class Setup:
    """What logs are made with."""

    tool: ModuleType
    folder: Path
    method: str
    drives: list[int]
    sets: int
    share: float
    gross: GrossErrors | None

    def errors(self, sequence: Sequence, receiver: str, kinds: Mapping[str, Kind]) -> Runs:
        """Errors of one road with logs of one dirt; each log is fused once."""
        most = max(self.drives)
        logs = [self.log(sequence, receiver, seed, dict(kinds)) for seed in range(most * self.sets)]
        fused = fuse(sequence, logs, self.method)
        return {
            count: [
                Errors.of(sequence.truth, slopes_of(among(fused, logs[at : at + count])))
                for first in range(0, len(logs), most)
                for at in range(first, first + most - count + 1, count)
            ]
            for count in self.drives
        }

    def log(self, sequence: Sequence, receiver: str, seed: int, kinds: dict[str, Kind]) -> Path:
        """One log; without kinds of dirt a clean one."""
        clean = make_log(self.tool, sequence, seed, self.folder, receiver)
        if not kinds:
            return clean
        profile = self.tool.PROFILES[receiver]
        sigmas = Receiver(horizontal_mps=profile["vh"], vertical_mps=profile["vv"])
        columns = spoilt(read_columns(clean), kinds, self.share, seed, sigmas, self.gross)
        return write_columns(columns, self.folder / f"dirty_{clean.name}")


def row_of(dirty: list[list[Errors]], clean: list[list[Errors]]) -> Row:
    """Figures of dirty logs beside those of clean ones; errors by road and group of drives."""
    mine, usual = (
        figures(list(map(list, zip(*by_road, strict=True)))) or {"coverage": 0.0}
        for by_road in (dirty, clean)
    )
    both = "rmse_percent" in mine and "rmse_percent" in usual
    return mine | {
        "clean_rmse_percent": usual.get("rmse_percent"),
        "clean_within_95": usual.get("within_95"),
        "ratio": mine["rmse_percent"] / usual["rmse_percent"] if both else None,
    }


def kinds_of(only: str, gross: GrossErrors | None) -> dict[str, dict[str, Kind]]:
    """By name the kinds of dirt of a row; ``only`` takes those whose name holds a text."""
    there = {name: kind for name, kind in KINDS.items() if gross is not None or not kind.measured}
    rows = {**{name: {name: kind} for name, kind in there.items()}, TOGETHER: there}
    chosen = {name: kinds for name, kinds in rows.items() if only in name}
    if not chosen:
        sys.exit(f"no dirt holds {only!r}; there are: {', '.join(rows)}")
    return chosen


def run(args: Namespace, folder: Path) -> list[Row]:
    """Every kind of dirt with every receiver and number of drives."""
    data = folder_of(args.data_dir, "karlsruhe")
    tool = load_tool(args.roadtruth or tool_beside(data))
    sequences = find_sequences(data, names=args.sequences)
    measured = data.resolve().parent / MEASURED
    gross = read_gross_errors(measured) if (measured / "ref.csv").exists() else None
    kinds = {CLEAN: {}, **kinds_of(args.only, gross)}
    if gross is None:
        left_out = ", ".join(name for name, kind in KINDS.items() if kind.measured)
        print(f"{measured} is absent: left out are {left_out}", file=sys.stderr)
    setup = Setup(tool, folder, args.method, args.drives, args.sets, args.share, gross)
    rows = []
    for receiver in args.profiles.split(","):
        found: dict[str, dict[str, Runs]] = {}
        for name, of_name in kinds.items():
            show_progress(f"{receiver}: {name}")
            found[name] = {s.name: setup.errors(s, receiver, of_name) for s in sequences}
        for name in kinds:
            for count in args.drives if name != CLEAN else ():
                mine, usual = ([runs[count] for runs in found[of].values()] for of in (name, CLEAN))
                row = {"dirt": name, "receiver": receiver, "drives": count, **row_of(mine, usual)}
                roads = zip(found[name], mine, usual, strict=True)
                row["roads"] = {road: row_of([one], [other]) for road, one, other in roads}
                rows.append(row)
    show_progress("")
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--sequences", default="00,05,08,09,10")
    parser.add_argument("--profiles", default="m8,phone", help="receivers, separated by commas")
    parser.add_argument("--drives", type=numbers, default=[1, 10], metavar="N[,N...]", help="drives together")
    parser.add_argument("--sets", type=int, default=1, help="sets of drives (default 1)")
    parser.add_argument("--share", type=float, default=0.1, help="of the epochs that is bad (default 0.1)")
    parser.add_argument("--only", default="", metavar="TEXT", help="kinds of dirt whose name holds the text")
    args = parser.parse_args()
    with plain_errors(), tempfile.TemporaryDirectory() as folder:
        rows = run(args, Path(folder))
    print(text_table(rows, COLUMNS))
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
