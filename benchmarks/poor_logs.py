#!/usr/bin/env python3
"""A ladder of poor logs: what slopes are worth when sensors are missing and epochs are far apart.

    python benchmarks/poor_logs.py DATA_DIR [--method NAME] [--seeds 5] [--sequences 00,09,10] [--every 1,5,10]
                                   [--tables ladder,streets,filtered] [--bound PATH] [--json FILE]

DATA_DIR is the folder ``karlsruhe``, or the one that holds it. The tool ``roadtruth.py`` makes logs of its reference
drives as a receiver of the M8 class records them, one a seed; of those are left

    everything           all sensors, with the SRTM tiles: the upper rung
    barometer            positions and pressure; 0.1 m of white noise, and a random walk of 0.5 m in ten minutes
    altitude             positions and altitudes, as in a GPX file: no accuracies, no velocities
    altitude and SRTM    the same with the tiles
    filtered altitude    the same without them, altitudes out of a low-pass of two seconds, as many receivers state them
    altimeter            positions, and the barometer's heights as altitudes, as bicycle computers write them
    positions and SRTM   positions alone with the tiles

each at one epoch in 1, 5 and 10 s. Printed for each: RMSE (spread over the seeds), share of the true slopes that have
an estimate, share of errors within 1.96 sigma, root mean square of error over sigma, RMSE on segments below 15 m, and
the RMSE of the same logs without noise: means over the sequences, errors pooled. Rows by sequence are in the JSON.

The second table is of the barometer alone at 1 Hz on made streets of 750 m whose segments are equally long: a height
that only a drive knows has to be carried from one short segment to the next, which the sequences ask of few. Beside it
the same slopes without the barometer's noise and drift, and the RMSE of taking 0 everywhere.

The third table is of altitudes at 1 Hz out of a low-pass of 1, 2 and 4 s and of none, from the M8 and from a phone, of
one drive and of ten together (a set of ten for every five of ``--seeds``, one at least). Beside it the RMSE that a
smoother of the same altitudes before the low-pass could reach at best, by the tool ``bound.py`` (``accuracy.bounds``).
``--tables`` prints only some.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from accuracy import filtered
from accuracy.arguments import data_parser_of, plain_errors
from accuracy.logs import POSITIONS, only, with_barometer, write_columns
from accuracy.poor import RUNGS, Rung, poor_log, road_of
from accuracy.scoring import (
    LENGTH_CLASSES_M,
    Errors,
    Row,
    figures,
    rms,
    show_progress,
    text_table,
    write_json,
)
from accuracy.sequences import (
    NOISE_FREE,
    Sequence,
    estimate,
    find_sequences,
    folder_of,
    load_tool,
    tool_beside,
)
from accuracy.streets import drive_along, make_hills, truth_of
from fusion.registry import DEFAULT_METHOD
from fusion.simulate.write.csv_file import csv_columns

COLUMNS = {
    "log": ("log", ""),
    "every_s": ("every s", "g"),
    "rmse_percent": ("RMSE %", ".3f"),
    "rmse_spread": ("(spread)", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "short_rmse_percent": (f"below {LENGTH_CLASSES_M[0]:g} m", ".3f"),
    "noise_free_rmse_percent": ("noise-free RMSE %", ".3f"),
}


STREET_COLUMNS = {
    "segment_m": ("segments of m", "g"),
    **{name: COLUMNS[name] for name in ("rmse_percent", "rmse_spread", "coverage", "within_95", "z_rms")},
    "sigma_rms_percent": ("sigma %", ".3f"),
    "noise_free_rmse_percent": COLUMNS["noise_free_rmse_percent"],
    "flat_rmse_percent": ("RMSE of 0", ".3f"),
}
STREET_M = 750.0
SEGMENTS_M = (10.0, 25.0, 50.0, 150.0)


TABLES = {
    "ladder": ("a ladder of poor logs", COLUMNS),
    "streets": ("barometer alone, streets of equal segments", STREET_COLUMNS),
    "filtered": ("altitudes out of a low-pass", filtered.COLUMNS),
}
RECEIVER = "m8"
Runs = dict[str, list[list[Errors]]]
"""Errors by receiver, seed and sequence."""


@dataclass(frozen=True)
class Setup:
    """What logs are made with."""

    tool: ModuleType
    folder: Path
    method: str
    seeds: int

    def rows(self, sequences: list[Sequence], rung: str, every_s: float) -> list[Row]:
        """A row for each sequence, then one for all of them."""
        show_progress(f"{rung}, every {every_s:g} s")
        by_road: dict[str, Runs] = {
            s.name: {
                receiver: [
                    [self.errors(s, RUNGS[rung], every_s, seed, receiver)] for seed in range(self.seeds)
                ]
                for receiver in (RECEIVER, NOISE_FREE)
            }
            for s in sequences
        }
        together = {
            receiver: [
                [e for (e,) in of_seed]
                for of_seed in zip(*(runs[receiver] for runs in by_road.values()), strict=True)
            ]
            for receiver in (RECEIVER, NOISE_FREE)
        }
        return [
            {"log": rung, "every_s": every_s, "sequence": name, **summarise(runs)}
            for name, runs in {**by_road, "all": together}.items()
        ]

    def errors(self, sequence: Sequence, rung: Rung, every_s: float, seed: int, receiver: str) -> Errors:
        """Errors of one poor log."""
        log = poor_log(self.tool, sequence, seed, self.folder, rung, every_s=every_s, receiver=receiver)
        return Errors.of(sequence.truth, estimate(road_of(sequence, rung), [log], self.method))


def run(args: Namespace, folder: Path) -> dict[str, list[Row]]:
    """The rows of each table."""
    names = args.tables.split(",")
    if not set(names) <= set(TABLES):
        sys.exit(f"--tables takes some of {','.join(TABLES)}")
    data = folder_of(args.data_dir, "karlsruhe")
    tool = load_tool(args.roadtruth or tool_beside(data))
    sequences = find_sequences(data, names=args.sequences)
    rows: dict[str, list[Row]] = {}
    if "ladder" in names:
        rows["ladder"] = ladder(args, Setup(tool, folder, args.method, args.seeds), sequences)
    if "streets" in names:
        rows["streets"] = [street_row(m, args.method, args.seeds, folder) for m in SEGMENTS_M]
    if "filtered" in names:
        bound = args.bound or tool_beside(data, "bound.py")
        of = load_tool(bound) if args.bound or bound.exists() else None
        drives = filtered.Drives(tool, of, folder, args.method, args.seeds)
        rows["filtered"] = filtered.filtered_rows(drives, sequences)
    return rows


def ladder(args: Namespace, setup: Setup, sequences: list[Sequence]) -> list[Row]:
    """Every rung at every sampling."""
    return [
        row
        for rung in RUNGS
        for every_s in map(float, args.every.split(","))
        for row in setup.rows(sequences, rung, every_s)
    ]


def summarise(runs: Runs) -> Row:
    """The figures of logs with noise, and what those without noise and short segments give."""
    pooled = Errors.pooled([e for of_seed in runs[RECEIVER] for e in of_seed])
    short = pooled.take(pooled.length_m < LENGTH_CLASSES_M[0])
    clean = figures(runs[NOISE_FREE])
    return {
        "coverage": 0.0,
        **(figures(runs[RECEIVER]) or {}),
        "short_rmse_percent": short.rmse if len(short) else None,
        "sigma_rms_percent": rms(pooled.sigma_percent) if len(pooled) else None,
        "noise_free_rmse_percent": clean["rmse_percent"] if clean else None,
    }


def street_row(segment_m: float, method: str, seeds: int, folder: Path) -> Row:
    """The barometer alone on a street of equal segments."""
    show_progress(f"street, segments of {segment_m:g} m")
    street = make_hills(STREET_M, segment_m)
    sequence = Sequence("street", truth_of(street), street.roads, None, None, None)
    runs: Runs = {RECEIVER: [], NOISE_FREE: []}
    for seed in range(seeds):
        drive = drive_along(street, seed, RECEIVER)
        columns = only(csv_columns(drive), POSITIONS)
        for receiver, rng in ((RECEIVER, np.random.default_rng([seed, 2])), (NOISE_FREE, None)):
            log = write_columns(with_barometer(columns, drive.truth.z_m, rng), folder / "street.csv")
            runs[receiver].append([Errors.of(sequence.truth, estimate(sequence, [log], method))])
    flat = rms(street.true_slope_percent)
    return {"log": "street", "segment_m": segment_m, **summarise(runs), "flat_rmse_percent": flat}


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--sequences", default="00,09,10")
    parser.add_argument("--every", default="1,5,10", help="seconds between epochs, separated by commas")
    parser.add_argument("--tables", default=",".join(TABLES), help="some of them, separated by commas")
    parser.add_argument("--bound", type=Path, metavar="PATH", help="where bound.py lies")
    args = parser.parse_args()
    with plain_errors(), tempfile.TemporaryDirectory() as temporary:
        rows = run(args, Path(temporary))
    show_progress("")
    for name, of_table in rows.items():
        title, columns = TABLES[name]
        print(f"{title}\n{text_table([r for r in of_table if r.get('sequence', 'all') == 'all'], columns)}\n")
    write_json(args.json, [row for of_table in rows.values() for row in of_table])


if __name__ == "__main__":
    main()
