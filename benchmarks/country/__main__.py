"""The network adjustment of a whole country, in blocks: time, memory, and whether it is the one system.

    PYTHONPATH=.:benchmarks python -m country [--segments N] [--processes N] [--most N] [--part N] [--town N]
                                              [--drives N] [--roads FILE.osm.pbf] [--json FILE]

Copies of a real town (default: the Heidelberg extract beside the repository) lie side by side, joined by made-up roads,
until there are ``--segments``. Made-up drives (``accuracy.adjustment_drives``): ``--drives`` of 10 km in each town, one
from every town to each neighbour, and one through all of them. Every segment is solved, driven or not. Making roads and
drives is not measured: passes lie in files, block by block, as a service has them in its database.

    part      ``--part`` segments in blocks, against the one system: the largest difference of slopes in sigmas, and
              between one process and ``--processes`` (0: the same bytes)
    country   ``--segments``: unknowns, passes, seconds by the clock from the roads in memory and passes in files to all
              slopes and sigmas, and the peak of the memory of all processes together (each page shared in equal parts)

Aims for 1,000,000 segments and 3,000,000 unknowns by two processes: at most 900 s and 6 GB; part within 1e-6 sigma.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import pickle
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.arguments import add_roads, parser_of
from accuracy.scoring import write_json
from country.made import Country, PassFiles, make_drives, town
from fusion.network.adjust import adjust, adjust_from
from fusion.network.blockwise.partition import Partition, bisected
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from service.watching import pages_kb, repeated

SAMPLE_S = 0.25
THREADS = ("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS")

Figures = dict[str, Any]


class Memory:
    """The peak of the memory of this process and its children together, MB, while it is watched."""

    def __init__(self) -> None:
        self.peak_mb = 0.0

    def look(self) -> None:
        """Look once."""
        every = [os.getpid(), *(p.pid or 0 for p in multiprocessing.active_children())]
        self.peak_mb = max(self.peak_mb, sum(pages_kb(one).get("Pss", 0) for one in every) / 1e3)


def pool(processes: int) -> ProcessPoolExecutor:
    """Processes of one thread each."""
    for name in THREADS:
        os.environ[name] = "1"
    return ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn"))


class Made:
    """A country with its drives in a folder, block by block."""

    def __init__(
        self, roads: RoadTable, segments: int, most: int, drives: int, processes: int, folder: Path
    ) -> None:
        country = Country.of(roads, segments)
        self.roads, self.block = country.roads, bisected(country.roads, most)
        self.files = PassFiles(folder)
        file = folder / "country"
        file.write_bytes(pickle.dumps((country, self.block.block)))
        with pool(processes) as hands:
            jobs = [
                hands.submit(make_drives, self.files, file, k, max(int(drives * share), 1))
                for k, share in enumerate(np.bincount(country.town[country.town >= 0]) / len(roads))
            ]
            jobs.append(hands.submit(make_drives, self.files, file, -1, 0))
            self.passes = sum(job.result() for job in jobs)

    def drives(self) -> dict[int, list[PassFactor]]:
        """All drives in memory."""
        out: dict[int, list[PassFactor]] = {}
        for block in np.unique(self.block.block).tolist():
            for name, passes in self.files.passes(block).items():
                out.setdefault(name, []).extend(passes)
        return out

    def solved(self, processes: int) -> tuple[Adjustment, float, float]:
        """In blocks, by so many processes; with seconds by the clock and MB."""
        memory = Memory()
        with (
            tempfile.TemporaryDirectory(dir=self.files.folder) as left,
            pool(processes) as hands,
            repeated(memory.look, SAMPLE_S),
        ):
            start = time.perf_counter()
            blocks = Partition(self.block.block, hands, self.block.parent, Path(left))
            found = adjust_from(self.files, self.roads, blocks)
            return found, time.perf_counter() - start, memory.peak_mb


def part(made: Made, processes: int) -> Figures:
    """Blocks against the one system, and one process against several."""
    whole = adjust(made.roads, made.drives())
    several, seconds, _ = made.solved(processes)
    alone, _, _ = made.solved(1)
    apart = np.abs(several.slope_percent - whole.slope_percent) / whole.slope_sigma_percent
    sigmas = np.abs(several.slope_sigma_percent / whole.slope_sigma_percent - 1)
    return {
        "part_segments": len(made.roads),
        "part_s": seconds,
        "part_apart_sigma": float(apart.max()),
        "part_sigmas_apart": float(sigmas.max()),
        "part_same_bytes": alone.slope_percent.tobytes() == several.slope_percent.tobytes()
        and alone.slope_sigma_percent.tobytes() == several.slope_sigma_percent.tobytes(),
    }


def country(made: Made, processes: int) -> Figures:
    """The whole, in blocks."""
    found, seconds, memory = made.solved(processes)
    return {
        "segments": int(np.isfinite(found.slope_percent + found.slope_sigma_percent).sum()),
        "unknowns": len(found.solution.x),
        "passes": made.passes,
        "blocks": int(made.block.block.max()) + 1,
        "seconds": seconds,
        "memory_mb": memory,
    }


def main() -> None:
    """Measure, print, write JSON."""
    parser = parser_of(__doc__)
    add_roads(parser)
    parser.add_argument("--segments", type=int, default=1_000_000, help="of the country (default 1000000)")
    parser.add_argument(
        "--part", type=int, default=100_000, help="of the part (default 100000; 0: leave it out)"
    )
    parser.add_argument(
        "--town", type=int, default=0, help="at most so many segments of the town (default: all)"
    )
    parser.add_argument("--drives", type=int, default=100, help="of 10 km in a town (default 100)")
    parser.add_argument("--processes", type=int, default=2, help="that do the work (default 2)")
    parser.add_argument("--most", type=int, default=4000, help="segments of a block (default 4000)")
    args = parser.parse_args()
    every = read_roads(args.roads)
    roads = town(every, args.town or len(every))
    f: Figures = {"processes": args.processes, "most": args.most}
    with tempfile.TemporaryDirectory() as folder:
        if args.segments:
            f |= country(
                _made(roads, args.segments, args, args.drives, Path(folder) / "country"), args.processes
            )
            print(
                f"country  {f['segments']:,} segments, {f['unknowns']:,} unknowns, {f['passes']:,} passes, "
                f"{f['blocks']} blocks: {f['seconds']:.0f} s, {f['memory_mb']:.0f} MB",
                flush=True,
            )
        if args.part:
            # Towns so small that there are three, and as many drives in each for its size.
            small = town(roads, max(args.part // 2 - args.part // 10, 1))
            drives = max(round(args.drives * len(small) / len(roads)), 1)
            f |= part(_made(small, args.part, args, drives, Path(folder) / "part"), args.processes)
            same = "the same bytes" if f["part_same_bytes"] else "NOT the same bytes"
            print(
                f"part     {f['part_segments']:,} segments: {f['part_apart_sigma']:.1e} sigma from the one system, "
                f"sigmas by {f['part_sigmas_apart']:.1e}; {same} by one process",
                flush=True,
            )
    write_json(args.json, f)


def _made(roads: RoadTable, segments: int, args: argparse.Namespace, drives: int, folder: Path) -> Made:
    folder.mkdir()
    return Made(roads, segments, args.most, drives, args.processes, folder)


if __name__ == "__main__":
    main()
