#!/usr/bin/env python3
"""User time of method ``profile`` for drives of 1, 2, 4 and 8 hours in a large road network.

    python benchmarks/profile_speed.py ROADS.osm.pbf [--hours 1,2,4,8] [--repeats 3] [--seed 1] [--json FILE]

A vehicle wanders over the roads of the file at the speeds of their classes, over hills made of waves, and logs
positions, Doppler velocity, specific force and pitch at 1 Hz with the errors of an ordinary receiver. The network is
loaded once and its time printed apart; each drive is then estimated ``--repeats`` times after one that compiles.
Printed: user time (median), the same per hour driven and its ratio to the shortest drive's (1 means linear), the
epochs, the segments driven, and the share of them within 1.96 sigma of the truth (a speed that comes from a wrong path
is no use).
"""

from __future__ import annotations

import resource
import statistics
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accuracy.arguments import parser_of
from accuracy.scoring import write_json
from fusion.frames import GRAVITY_MPS2, LocalProjection
from fusion.pipeline import run_drive
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.types import Attitude, DriveLog, Floats, GnssFix, GnssVelocity, Ints, SegmentSlope, SpecificForce

SPEEDS_MPS = {"motorway": 30.0, "trunk": 25.0, "primary": 18.0, "secondary": 15.0, "tertiary": 13.0}
ACCELERATION_MPS2 = 1.2
MOUNT_RAD = 0.02
START_S = 1_700_000_000.0
WAVES = ((900.0, 12.0), (350.0, 4.0), (140.0, 0.8))


def wander(table: RoadTable, length_m: float, rng: np.random.Generator) -> tuple[Ints, NDArray[np.bool_]]:
    """Segments in driving order and their directions: straight on where possible, never back unless at a dead end."""
    arms: dict[int, list[tuple[int, bool]]] = {}
    for row, (a, b, way) in enumerate(
        zip(table.from_node.tolist(), table.to_node.tolist(), table.oneway.tolist(), strict=True)
    ):
        if way >= 0:
            arms.setdefault(a, []).append((row, True))
        if way <= 0:
            arms.setdefault(b, []).append((row, False))
    driven = np.zeros(len(table), int)
    rows, forwards, total = [], [], 0.0
    row, forward = int(rng.integers(len(table))), True
    while total < length_m:
        rows.append(row)
        forwards.append(forward)
        driven[row] += 1
        total += float(table.length_m[row])
        node = int(table.to_node[row] if forward else table.from_node[row])
        choices = [c for c in arms.get(node, []) if c[0] != row] or arms.get(node, [])
        if not choices:  # the map's edge at the end of a one-way street
            choices = [(row, not forward)]
        # Roads that were driven least; big ones before small ones, so that the drive gets about.
        quiet = [driven[r] - (0.5 if table.highway[r] in SPEEDS_MPS else 0.0) for r, _ in choices]
        least = [c for c, q in zip(choices, quiet, strict=True) if q == min(quiet)]
        row, forward = least[int(rng.integers(len(least)))]
    return np.array(rows), np.array(forwards)


def terrain(x_m: Floats, y_m: Floats) -> Floats:
    """Height of the hills."""
    return np.asarray(
        sum(h * np.sin(2 * np.pi * (x_m + 0.6 * y_m) / w) * np.cos(2 * np.pi * y_m / w) for w, h in WAVES)
    )


def record(table: RoadTable, hours: float, seed: int) -> tuple[DriveLog, Ints, Floats]:
    """A log, the segments driven, and the true slope (%) of every segment."""
    rng = np.random.default_rng(seed)
    projection = LocalProjection.around(table.lon0_deg, table.lat0_deg)
    rows, forward = wander(table, hours * 3600 * 20.0, rng)
    x0, y0 = projection.to_xy(table.lon0_deg, table.lat0_deg)
    x1, y1 = projection.to_xy(table.lon1_deg, table.lat1_deg)
    px = np.concatenate(
        [[np.where(forward[0], x0[rows[0]], x1[rows[0]])], np.where(forward, x1[rows], x0[rows])]
    )
    py = np.concatenate(
        [[np.where(forward[0], y0[rows[0]], y1[rows[0]])], np.where(forward, y1[rows], y0[rows])]
    )
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(px), np.diff(py)))])
    limit = np.array([SPEEDS_MPS.get(str(table.highway[r]), 9.0) for r in rows])
    heading = np.arctan2(np.diff(py), np.diff(px))
    limit[1:] = np.minimum(limit[1:], 4 + 26 * np.clip(np.cos(np.diff(heading)), 0, 1) ** 2)
    grid = np.arange(0.0, along[-1], 2.0)
    speed = limit[np.clip(np.searchsorted(along, grid, side="right") - 1, 0, len(limit) - 1)]
    for order in (range(1, len(grid)), range(len(grid) - 2, -1, -1)):
        step = 1 if order.step > 0 else -1
        for k in order:
            speed[k] = min(speed[k], float(np.sqrt(speed[k - step] ** 2 + 4 * ACCELERATION_MPS2)))
    clock = np.concatenate([[0.0], np.cumsum(2.0 / (0.5 * (speed[1:] + speed[:-1])))])
    t = np.arange(0.0, min(hours * 3600, clock[-1]), 1.0)
    return (
        _log(projection, rng, t, np.interp(t, clock, grid), np.interp(t, clock, speed), along, px, py),
        rows,
        (100 * (terrain(x1, y1) - terrain(x0, y0)) / np.maximum(np.hypot(x1 - x0, y1 - y0), 0.1)),
    )


