#!/usr/bin/env python3
"""How the network adjustment grows: a drive's update with 10, 100, 1,000 drives on its roads, and all from scratch.

    python benchmarks/adjustment.py [--roads FILE.osm.pbf] [--drives 10,100,1000] [--repeat N]
                                    [--skip-service] [--skip-region] [--json FILE]

Three parts, each a line a size; times are medians of ``--repeat`` updates by further drives, memory is the peak of what
Python and numpy hold beyond the stored evidence (tracemalloc, in a run of its own):

    town      the library on the simulated town: factors of four simulated drives, and copies of them with other noise.
              update = evidence of the touched segments, window, solution, selection; scratch = all of it from the
              encoded passes
    region    the library on FILE (default: Heidelberg beside the repository): 100 drives of 10 km on random routes with
              made-up passes; then every segment of the map driven once
    service   the town again, in an embedded PostgreSQL: publishing one more drive, and taking it back, from the lock to
              the commit, with the share of each step

Aims: an update at most 1 s with 1,000 drives on its roads; Heidelberg from scratch at 100 drives at most 60 s on two
cores.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from adjustment_drives import Copies, Synthetic, town_drives
from fusion.network.adjust import Adjustment, adjust
from fusion.network.evidence import SegmentEvidence
from fusion.network.pass_factor import PassFactor
from fusion.network.window import PUBLISH_RADIUS_M, WINDOW_RADIUS_M, gap_rows, neighbourhood
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import make_town

HEIDELBERG = (
    Path(__file__).resolve().parents[2] / "shared" / "data" / "maps" / "heidelberg-2024-09.test.osm.pbf"
)
REGION_DRIVES, REGION_ROUTE_M = 100, 10_000.0
AIM_UPDATE_S, AIM_REGION_S = 1.0, 60.0

Encoded = list[tuple[int, tuple[int, ...], bytes]]
Figures = dict[str, Any]
T = TypeVar("T")


@dataclass
class Store:
    """What a service stores: passes as bytes by own segment, and the evidence made of them."""

    roads: RoadTable
    passes: dict[int, Encoded] = field(default_factory=dict)
    evidence: dict[int, SegmentEvidence] = field(default_factory=dict)
    keys: int = 0

    def add(self, factors: Sequence[PassFactor]) -> None:
        """Store passes; evidence is left as it was."""
        for factor in factors:
            one = (self.keys, factor.segments, factor.encode())
            self.passes.setdefault(factor.segments[-1], []).append(one)
            self.keys += 1

    def condense(self) -> dict[int, SegmentEvidence]:
        """The evidence of all stored passes, from scratch."""
        return {row: SegmentEvidence.build_encoded(encoded) for row, encoded in self.passes.items()}

    def mask(self, rows: Iterable[int]) -> np.ndarray:
        """Rows as a mask."""
        out = np.zeros(len(self.roads), bool)
        out[list(rows)] = True
        return out


@dataclass
class Clock:
    """Seconds by step."""

    steps: dict[str, float] = field(default_factory=dict)

    def time(self, name: str, work: Callable[[], T]) -> T:
        """Do it and note how long it took."""
        start = time.perf_counter()
        result = work()
        self.steps[name] = self.steps.get(name, 0.0) + time.perf_counter() - start
        return result

    @property
    def total(self) -> float:
        return sum(self.steps.values())


def solve(store: Store, evidence: Mapping[int, SegmentEvidence], use: np.ndarray) -> Adjustment:
    """Adjust the rows of a mask."""
    rows = np.flatnonzero(use)
    known = [evidence.get(row) for row in rows.tolist()]
    return adjust(store.roads.subset(use), known, np.full(len(rows), np.nan), rows)


def update(store: Store, factors: Sequence[PassFactor], clock: Clock) -> tuple[int, int]:
    """A further drive, as the service does it without its database; returns segments solved and published."""
    added: dict[int, list[tuple[int, PassFactor]]] = {}
    for number, factor in enumerate(factors):
        added.setdefault(factor.segments[-1], []).append((store.keys + number, factor))
    evidence = dict(store.evidence)
    clock.time("evidence", lambda: evidence.update(_extended(store, added)))
    touched, driven = store.mask(added), store.mask(evidence)

    def around() -> tuple[np.ndarray, np.ndarray]:
        open_rows = driven | gap_rows(store.roads, driven)
        return (
            neighbourhood(store.roads, open_rows, touched, WINDOW_RADIUS_M),
            neighbourhood(store.roads, open_rows, touched, PUBLISH_RADIUS_M),
        )

    window, published = clock.time("window", around)
    found = clock.time("solve", lambda: solve(store, evidence, window))
    clock.time("select", lambda: found.slope_percent[published[window]])
    return int(window.sum()), int(published.sum())


def _extended(
    store: Store, added: Mapping[int, Sequence[tuple[int, PassFactor]]]
) -> dict[int, SegmentEvidence]:
    out = {}
    for row, passes in added.items():
        known = store.evidence.get(row)
        if known is None:
            out[row] = SegmentEvidence.build(passes)
            continue
        try:
            out[row] = known.with_passes(passes)
        except KeyError:  # verdicts over stored passes turn
            wanted = known.missing_for(passes)
            stored = {key: (segments, data) for key, segments, data in store.passes[row]}
            flipped = {key: PassFactor.decode(stored[key][1], stored[key][0]) for key in wanted}
            out[row] = known.with_passes(passes, flipped)
    return out


def scratch(store: Store, clock: Clock) -> Adjustment:
    """Everything from the stored passes."""
    evidence = clock.time("evidence", store.condense)
    driven = store.mask(evidence)
    use = clock.time("gaps", lambda: driven | gap_rows(store.roads, driven))
    return clock.time("solve", lambda: solve(store, evidence, use))


def peak_mb(work: Callable[[], object]) -> float:
    """Peak of what the work allocates, MB."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def measure(store: Store, further: Callable[[int], list[PassFactor]], repeat: int) -> Figures:
    """Updates by further drives and a solution from scratch; the store's evidence is renewed."""
    whole = Clock()
    scratch(store, whole)
    store.evidence = store.condense()
    update(store, further(0), Clock())
    clocks, sizes = [], (0, 0)
    for number in range(repeat):
        clocks.append(Clock())
        sizes = update(store, further(number), clocks[-1])
    median = sorted(clocks, key=lambda clock: clock.total)[len(clocks) // 2]
    return {
        "driven_segments": len(store.evidence),
        "passes": store.keys,
        "drive_segments": len({f.segments[-1] for f in further(0)}),
        "window_segments": sizes[0],
        "published_segments": sizes[1],
        "update_s": statistics.median(clock.total for clock in clocks),
        "update_steps_s": median.steps,
        "update_mb": peak_mb(lambda: update(store, further(0), Clock())),
        "scratch_s": whole.total,
        "scratch_steps_s": whole.steps,
        "scratch_mb": peak_mb(lambda: scratch(store, Clock())),
        "evidence_mb": sum(len(one.encode()) for one in store.evidence.values()) / 1e6,
        "passes_mb": sum(len(data) for encoded in store.passes.values() for _, _, data in encoded) / 1e6,
    }


def town_part(sizes: Sequence[int], repeat: int) -> list[Figures]:
    """The library on the simulated town."""
    town = make_town()
    copies = Copies.of(town_drives(town))
    store, out, stored = Store(town.roads), [], 0
    for drives in sizes:
        # Each of the originals drives on roads of its own, mostly: n on every road are 4 n in all.
        while stored < drives * len(copies.originals):
            store.add(copies.drive(stored))
            stored += 1
        figures = measure(store, lambda k: copies.drive(10**6 + k), repeat)
        out.append({"drives": drives, "stored": stored, **figures})
        show_library("town", " on each road", out[-1])
    return out


def region_part(file: Path, repeat: int) -> list[Figures]:
    """The library on a real map."""
    roads = read_roads(file)
    synthetic = Synthetic(roads)
    store = Store(roads)
    for _ in range(REGION_DRIVES):
        store.add(synthetic.drive(synthetic.route(REGION_ROUTE_M)))
    further = [synthetic.drive(synthetic.route(REGION_ROUTE_M)) for _ in range(repeat)]
    out: list[Figures] = [{"drives": REGION_DRIVES, **measure(store, lambda k: further[k], repeat)}]
    show_library(file.name.split(".")[0], f" of {REGION_ROUTE_M / 1000:.0f} km", out[0])
    everything = Store(roads)
    everything.add(list(synthetic.everywhere()))
    clock = Clock()
    scratch(everything, clock)
    out.append(
        {
            "drives": "all",
            "driven_segments": len(roads),
            "scratch_s": clock.total,
            "scratch_steps_s": clock.steps,
        }
    )
    print(f"every one of {len(roads):,} segments driven once: {clock.total:.1f} s ({steps(clock.steps)})")
    return out


def steps(seconds: Mapping[str, float]) -> str:
    """The split of a time, in words."""
    return ", ".join(f"{name} {value:.3f}" for name, value in seconds.items() if value >= 0.0005)


def show_library(name: str, of: str, f: Figures) -> None:
    """One size of a library part."""
    print(
        f"{name}: {f['drives']} drives{of}, {f['driven_segments']:,} segments driven, {f['passes']:,} passes\n"
        f"  update   {f['update_s']:7.3f} s  {f['update_mb']:7.1f} MB  {f['drive_segments']} segments driven, "
        f"{f['window_segments']} solved, {f['published_segments']} published ({steps(f['update_steps_s'])})\n"
        f"  scratch  {f['scratch_s']:7.3f} s  {f['scratch_mb']:7.1f} MB  {f['scratch_s'] / f['update_s']:.1f} updates "
        f"({steps(f['scratch_steps_s'])}); stored: evidence {f['evidence_mb']:.1f} MB, passes {f['passes_mb']:.1f} MB",
        flush=True,
    )


def main() -> None:
    """Measure, print, write JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--roads", type=Path, default=HEIDELBERG, help="road map of the region")
    parser.add_argument(
        "--drives", default="10,100,1000", help="drives on each road, ascending, comma-separated"
    )
    parser.add_argument("--repeat", type=int, default=5, help="updates to take the median of (default 5)")
    parser.add_argument("--skip-service", action="store_true", help="leave out the database")
    parser.add_argument("--skip-region", action="store_true", help="leave out the real map")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    args = parser.parse_args()
    sizes = sorted(int(v) for v in args.drives.split(","))
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    figures: dict[str, object] = {"town": town_part(sizes, args.repeat)}
    if args.skip_region:
        pass
    elif args.roads.exists():
        figures["region"] = region_part(args.roads, args.repeat)
    else:
        print(f"{args.roads} is not there: the region is left out; name a road map by --roads.")
    if not args.skip_service:
        from adjustment_service import service_part  # noqa: PLC0415 - a machine without PostgreSQL can do the rest

        figures["service"] = service_part(sizes, args.repeat)
    if args.json:
        args.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
