#!/usr/bin/env python3
"""The thesis's simulated run through street canyons, over many seeds: its tables 4.3 and 3.10 beside ours.

    python benchmarks/street_canyon.py [--seeds 20] [--scenes study blurred more urban] [--readings ours thesis]
                                       [--solvers NAME ...] [--particles N ...] [--json FILE]

Viandier 2011 drives 594 epochs at 1 Hz through a scene of Rouen that is not public. Here route, fronts and sky are
drawn anew for each seed (``fusion.published.canyon``). Solvers take pseudoranges and C/N0 alone, as in the thesis: no
range rates, no odometer. Scenes:

  study    range + detour + N(0, 1), clock 0, GPS alone, the reception state known (C/N0 tells it without error)
  blurred  the same, but C/N0 fades and fronts differ in what they swallow: some states are told wrong
  more     as study, with Galileo beside GPS: twice the satellites
  urban    as study, between urban fronts all the way

Readings: ``ours`` are the defaults of the solvers, made for real receivers: noises of 2 m and more that follow C/N0 and
elevation, errors that last. ``thesis`` is what its simulation gave its filters, as far as options and input can
say it: EKF and PF know white noise alone, alike for all satellites (C/N0 and elevation withheld), JMS-GMM and RBPF-DPM
know the state beside that; errors do not last; base measures of Table 3.9. ``one-sided`` is the same in both.

For each solver: mean 3-D error, share of epochs within 5 m, MUT, MDT and MTBF, each the mean over the seeds with the
half width of its 95 % interval, beside the published figure; coverage of the 95 % ellipses. Then the published order,
each pair over the same seeds; then density tracking of the satellite that is reflected most, and of one that is
reflected least. ``--particles``: besides, the PF with so many particles on the study scene, beside the EKF. Both know
the same law, so that the cloud can but tend to the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats

from accuracy.arguments import parser_of
from accuracy.scoring import text_table, write_json
from fusion.catalogue import ERROR_MODELS, SOLVERS
from fusion.gnss.error_models.base import Series, share_within
from fusion.gnss.measurements import Aids, Measurements
from fusion.gnss.reception import THRESHOLDS_DBHZ
from fusion.published.canyon.drive import CanyonDrive
from fusion.published.positioning.dpm import LOS_SIMULATED
from fusion.signals import GALILEO, GPS
from fusion.types import Floats, no_progress
from published.positioning import canyon_slopes
from published.positioning.metrics import PositionMetrics, position_metrics
from published.positioning.rouen import BLURRED, rouen

SCENES: dict[str, Callable[[int], CanyonDrive]] = {
    "study": rouen,
    "blurred": lambda seed: rouen(seed, BLURRED),
    "more": lambda seed: rouen(seed, systems=(GPS, GALILEO)),
    "urban": lambda seed: rouen(seed, shares={"urban": 1.0}),
}
PUBLISHED = {
    "ekf": (6.02, 0.62, 10.6, 6.4, 17.0),
    "pf": (4.28, 0.80, 12.5, 3.1, 15.6),
    "jms-gmm": (2.86, 0.87, 15.5, 2.2, 17.7),
    "rbpf-dpm": (1.90, 0.97, 38.3, 1.2, 39.5),
}
"""Table 4.3: mean error (m), share within 5 m, MUT, MDT, MTBF (s); the thesis's FP is an FPLL filter, as ``pf`` is."""
ORDER = tuple(PUBLISHED)
PUBLISHED_DENSITY = {
    ("dpm", "reflected most"): (0.8552, 0.9326, 0.9638),
    ("gmm", "reflected most"): (0.7626, 0.8809, 0.9090),
    ("dpm", "reflected least"): (0.8282, 0.9343, 0.9781),
    ("gmm", "reflected least"): (0.6532, 0.8754, 0.9276),
}
"""Table 3.10: satellite 13 (non-stationary) and 18 (always direct), within 1, 2 and 3 sigma."""
SEEN_SHARE = 0.5
"""A satellite whose density is tracked is measured in this share of the epochs or more."""
STRONG_DBHZ = 80.0
"""At this C/N0 and at the zenith every pseudorange counts alike, with 2 m, the least noise that solvers know."""
KNOW_STATES = ("jms-gmm", "rbpf-dpm")
_WHITE = {"tau_s": 1.0}
"""Errors that last no longer than an epoch."""
THESIS_OPTIONS: dict[str, dict[str, Any]] = {
    "ekf": _WHITE,
    "pf": _WHITE,
    "jms-gmm": _WHITE,
    "rbpf-dpm": _WHITE
    | {
        "los_alpha": LOS_SIMULATED.alpha,
        "los_k": LOS_SIMULATED.k,
        "los_dof": LOS_SIMULATED.dof,
        "los_scale_m2": LOS_SIMULATED.scale_m2,
    },
}
READINGS = ("ours", "thesis")
Found = dict[str, list[PositionMetrics]]


