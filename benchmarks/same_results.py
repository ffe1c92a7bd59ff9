#!/usr/bin/env python3
"""Whether two states of the code give the same results, byte for byte: what a change of structure must hold.

    python benchmarks/same_results.py DATA_DIR --before CHECKOUT [--after CHECKOUT] [--seeds 3] [--only TEXT]
                                      [--keep DIR] [--json FILE]

CHECKOUT is a working tree of this repository at the state in question (``git worktree add ../before COMMIT``). Both
states run with the interpreter that runs this script, each from its own folder, so packages are the same:

* ``versant fuse`` by every method on Karlsruhe 09 and 10 (M8, ``--seeds`` logs each, made once by ``roadtruth.py``)
  with both elevation tiles, and all logs of a road together by ``profile``;
* ``versant fuse`` by every method on the log of comma2k19;
* ``versant track`` on those logs, ``versant simulate`` (roads, elevation, drives, truth), ``versant methods``;
* ``versant demo``: the whole service.

Two files are the same where their bytes are, but for what the clock of the machine writes (``updated_at``). Compiled
loops in which sums may be regrouped give other last digits in the process that compiles them than in those that load
them from the cache, so every method runs once in each state before anything counts. Exit status 1 where any differs.
``--only`` takes the cases whose name holds the text (``fuse raw``, ``09_0``, ``demo``). ``--keep DIR`` leaves the files
there and takes those that are there already.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from accuracy.arguments import REPOSITORY, parser_of
from accuracy.scoring import write_json

ROADS = ("09", "10")
METHODS = (
    "profile", "particle", "odometer-map", "gps-ins-kf", "gps-ins-ekf", "gps-ins-ukf", "ukf-dem", "raw", "dem"
)  # fmt: skip
CLOCK = re.compile(rb'"updated_at":\s*"[^"]*"')
SIMULATED = ("*.osm", "*.tif", "*.csv", "*.csv.gz", "*.ubx", "*.gpx", "*.nmea")


@dataclass(frozen=True)
class Case:
    """One command; ``{out}`` in ``arguments`` is the folder or file that it writes, None: its standard output."""

    name: str
    arguments: tuple[str, ...]

    @property
    def writes(self) -> bool:
        """Whether the command writes files rather than standard output."""
        return any("{out}" in argument for argument in self.arguments)


def make_logs(data_dir: Path, tool: Path, seeds: int, folder: Path) -> dict[str, list[Path]]:
    """Receiver logs of each road, one a seed."""
    logs: dict[str, list[Path]] = {}
    for road in ROADS:
        for seed in range(seeds):
            out = folder / f"{road}_{seed}.csv"
            reference = data_dir / "karlsruhe" / f"ref_{road}.csv"
            command = [
                sys.executable,
                str(tool),
                "drive",
                str(reference),
                "-o",
                str(out),
                "--seed",
                str(seed),
            ]
            if not out.exists():
                subprocess.run([*command, "--profile", "m8"], check=True, stdout=subprocess.DEVNULL)
            logs.setdefault(road, []).append(out)
    return logs


def cases(data_dir: Path, logs: dict[str, list[Path]]) -> Iterator[Case]:
    """Everything that is compared."""
    roads = data_dir / "karlsruhe" / "roads_09_10.osm"
    tiles = sorted((data_dir / "karlsruhe").glob("*.hgt"))
    around = ("--roads", str(roads), "--dem", *map(str, tiles))
    real = data_dir / "comma2k19"
    for method in METHODS:
        chosen = ("--method", method, "-o", "{out}.geojson")
        for road in ROADS:
            for log in logs[road]:
                yield Case(f"fuse {method} {log.stem}", ("fuse", str(log), *around, *chosen))
        if method != "dem":
            arguments = ("fuse", str(real / "log.csv"), "--roads", str(real / "roads.osm"), *chosen)
            yield Case(f"fuse {method} comma2k19", arguments)
    for road in ROADS:
        together = ("fuse", *map(str, logs[road]), *around, "-o", "{out}.geojson")
        yield Case(f"fuse profile {road} together", together)
    for log in (logs["09"][0], real / "log.csv"):
        yield Case(f"track {log.parent.name} {log.stem}", ("track", str(log), "-o", "{out}.csv"))
    yield Case("simulate", ("simulate", "-o", "{out}"))
    yield Case("methods", ("methods",))
    yield Case("demo", ("demo", "--output", "{out}"))


def run(case: Case, checkout: Path, folder: Path) -> dict[str, str]:
    """Run a case in a checkout; the hash of each file that it writes, or of what it prints."""
    out = folder / case.name.replace(" ", "_")
    marker = out.with_name(f"{out.name}.hashes")
    if marker.exists():
        hashes: dict[str, str] = json.loads(marker.read_text())
        return hashes
    arguments = [argument.replace("{out}", str(out)) for argument in case.arguments]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    process = subprocess.run(
        [sys.executable, "-m", "app.cli", "--quiet", *arguments],
        cwd=checkout, env=environment, capture_output=True, check=False,
    )  # fmt: skip
    hashes = {"exit status": str(process.returncode)}
    if process.returncode:
        hashes["standard error"] = digest(process.stderr)
    if not case.writes:
        hashes["standard output"] = digest(process.stdout)
    hashes |= {str(path.relative_to(folder)): digest(path.read_bytes()) for path in written(out)}
    marker.write_text(json.dumps(hashes, indent=1))
    return hashes


def warm_up(everything: list[Case], states: dict[str, Path], folder: Path) -> None:
    """Run one case of every method in each state, so that all loops are compiled."""
    first = {case.name.split()[1]: case for case in reversed(everything) if case.name.startswith("fuse ")}
    for name, checkout in states.items():
        for case in first.values():
            marker = folder / name / f"{case.name.replace(' ', '_')}.hashes"
            if not marker.exists():
                run(case, checkout, folder / name)
                marker.unlink()


def written(out: Path) -> Iterator[Path]:
    """The files of a case that a change of structure must not touch; pictures carry their maker's version."""
    if out.is_dir():
        patterns = ("*.geojson", *SIMULATED)
        yield from sorted(path for pattern in patterns for path in out.rglob(pattern))
    yield from sorted(p for p in out.parent.glob(f"{out.name}.*") if p.suffix in {".geojson", ".csv"})


