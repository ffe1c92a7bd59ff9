#!/usr/bin/env python3
"""Positions from raw pseudoranges: every solver on a measured log, beside the literature.

    python benchmarks/pseudorange.py DIR [--solver NAME ...] [--seeds N] [--skip-literature] [--json FILE]
    python benchmarks/pseudorange.py DIR --convert OUTDIR
    python benchmarks/pseudorange.py --rinex OBS NAV... --truth CSV [the same options]

DIR has smartLoc's Potsdamer Platz (``../shared/data/smartloc``). ``--convert`` writes it as the project's CSV of
pseudoranges and a Versant CSV with odometer and gyroscope. ``--rinex`` takes any log with its navigation files (RINEX,
or whatever ``versant fuse`` reads), and a truth with the columns gps_week, tow_s, lat_deg, lon_deg, height_m; it is
interpolated to the epochs, except over more than a second and a half.

2-D: mean, median and 95th percentile of horizontal errors (m); 3-D: mean; spread: standard deviation of the 2-D mean
over the seeds; in 95 %: share of the true places within the stated 95 % ellipse; sigma: median of the stated radial
ones; ms: processor time an epoch, compiled, median. Each epoch with a truth counts; those without a position are
shown. Bars of issue 12: one-sided 12 m 2-D and 18 m 3-D, with odometer 8.5, smoothed 7.5, rbpf-dpm 17; on a log from
another city one-sided with Doppler 4.5 m, 95 % under 10 m.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.arguments import parser_of
from accuracy.scoring import write_json
from fusion.catalogue import SOLVERS
from fusion.formats import read_logs
from fusion.frames import geodetic
from fusion.gnss.earth import ecef
from fusion.gnss.measure import measure
from fusion.gnss.measurements import Solution, Solver, aids_of
from fusion.signals import WEEK_S, unix_from_gps
from fusion.types import Floats, no_progress
from published.positioning import smartloc
from published.positioning.robust import ESTIMATORS, single_points, track
from published.positioning.scoring import Scene, figures, row
from satellites.library import library_single_points

TRUTH_GAP_S = 1.5
HEIGHT_SIGMA_M = 3.0

Row = tuple[str, str, dict[str, Any]]
"""Label, solver, options."""

ROWS: list[Row] = [
    ("ls", "ls", {}),
    ("wls", "wls", {}),
    ("ekf", "ekf", {}),
    ("ekf + odometer", "ekf", {"odometer": True}),
    ("pf, bootstrap", "pf", {"proposal": "bootstrap"}),
    ("pf, fpll", "pf", {"proposal": "fpll"}),
    ("jms-gmm", "jms-gmm", {}),
    ("jms-gmm, literal", "jms-gmm", {"reading": "literal"}),
    ("rbpf-dpm", "rbpf-dpm", {}),
    ("rbpf-dpm, literal", "rbpf-dpm", {"reading": "literal"}),
    ("one-sided filter", "one-sided", {"smooth": False, "odometer": False}),
    ("  without Doppler", "one-sided", {"smooth": False, "odometer": False, "doppler": False}),
    ("  + odometer", "one-sided", {"smooth": False}),
    ("one-sided smoothed", "one-sided", {"odometer": False}),
    ("  without Doppler", "one-sided", {"odometer": False, "doppler": False}),
    ("  + odometer", "one-sided", {}),
]
TRUE_HEIGHT: list[Row] = [
    ("filter + height *", "one-sided", {"smooth": False, "odometer": False}),
    ("smoothed + odo + height *", "one-sided", {}),
]
"""Rows marked * are given the true height with 3 m of noise, as a map's would be."""


def recorded(files: list[Path], truth: Path) -> Scene:
    """A log of files with a truth of its own."""
    log = read_logs(files)
    if log.raw is None or not len(log.raw.signals):
        sys.exit(f"{files[0]}: no raw pseudoranges in it")
    measured = measure(log.raw, no_progress)
    for warning in (*log.warnings, *measured.warnings):
        print("  " + warning)
    print(f"  {measured.counts}")
    table = np.genfromtxt(truth, delimiter=",", names=True)
    time_s = unix_from_gps(table["gps_week"] * WEEK_S + table["tow_s"])
    order = np.argsort(time_s)
    places = ecef(table["lon_deg"], table["lat_deg"], table["height_m"])[order]
    true = interpolated(measured.time_s, time_s[order], places)
    return Scene(measured, aids_of(log, measured.time_s), true)


def interpolated(at_s: Floats, time_s: Floats, places: Floats) -> Floats:
    """Places (m, 3) at times (m,), NaN outside and inside gaps."""
    after = np.clip(np.searchsorted(time_s, at_s), 1, len(time_s) - 1)
    before = after - 1
    gap = time_s[after] - time_s[before]
    share = ((at_s - time_s[before]) / gap)[:, None]
    interpolated = places[before] + share * (places[after] - places[before])
    exact = np.minimum(np.abs(at_s - time_s[after]), np.abs(at_s - time_s[before])) < 1e-3
    bad = (at_s < time_s[0] - 1e-3) | (at_s > time_s[-1] + 1e-3) | ((gap > TRUTH_GAP_S) & ~exact)
    return np.where(bad[:, None], np.nan, interpolated)


def with_height(scene: Scene) -> Scene:
    """The log with heights as a map and an elevation model would give them: the true ones with 3 m of noise."""
    _, _, height = geodetic(np.nan_to_num(scene.truth_m))
    height[~np.isfinite(scene.truth_m).all(axis=1)] = np.nan
    noisy = height + np.random.default_rng(1).normal(0, HEIGHT_SIGMA_M, len(height))
    sigma = np.where(np.isfinite(noisy), HEIGHT_SIGMA_M, np.nan)
    return replace(scene, aids=replace(scene.aids, height_m=noisy, height_sigma_m=sigma))