def measurements_for(drive: CanyonDrive, name: str, reading: str) -> tuple[Measurements, dict[str, Any]]:
    """What a solver is given of a drive, and its options."""
    measured = drive.measurements()
    measured = replace(measured, range_rate_mps=np.full(len(measured.satellite), np.nan))
    if reading == "ours" or name not in PUBLISHED:
        return measured, {}
    cn0 = np.full(len(measured.satellite), STRONG_DBHZ)
    if name in KNOW_STATES:
        cn0[measured.cn0_dbhz < THRESHOLDS_DBHZ["u-blox"]] = THRESHOLDS_DBHZ["u-blox"] - 0.1
    zenith = np.full(len(cn0), np.pi / 2)
    return replace(measured, cn0_dbhz=cn0, elevation_rad=zenith), THESIS_OPTIONS[name]


def run_scene(drives: list[CanyonDrive], names: list[str], reading: str) -> Found:
    """Metrics of each solver by drive, whose number is the solver's seed."""
    results: Found = {name: [] for name in names}
    for seed, drive in enumerate(drives):
        for name in names:
            solver = SOLVERS[name]
            measured, options = measurements_for(drive, name, reading)
            aids = Aids.none(len(measured))
            solution = solver.solve(measured, aids, solver.options_model(**options), seed, no_progress)
            results[name].append(position_metrics(measured.time_s, solution, drive.ride.position_m))
    return results


def print_clouds(drives: list[CanyonDrive], counts: list[int]) -> None:
    """The mean error of the particle filter by the number of its particles, and the EKF's."""
    for name, count in (*(("pf", n) for n in counts), ("ekf", 0)):
        solver, errors = SOLVERS[name], []
        for seed, drive in enumerate(drives):
            measured, _ = measurements_for(drive, name, "ours")
            options = solver.options_model(**({"particles": count} if count else {}))
            solution = solver.solve(measured, Aids.none(len(measured)), options, seed, no_progress)
            errors.append(position_metrics(measured.time_s, solution, drive.ride.position_m).mean_3d_m)
        mean, half = interval(np.array(errors))
        print(f"  {name} {count or '':>6}: {mean:6.2f} ± {half:.2f} m")


def interval(values: Floats) -> tuple[float, float]:
    """Mean and half width of its 95 % interval over the seeds; NaN are left out."""
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if len(finite) < 2:
        return (float(finite.mean()) if len(finite) else np.nan), np.nan
    half = stats.t.ppf(0.975, len(finite) - 1) * finite.std(ddof=1) / np.sqrt(len(finite))
    return float(finite.mean()), float(half)


def describe(drives: list[CanyonDrive]) -> str:
    """What the scene is like."""
    tracked = np.concatenate([np.diff(d.sky.first) for d in drives])
    reflected = np.mean([d.reflected.mean() for d in drives])
    detour = np.concatenate([d.error_m[d.reflected] for d in drives])
    return (
        f"{tracked.mean():.1f} satellites tracked ({np.mean(tracked < 4):.1%} of epochs under 4), {reflected:.1%} of "
        f"rows reflected, longer by {np.median(detour):.1f} m (median), {np.quantile(detour, 0.95):.1f} m (95 %)"
    )


def print_positions(results: Found) -> None:
    """Table 4.3."""
    print(
        f"{'':12}{'mean 3-D m':>19}{'within 5 m':>19}{'MUT s':>19}{'MDT s':>19}{'MTBF s':>19}{'covered':>9}"
    )
    for name, runs in results.items():
        columns = [
            [m.mean_3d_m for m in runs],
            [m.within_3d[1] for m in runs],
            [m.mut_s for m in runs],
            [m.mdt_s for m in runs],
            [m.mtbf_s for m in runs],
        ]
        cells = []
        for k, column in enumerate(columns):
            mean, half = interval(np.array(column))
            printed = f"[{PUBLISHED[name][k]:g}]" if name in PUBLISHED else ""
            cells.append(f"{mean:6.2f} ±{half:5.2f} {printed:>5}".rjust(19))
        covered = np.nanmean([m.coverage_2d for m in runs])
        print(f"{name:12}{''.join(cells)}{covered:9.1%}")