def digest(data: bytes) -> str:
    """SHA-256, hex, of what does not depend on the clock."""
    return hashlib.sha256(CLOCK.sub(b"", data)).hexdigest()


def compare(args: argparse.Namespace, folder: Path) -> list[dict[str, object]]:
    """One row a case."""
    tool = args.roadtruth or args.data_dir.parent / "tools" / "roadtruth.py"
    states = {"before": args.before.resolve(), "after": args.after.resolve()}
    for name in (*states, "logs"):
        (folder / name).mkdir(exist_ok=True, parents=True)
    rows: list[dict[str, object]] = []
    logs = make_logs(args.data_dir, tool, args.seeds, folder / "logs")
    everything = [case for case in cases(args.data_dir.resolve(), logs) if args.only in case.name]
    warm_up(everything, states, folder)
    for case in everything:
        hashes = {name: run(case, checkout, folder / name) for name, checkout in states.items()}
        names = sorted({*hashes["before"], *hashes["after"]})
        differing = [name for name in names if hashes["before"].get(name) != hashes["after"].get(name)]
        rows.append(
            {
                "case": case.name,
                "outputs": len(names) - 1,
                "exit_status": hashes["after"]["exit status"],
                "differing": differing,
            }
        )
        print(f"{case.name:36} {len(names) - 1:3} outputs  {'DIFFERS' if differing else 'same'}", flush=True)
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--after", type=Path, default=REPOSITORY)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--keep", type=Path, help="folder for the files of both")
    parser.add_argument("--roadtruth", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = compare(args, (args.keep or Path(folder)).resolve())
    different = [row for row in rows if row["differing"]]
    print(f"{len(rows)} cases, {len(different)} with different results")
    write_json(args.json, rows)
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
