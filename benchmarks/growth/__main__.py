"""What publishing, tiles, items, queries, a removal and an import take on a large map, and on a smaller one.

    PYTHONPATH=.:benchmarks python -m growth [--roads FILE.osm.pbf] [--region FILE.osm.pbf] [--passes-each 2]
        [--segments 1000000,10000000] [--drives 40] [--rounds 3] [--keep DIR] [--json FILE]

For each size a database is made in one embedded cluster with the settings of ``versant up``: the roads (default:
Heidelberg, beside the repository) are imported, ``--drives`` logs of 10 km go through the service, and ``made`` copies
roads, slopes and drives with all their passes. Then, in rounds, an API and a worker of one lane are started on one
database after the other, and asked the same, where the original roads are. Figures are medians; the last column is the
largest ratio of a size to the first. DIR keeps the databases for the next run.

    publish      s from upload to ``done`` of a drive in the idle service
    remove       s from DELETE until the drive is gone
    tile z       ms of a tile whose cells have a new version, so that it is built
    items        ms of a page of 1,000 features in a box, and of the steepest of the whole map
    query        ms of each of the operators' queries; what is kept was made before
    import       s of a region of its own (default: Liechtenstein): new, and the same again

Aims: at ten times the segments and passes, each at most 1.5 times as long.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx

from accuracy.arguments import REPOSITORY, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core import databases
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from app.map import figures
from growth import made
from growth.asked import Asked, box_of
from service.databases import sessions_of
from service.logs import make_logs
from service.processes import Service

MAPS = REPOSITORY.parent / "shared/data/maps"
ALONE = 3
"""Drives that are published and removed in each round."""
Times = dict[str, list[float]]


def main() -> None:
    """Parse the command line, make, ask, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--roads", type=Path, default=MAPS / "heidelberg-2024-09.test.osm.pbf")
    parser.add_argument("--region", type=Path, default=MAPS / "liechtenstein-2015-07.osm.pbf")
    parser.add_argument("--segments", default="1000000,10000000")
    parser.add_argument("--passes-each", type=float, default=2.0)
    parser.add_argument("--drives", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--keep", type=Path)
    args = parser.parse_args()
    counts = [int(count) for count in args.segments.split(",")]
    with ExitStack() as stack:
        folder = args.keep or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="versant-bench-")))
        cluster = stack.enter_context(EmbeddedPostgres(folder))
        logs = make_logs(args.roads, args.drives + args.rounds * ALONE, folder)
        services = {count: _made(cluster, folder, count, args, logs[: args.drives]) for count in counts}
        times = {count: defaultdict[str, list[float]](list) for count in counts}
        left = iter(logs[args.drives :])
        for number in range(args.rounds):
            alone = [next(left) for _ in range(ALONE)]
            for count, service in services.items():
                show_progress(f"round {number + 1} of {args.rounds}, {count} segments")
                _round(service, times[count], alone, args.region)
        show_progress("")
        figures_of = {
            count: {k: statistics.median(v) for k, v in found.items()} for count, found in times.items()
        }
        rows = [_row(name, [figures_of[count][name] for count in counts]) for name in figures_of[counts[0]]]
        columns = {
            "what": ("", ""),
            **{str(k): (f"{n:,}", ".3g") for k, n in enumerate(counts)},
            "ratio": ("ratio", ".2f"),
        }
        print(text_table(rows, columns))
        sizes = {count: _sizes(service) for count, service in services.items()}
        write_json(args.json, {"figures": figures_of, "sizes": sizes})


def _sizes(service: Service) -> dict[str, int]:
    """Rows and bytes of a database, printed."""
    with sessions_of(service.url) as sessions:
        rows, room = made.sizes(sessions), made.bytes_of_tables(sessions)
    print("\n" + ", ".join(f"{name} {value:,}" for name, value in rows.items()))
    print("MB: " + ", ".join(f"{name} {value / 1e6:.0f}" for name, value in room.items()))
    return {**rows, **{f"bytes of {name}": value for name, value in room.items()}}


def _row(what: str, values: list[float]) -> dict[str, object]:
    return {"what": what, **{str(k): v for k, v in enumerate(values)}, "ratio": max(values) / values[0]}


def _made(
    cluster: EmbeddedPostgres, folder: Path, segments: int, args: argparse.Namespace, logs: list[bytes]
) -> Service:
    """The service on a database of this size."""
    name = f"growth_{segments}"
    new = databases.ensure_database(cluster.url, name)
    service = Service(REPOSITORY, libpq_url(cluster.url_of(name)), folder / name, threads=1)
    service.command("migrate")
    if new:
        show_progress(f"{segments} segments: roads and drives")
        service.command("import-roads", str(args.roads), "--region", "first")
        with _running(service):
            for log in logs:
                service.send(log)
            service.await_done()
    with sessions_of(service.url) as sessions:
        made.grow(sessions, segments, round(segments * args.passes_each))
    return service


@contextmanager
def _running(service: Service) -> Iterator[None]:
    with service.started("api", "--port", str(service.port)):
        service.await_ready()
        with service.started(*service.worker):
            yield


def _round(service: Service, times: Times, logs: list[bytes], region: Path) -> None:
    """Ask everything once."""
    with (
        sessions_of(service.url) as sessions,
        _running(service),
        httpx.Client(base_url=service.address, trust_env=False, timeout=600) as client,
    ):
        while figures.renew_one(sessions):
            pass
        asked = Asked(client, sessions, box_of(sessions))
        for log in logs:
            times["publish, s"].append(service.alone(log))
        for name, ask in asked.reads().items():
            times[name].append(ask())
        for address in asked.newest_drives(len(logs)):
            times["remove, s"].append(asked.removed(address))
        for name in ("import, new, s", "import, again, s"):
            times[name].append(
                _timed(lambda: service.command("import-roads", str(region), "--region", "second"))
            )
        service.command("regions", "remove", "second", "--yes")


def _timed(work: Callable[[], object]) -> float:
    began_s = time.monotonic()
    work()
    return time.monotonic() - began_s


if __name__ == "__main__":
    main()
