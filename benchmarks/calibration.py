#!/usr/bin/env python3
"""Simulation-based calibration: do slopes err as their sigmas say, on data drawn from the very model?

    python benchmarks/calibration.py [--seeds 10] [--first 0] [--segments 24] [--drives 1,3,10,40]
                                     [--sets all,altitude only] [--json FILE]

Each seed is a road (``accuracy.road_draws``): segments of random lengths, a grade that walks at random with random
roughness, changes of grade at plain nodes as ``fusion.network.joints`` believes in. As many drives as the largest
of ``--drives`` go over it, with exact horizontal velocities and with sensors that err as method ``profile`` assumes, at
random levels; half of them have Gaussian noise in pitch and force, half Student's t. For each
set of sensors each log goes through ``run_drive``, with the others switched off by the method's options, and groups of
drives through ``solve_network``; a draw is one such group, and a road gives ``GROUPS`` of each size at most.

Places are wrong as they are believed to be: the map has its nodes elsewhere along the road than they are
(``published.PLACE_SIGMA_M``), the same for all drives, and slopes are true between where they are; positions wander
along the road by the accuracy that they state.

Altimeters are late as it is believed of them. What the network believes in beyond that and the data do not have: steps
of height at nodes, which the drive's own model does not know either.

Printed for each set, number of drives and class of length: slopes, RMSE, mean stated sigma, share within 1.96 sigma and
the root mean square of error over sigma; ``low`` and ``high`` mark shares outside 93 to 97 % of at least 300 slopes.
Then whether the ranks Phi((true - slope) / sigma) are uniform: chi-square over 20 bins and its p, once of all slopes
(whose errors hang together within a draw, so that p is too small) and once of one random slope a draw. Last the noise
levels that drives learned over the true ones: geometric mean, and after the x the factor by which they scatter. The
method's white levels are scales of Student's t with 5 degrees of freedom, for which Gaussian noise of sigma 1 has
``GAUSSIAN_SCALE``; truths of Gaussian noise have been multiplied by that. ``shared``, the part of a pitch error in the
force, is 0 in truth; it raises the force's level, which is of what is left of the force.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from accuracy.arguments import parser_of
from accuracy.calibration_tables import LEVELS, Cell, Draw, Ratio, gaussian_scale, show
from accuracy.model_draws import FREEDOM, RATES, DrawnDrive, draw_drive
from accuracy.road_draws import DrawnRoad, draw_road
from accuracy.scoring import show_progress, write_json
from fusion.errors import FusionError
from fusion.methods.base import DriveResult
from fusion.network import drive_beliefs
from fusion.pipeline import run_drive
from fusion.roads.table import rows_of
from fusion.together import FusedDrive, solve_network

SENSORS = ("altitude", "doppler", "pitch", "force", "barometer")
SENSOR_SETS: dict[str, tuple[str, ...]] = {
    "all": SENSORS,
    **{f"no {one}": tuple(s for s in SENSORS if s != one) for one in SENSORS},
    **{f"{one} only": (one,) for one in ("altitude", "barometer", "doppler")},
}
GROUPS = 4
"""So many draws of each number of drives a road gives at most."""


GAUSSIAN_SCALE = gaussian_scale(FREEDOM)


def run_seed(
    seed: int, segments: int, counts: Sequence[int], sets: Sequence[str]
) -> tuple[dict[Cell, list[Draw]], list[Ratio]]:
    """All draws on the road of a seed, and what its drives learned."""
    rng = np.random.default_rng([seed, 1])
    road = draw_road(rng, segments)
    fleet_s = rng.normal(*drive_beliefs.LAG_MEAN_S)
    drives = [
        draw_drive(rng, road, k, rng.normal(fleet_s, drive_beliefs.LAG_SIGMA_S)) for k in range(max(counts))
    ]
    draws: dict[Cell, list[Draw]] = {}
    ratios: list[Ratio] = []
    for name in sets:
        options = {sensor: sensor in SENSOR_SETS[name] for sensor in SENSORS}
        fused = []
        for drive in drives:
            try:
                network, result = run_drive(drive.log, road.table, None, options=options)
            except FusionError:
                continue
            fused.append(FusedDrive(rows_of(road.table, network.table), result, drive.log.fix.time_s))
            ratios += _ratios(name, drive, result)
        for count in counts:
            groups = [fused[k : k + count] for k in range(0, len(fused) - count + 1, count)]
            draws[Cell(name, count)] = [_draw(road, group, rng) for group in groups[:GROUPS]]
    return draws, ratios


def _ratios(name: str, drive: DrawnDrive, result: DriveResult) -> list[Ratio]:
    out = []
    for level, sensor in LEVELS.items():
        if sensor is not None and sensor not in SENSOR_SETS[name]:
            continue
        true, label = drive.level(level), level
        if level not in RATES:
            heavy = drive.heavy and level in ("pitch", "force")
            true *= 1.0 if heavy else GAUSSIAN_SCALE
            label += " (t)" if heavy else ""
        label += f", {drive.rate_hz:g} Hz"
        out.append(Ratio(name, label, result.report["noise"][level] / true))
    if {"pitch", "force"} <= set(SENSOR_SETS[name]):
        # None of the pitch's error is in the force: what is learned of it is given as 1 plus itself.
        out.append(Ratio(name, f"1 + shared, {drive.rate_hz:g} Hz", 1 + result.report["noise"]["shared"]))
    return out


def _draw(road: DrawnRoad, fused: Sequence[FusedDrive], rng: np.random.Generator) -> Draw:
    parts = solve_network(road.table, None, fused).parts
    rows = np.array(sorted(parts), np.int64)
    estimates = np.array(
        [(parts[r][0].slope_percent, parts[r][0].slope_sigma_percent) for r in rows.tolist()]
    )
    return Draw(
        road.table.length_m[rows],
        road.slopes_percent()[rows],
        estimates[:, 0],
        estimates[:, 1],
        int(rng.integers(len(rows))),
    )


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--segments", type=int, default=24, help="of each road")
    parser.add_argument("--drives", default="1,3,10,40", metavar="N[,N...]")
    parser.add_argument("--sets", default=",".join(SENSOR_SETS), help="only these, separated by commas")
    args = parser.parse_args()
    counts, sets = [int(n) for n in args.drives.split(",")], args.sets.split(",")
    unknown = [name for name in sets if name not in SENSOR_SETS]
    if unknown:
        parser.error(f"no such sets of sensors: {', '.join(unknown)}; there are: {', '.join(SENSOR_SETS)}")
    draws: dict[Cell, list[Draw]] = {Cell(name, count): [] for name in sets for count in counts}
    ratios: list[Ratio] = []
    for seed in range(args.first, args.first + args.seeds):
        show_progress(f"seed {seed}")
        of_seed, learned = run_seed(seed, args.segments, counts, sets)
        for cell, of_cell in of_seed.items():
            draws[cell] += of_cell
        ratios += learned
    show_progress("")
    write_json(args.json, show(draws, ratios, sets))


if __name__ == "__main__":
    main()
