#!/usr/bin/env python3
"""Requests a second of a map of a million segments, beside tipg and a bare ``ST_AsMVT`` endpoint in the same run.

    python benchmarks/serving.py FILE --tipg PYTHON [--segments 1000000] [--rounds 3] [--seconds 3] [--keep DIR]
                                 [--json FILE]

FILE is a road map (.osm.pbf) whose copies make up the segments (``served/million.py``). PYTHON is the interpreter of an
environment with tipg and uvicorn, which want other packages than ours: ``python -m venv tipg`` and
``tipg/bin/pip install tipg uvicorn uvloop``. DIR keeps the database for the next run.

One embedded cluster with the settings of `versant up`, one process each of ``versant api``, tipg and the bare endpoint,
and two clients that keep their connections and ask for tiles where the roads are. Rounds take turns between the
servers; figures are medians of the rounds, ratios those within one round. Rows:

    tipg, bare   a tile built for each request: five properties; tipg from a flat table without a join, not compressed
    first        our first build of a tile: before each pass every cell gets a new version, so no stored tile counts
    warm         our stored tile, whose version is looked up in the database at each request
    304          the same with If-None-Match
    items        pages of 1,000 features of GeoJSON with all properties, in boxes of 1,000 and more (tiles of zoom 14),
                 and beside them tipg's
    beside       warm, while one drive is published each second (slopes of 125 segments, versions, and what follows from
                 them by a worker); and what is left of the rate

Aims, as ratios to tipg at zooms 14, 12, 10: first 2.5, 5, 20, with 95 % under 60 ms; warm 8, 20, 100; 304 12, 30, 200;
items 10; beside at least 0.67 of warm. A tile of ours below zoom 13 holds merged roads, tipg's every segment: that is
the point, and not the same picture.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import text

from accuracy.arguments import REPOSITORY, parser_of
from accuracy.scoring import show_progress, write_json
from app.core.db import Sessions
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from app.map.derived import following
from app.map.derived.following import LONG_S, follow_all
from app.network.cells import raise_versions
from served.clients import Asked, Rates, ask, tags_of
from served.million import fill
from served.servers import PROPERTIES, SCHEMA, bare, make_flat, tipg
from service.databases import new_database, sessions_of
from service.processes import Service
from service.watching import repeated

ZOOMS = (14, 12, 10)
TILES = {14: 400, 12: 120, 10: 24}
"""Tiles asked for, at most."""
HELD = 0.8
"""Of all segments, in the tiles that some are taken of: towns rather than edges of the map."""
ITEMS, PAGE = 60, 1000
PORT = 18_520
ITEMS_AIM = 10.0
AIMS = {
    "first": {14: 2.5, 12: 5.0, 10: 20.0},
    "warm": {14: 8.0, 12: 20.0, 10: 100.0},
    "304": {14: 12.0, 12: 30.0, 10: 200.0},
    "beside": {14: 0.67, 12: 0.67, 10: 0.67},
}

_DENSITY = text("SELECT cell, count(*) AS segments FROM segments GROUP BY cell ORDER BY cell")
_NEW_VERSIONS = text("UPDATE cells SET version = version + 1, drawn_version = drawn_version + 1")
_SOMEWHERE = text(
    """
    WITH moved AS (
        UPDATE segment_slopes SET slope_percent = slope_percent + 0.01, updated_at = clock_timestamp()
        WHERE segment_id IN (SELECT s.id FROM segments AS s JOIN segment_slopes AS a ON a.segment_id = s.id
                             WHERE s.id > :id ORDER BY s.id LIMIT 125)
        RETURNING segment_id)
    SELECT DISTINCT s.cell FROM moved JOIN segments AS s ON s.id = moved.segment_id
    """
)
_LAST = text("SELECT max(id) FROM segments")


def tiles_to_ask(sessions: Sessions) -> dict[int, list[tuple[int, int, float]]]:
    """x, y of some tiles of each zoom, and segments in it: of the fullest ones that hold four fifths of all segments.

    The same in every run.
    """
    with sessions() as session:
        rows = session.execute(_DENSITY).all()
    rng = np.random.default_rng(14)
    chosen = {}
    for zoom in ZOOMS:
        there: dict[tuple[int, int], int] = {}
        for cell, segments in rows:
            tile = (cell >> 14) >> (14 - zoom), (cell & 16383) >> (14 - zoom)
            there[tile] = there.get(tile, 0) + segments
        fullest = sorted(there, key=lambda tile: -there[tile])
        held = np.cumsum([there[tile] for tile in fullest]) / sum(there.values())
        keys = fullest[: int(np.searchsorted(held, HELD)) + 1]
        drawn = rng.permutation(len(keys))[: TILES[zoom]]
        chosen[zoom] = [(*keys[n], there[keys[n]]) for n in drawn]
    return chosen


@contextmanager
def published_each_second(sessions: Sessions) -> Iterator[None]:
    """One drive's slopes after the other."""
    rng = np.random.default_rng(1)
    with sessions() as session:
        last = session.execute(_LAST).scalar_one()

    def publish() -> None:
        with sessions.begin() as session:
            cells = session.execute(_SOMEWHERE, {"id": int(rng.integers(last))}).scalars().all()
            raise_versions(session, cells)

    with repeated(publish, 1.0):
        yield


