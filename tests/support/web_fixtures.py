"""A running service on a free port of the loopback interface, with a real database behind it."""

from __future__ import annotations

import itertools
import ssl
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import httpx
import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI

from app.core import databases
from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.core.receiving.connections import server_options
from app.core.settings import Settings
from app.drives import claims, tracks
from app.drives import store as drives
from app.embedded.cluster import EmbeddedPostgres
from app.jobs.context import JobContext
from app.main import create_app
from app.map import figures
from app.network import extracts
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.roads import store as road_store
from fusion.roads.table import RoadTable
from fusion.types import SegmentSlope, Track
from processing_support import publish_all
from road_support import replace_roads

GRID = 8  # streets each way
WEST, SOUTH, STEP = 8.40, 49.00, 0.002
START_S = 1_700_000_000.0
TLS = ssl.create_default_context()
"""Nothing here speaks TLS, but each client would read all certificates of the machine for a context of its own."""


@dataclass
class Web:
    """A service as its users see it, and its database for what they cannot do."""

    base: str
    client: httpx.Client
    settings: Settings
    sessions: Sessions
    app: FastAPI
    """What answers, for what only it knows."""

    @property
    def context(self) -> JobContext:
        return JobContext(self.settings, self.sessions)

    @property
    def blobs(self) -> BlobStore:
        return BlobStore(self.settings.blob_store_url)


@contextmanager
def served(settings: Settings) -> Iterator[Web]:
    app = create_app(settings)
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            host="127.0.0.1",
            port=0,
            log_level="critical",
            **server_options(settings),
            timeout_graceful_shutdown=5,
        )
    )
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    started = threading.Event()
    while not server.started:
        assert thread.is_alive(), "the server did not start"
        started.wait(0.01)
    base = f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    engine = make_engine(str(settings.database_url))
    try:
        with httpx.Client(base_url=base, trust_env=False, timeout=60, verify=TLS) as client:
            yield Web(base, client, settings, session_factory(engine), app)
    finally:
        server.should_exit = True
        thread.join(timeout=20)
        engine.dispose()
        assert not thread.is_alive(), "the server did not stop"


