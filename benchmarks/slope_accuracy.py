#!/usr/bin/env python3
"""Accuracy of road slopes against precise reference drives, beside the baselines in the same run.

    python benchmarks/slope_accuracy.py DATA_DIR [--method NAME] [--seeds N] [--profile m8|phone|f9p]
                                        [--cut 60:40] [--drives N] [--sequences 09,10] [--option name=value]
                                        [--json FILE]

DATA_DIR holds sequences: ``ref_XX.csv`` (precise track) with ``truth_XX.csv`` (slope per segment), a road file
whose name contains XX, and DEM tiles (``*.hgt``, ``*.tif``) if there are any; or one real log, ``log.csv`` with
``truth.csv`` and ``roads.osm``. From each ``ref_XX.csv`` the tool ``roadtruth.py`` (``--roadtruth PATH``, by default
``../tools`` beside DATA_DIR's parent) makes receiver logs, one a seed. With ``--drives N`` each score is of N drives
put together as ``versant fuse`` does, seeds s*N .. s*N+N-1. ``--sequences`` takes only some.

For each sequence and method, means over the seeds (spread of the RMSE in brackets): RMSE and 90th percentile of
|error| in percent of slope, coverage (share of truth segments with an estimate), share of errors within 1.96 sigma
(pooled over the seeds), share of wrong signs among true slopes steeper than 1 %. The last column is the RMSE's ratio
to the ``dem`` baseline (``raw`` where there is no DEM). The rows ``all`` are means over the sequences, errors pooled.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import importlib.util
import io
import json
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np

from app.cli.fuse_files import Fusion
from fusion.errors import FusionError, MissingSensorError
from fusion.pipeline import parse_options
from fusion.registry import DEFAULT_METHOD
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem

Key = tuple[int, int, int]
BASELINES = ("raw", "dem")


@dataclass(frozen=True)
class Sequence:
    """A stretch of road with its truth; ``reference`` is None where a real log is given instead."""

    name: str
    truth: dict[Key, float]
    roads: RoadTable
    dem: Dem | None
    reference: Path | None
    log: Path | None


@dataclass
class Scores:
    """Per-seed errors of one method on one sequence."""

    rmse: list[float]
    p90: list[float]
    coverage: list[float]
    wrong_sign: list[float]
    inside: list[bool]


def find_sequences(folder: Path) -> list[Sequence]:
    """Every sequence in ``folder``."""
    tiles = sorted([*folder.glob("*.hgt"), *folder.glob("*.tif")])
    dem = Dem.open(tiles) if tiles else None
    found = [
        Sequence(
            name=reference.stem.removeprefix("ref_"),
            truth=read_truth(reference.with_name(reference.name.replace("ref_", "truth_"))),
            roads=read_roads(road_file(folder, reference.stem.removeprefix("ref_"))),
            dem=dem,
            reference=reference,
            log=None,
        )
        for reference in sorted(folder.glob("ref_*.csv"))
    ]
    if (folder / "log.csv").exists():
        roads = read_roads(folder / "roads.osm")
        found.append(
            Sequence(folder.name, read_truth(folder / "truth.csv"), roads, dem, None, folder / "log.csv")
        )
    if not found:
        sys.exit(f"{folder}: neither ref_*.csv nor log.csv")
    return found


def road_file(folder: Path, name: str) -> Path:
    """The road file for sequence ``name``: its name holds the sequence's."""
    fitting = [p for p in sorted(folder.glob("roads*.osm*")) if name in p.name.split(".")[0].split("_")]
    if not fitting:
        sys.exit(f"{folder}: no road file whose name holds {name!r}")
    return fitting[0]


def read_truth(path: Path) -> dict[Key, float]:
    """True slope in percent by (way, from, to)."""
    with path.open(newline="") as file:
        return {
            (int(r["osm_way_id"]), int(r["from_node"]), int(r["to_node"])): float(r["slope_percent"])
            for r in csv.DictReader(file)
        }


def load_tool(path: Path) -> ModuleType:
    """The module ``roadtruth``."""
    spec = importlib.util.spec_from_file_location("roadtruth", path)
    if spec is None or spec.loader is None or not path.exists():
        sys.exit(f"{path}: not there; name roadtruth.py by --roadtruth")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def make_log(
    tool: ModuleType | None, sequence: Sequence, seed: int, args: argparse.Namespace, folder: Path
) -> Path:
    """A receiver's log of the sequence."""
    if sequence.log is not None:
        return sequence.log
    if tool is None:
        raise ValueError("a sequence without a log needs the tool that makes one")
    out = folder / f"{sequence.name}_{seed}.csv"
    wanted = SimpleNamespace(
        ref=str(sequence.reference), out=str(out), seed=seed, rate=1.0, profile=args.profile, cut=args.cut
    )
    with contextlib.redirect_stdout(io.StringIO()):
        tool.drive(wanted)
    return out


def estimate(
    sequence: Sequence, logs: list[Path], method: str, options: dict[str, str]
) -> dict[Key, tuple[float, float]]:
    """Slope and sigma by (way, from, to) from logs, put together as ``versant fuse`` does."""
    fusion = Fusion(method, parse_options(method, options), sequence.roads, sequence.dem)
    for log in logs:
        with contextlib.suppress(MissingSensorError):
            fusion.add(log)
    return {
        (f.osm_way_id, f.from_node, f.to_node): (f.slope_percent, f.slope_sigma_percent)
        for f in (fusion.features() if fusion.fused else ())
        if f.slope_percent is not None and f.slope_sigma_percent is not None
    }


