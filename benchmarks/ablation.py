#!/usr/bin/env python3
"""What each sensor adds to method ``profile``: slopes from altitudes alone, then with one sensor more at a time.

    python benchmarks/ablation.py DATA_DIR [--seeds N] [--profile m8|phone|f9p] [--json FILE]

DATA_DIR holds ``karlsruhe`` and ``comma2k19`` as in ``slope_accuracy.py`` (folders that are missing are left out).
Printed for the drives 09 and 10 and the real log: RMSE in percent of slope, coverage, and the share within 1.96 sigma.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from slope_accuracy import (
    Scores,
    Sequence,
    add_score,
    estimate,
    find_sequences,
    load_tool,
    make_log,
    summarise,
)

SENSORS = ("altitude", "doppler", "pitch", "force", "dem")
LABELS = ("altitude alone", "+ Doppler", "+ pitch", "+ specific force", "+ DEM")
SEQUENCES = ("09", "10", "comma2k19")


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--profile", default="m8", choices=("m8", "phone", "f9p"))
    parser.add_argument("--roadtruth", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    args.cut = None
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    folders = [args.data_dir / name for name in ("karlsruhe", "comma2k19")]
    sequences = [s for f in folders if f.is_dir() for s in find_sequences(f) if s.name in SEQUENCES]
    if not sequences:
        sys.exit(f"{args.data_dir}: neither karlsruhe nor comma2k19")
    rows = [row for sequence in sequences for row in ablate(sequence, args)]
    print(f"{'sequence':10} {'sensors':18} {'RMSE %':>8} {'cover':>7} {'in 1.96s':>9}")
    for r in rows:
        print(
            f"{r['sequence']:10} {r['sensors']:18} {r['rmse_percent']:8.3f} {r['coverage']:7.1%} {r['within_95']:9.1%}"
        )
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


def ablate(sequence: Sequence, args: argparse.Namespace) -> list[dict[str, object]]:
    """One row for each set of sensors."""
    tool = args.roadtruth or args.data_dir.parent / "tools" / "roadtruth.py"
    module = load_tool(tool) if sequence.reference is not None else None
    seeds = args.seeds if sequence.reference is not None else 1
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        logs = [make_log(module, sequence, seed, args, Path(folder)) for seed in range(seeds)]
        for count, label in enumerate(LABELS, 1):
            options = {name: str(name in SENSORS[:count]).lower() for name in SENSORS}
            # Without its raster as well: the network's solution would take the terrain's slopes from it.
            bare = sequence if "dem" in SENSORS[:count] else replace(sequence, dem=None)
            scores = Scores([], [], [], [], [])
            for log in logs:
                add_score(scores, sequence.truth, estimate(bare, [log], "profile", options))
            rows += [{**row, "sensors": label} for row in summarise(sequence.name, {"profile": scores})]
    return rows


if __name__ == "__main__":
    main()
