#!/usr/bin/env python3
"""What each sensor adds to method ``profile``: slopes from altitudes alone, then with one sensor more at a time.

    python benchmarks/ablation.py DATA_DIR [--seeds N] [--profile m8|phone|f9p] [--json FILE]

DATA_DIR holds ``karlsruhe`` and ``comma2k19`` as in ``slope_accuracy.py`` (folders that are missing are left out).
Printed for the drives 09 and 10 and the real log: RMSE in percent of slope, coverage, and the share within 1.96 sigma.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from accuracy.scoring import Errors, Row, figures, text_table, write_json
from accuracy.sequences import (
    RECEIVERS,
    Sequence,
    estimate,
    find_sequences,
    load_tool,
    make_log,
    parser_of,
    tool_beside,
)

SENSORS = ("altitude", "doppler", "pitch", "force", "dem")
LABELS = ("altitude alone", "+ Doppler", "+ pitch", "+ specific force", "+ DEM")
SEQUENCES = ("09", "10", "comma2k19")
COLUMNS = {
    "sequence": ("sequence", ""),
    "sensors": ("sensors", ""),
    "rmse_percent": ("RMSE %", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
}


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--profile", default="m8", choices=RECEIVERS)
    args = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    folders = [args.data_dir / name for name in ("karlsruhe", "comma2k19")]
    sequences = [s for f in folders if f.is_dir() for s in find_sequences(f) if s.name in SEQUENCES]
    if not sequences:
        sys.exit(f"{args.data_dir}: neither karlsruhe nor comma2k19")
    rows = [row for sequence in sequences for row in ablate(sequence, args)]
    print(text_table(rows, COLUMNS))
    write_json(args.json, rows)


def ablate(sequence: Sequence, args: argparse.Namespace) -> list[Row]:
    """One row for each set of sensors."""
    tool = args.roadtruth or tool_beside(args.data_dir / "karlsruhe")
    module = load_tool(tool) if sequence.log is None else None
    seeds = args.seeds if sequence.log is None else 1
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
                rows.append({"sequence": sequence.name, "sensors": label, **scores})
    return rows


if __name__ == "__main__":
    main()
