"""How fast `versant import-roads` is, end to end: reading the file, COPY, merge, indexes, commit.

    python benchmarks/import_roads.py FILE [--runs 5] [--json FILE]

Each run imports FILE into an empty database of an embedded cluster with the settings of `versant up` (a commit
is on disk when it returns), then once more into the same database, where every segment is kept. Printed are the
medians. Aim: at least 20,000 segments per second for the first import on two cores (Heidelberg extract).
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from app.core import databases, migrate
from app.core.db import make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from app.roads.imports import import_roads
from fusion.roads.osm import read_roads


def seconds(work: Callable[[], object]) -> float:
    """Wall-clock time that ``work`` takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(cluster: EmbeddedPostgres, file: Path, folder: Path, runs: int) -> dict[str, list[float]]:
    """Seconds of reading alone, of a first import and of a re-import, one value per run."""
    out: dict[str, list[float]] = {"read_s": [], "first_s": [], "again_s": []}
    for run in range(runs):
        name = f"import_{run}"
        databases.ensure_database(cluster.url, name)
        migrate.upgrade(cluster.url_of(name))
        engine = make_engine(cluster.url_of(name))
        sessions = session_factory(engine)
        out["read_s"].append(seconds(lambda: read_roads(file)))
        for key in ("first_s", "again_s"):
            out[key].append(seconds(lambda: import_roads(sessions, file, folder / "dem")))  # noqa: B023
        engine.dispose()
        databases.drop_database(cluster.url, name)
    return out


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("file", type=Path, help="road map: .osm.pbf, .osm or .osm.gz")
    parser.add_argument("--runs", type=int, default=5, help="imports to take the median of (default 5)")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    chosen = parser.parse_args()
    segments = len(read_roads(chosen.file))
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        times = measure(cluster, chosen.file, Path(folder), chosen.runs)
    median = {key: statistics.median(values) for key, values in times.items()}
    print(f"{chosen.file.name}: {segments} segments, median of {chosen.runs} runs")
    for key, label in (
        ("read_s", "reading alone"),
        ("first_s", "first import"),
        ("again_s", "same map again"),
    ):
        print(f"  {label:<15} {median[key]:7.2f} s  {segments / median[key]:9,.0f} segments/s")
    if chosen.json:
        figures = {"file": chosen.file.name, "segments": segments, "median": median, "runs": times}
        chosen.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