class Setup:
    """The servers, and what is asked of them."""

    def __init__(self, sessions: Sessions, ours: int, theirs: int, plain: int, seconds: float) -> None:
        self.sessions, self.seconds = sessions, seconds
        self.ours, self.theirs, self.plain = ours, theirs, plain
        self.tiles = tiles_to_ask(sessions)
        full = [(x, y) for x, y, segments in self.tiles[14] if segments >= PAGE]
        self.boxes = [_box(14, x, y) for x, y in full[:ITEMS]]

    def paths(self, zoom: int, form: str) -> list[Asked]:
        """What is asked of one server."""
        return [Asked(form.format(z=zoom, x=x, y=y)) for x, y, _ in self.tiles[zoom]]

    def round(self, zoom: int) -> dict[str, Rates]:
        """Every row once, at one zoom."""
        own = self.paths(zoom, "/tiles/{z}/{x}/{y}.mvt")
        its = f"/collections/{SCHEMA}.tiles/tiles/WebMercatorQuad/{{z}}/{{x}}/{{y}}?properties=" + ",".join(
            PROPERTIES
        )
        rates = {
            "tipg": ask(self.theirs, self.paths(zoom, its), seconds=self.seconds, compressed=False),
            "bare": ask(self.plain, self.paths(zoom, "/{z}/{x}/{y}"), seconds=self.seconds, compressed=False),
            "first": self.first_builds(own),
        }
        ask(self.ours, own)
        rates["warm"] = ask(self.ours, own, seconds=self.seconds)
        tagged = tags_of(self.ours, [one.path for one in own])
        rates["304"] = ask(self.ours, tagged, seconds=self.seconds)
        return rates

    def first_builds(self, own: list[Asked]) -> Rates:
        """Passes over all tiles, each after every cell has changed."""
        passes: list[Rates] = []
        while sum(one.seconds for one in passes) < self.seconds and len(passes) < 40:
            with self.sessions.begin() as session:
                session.execute(_NEW_VERSIONS)
            time.sleep(0.2)
            passes.append(ask(self.ours, own))
        return together(passes)

    def items(self) -> dict[str, Rates]:
        """Pages of 1,000 features."""
        ours = [Asked(f"/collections/segments/items?limit={PAGE}&bbox={box}") for box in self.boxes]
        theirs = [
            Asked(f"/collections/{SCHEMA}.items/items?f=geojson&limit={PAGE}&bbox={box}")
            for box in self.boxes
        ]
        return {
            "items": ask(self.ours, ours, seconds=self.seconds, compressed=False),
            "items, tipg": ask(self.theirs, theirs, seconds=2 * self.seconds, compressed=False),
        }

    def beside(self, zoom: int) -> Rates:
        """Warm, while drives are published."""
        own = self.paths(zoom, "/tiles/{z}/{x}/{y}.mvt")
        ask(self.ours, own)
        with published_each_second(self.sessions):
            time.sleep(1.5)
            return ask(self.ours, own, seconds=3 * self.seconds)


def together(passes: list[Rates]) -> Rates:
    """Passes as one."""
    statuses: dict[int, int] = {}
    for one in passes:
        for status, n in one.statuses.items():
            statuses[status] = statuses.get(status, 0) + n
    return Rates(
        sum(one.requests for one in passes),
        sum(one.seconds for one in passes),
        np.concatenate([one.took_ms for one in passes]),
        sum(one.size_bytes for one in passes),
        statuses,
    )


def _box(zoom: int, x: int, y: int) -> str:
    def lat(row: int) -> float:
        return float(np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * row / 2**zoom)))))

    west, east = (360 * column / 2**zoom - 180 for column in (x, x + 1))
    return f"{west:.6f},{lat(y + 1):.6f},{east:.6f},{lat(y):.6f}"


@contextmanager
def servers(cluster: EmbeddedPostgres, folder: Path, python: Path, seconds: float) -> Iterator[Setup]:
    """All of them, until the block ends."""
    dsn = libpq_url(cluster.url_of("million"))
    service = Service(REPOSITORY, dsn, folder / "data")
    with ExitStack() as running:
        sessions = running.enter_context(sessions_of(cluster.url_of("million")))
        running.enter_context(tipg(python, dsn, PORT))
        running.enter_context(bare(dsn, PORT + 1))
        running.enter_context(service.started("api", "--port", str(service.port)))
        running.enter_context(service.started("worker", "--concurrency", "1"))
        service.await_ready()
        await_derived(sessions)
        yield Setup(sessions, service.port, PORT, PORT + 1, seconds)


