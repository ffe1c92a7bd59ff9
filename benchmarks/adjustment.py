#!/usr/bin/env python3
"""How the network adjustment grows: a further drive's update on a real map, all from scratch, and all in blocks.

    python benchmarks/adjustment.py [--roads FILE.osm.pbf] [--drives N] [--repeat N] [--most N]
                                    [--skip-blocks] [--skip-service] [--json FILE]

``--drives`` made-up drives of 10 km on random routes through the map (default: Heidelberg, beside the repository), with
what receivers measured on them (``accuracy.adjustment_drives``). Seconds are of processor time, all threads together;
memory is the peak of what Python and numpy hold beyond roads and factors (tracemalloc, in a run of its own).

    update    a further drive: window, passes from their bytes, what is said elsewhere, solution. What a service reads
              from its database is at hand: roads around, passes as bytes, and what each drive says of its constants
    scratch   all drives
    agreement the update against all drives and the further one from scratch: differences of slopes within the published
              radius, in sigmas; and how far beyond it the further drive changed slopes at all
    blocks    all drives in blocks of ``--most`` segments, against all at once
    service   publishing a further drive in an embedded PostgreSQL, and taking it back (``service.adjustment``)

Aims: an update at most 0.5 s; scratch at most 10 s; 99 % of agreement within 0.1 sigma, and beyond at most 0.1 sigma.
"""

from __future__ import annotations

import statistics
import time
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from accuracy.adjustment_drives import Synthetic
from accuracy.arguments import HEIDELBERG, parser_of
from accuracy.scoring import write_json
from fusion.network.adjust import adjust
from fusion.network.blockwise.partition import Partition, bisected
from fusion.network.drive_constants import ConstantsInformation
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.subnetwork import SOLVE_RADIUS_M, Subnetwork, boxes_around, gap_rows, subnetwork_around
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

ROUTE_M = 10_000.0

Figures = dict[str, Any]
Drives = Mapping[int, Sequence[PassFactor]]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes and sigmas of all roads (n,), percent; NaN where nothing was solved."""

    slope: Floats
    sigma: Floats

    @classmethod
    def of(cls, adjustment: Adjustment, rows: Ints, size: int) -> Slopes:
        """Bring the solution of some rows to all roads."""
        slope, sigma = np.full(size, np.nan), np.full(size, np.nan)
        slope[rows], sigma[rows] = adjustment.slope_percent, adjustment.slope_sigma_percent
        return cls(slope, sigma)

    def apart(self, other: Slopes, rows: Bools) -> Floats:
        """Differences over the other's sigmas, of rows that both know."""
        both = rows & np.isfinite(self.slope) & np.isfinite(other.slope)
        return np.asarray(np.abs(self.slope - other.slope)[both] / other.sigma[both])


def driven_rows(size: int, drives: Drives) -> Bools:
    """Mask of the rows that drives passed."""
    out = np.zeros(size, bool)
    out[[p.segment for passes in drives.values() for p in passes]] = True
    return out


def inside(drives: Drives, rows: Bools) -> dict[int, list[PassFactor]]:
    """The passes over some rows, by their numbers among these."""
    number = (np.cumsum(rows) - 1).tolist()
    chosen = rows.tolist()
    slopes = {
        k: [p.over(number[p.segment]) for p in passes if chosen[p.segment]] for k, passes in drives.items()
    }
    return {k: passes for k, passes in slopes.items() if passes}


@dataclass(frozen=True, eq=False)
class Read:
    """What is read from the database for an update: roads around and their rows, passes over them and the new ones."""

    table: RoadTable
    rows: Ints
    passes: dict[int, list[tuple[bytes, int, int]]]
    said: dict[int, bytes]
    further: list[PassFactor]

    @property
    def touched(self) -> Bools:
        """The rows that the further drive passed."""
        return driven_rows(len(self.table), {-1: self.further})


