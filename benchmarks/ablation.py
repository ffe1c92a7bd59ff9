#!/usr/bin/env python3
"""What each part of method ``profile`` is worth: sensors one more at a time, or constants one by one.

    python benchmarks/ablation.py DATA_DIR [--seeds N] [--profile m8|phone|f9p] [--bound PATH] [--json FILE]
    python benchmarks/ablation.py DATA_DIR --constants [--only TEXT] [--sequences 00,09,10] [--seeds N]
                                                     [--log RUNG] [...]

DATA_DIR holds ``karlsruhe`` and ``comma2k19`` as in ``slope_accuracy.py`` (folders that are missing are left out).

Sensors: slopes from altitudes alone, then with one sensor more at a time. Printed for the drives 09 and 10 and the real
log: RMSE in percent of slope, coverage, and the share within 1.96 sigma; and of the made logs what the same sensors can
give at best, by the tool ``bound.py`` (``accuracy.bounds``), which knows no elevation model.

Constants: the model of the network as it is, and once with each constant of ``accuracy.constants`` halved, doubled or
switched off (``--only``: those whose label holds the text). Of the sequences of ``karlsruhe``, with one drive (each of
``--seeds`` sets) and with ten (a set of ten for every five of ``--seeds``, one at least): RMSE, by how much the change
makes it worse, share within 1.96 sigma and the root mean square of error over sigma; means over the sequences, errors
pooled, and by sequence in the JSON. ``--log`` takes one of the poor logs of ``poor_logs.py`` instead of a receiver's
whole log (``barometer``, ``altimeter``, ``filtered altitude``): constants of sensors that a receiver does not have
change nothing in its logs.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence as Several
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from accuracy.arguments import data_parser_of
from accuracy.bounds import ALL_SENSORS, AS_FITTED, RoadBound
from accuracy.constants import CHANGES, Change, changed
from accuracy.poor import RUNGS, poor_log, road_of
from accuracy.scoring import Errors, Row, figures, rms, show_progress, text_table, write_json
from accuracy.sequences import (
    RECEIVERS,
    Sequence,
    among,
    estimate,
    find_sequences,
    fuse,
    load_tool,
    make_log,
    slopes_of,
    tool_beside,
)
from app.cli.logs.fusing import Fusion

SENSORS = ("altitude", "doppler", "pitch", "force", "dem")
LABELS = ("altitude alone", "+ Doppler", "+ pitch", "+ specific force", "+ DEM")
SEQUENCES = ("09", "10", "comma2k19")
COLUMNS = {
    "sequence": ("sequence", ""),
    "sensors": ("sensors", ""),
    "bound_percent": ("bound %", ".3f"),
    "rmse_percent": ("RMSE %", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
}
MANY = 10
"""Drives in the larger sets."""
SETS_OF = (1, MANY)
CONSTANT_COLUMNS = {
    "constant": ("constant", ""),
    **{
        f"{name}_{drives}": (f"{title} ({drives})", spec)
        for drives in SETS_OF
        for name, title, spec in (
            ("rmse_percent", "RMSE %", ".3f"),
            ("worse", "worse", "+.1%"),
            ("within_95", "in 1.96s", ".1%"),
            ("z_rms", "z-rms", ".2f"),
        )
    },
}


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--profile", default="m8", choices=RECEIVERS)
    parser.add_argument("--bound", type=Path, metavar="PATH", help="where bound.py lies")
    parser.add_argument("--constants", action="store_true", help="constants instead of sensors")
    parser.add_argument("--only", default="", metavar="TEXT", help="constants whose label holds the text")
    parser.add_argument("--sequences", default="00,09,10", help="of the constants, separated by commas")
    parser.add_argument("--log", default="everything", choices=tuple(RUNGS), help="what is left of the logs")
    args = parser.parse_args()
    rows = of_constants(args) if args.constants else of_sensors(args)
    print(text_table(rows, CONSTANT_COLUMNS if args.constants else COLUMNS))
    write_json(args.json, rows)


def of_sensors(args: Namespace) -> list[Row]:
    """One row for each sequence and set of sensors."""
    folders = [args.data_dir / name for name in ("karlsruhe", "comma2k19")]
    sequences = [s for f in folders if f.is_dir() for s in find_sequences(f) if s.name in SEQUENCES]
    if not sequences:
        sys.exit(f"{args.data_dir}: neither karlsruhe nor comma2k19")
    return [row for sequence in sequences for row in ablate(sequence, args)]


def ablate(sequence: Sequence, args: Namespace) -> list[Row]:
    """One row for each set of sensors."""
    tool = args.roadtruth or tool_beside(args.data_dir / "karlsruhe")
    module = load_tool(tool) if sequence.log is None else None
    seeds = args.seeds if sequence.log is None else 1
    bound = args.bound or tool_beside(args.data_dir / "karlsruhe", "bound.py")
    road = RoadBound.of(load_tool(bound), sequence) if module is not None and bound.exists() else None
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        logs = [make_log(module, sequence, seed, Path(folder), args.profile) for seed in range(seeds)]
        for count, label in enumerate(LABELS, 1):
            options = {name: str(name in SENSORS[:count]).lower() for name in SENSORS}
            # Without its raster as well: the network's solution would take the terrain's slopes from it.
            bare = sequence if "dem" in SENSORS[:count] else replace(sequence, dem=None)
            errors = [Errors.of(sequence.truth, estimate(bare, [log], "profile", options)) for log in logs]
            scores = figures([[e] for e in errors])
            if scores is not None:
                best = None if road is None else best_of(road, logs, args.profile, count)
                rows.append(
                    {"sequence": sequence.name, "sensors": label, "bound_percent": best} | dict(scores)
                )
    return rows


def best_of(road: RoadBound, logs: Several[Path], receiver: str, count: int) -> float | None:
    """What so many sensors can give at best: the mean RMSE of the bound over the logs, whose numbers are their seeds.

    None beyond the sensors that the bound knows.
    """
    sensors = ALL_SENSORS[:count]
    if len(sensors) < count:
        return None
    errors = [road.errors([road.drive(log, receiver, seed, sensors)]) for seed, log in enumerate(logs)]
    return float(np.mean([rms(of[AS_FITTED]) for of in errors]))


@dataclass(frozen=True)
class Sets:
    """The logs of one sequence, by number of drives in a set, and each log fused as the library is."""

    sequence: Sequence
    logs: dict[int, list[list[Path]]]
    fused: Fusion

    def errors(self, drives: int, change: Change | None) -> list[Errors]:
        """Errors of every set with a constant changed."""
        out = []
        for logs in self.logs[drives]:
            with changed(change):
                anew = change and change.factors
                one = fuse(self.sequence, logs, "profile") if anew else among(self.fused, logs)
                out.append(Errors.of(self.sequence.truth, slopes_of(one)))
        return out


def of_constants(args: Namespace) -> list[Row]:
    """The model as it is, then one row for each change."""
    chosen = [c for c in CHANGES if args.only.lower() in c.label.lower()]
    if not chosen:
        sys.exit(f"no constant holds {args.only!r}; there are: {', '.join(c.label for c in CHANGES)}")
    data = args.data_dir / "karlsruhe" if (args.data_dir / "karlsruhe").is_dir() else args.data_dir
    tool = load_tool(args.roadtruth or tool_beside(data))
    rung = RUNGS[args.log]
    sequences = [road_of(s, rung) for s in find_sequences(data, names=args.sequences)]
    with tempfile.TemporaryDirectory() as folder:
        sets = []
        for sequence in sequences:
            show_progress(f"{sequence.name}: logs")
            count = max(args.seeds, MANY * max(1, args.seeds // 5))
            logs = [
                poor_log(tool, sequence, seed, Path(folder), rung, receiver=args.profile)
                for seed in range(count)
            ]
            many = [logs[at : at + MANY] for at in range(0, MANY * max(1, args.seeds // 5), MANY)]
            by_drives = {1: [[log] for log in logs[: args.seeds]], MANY: many}
            sets.append(Sets(sequence, by_drives, fuse(sequence, logs, "profile")))
        rows: list[Row] = []
        for change in (None, *chosen):
            show_progress(change.label if change else "as it is")
            rows.append(row_of(change, sets, rows[0] if rows else None))
        show_progress("")
    return rows


def row_of(change: Change | None, sets: list[Sets], base: Row | None) -> Row:
    """Figures with one constant changed beside those of the model as it is."""
    row: Row = {"constant": change.label if change else "(as it is)", "sequences": {}}
    for drives in SETS_OF:
        errors = [one.errors(drives, change) for one in sets]
        for one, of_sequence in zip(sets, errors, strict=True):
            row["sequences"].setdefault(one.sequence.name, {})[drives] = figures([[e] for e in of_sequence])
        scores = figures(list(map(list, zip(*errors, strict=True)))) or {}
        row |= {f"{name}_{drives}": scores.get(name) for name in ("rmse_percent", "within_95", "z_rms")}
        mine, usual = row[f"rmse_percent_{drives}"], (base or row)[f"rmse_percent_{drives}"]
        row[f"worse_{drives}"] = mine / usual - 1 if mine and usual else None
    return row


if __name__ == "__main__":
    main()
