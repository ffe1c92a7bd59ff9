#!/usr/bin/env python3
"""Whether a cheaper filter gives the answer of 100,000 particles, and in what part of their time.

    PYTHONPATH=.:benchmarks python -m published.particle.cheap_filter DATA_DIR [--filters ekf,kf] [--roads 09,10,town]
        [--seeds 8] [--filter-seeds 2] [--particles 100000] [--profile m8|phone|f9p] [--cut 60:40] [--rounds 3]
        [--json FILE]

DATA_DIR holds the karlsruhe sequences (see ``slope_accuracy.py``); beside its drives 09 and 10 stands the simulated
town. Each filter of method ``particle`` takes the same logs, one a drive seed; the cloud takes each log with several
filter seeds. Truth is the slope of each segment.

For each road and filter: mean RMSE over the drives in percent of slope, its spread (one standard deviation) over the
drive seeds, what the cloud's own seed changes in a slope (rms of the difference of two clouds, divided by sqrt 2), the
rms difference of a slope from the mean of the clouds, the share within 1.96 sigma; ratios of RMSE and of spread to the
cloud's. Then seconds: the whole method after reading the log (epochs, mount, filter, slopes), its ratio, and the filter
alone per epoch (with the terrain's windows) and its ratio: medians of rounds that take the filters in turn, on the
first drive.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.arguments import parser_of
from accuracy.scoring import rms, write_json
from accuracy.sequences import find_sequences, load_tool, make_log
from fusion.catalogue import METHODS
from fusion.formats import read_log
from fusion.pipeline import road_boxes
from fusion.published.particle.method import prepare, threads_for
from fusion.published.particle.options import ParticleOptions
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, no_progress

Key = tuple[int, int, int]
Slopes = dict[Key, tuple[float, float]]
Figures = dict[str, Any]
"""One row of the table, by column: names as text, figures as numbers."""
CLOUD = "sir"


@dataclass(frozen=True)
class Drive:
    """One log with what lies around it."""

    log: DriveLog
    network: RoadNetwork
    dem: Dem | None
    truth: dict[Key, float]

    def keys(self) -> list[Key]:
        """The identity of every segment."""
        return keys_of(self.network.table)


def keys_of(table: RoadTable) -> list[Key]:
    """(way, from, to) of every segment."""
    return list(zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True))


def drive_of(path: Path, roads: RoadTable, dem: Dem | None, truth: dict[Key, float]) -> Drive:
    """A log as the pipeline hands it to a method."""
    log = read_log(path)
    return Drive(log, RoadNetwork.project(roads.along(road_boxes(log))), dem, truth)


def roads_of(args: argparse.Namespace, folder: Path) -> Iterator[tuple[str, list[Drive]]]:
    """Each road with its drives."""
    tool = load_tool(args.roadtruth or args.data_dir.parent.parent / "tools" / "roadtruth.py")
    for sequence in find_sequences(args.data_dir):
        if sequence.name in args.roads.split(","):
            logs = [
                make_log(tool, sequence, seed, folder, args.profile, args.cut) for seed in range(args.seeds)
            ]
            truth = {key: true.slope_percent for key, true in sequence.truth.items()}
            yield sequence.name, [drive_of(log, sequence.roads, sequence.dem, truth) for log in logs]
    if "town" not in args.roads.split(","):
        return
    town = make_town(seed=1)
    write_dem(town, folder / "dem.tif")
    dem = Dem.open([folder / "dem.tif"])
    truth = dict(zip(keys_of(town.roads), town.true_slope_percent.tolist(), strict=True))
    outages = [(float(begin), float(length)) for begin, length in (cut.split(":") for cut in args.cut or [])]
    drives = []
    for seed in range(args.seeds):
        path = folder / f"town_{seed}.csv"
        write_csv(simulate_drive(town, seed, duration_s=400, receiver=args.profile, outages=outages), path)
        drives.append(drive_of(path, town.roads, dem, truth))
    yield "town", drives


def slopes_of(drive: Drive, options: ParticleOptions) -> tuple[Slopes, float]:
    """Slopes and their sigmas by segment, and the seconds that the method took."""
    begin = time.perf_counter()
    result = METHODS["particle"].estimate(drive.log, drive.network, drive.dem, options, no_progress)
    seconds = time.perf_counter() - begin
    keys = drive.keys()
    return {keys[s.segment]: (s.slope_percent, s.slope_sigma_percent) for s in result.slopes}, seconds


def filter_seconds(drive: Drive, options: ParticleOptions) -> float:
    """Seconds per epoch of the filter alone, the windows of the terrain included."""
    run, _ = prepare(drive.log, drive.network, drive.dem, options)
    begin = time.perf_counter()
    with threads_for(options.particles):
        run.run(no_progress)
    return (time.perf_counter() - begin) / len(run.epochs)


def differences(one: Slopes, other: Slopes) -> Floats:
    """One minus the other, on the segments of both."""
    return np.array([one[key][0] - other[key][0] for key in one if key in other])


def errors(drive: Drive, slopes: Slopes) -> tuple[Floats, Floats]:
    """Errors and sigmas on the segments whose truth is known."""
    keys = [key for key in slopes if key in drive.truth]
    slope, sigma = np.array([slopes[key] for key in keys]).T
    return slope - np.array([drive.truth[key] for key in keys]), sigma


def row_of(
    name: str, drives: list[Drive], estimates: list[list[Slopes]], clouds: list[list[Slopes]]
) -> Figures:
    """Accuracy of one filter: ``found`` by drive and filter seed, beside the ``clouds``."""
    scores = np.array(
        [[rms(errors(d, s)[0]) for s in runs] for d, runs in zip(drives, estimates, strict=True)]
    )  # drives, filter seeds
    inside = [
        np.abs(e) <= 1.96 * sigma
        for d, runs in zip(drives, estimates, strict=True)
        for e, sigma in (errors(d, s) for s in runs)
    ]
    other_seed = [differences(runs[0], run) for runs in estimates for run in runs[1:]]
    mean_clouds = [
        {key: (float(np.mean([run[key][0] for run in runs if key in run])), 0.0) for key in runs[0]}
        for runs in clouds
    ]
    from_clouds = [differences(runs[0], mean) for runs, mean in zip(estimates, mean_clouds, strict=True)]
    return {
        "filter": name,
        "rmse_percent": float(scores.mean()),
        "spread_percent": float(np.mean(scores.std(axis=0))),
        "own_seed_percent": rms(np.concatenate(other_seed)) / 2**0.5 if other_seed else 0.0,
        "from_clouds_percent": rms(np.concatenate(from_clouds)),
        "within_95": float(np.mean(np.concatenate(inside))),
    }


def run(args: argparse.Namespace) -> list[Figures]:
    """Every road, every filter."""
    names = [CLOUD, *args.filters.split(",")]
    options = {
        name: [
            ParticleOptions(filter=name, particles=args.particles, seed=seed)
            for seed in range(args.filter_seeds if name == CLOUD else 1)
        ]
        for name in names
    }
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for road, drives in roads_of(args, Path(folder)):
            estimates = {n: [[slopes_of(d, o)[0] for o in options[n]] for d in drives] for n in names}
            rounds = [
                {
                    n: (slopes_of(drives[0], options[n][0])[1], filter_seconds(drives[0], options[n][0]))
                    for n in names
                }
                for _ in range(args.rounds)
            ]
            for name in names:
                row = {"road": road, **row_of(name, drives, estimates[name], estimates[CLOUD])}
                row["seconds"] = statistics.median(r[name][0] for r in rounds)
                row["seconds_per_epoch"] = statistics.median(r[name][1] for r in rounds)
                rows.append(row)
    for row in rows:
        cloud = next(r for r in rows if r["road"] == row["road"] and r["filter"] == CLOUD)
        row["rmse_ratio"] = row["rmse_percent"] / cloud["rmse_percent"]
        row["spread_ratio"] = row["spread_percent"] / cloud["spread_percent"]
        row["faster"] = cloud["seconds"] / row["seconds"]
        row["filter_faster"] = cloud["seconds_per_epoch"] / row["seconds_per_epoch"]
    return rows


def show(rows: list[Figures]) -> None:
    """The table a person reads."""
    print(
        f"{'road':5} {'filter':6} {'RMSE %':>7} {'ratio':>6} {'spread':>7} {'ratio':>6} {'own seed':>8} {'from sir':>8}"
        f" {'in 1.96s':>8} {'method s':>9} {'faster':>7} {'us/epoch':>9} {'faster':>7}"
    )
    for r in rows:
        print(
            f"{r['road']:5} {r['filter']:6} {r['rmse_percent']:7.3f} {r['rmse_ratio']:6.3f} {r['spread_percent']:7.3f}"
            f" {r['spread_ratio']:6.3f} {r['own_seed_percent']:8.3f} {r['from_clouds_percent']:8.3f}"
            f" {r['within_95']:8.1%} {r['seconds']:9.4f} {r['faster']:7.1f} {1e6 * r['seconds_per_epoch']:9.1f}"
            f" {r['filter_faster']:7.1f}"
        )


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("--filters", default="ekf,kf", help="what to hold against the cloud")
    parser.add_argument("--roads", default="09,10,town")
    parser.add_argument("--seeds", type=int, default=8, help="drives over each road")
    parser.add_argument("--filter-seeds", type=int, default=2, help="seeds of the cloud on each drive")
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--profile", default="m8", choices=("m8", "phone", "f9p"))
    parser.add_argument("--cut", action="append", metavar="START:LENGTH", help="seconds without GNSS")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--roadtruth", type=Path)
    args = parser.parse_args()
    rows = run(args)
    show(rows)
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
