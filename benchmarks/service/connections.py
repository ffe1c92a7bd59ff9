#!/usr/bin/env python3
"""How many connections to PostgreSQL a service takes: an API, lanes without work, lanes at work.

    PYTHONPATH=.:benchmarks python -m service.connections [--lanes 2] [--drives 12] [--checkout FOLDER] [--json FILE]

On an embedded cluster, with simulated drives of ten minutes. ``--checkout``: the service of another state of the code.

    mean, most   connections at once, of all processes that are named, looked at every 20 ms
    new          connections that were made, per second
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psycopg

from accuracy.arguments import REPOSITORY, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from fusion.simulate.demonstration import write_all
from service.processes import Service

LOOK_EVERY_S = 0.02
SETTLES_S, WATCHED_S = 12.0, 30.0
COLUMNS = {"what": ("", ""), "mean": ("mean", ".2f"), "most": ("most", ".0f"), "new_per_s": ("new/s", ".2f")}
_CONNECTIONS = """
    SELECT count(*) FROM pg_stat_activity
    WHERE datname = current_database() AND pid <> pg_backend_pid() AND backend_type = 'client backend'
"""
_MADE = "SELECT sessions FROM pg_stat_database WHERE datname = current_database()"

Row = dict[str, float | str]


class Watch:
    """Counts from a connection of its own."""

    def __init__(self, url: str) -> None:
        self._connection = psycopg.connect(url, autocommit=True)

    def over(self, what: str, goes_on: Callable[[], bool]) -> Row:
        """What there is while ``goes_on``."""
        show_progress(what)
        counts, began_s, made = list[int](), time.monotonic(), self._ask(_MADE)
        while goes_on():
            counts.append(self._ask(_CONNECTIONS))
            time.sleep(LOOK_EVERY_S)
        took_s = time.monotonic() - began_s
        new = (self._ask(_MADE) - made) / took_s
        return {"what": what, "mean": float(np.mean(counts)), "most": max(counts), "new_per_s": new}

    def for_s(self, what: str, seconds: float) -> Row:
        """What there is in so many seconds."""
        until_s = time.monotonic() + seconds
        return self.over(what, lambda: time.monotonic() < until_s)

    def _ask(self, query: str) -> int:
        row = self._connection.execute(query.encode()).fetchone()
        assert row is not None  # noqa: S101 - an aggregate, or this database's row
        return int(row[0])


@contextmanager
def in_background(work: Callable[[], None]) -> Iterator[threading.Thread]:
    """Do it in a thread, which has ended when the block has."""
    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield thread
    finally:
        thread.join()


def measured(service: Service, logs: list[bytes], lanes: int) -> list[Row]:
    """The table."""
    watch, rows = Watch(service.url), list[Row]()
    with service.started("api", "--port", str(service.port)):
        service.await_ready()
        time.sleep(SETTLES_S)
        rows.append(watch.for_s("API at rest", WATCHED_S))
        for log in logs:
            service.send(log)
    with service.started("worker", "--concurrency", str(lanes)):
        with in_background(service.await_done) as waiting:
            time.sleep(SETTLES_S)
            rows.append(watch.over(f"{lanes} lanes at work", waiting.is_alive))
        time.sleep(SETTLES_S)
        rows.append(watch.for_s(f"{lanes} lanes at rest", WATCHED_S))
    return rows


def main() -> None:
    """Measure, print and write."""
    parser = parser_of(__doc__)
    parser.add_argument("--lanes", type=int, default=2)
    parser.add_argument("--drives", type=int, default=12)
    parser.add_argument("--checkout", type=Path, default=REPOSITORY, help="whose service it is")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="versant-connections-") as name:
        folder = Path(name)
        town = write_all(folder / "town", args.drives, seed=1)
        with EmbeddedPostgres(folder, durable=False) as cluster:
            service = Service(args.checkout, libpq_url(cluster.url), folder / "data")
            service.set_up(town.osm, town.dem)
            rows = measured(service, [path.read_bytes() for path in town.drives], args.lanes)
    show_progress("")
    print(text_table(rows, COLUMNS))
    write_json(args.json, {"rows": rows})


if __name__ == "__main__":
    main()
