"""How long editions take: the first of 500 drives over a whole extract, and the next one after 20 more.

    PYTHONPATH=.:benchmarks python -m privacy.making [--roads FILE] [--drives 500] [--more 20] [--json FILE]

The town is that of the privacy attack, on all roads of the file (Heidelberg). Drives lie in the database as workers
store them, unsolved: an edition reads passes, not the live map. Printed are the seconds of each stage, files included,
and the megabytes of its files and of what the database keeps of it: of passes that may be told, and of the map.
Aims: 60 s for the first and 20 s for the next, on two cores beside the live service.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from datetime import date, timedelta
from pathlib import Path

from sqlalchemy import text

from accuracy.arguments import add_roads, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core.caller import EDITION, TOLD
from app.embedded.cluster import EmbeddedPostgres
from app.releases.run import in_words, release
from privacy.city import City
from privacy.recording import Recorder
from privacy.service import Server, Service
from privacy.town import Trip, make_town

OWNERS, WEEKS, SEED = 200, 4, 1
_BYTES = text("""
    SELECT coalesce(sum(pg_total_relation_size(oid)), 0) FROM pg_class
    WHERE relkind = 'r' AND relnamespace = CAST(:schema AS regnamespace)
""")
EVERYWHERE = (-180.0, -90.0, 180.0, 90.0)


class Stages:
    """The seconds of each stage of a progress."""

    def __init__(self) -> None:
        self.took_s: dict[str, float] = {}
        self._stage, self._since = "beginning", time.perf_counter()

    def __call__(self, stage: str, share: float) -> None:
        """The time until now was the former stage's."""
        now = time.perf_counter()
        self.took_s[self._stage] = self.took_s.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = stage, now


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    add_roads(parser)
    parser.add_argument("--drives", type=int, default=500)
    parser.add_argument("--more", type=int, default=20)
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        rows = run(args, Server(cluster.url, Path(folder)))
    write_json(args.json, rows)


def run(args: argparse.Namespace, server: Server) -> list[dict[str, float]]:
    """The seconds of both editions, printed as well."""
    show_progress("roads")
    server.import_roads(args.roads)
    roads, ids = server.roads()
    city = City(roads, EVERYWHERE)
    trips = make_town(city, OWNERS, args.drives + args.more, WEEKS, SEED).trips
    recorder, rows, day = Recorder(city, SEED), [], date(2026, 11, 2)
    with server.service("making", ids) as service:
        owners = [service.add_owner(f"owner {k}") for k in range(OWNERS)]
        for part in (trips[: args.drives], trips[args.drives :]):
            _store(service, recorder, owners, part)
            stages, began = Stages(), time.perf_counter()
            settings = service.settings.model_copy(update={"public_map": "releases"})
            edition = release(str(settings.database_url), settings, day=day, progress=stages)
            stages("end", 1.0)
            whole_s = time.perf_counter() - began
            show_progress("")
            print(in_words(edition))
            room = {"files MB": sum(file["size_bytes"] for file in edition.files) / 1e6, **_room(service)}
            rows.append(
                {"drives": len(part), "segments": edition.segments, **stages.took_s, "all": whole_s, **room}
            )
            day += timedelta(days=7)
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: (name, "g" if name in {"drives", "segments"} else ".1f") for name in names}
    print(text_table([dict.fromkeys(names, 0.0) | row for row in rows], columns))
    return rows


def _room(service: Service) -> dict[str, float]:
    """Megabytes of the schemas of an edition, indexes included."""
    with service.sessions() as session:
        return {
            f"{schema} MB": float(session.execute(_BYTES, {"schema": schema}).scalar_one()) / 1e6
            for schema in (TOLD, EDITION)
        }


def _store(service: Service, recorder: Recorder, owners: Sequence[int], trips: Sequence[Trip]) -> None:
    for number, trip in enumerate(trips):
        show_progress(f"drive {number + 1} of {len(trips)}")
        service.store(owners[trip.owner], recorder.record(trip))


if __name__ == "__main__":
    main()