def await_derived(sessions: Sessions) -> None:
    """Until a worker has derived all that low zooms draw."""
    while True:
        with sessions() as session:
            if following.look(session, LONG_S).idle:
                return
        time.sleep(0.2)


def fill_once(cluster: EmbeddedPostgres, roads: Path, folder: Path, segments: int) -> None:
    """Fill the database unless a run before has."""
    if (folder / "filled").exists():
        return
    with new_database(cluster, "million") as sessions:
        show_progress("filling the database")
        fill(sessions, roads, folder, segments)
        make_flat(sessions)
        show_progress("deriving ways and what low zooms draw")
        began = time.process_time()
        follow_all(sessions)
    print(f"derived in {time.process_time() - began:.0f} s of processor time, without the database's")
    (folder / "filled").touch()


def measure(setup: Setup, rounds: int) -> dict[str, Any]:
    """Medians over the rounds, ratios within rounds."""
    samples: dict[str, list[tuple[float, float, float]]] = {}
    ratios: dict[str, list[float]] = {}
    odd: dict[str, dict[int, int]] = {}

    def note(name: str, rates: Rates, beside: Rates | None) -> None:
        samples.setdefault(name, []).append((rates.per_second, rates.p95_ms, rates.mean_bytes))
        if beside is not None:
            ratios.setdefault(name, []).append(rates.per_second / beside.per_second)
        strange = {status: n for status, n in rates.statuses.items() if status not in {200, 304}}
        if strange:
            odd[name] = strange

    for n in range(rounds):
        for zoom in ZOOMS:
            show_progress(f"round {n + 1} of {rounds}, zoom {zoom}")
            rows = setup.round(zoom)
            for name, rates in rows.items():
                note(f"z{zoom} {name}", rates, rows["tipg"])
            note(f"z{zoom} beside", setup.beside(zoom), rows["warm"])
        pages = setup.items()
        note("items", pages["items"], pages["items, tipg"])
        note("items, tipg", pages["items, tipg"], None)
    return {
        name: {
            "per_second": statistics.median(r for r, _, _ in values),
            "p95_ms": statistics.median(p for _, p, _ in values),
            "bytes": statistics.median(b for _, _, b in values),
            "ratio": statistics.median(ratios[name]) if name in ratios else None,
            **({"other_statuses": odd[name]} if name in odd else {}),
        }
        for name, values in samples.items()
    }


def report(figures: dict[str, Any], density: Mapping[int, float]) -> None:
    """Print the table."""
    print(f"{'':<14}{'per second':>11}{'p95 ms':>9}{'kB':>9}{'x tipg':>9}{'aim':>7}")
    for name, row in figures.items():
        zoom, _, kind = name.partition(" ")
        aim = ITEMS_AIM if name == "items" else AIMS[kind].get(int(zoom[1:])) if kind in AIMS else None
        of = row["ratio"]
        print(
            f"{name:<14}{row['per_second']:>11,.0f}{row['p95_ms']:>9.1f}{row['bytes'] / 1e3:>9.1f}"
            f"{'' if of is None else f'{of:.2f}':>9}{'' if aim is None or of is None else f'{aim:g}':>7}"
            f"{'  ' + str(row['other_statuses']) if 'other_statuses' in row else ''}"
        )
    print("beside: of warm in the same round (aim 0.67). Segments in a tile, mean:", density)


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = parser_of(__doc__)
    parser.add_argument("file", type=Path, help="road map: .osm.pbf, .osm or .osm.gz")
    parser.add_argument("--tipg", type=Path, required=True, help="interpreter of an environment with tipg")
    parser.add_argument("--segments", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each row in each round (default 3)")
    parser.add_argument(
        "--keep", type=Path, help="keep the database in this folder, and use it if it is there"
    )
    chosen = parser.parse_args()
    with ExitStack() as open_:
        folder = chosen.keep or Path(
            open_.enter_context(tempfile.TemporaryDirectory(prefix="versant-bench-"))
        )
        cluster = open_.enter_context(EmbeddedPostgres(folder / "cluster"))
        fill_once(cluster, chosen.file, folder, chosen.segments)
        setup = open_.enter_context(servers(cluster, folder, chosen.tipg, chosen.seconds))
        figures = measure(setup, chosen.rounds)
        density = {zoom: round(float(np.mean([n for *_, n in setup.tiles[zoom]]))) for zoom in ZOOMS}
    show_progress("")
    report(figures, density)
    write_json(chosen.json, figures)


if __name__ == "__main__":
    main()