def solvers(scene: Scene, names: list[str], seeds: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Rows of the solvers, as far as they make a difference on this log."""
    has_odometer = bool(np.isfinite(scene.aids.speed_mps).any())
    has_rates = bool(np.isfinite(scene.measured.range_rate_mps).any())
    for chosen, variant in ((ROWS, scene), (TRUE_HEIGHT, with_height(scene))):
        for label, name, options in chosen:
            idle = ("odometer" in label and not has_odometer) or ("Doppler" in label and not has_rates)
            if idle or (names and name not in names):
                continue
            if name not in SOLVERS:
                print(f"{label:28} is not there")
                continue
            solver: Solver = SOLVERS[name]
            # What draws nothing needs one seed.
            drawn = name in {"pf", "jms-gmm", "rbpf-dpm"}
            yield label, row(variant, solver, options, seeds if drawn else 1)


def literature(scene: Scene) -> Iterator[tuple[str, dict[str, float]]]:
    """Rows of the estimators of the literature."""
    yield "RTKLIB's weights", figures(scene, _bare(scene, single_points(scene.measured), None))
    odometers = (False, True) if np.isfinite(scene.aids.speed_mps).any() else (False,)
    for smoothed in (False, True):
        for odometer in odometers:
            for name in ESTIMATORS:
                places, spread = track(scene.measured, scene.aids, name, smoothed, odometer)
                label = f"{name}{', smoothed' if smoothed else ''}{' + odo' if odometer else ''}"
                yield label, figures(scene, _bare(scene, places, spread))


def beside_rtklib(scene: Scene, files: list[Path]) -> Iterator[tuple[str, dict[str, float]]]:
    """RTKLIB's own single-point positioning of the same files, and ours at the epochs that it has, for both alike."""
    raw = read_logs(files).raw
    if raw is None:
        return
    places = library_single_points(raw.signals, files)
    yield "RTKLIB, single points", figures(scene, _bare(scene, places, None))
    solved = np.asarray(np.isfinite(places).all(axis=1))
    there = replace(scene, truth_m=np.where(solved[:, None], scene.truth_m, np.nan))
    for label, smooth in (("one-sided filter, there", False), ("one-sided smoothed, there", True)):
        yield label, row(there, SOLVERS["one-sided"], {"smooth": smooth, "odometer": False}, 1)


def _bare(scene: Scene, places: Floats, spread: Floats | None) -> Solution:
    m = len(scene.measured)
    covariance = np.full((m, 6, 6), np.nan)
    if spread is not None:
        covariance[:, :3, :3] = spread
    rows = np.full(len(scene.measured.satellite), np.nan)
    return Solution(
        places, np.full((m, 3), np.nan), covariance, np.full(m, np.nan), rows, rows, np.zeros(m, bool)
    )


def show(label: str, values: dict[str, float]) -> None:
    """One line of the table."""
    if not values.get("epochs"):
        print(f"{label:28} no position at all")
        return
    flat = f"{values['mean_m']:9.2f} {values['median_m']:7.2f} {values['p95_m']:7.2f}"
    rest = f"{values['mean_3d_m']:9.2f} {values.get('spread_m', 0.0):7.2f} {100 * values['within_95']:6.1f}"
    cost = f"{values['ms_per_epoch']:7.3f}" if "ms_per_epoch" in values else "      -"
    print(f"{label:28} {flat} {rest} {values['sigma_m']:7.2f} {values['missing']:6.0f} {cost}", flush=True)


def main() -> None:
    """Read the log, print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", nargs="?", type=Path, help="smartLoc's folder")
    parser.add_argument(
        "--convert", type=Path, metavar="OUTDIR", help="write smartLoc as the project's CSV files"
    )
    parser.add_argument("--rinex", nargs="+", type=Path, metavar="FILE", help="observations, then navigation")
    parser.add_argument("--truth", type=Path, metavar="CSV")
    parser.add_argument(
        "--solver", action="append", default=[], metavar="NAME", help="only these; repeatable"
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--skip-literature", action="store_true")
    args = parser.parse_args()
    if args.convert and args.folder:
        print(*smartloc.convert(args.folder, args.convert), sep="\n")
        return
    if bool(args.rinex) == bool(args.folder) or bool(args.rinex) != bool(args.truth):
        parser.error("give smartLoc's folder, or --rinex with --truth")
    scene = recorded(args.rinex, args.truth) if args.rinex else smartloc.read(args.folder)
    true = int(np.isfinite(scene.truth_m).all(axis=1).sum())
    print(f"{len(scene.measured)} epochs, {true} with truth; {', '.join(scene.measured.groups)}")
    print(
        f"{'':28} {'2-D mean  median     p95':>25} {'3-D':>9} {'spread':>7} {'in 95':>6} {'sigma':>7}   none      ms"
    )
    table: dict[str, dict[str, float]] = {}
    for label, values in solvers(scene, args.solver, args.seeds):
        show(label, values)
        table[label if label.strip() == label else f"{list(table)[-1]} {label.strip()}"] = values
    if not args.skip_literature:
        own = beside_rtklib(scene, args.rinex) if args.rinex else ()
        for label, values in (*own, *literature(scene)):
            show(label, values)
            table[label] = values
    write_json(args.json, table)


if __name__ == "__main__":
    main()