def grid_roads() -> RoadTable:
    """A grid of short streets, and one street across the antimeridian's both sides."""
    way, first, second = list[int](), list[int](), list[int]()
    places: list[tuple[tuple[int, int], tuple[int, int]]] = []

    def add(number_of_way: int, begin: tuple[int, int], end: tuple[int, int]) -> None:
        way.append(number_of_way)
        first.append(number[begin])
        second.append(number[end])
        places.append((begin, end))

    node = itertools.count(1)
    number = {(i, j): next(node) for i in range(GRID) for j in range(GRID)}
    for i in range(GRID):
        for j in range(GRID - 1):
            add(1 + i, (i, j), (i, j + 1))
    for j in range(GRID):
        for i in range(GRID - 1):
            add(GRID + 1 + j, (i, j), (i + 1, j))
    lon0, lat0, lon1, lat1 = (
        [origin + STEP * ends[end][axis] for ends in places]
        for end, axis, origin in ((0, 0, WEST), (0, 1, SOUTH), (1, 0, WEST), (1, 1, SOUTH))
    )
    for k, (a, b) in enumerate(((179.990, 179.995), (179.995, 180.0), (-180.0, -179.995))):
        way.append(900)
        first.append(1000 + k)
        second.append(1001 + k)
        lon0.append(a)
        lon1.append(b)
        lat0.append(-17.0)
        lat1.append(-17.0)
    n = len(way)
    return RoadTable.from_columns(
        osm_way_id=way,
        from_node=first,
        to_node=second,
        lon0_deg=lon0,
        lat0_deg=lat0,
        lon1_deg=lon1,
        lat1_deg=lat1,
        oneway=np.arange(n) % 3 - 1,
        bridge=np.arange(n) % 5 == 0,
        tunnel=np.zeros(n, bool),
        layer=np.zeros(n, int),
        highway=["residential", "primary", "track"] * (n // 3) + ["service"] * (n % 3),
        name=[None if k % 2 else f"Straße {k}" for k in range(n)],
    )


def fill_roads(sessions: Sessions) -> list[int]:
    """Import the grid; returns the ids in the table's order."""
    with sessions.begin() as session:
        table = grid_roads()
        dem_slope = np.where(np.arange(len(table)) % 4 == 0, np.nan, 1.5)
        replace_roads(session, table, "grid.osm", "0" * 64, dem_slope_percent=dem_slope)
    with sessions() as session:
        return [int(i) for i in extracts.all_roads(session)[1]]


def add_drive(
    sessions: Sessions, indices: list[int], slope_percent: float = 2.0, sigma_percent: float = 0.5
) -> uuid.UUID:
    """A done drive with an estimate for each of these rows of the grid, as the worker would leave it."""
    key = uuid.uuid4().hex
    with sessions.begin() as session:
        table, ids = extracts.all_roads(session)
        drive, _ = drives.create_drive(
            session,
            sha256=key,
            filename=f"{key}.csv",
            size_bytes=1,
            blob_key=f"drives/{key}",
            method="raw",
            options={},
        )
        assert claims.mark_running(session, drive.id, drive.generation)
        track = track_along(table, indices)
        tracks.save_track(session, drive.id, tracks.EncodedTrack.of(track, ids))
        claims.mark_publishing(
            session,
            drive.id,
            report={"matched_share": 1.0},
            bounds=(8.0, 48.0, 9.0, 49.0),
            epochs=len(track),
            distance_m=100.0,
            drive_time=datetime.fromtimestamp(START_S, UTC),
        )
        estimates = [
            SegmentSlope(k, slope_percent, sigma_percent, 5, 1, START_S + 5 * n, START_S + 5 * n + 4)
            for n, k in enumerate(indices)
        ]
        version = road_store.current_road_version(session)
        assert version is not None
        provenance = slopes.RunProvenance("raw", {"min_epochs": 4}, "test", version.id, None)
        slopes.append_result(session, MarkedBy(drive.id, 1), ids, estimates, provenance)
    publish_all(sessions, BlobStore("memory://blobs"))
    return drive.id


def track_along(table: RoadTable, indices: list[int], per_segment: int = 5) -> Track:
    """Five epochs on each segment, from its from_node to its to_node; then one epoch of nothing."""
    along = np.tile(np.linspace(0.1, 0.9, per_segment), len(indices))
    k = np.repeat(indices, per_segment)
    n = len(k)
    lat = table.lat0_deg[k] + along * (table.lat1_deg[k] - table.lat0_deg[k])
    lon = table.lon0_deg[k] + along * (table.lon1_deg[k] - table.lon0_deg[k])

    def column(values: object) -> np.ndarray:
        return np.append(np.broadcast_to(np.asarray(values, float), n), np.nan)

    return Track(
        time_s=START_S + np.arange(n + 1.0),
        lat_deg=column(lat),
        lon_deg=column(lon),
        alt_m=column(120 + 0.1 * np.arange(n)),
        h_sigma_m=column(1.5),
        alt_sigma_m=column(2.0),
        speed_mps=column(10.0),
        heading_rad=column(np.pi / 2),
        pitch_rad=column(np.nan),
        pitch_sigma_rad=column(np.nan),
        segment=np.r_[k, -1],
        distance_m=column(along * table.length_m[k]),
        has_gnss=np.r_[np.ones(n, bool), False],
        after_outage=np.zeros(n + 1, bool),
    )


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    """Small limits, so that tests reach them."""
    return Settings(
        database_url=database_url,
        data_dir=tmp_path,
        max_upload_bytes=200_000,
        items_limit_max=50,
        items_limit_default=20,
        default_method="raw",
    )


@pytest.fixture
def web(settings: Settings) -> Iterator[Web]:
    """An empty service of this test alone."""
    with served(settings) as running:
        yield running


@pytest.fixture(scope="session")
def grid_database(cluster: EmbeddedPostgres, template_db: str, new_database: Callable[[str], str]) -> str:
    """Name of a database with the grid's roads that nobody is connected to."""
    name = new_database(template_db)
    engine = make_engine(cluster.url_of(name))
    fill_roads(session_factory(engine))
    engine.dispose()
    return name


@pytest.fixture
def filled(grid_database: str, web: Web) -> Web:
    """The same with the grid's roads."""
    return web


@pytest.fixture(scope="session")
def reading(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Web]:
    """One service for all tests that only read: the grid, two drives over parts of it."""
    name = new_database(template_db)
    folder = tmp_path_factory.mktemp("reading")
    settings = Settings(
        database_url=cluster.url_of(name), data_dir=folder, items_limit_max=50, items_limit_default=20
    )
    with served(settings) as running:
        fill_roads(running.sessions)
        add_drive(running.sessions, [0, 1, 2], 3.0)
        add_drive(running.sessions, [2, 3, 4, 5], -1.0)
        figures.note_today(running.sessions)
        yield running
    databases.drop_database(cluster.url, name)


@pytest.fixture(scope="session")
def drive_maker() -> Callable[..., uuid.UUID]:
    """``add_drive`` for the test modules, which cannot import this file."""
    return add_drive


@pytest.fixture(scope="session")
def server_maker() -> Callable[[Settings], object]:
    """``served`` for the test modules."""
    return served