def _log(
    projection: LocalProjection, rng: np.random.Generator, t: Floats, s: Floats, v: Floats, along: Floats,
    px: Floats, py: Floats,
) -> DriveLog:  # fmt: skip
    """What the sensors say."""
    n = len(t)
    height = np.interp(s, along, terrain(px, py))
    row = np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(px) - 2)
    run = np.maximum(along[row + 1] - along[row], 0.1)
    grade = (terrain(px, py)[row + 1] - terrain(px, py)[row]) / run
    east, north = np.diff(px)[row] / run, np.diff(py)[row] / run

    def wandering(sigma: float, tau_s: float) -> Floats:
        a = np.exp(-1 / tau_s)
        out = np.empty(n)
        out[0], shocks = sigma * rng.normal(), sigma * np.sqrt(1 - a * a) * rng.normal(size=n)
        for k in range(1, n):
            out[k] = a * out[k - 1] + shocks[k]
        return out

    lon, lat = projection.to_lonlat(
        np.interp(s, along, px) + wandering(1.0, 100) + 0.3 * rng.normal(size=n),
        np.interp(s, along, py) + wandering(1.0, 100) + 0.3 * rng.normal(size=n),
    )
    time_s, nothing = START_S + t, np.full(n, np.nan)
    springs = 0.01 * rng.normal(size=n)
    force = np.gradient(v, t) + GRAVITY_MPS2 * (grade + MOUNT_RAD + springs) + 0.05 * rng.normal(size=n)
    return DriveLog(
        source_format="benchmark",
        fix=GnssFix(
            time_s, lat, lon, height + wandering(3.0, 120) + 0.5 * rng.normal(size=n), nothing,
            np.full(n, 2.0), np.full(n, 3.5),
        ),
        velocity=GnssVelocity(
            time_s, v * north + 0.05 * rng.normal(size=n), v * east + 0.05 * rng.normal(size=n),
            -v * grade + 0.1 * rng.normal(size=n), np.full(n, 0.11),
        ),
        force=SpecificForce(time_s, force, nothing, np.full(n, GRAVITY_MPS2)),
        attitude=Attitude(
            time_s, np.zeros(n), np.arctan(grade + MOUNT_RAD + springs) + 0.0035 * rng.normal(size=n),
            np.arctan2(east, north), nothing, nothing, nothing,
        ),
    )  # fmt: skip


def user_s() -> float:
    """User time of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("roads", type=Path)
    parser.add_argument("--hours", default="1,2,4,8")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    begin = time.perf_counter()
    table = read_roads(args.roads)
    print(f"{len(table):,} segments loaded in {time.perf_counter() - begin:.2f} s")
    run_drive(record(table, 0.1, args.seed)[0], table, None, method="profile")
    rows = []
    print(
        f"{'hours':>6} {'epochs':>8} {'segments':>9} {'user s':>8} {'s/hour':>8} {'ratio':>6} {'in 1.96s':>9}"
    )
    for hours in (float(h) for h in args.hours.split(",")):
        log, driven, true = record(table, hours, args.seed)
        times = []
        for _ in range(args.repeats):
            before = user_s()
            network, result = run_drive(log, table, None, method="profile")
            times.append(user_s() - before)
        rows.append(
            _row(hours, log, statistics.median(times), network.table, result.slopes, table, true, driven)
        )
        rows[-1]["ratio"] = rows[-1]["s_per_hour"] / rows[0]["s_per_hour"]
        r = rows[-1]
        print(
            f"{r['hours']:6.1f} {r['epochs']:8.0f} {r['segments']:9.0f} {r['user_s']:8.2f} {r['s_per_hour']:8.2f} "
            f"{r['ratio']:6.2f} {r['within']:9.1%}"
        )
    write_json(args.json, rows)


def _row(
    hours: float,
    log: DriveLog,
    seconds: float,
    near: RoadTable,
    slopes: tuple[SegmentSlope, ...],
    table: RoadTable,
    true: Floats,
    driven: Ints,
) -> dict[str, float]:
    """One line of the table."""
    identity = zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True)
    row_of = {key: row for row, key in enumerate(identity)}
    where = [
        row_of[int(near.osm_way_id[s.segment]), int(near.from_node[s.segment]), int(near.to_node[s.segment])]
        for s in slopes
    ]
    on_route = np.isin(where, driven)
    error = np.array([s.slope_percent for s in slopes]) - true[where]
    sigma = np.array([s.slope_sigma_percent for s in slopes])
    return {
        "hours": hours,
        "epochs": len(log.fix),
        "segments": len(slopes),
        "user_s": seconds,
        "s_per_hour": seconds / hours,
        "within": float(np.mean(np.abs(error[on_route]) <= 1.96 * sigma[on_route])),
    }


if __name__ == "__main__":
    main()
