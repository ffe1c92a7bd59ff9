"""``versant batch`` over an archive of made-up logs: how fast, and whether its results are right whatever dies.

    PYTHONPATH=.:benchmarks python -m batch [--logs N] [--length M] [--part N] [--processes N] [--kill-every S]
                                            [--roads FILE.osm.pbf] [--dem FILE] [--only NAME ...] [--folder FOLDER]
                                            [--json FILE]

``--logs`` drives over a real town (default: the Heidelberg extract beside the repository), ten minutes apart, as CSV,
gzipped CSV, GPX, NMEA, zips of two files and GPX with the late heights of an altimeter; 1 % more files are broken.
Making them is not measured; a ``--folder`` keeps them for the next run.

    speed      by one worker process and by ``--processes``: seconds by the clock and of processors, logs a second and
               core, how many times faster, whether all files have the same bytes, whether each broken file is named,
               and how many others cannot be used (a made-up drive may turn round and round in one yard)
    killed     a worker is killed at random every ``--kill-every`` seconds: the same bytes
    cut        the command is killed three times: it goes on, the same bytes
    scheduler  a scheduler and two workers of their own; the scheduler is killed: the command ends, and goes on with a
               new one, the same bytes
    equal      the first ``--part`` logs against what ``versant fuse`` computes: the largest difference in sigmas

Aims: within 1e-6 sigma, two workers at least 1.8 times one, the same bytes always, each broken file named.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from accuracy.arguments import add_roads, parser_of
from accuracy.scoring import write_json
from app.batch.folder import BatchFolder
from app.batch.hands import hands
from app.batch.run import Request, run
from app.cli.logs.fusing import Fusion
from app.cli.logs.named import LogFiles
from batch.logs import make_broken, make_log
from batch.runs import bytes_of, cut_off, timed, with_kills, without_scheduler
from fusion.pipeline import parse_options
from fusion.roads.osm import read_roads
from fusion.terrain.dem import Dem
from fusion.types import Progress, no_progress

BROKEN_SHARE = 0.01
PORT = 38786
CUT_AFTER = (0.25, 0.5, 0.6)
"""Shares of the time that the work takes."""

Figures = dict[str, Any]


class Unseen:
    """Nobody looks at bars."""

    def work(self, name: str) -> Progress:
        """A bar that is none."""
        return no_progress

    def count(self, name: str, total: int) -> Callable[[int], None]:
        """Another."""
        return lambda more: None


class Archive:
    """The logs, and where results go."""

    def __init__(self, args: argparse.Namespace, folder: Path) -> None:
        self.args, self.folder, self.logs = args, folder, folder / "logs"
        self.dem = [] if args.dem is None else ["--dem", args.dem]
        self.made = self._made(args)
        self.broken = make_broken(max(round(BROKEN_SHARE * args.logs), 1), self.logs)

    def _made(self, args: argparse.Namespace) -> list[Path]:
        """The logs, or those that a former run has left in the folder."""
        kept, wanted = self.folder / "made.json", [args.logs, args.length, str(args.roads)]
        if kept.exists() and (found := json.loads(kept.read_text()))["wanted"] == wanted:
            return [self.logs / name for name in found["logs"]]
        with ProcessPoolExecutor(args.processes) as pool:
            make = partial(make_log, read_roads(args.roads), length_m=args.length, folder=self.logs)
            made = list(pool.map(make, range(args.logs), chunksize=8))
        names = [str(path.relative_to(self.logs)) for path in made]
        kept.write_text(json.dumps({"wanted": wanted, "logs": names}))
        return made

    def command(self, name: str, *more: str | Path) -> list[str | Path]:
        """Over all logs, into a folder of this name."""
        return ["batch", self.logs, "--roads", self.args.roads, *self.dem, "-o", self.folder / name, *more]

    @cache  # noqa: B019 - there is one archive
    def undisturbed(self) -> tuple[float, float]:
        """Make ``several``, where nothing dies: seconds by the clock, and of processors."""
        return timed(self.command("several", "--processes", str(self.args.processes)))

    def results(self, name: str) -> dict[str, str]:
        """Digests of what is there."""
        return bytes_of(self.folder / name)


def speed(archive: Archive) -> Figures:
    """One worker, and several."""
    count, processes = len(archive.made), archive.args.processes
    one_s, one_cpu_s = timed(archive.command("one", "--processes", "1"))
    several_s, several_cpu_s = archive.undisturbed()
    rows = pq.read_table(archive.folder / "several" / "report.parquet").to_pylist()
    of_broken = {str(path) for path in archive.broken}
    # Empty files are one file, several times: the report names each.
    unused = {row["log"] for row in rows if row["status"] in {"failed", "repeated"} and row["reason"]}
    return {
        "one_s": one_s,
        "several_s": several_s,
        "one_cpu_s": one_cpu_s,
        "several_cpu_s": several_cpu_s,
        "logs_per_s_and_core": count / several_s / processes,
        "times_faster": one_s / several_s,
        "same_bytes": archive.results("one") == archive.results("several"),
        "broken_named": of_broken <= unused,
        "others_unused": len(unused - of_broken),
        "done": sum(row["status"] == "done" for row in rows),
        "segments": pq.read_metadata(archive.folder / "several" / "slopes.parquet").num_rows,
    }


def killed(archive: Archive) -> Figures:
    """Workers die."""
    archive.undisturbed()
    two = ("--processes", str(archive.args.processes))
    count = with_kills(archive.command("killed", *two), archive.args.kill_every)
    return {"killed": count, "killed_same_bytes": archive.results("killed") == archive.results("several")}


def cut(archive: Archive) -> Figures:
    """The command dies."""
    seconds, _ = archive.undisturbed()
    two = ("--processes", str(archive.args.processes))
    begun = cut_off(archive.command("cut", *two), [seconds * share for share in CUT_AFTER])
    return {"cut_begun": begun, "cut_same_bytes": archive.results("cut") == archive.results("several")}


def scheduler(archive: Archive) -> Figures:
    """The scheduler dies."""
    archive.undisturbed()
    first, second = without_scheduler(archive.command("scheduler"), PORT, archive.args.kill_every)
    return {
        "scheduler_first": first,
        "scheduler_second": second,
        "scheduler_same_bytes": archive.results("scheduler") == archive.results("several"),
    }


def equal(archive: Archive) -> Figures:
    """A part, against ``versant fuse``."""
    paths = [_beside(path, archive.folder / "part") for path in archive.made[: archive.args.part]]
    options = parse_options("profile")
    rasters = [] if archive.args.dem is None else [archive.args.dem]
    asked = Request(
        (str(archive.folder / "part"),), archive.args.roads, tuple(rasters), "profile",
        options.model_dump(mode="json"), None, True, ("geoparquet",),
    )  # fmt: skip
    with hands(None, archive.args.processes, None) as workers:
        found = run(asked, BatchFolder(archive.folder / "equal"), workers, Unseen()).solution
    dem = Dem.open(rasters, trusted=True) if rasters else None
    fusion = Fusion("profile", options, read_roads(archive.args.roads), dem)
    for path in sorted(paths):
        fusion.add(LogFiles((path,)))
    wanted = fusion.solve(gaps=True).solution
    if found is None or not np.array_equal(found.roads.osm_way_id, wanted.roads.osm_way_id):
        raise SystemExit("the batch and versant fuse found other segments")
    slope, sigma = (
        [np.array([getattr(s, name) for s in w.slopes]) for w in (found, wanted)]
        for name in ("slope_percent", "slope_sigma_percent")
    )
    return {
        "part_logs": len(paths),
        "part_segments": len(wanted),
        "part_apart_sigma": float(np.max(np.abs(slope[0] - slope[1]) / sigma[1])),
        "part_sigmas_apart": float(np.max(np.abs(sigma[0] / sigma[1] - 1))),
        "part_same_judgement": found.rejected == wanted.rejected and found.duplicates == wanted.duplicates,
        "part_late": sum(one.result.late_by is not None for one in fusion.fused),
    }


def _beside(path: Path, folder: Path) -> Path:
    """A log in a folder of its own: a zip that is named would be an archive of logs."""
    folder.mkdir(exist_ok=True)
    return Path(shutil.copy(path, folder))


PARTS = {"speed": speed, "killed": killed, "cut": cut, "scheduler": scheduler, "equal": equal}


def main() -> None:
    """Measure, print, write JSON."""
    parser = parser_of(__doc__)
    add_roads(parser)
    parser.add_argument("--dem", type=Path, help="elevation raster (default: none)")
    parser.add_argument("--logs", type=int, default=2000, help="default 2000")
    parser.add_argument("--length", type=float, default=10_000.0, help="m of a drive (default 10000)")
    parser.add_argument("--part", type=int, default=60, help="logs of the part (default 60)")
    parser.add_argument("--processes", type=int, default=2, help="workers (default 2)")
    parser.add_argument("--kill-every", type=float, default=20.0, help="seconds (default 20)")
    parser.add_argument("--only", nargs="*", choices=PARTS, default=list(PARTS), help="default: all")
    parser.add_argument("--folder", type=Path, help="where logs and results are left (default: nowhere)")
    args = parser.parse_args()
    os.environ["PYTHONPATH"] = os.pathsep.join([".", os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as place:
        folder = (args.folder or Path(place)).absolute()
        for name in (*PARTS, "one", "several", "part"):  # of a former run
            shutil.rmtree(folder / name, ignore_errors=True)
        archive = Archive(args, folder)
        f: Figures = {"logs": len(archive.made), "broken": len(archive.broken), "processes": args.processes}
        for name in args.only:
            found = PARTS[name](archive)
            f |= found
            print(f"{name:9}", ", ".join(f"{k} {_shown(v)}" for k, v in found.items()), flush=True)
    write_json(args.json, f)


def _shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