class Store:
    """What a service has of roads and drives."""

    def __init__(self, roads: RoadTable, drives: Drives) -> None:
        self.roads, self.drives = roads, dict(drives)
        self.said = {k: ConstantsInformation.of_passes(passes).encode() for k, passes in drives.items()}

    def read(self, factors: Sequence[PassFactor]) -> Read:
        """What lies around the passes of a further drive."""
        rows = np.unique([p.segment for p in factors])
        r = self.roads
        lines = (r.lon0_deg[rows], r.lat0_deg[rows], r.lon1_deg[rows], r.lat1_deg[rows])
        mask = np.zeros(len(r), bool)
        for west, south, east, north in boxes_around(*lines, SOLVE_RADIUS_M + 100.0):
            for lon, lat in ((r.lon0_deg, r.lat0_deg), (r.lon1_deg, r.lat1_deg)):
                mask |= (lon >= west) & (lon <= east) & (lat >= south) & (lat <= north)
        near = inside(self.drives, mask)
        passes = {k: [(p.encode(), p.segment, p.sequence) for p in said] for k, said in near.items()}
        further = inside({-1: factors}, mask)[-1]
        return Read(r.subset(mask), np.flatnonzero(mask), passes, {k: self.said[k] for k in near}, further)


def update(read: Read) -> tuple[Adjustment, Subnetwork, dict[str, float]]:
    """A further drive, as the service does it without its database; with the seconds of each step."""
    clock, times = time.process_time, [time.process_time()]
    driven = read.touched
    driven[[row for passes in read.passes.values() for _, row, _ in passes]] = True
    window = subnetwork_around(read.table, driven, read.touched, driven)
    times.append(clock())
    number, chosen = (np.cumsum(window.solved) - 1).tolist(), window.solved.tolist()
    stored = [
        (k, data, number[row], sequence)
        for k, passes in read.passes.items()
        for data, row, sequence in passes
        if chosen[row]
    ]
    mine = inside({-1: read.further}, window.solved)
    for (k, *_), one in zip(stored, PassFactor.decode_all([s[1:] for s in stored]), strict=True):
        mine.setdefault(k, []).append(one)
    times.append(clock())
    outside = {
        k: ConstantsInformation.decode(read.said[k]) - ConstantsInformation.of_passes(passes)
        for k, passes in mine.items()
        if k >= 0
    }
    times.append(clock())
    adjustment = adjust(read.table.subset(window.solved), mine, outside=outside)
    times.append(clock())
    names = ("window", "decode", "elsewhere", "solve")
    return adjustment, window, dict(zip(names, np.diff(times).tolist(), strict=True))