def print_order(results: Found) -> None:
    """Whether each solver of the published order is better than those before it, over the same seeds."""
    for worse, better in combinations([n for n in (*ORDER, "one-sided") if n in results], 2):
        gain = np.array(
            [a.mean_3d_m - b.mean_3d_m for a, b in zip(results[worse], results[better], strict=True)]
        )
        mean, half = interval(gain)
        says = "yes" if mean - half > 0 else "no, the other way" if mean + half < 0 else "not told apart"
        print(
            f"  {worse} > {better}: gain {mean:+.2f} ± {half:.2f} m, in {np.mean(gain > 0):.0%} of seeds: {says}"
        )


def followed(drive: CanyonDrive) -> dict[str, Series]:
    """The error series of the satellites reflected most and least, of those seen often."""
    measured = drive.measurements()
    rows = [np.flatnonzero(measured.satellite == k) for k in range(len(measured.names))]
    rows = [r for r in rows if len(r) >= SEEN_SHARE * len(measured)] or rows
    shares = [float(drive.reflected[r].mean()) for r in rows]
    chosen = {"reflected most": rows[int(np.argmax(shares))], "reflected least": rows[int(np.argmin(shares))]}
    return {
        name: Series(measured.time_s[measured.epoch[r]], drive.error_m[r], drive.state[r], drive.cn0_dbhz[r])
        for name, r in chosen.items()
    }


def densities(drives: list[CanyonDrive]) -> dict[tuple[str, str], list[list[float]]]:
    """Table 3.10: for each model and satellite the shares within 1, 2 and 3 sigma, by seed."""
    out: dict[tuple[str, str], list[list[float]]] = {key: [] for key in PUBLISHED_DENSITY}
    for seed, drive in enumerate(drives):
        for which, series in followed(drive).items():
            for model in ("dpm", "gmm"):
                mean, variance = ERROR_MODELS[model].track(series, seed)
                out[model, which].append([share_within(series, mean, variance, k) for k in (1, 2, 3)])
    return out


def print_densities(densities: dict[tuple[str, str], list[list[float]]]) -> None:
    """Table 3.10."""
    for (model, which), shares in densities.items():
        cells = []
        for k, published in enumerate(PUBLISHED_DENSITY[model, which]):
            mean, half = interval(np.array([s[k] for s in shares]))
            cells.append(f"{k + 1} sigma {mean:6.1%} ± {half:5.1%} [{published:.1%}]")
        print(f"  {model}, satellite {which}: {'   '.join(cells)}")


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, help="default 20, of slopes 5")
    parser.add_argument(
        "--slopes", action="store_true", help="slopes of drives through simulated towns instead"
    )
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=["study"])
    parser.add_argument("--readings", nargs="+", choices=READINGS, default=list(READINGS))
    parser.add_argument("--solvers", nargs="+", metavar="NAME", default=list(SOLVERS))
    parser.add_argument("--particles", nargs="+", type=int, metavar="N")
    args = parser.parse_args()
    if args.slopes:
        rows = canyon_slopes.run(args.seeds or 5)
        print(text_table(rows, canyon_slopes.COLUMNS))
        write_json(args.json, rows)
        return
    report: dict[str, Any] = {}
    for scene in args.scenes:
        drives = [SCENES[scene](seed) for seed in range(args.seeds or 20)]
        print(f"{scene}: {len(drives)} seeds, {describe(drives)}; [published] of table 4.3")
        positions = {}
        for reading in args.readings:
            results = run_scene(drives, args.solvers, reading)
            print(f"reading {reading}")
            print_positions(results)
            print_order(results)
            positions[reading] = {name: [asdict(m) for m in runs] for name, runs in results.items()}
        tracked = densities(drives)
        print("density tracking, [published] of table 3.10; a sound normal model: 68.3, 95.4, 99.7 %")
        print_densities(tracked)
        print(flush=True)
        report[scene] = {
            "positions": positions,
            "density": {f"{model}, {which}": shares for (model, which), shares in tracked.items()},
        }
    if args.particles:
        print("particles, study scene")
        print_clouds([rouen(seed) for seed in range(args.seeds)], args.particles)
    write_json(args.json, report)


if __name__ == "__main__":
    main()