def add_score(scores: Scores, truth: dict[Key, float], got: dict[Key, tuple[float, float]]) -> None:
    """Add one seed's figures."""
    both = [key for key in truth if key in got]
    scores.coverage.append(len(both) / len(truth))
    if not both:
        return
    true = np.array([truth[key] for key in both])
    slope, sigma = np.array([got[key] for key in both]).T
    error = slope - true
    steep = np.abs(true) > 1
    scores.rmse.append(float(np.sqrt(np.mean(error**2))))
    scores.p90.append(float(np.quantile(np.abs(error), 0.9)))
    scores.wrong_sign.append(float(np.mean((np.sign(slope) != np.sign(true)) & steep)))
    scores.inside += (np.abs(error) <= 1.96 * sigma).tolist()


def run(args: argparse.Namespace) -> list[dict[str, object]]:
    """Score every sequence and method."""
    wanted = None if args.sequences is None else args.sequences.split(",")
    sequences = [s for s in find_sequences(args.data_dir) if wanted is None or s.name in wanted]
    if not sequences:
        sys.exit(f"{args.data_dir}: no sequence named {args.sequences}")
    options = dict(item.split("=", 1) for item in args.option)
    needs_tool = any(s.reference is not None for s in sequences)
    tool = (
        load_tool(args.roadtruth or args.data_dir.parent.parent / "tools" / "roadtruth.py")
        if needs_tool
        else None
    )
    methods = [args.method, *(m for m in BASELINES if m != args.method)]
    rows: list[dict[str, object]] = []
    everything: list[dict[str, Scores]] = []
    with tempfile.TemporaryDirectory() as folder:
        for sequence in sequences:
            seeds = args.seeds if sequence.reference is not None else 1
            scores = {m: Scores([], [], [], [], []) for m in methods}
            for seed in range(seeds):
                count = args.drives if sequence.reference is not None else 1
                logs = [make_log(tool, sequence, seed * count + d, args, Path(folder)) for d in range(count)]
                for method in methods:
                    chosen = options if method == args.method else {}
                    add_score(scores[method], sequence.truth, estimate(sequence, logs, method, chosen))
                if sys.stderr.isatty():
                    print(f"\r{sequence.name}: seed {seed + 1}/{seeds} ", end="", file=sys.stderr)
            rows += summarise(sequence.name, scores)
            everything.append(scores)
    if len(everything) > 1:
        rows += summarise("all", {m: pooled([scores[m] for scores in everything]) for m in methods})
    return rows


def pooled(parts: list[Scores]) -> Scores:
    """Figures of a seed averaged over the sequences; errors within 1.96 sigma counted together."""

    def by_seed(name: str) -> list[float]:
        return [float(np.mean(values)) for values in zip(*(getattr(p, name) for p in parts), strict=False)]

    return Scores(
        rmse=by_seed("rmse"),
        p90=by_seed("p90"),
        coverage=by_seed("coverage"),
        wrong_sign=by_seed("wrong_sign"),
        inside=[inside for p in parts for inside in p.inside],
    )


def summarise(name: str, scores: dict[str, Scores]) -> list[dict[str, object]]:
    """One row a method; methods that yielded nothing are left out."""
    means = {m: float(np.mean(s.rmse)) for m, s in scores.items() if s.rmse}
    base = means.get("dem", means.get("raw", float("nan")))
    return [
        {
            "sequence": name,
            "method": method,
            "rmse_percent": means[method],
            "rmse_spread": float(np.std(s.rmse)),
            "p90_percent": float(np.mean(s.p90)),
            "coverage": float(np.mean(s.coverage)),
            "within_95": float(np.mean(s.inside)),
            "wrong_sign": float(np.mean(s.wrong_sign)),
            "ratio": means[method] / base,
        }
        for method, s in scores.items()
        if s.rmse
    ]


def show(rows: list[dict[str, object]]) -> None:
    """The table a person reads."""
    print(
        f"{'sequence':10} {'method':10} {'RMSE %':>14} {'p90 %':>7} {'cover':>7} {'in 1.96s':>9} "
        f"{'wrong':>7} {'ratio':>6}"
    )
    for r in rows:
        rmse = f"{r['rmse_percent']:.3f} ({r['rmse_spread']:.3f})"
        print(
            f"{r['sequence']:10} {r['method']:10} {rmse:>14} {r['p90_percent']:7.3f} {r['coverage']:7.1%}"
            f" {r['within_95']:9.1%} {r['wrong_sign']:7.1%} {r['ratio']:6.2f}"
        )


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--profile", default="m8", choices=("m8", "phone", "f9p"))
    parser.add_argument("--cut", action="append", metavar="START:LENGTH", help="seconds without GNSS")
    parser.add_argument("--drives", type=int, default=1)
    parser.add_argument("--sequences", help="only these, separated by commas")
    parser.add_argument(
        "--option", action="append", default=[], metavar="NAME=VALUE", help="option of the method"
    )
    parser.add_argument("--roadtruth", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    try:
        rows = run(args)
    except FusionError as error:
        sys.exit(str(error))
    show(rows)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