def scratch(
    roads: RoadTable, drives: Drives, blocks: Callable[[RoadTable], Partition] | None = None
) -> Slopes:
    """Everything from the factors."""
    driven = driven_rows(len(roads), drives)
    use = driven | gap_rows(roads, driven)
    table = roads.subset(use)
    adjustment = adjust(table, inside(drives, use), blocks=blocks(table) if blocks else None)
    return Slopes.of(adjustment, np.flatnonzero(use), len(roads))


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """The result and seconds of processor time."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def peak_mb(work: Callable[[], object]) -> float:
    """Peak of what the work allocates, MB."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def update_part(store: Store, further: Sequence[list[PassFactor]], before: Slopes) -> Figures:
    """Updates by further drives, and how near they come to all from scratch."""
    seconds, split, within, beyond = [], [], [], []
    sizes: list[tuple[int, int]] = []
    for number, factors in enumerate([further[0], *further]):
        read = store.read(factors)
        updated, window, steps = update(read)
        if not number:
            continue  # the first is to compile, and to have every page in memory
        seconds.append(sum(steps.values()))
        split.append(steps)
        sizes.append((int(window.solved.sum()), int(window.published.sum())))
        local = Slopes.of(updated, read.rows[window.solved], len(store.roads))
        from_scratch = scratch(store.roads, {**store.drives, -1: factors})
        shown = np.zeros(len(store.roads), bool)
        shown[read.rows[window.published & ~window.outward]] = True
        within.append(local.apart(from_scratch, shown))
        beyond.append(before.apart(from_scratch, ~shown))
    read = store.read(further[0])
    middle = int(np.argsort(seconds)[len(seconds) // 2])
    return {
        "update_s": statistics.median(seconds),
        "update_steps_s": split[middle],
        "solved": sizes[middle][0],
        "published": sizes[middle][1],
        "update_mb": peak_mb(lambda: update(read)),
        "within_99_sigma": float(np.quantile(np.concatenate(within), 0.99)),
        "beyond_99_sigma": float(np.quantile(np.concatenate(beyond), 0.99)),
        "beyond_most_sigma": float(np.concatenate(beyond).max()),
    }


def blocks_part(roads: RoadTable, drives: Drives, reference: Slopes, most: int) -> Figures:
    """All drives in blocks, against all at once."""
    in_blocks, seconds = timed(lambda: scratch(roads, drives, lambda table: bisected(table, most)))
    apart = in_blocks.apart(reference, np.ones(len(roads), bool))
    memory = peak_mb(lambda: scratch(roads, drives, lambda table: bisected(table, most)))
    return {"blocks_s": seconds, "blocks_mb": memory, "blocks_apart_sigma": float(apart.max())}


def region_part(file: Path, count: int, repeat: int, most: int | None) -> Figures:
    """All parts on a real map."""
    roads = read_roads(file)
    synthetic = Synthetic(roads)
    drives = {k: synthetic.drive(synthetic.route(ROUTE_M)) for k in range(count)}
    further = [synthetic.drive(synthetic.route(ROUTE_M)) for _ in range(repeat)]
    store = Store(roads, drives)
    from_scratch, seconds = timed(lambda: scratch(roads, drives))
    from_scratch, again = timed(lambda: scratch(roads, drives))
    passes = sum(map(len, drives.values()))
    f: Figures = {
        "drives": count,
        "passes": passes,
        "segments": int(np.isfinite(from_scratch.slope).sum()),
        "scratch_first_s": seconds,
        "scratch_s": again,
        "scratch_mb": peak_mb(lambda: scratch(roads, drives)),
    }
    print(
        f"{file.name.split('.')[0]}: {count} drives of {ROUTE_M / 1000:.0f} km, {passes:,} passes, "
        f"{f['segments']:,} segments\n  scratch  {again:7.3f} s  {f['scratch_mb']:7.1f} MB",
        flush=True,
    )
    f |= update_part(store, further, from_scratch)
    split = ", ".join(f"{name} {value:.3f}" for name, value in f["update_steps_s"].items())
    print(
        f"  update   {f['update_s']:7.3f} s  {f['update_mb']:7.1f} MB  {f['solved']} segments solved, "
        f"{f['published']} published ({split})\n"
        f"  against all at once: 99 % within {f['within_99_sigma']:.3f} sigma; beyond what is published the drive "
        f"changed 99 % by at most {f['beyond_99_sigma']:.3f}, all by {f['beyond_most_sigma']:.3f}",
        flush=True,
    )
    if most:
        f |= blocks_part(roads, drives, from_scratch, most)
        print(
            f"  blocks   {f['blocks_s']:7.3f} s  {f['blocks_mb']:7.1f} MB  of {most} segments; at most "
            f"{f['blocks_apart_sigma']:.1e} sigma from all at once",
            flush=True,
        )
    return f


def main() -> None:
    """Measure, print, write JSON."""
    parser = parser_of(__doc__)
    parser.add_argument("--roads", type=Path, default=HEIDELBERG, help="road map of the region")
    parser.add_argument("--drives", type=int, default=100, help="so many of 10 km (default 100)")
    parser.add_argument("--repeat", type=int, default=3, help="updates to take the median of (default 3)")
    parser.add_argument("--most", type=int, default=4000, help="segments of a block (default 4000)")
    parser.add_argument("--skip-blocks", action="store_true", help="leave out the blocks")
    parser.add_argument("--skip-service", action="store_true", help="leave out the database")
    args = parser.parse_args()
    figures: dict[str, object] = {}
    if args.roads.exists():
        most = None if args.skip_blocks else args.most
        figures["region"] = region_part(args.roads, args.drives, args.repeat, most)
    else:
        print(f"{args.roads} is not there: the region is left out; name a road map by --roads.")
    if not args.skip_service:
        from service.adjustment import service_part  # noqa: PLC0415 - a machine without PostgreSQL can do the rest

        figures["service"] = service_part(args.repeat)
    write_json(args.json, figures)


if __name__ == "__main__":
    main()
