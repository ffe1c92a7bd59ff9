"""A service on a real map with slopes, as processes and a database: what clients read."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from accuracy.arguments import REPOSITORY
from accuracy.scoring import show_progress
from app.core import migrate
from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings.places import libpq_url
from app.drives import claims, publishing
from app.embedded.cluster import EmbeddedPostgres
from app.network import extracts
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.network.swap import solve_all_marked
from app.roads import store as road_store
from app.roads.imports import import_roads
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints, SegmentSlope
from service.databases import begun_drive, sessions_of
from service.processes import Service

START_S = 1_700_000_000.0
APART_S = 7200.0
DRIVES = 6
DRIVEN_SHARE = 0.3
"""Of all ways, how many each drive goes over."""
HILL_M, HILL_DEG = 45.0, 0.011
"""How high the made-up hills are, and how wide."""


@dataclass(frozen=True)
class Scene:
    """An API on the loopback, and its database for whoever knows SQL."""

    address: str
    database_url: str
    service: Service


@contextmanager
def scene(roads: Path) -> Iterator[Scene]:
    """A service on the roads of a map, of which about nine in ten ways were driven, over hills that are made up."""
    with (
        tempfile.TemporaryDirectory(prefix="versant-clients-") as name,
        EmbeddedPostgres(Path(name) / "cluster", durable=False) as cluster,
    ):
        folder = Path(name)
        migrate.upgrade(cluster.url)
        with sessions_of(cluster.url) as sessions:
            show_progress("importing")
            import_roads(sessions, roads, folder / "dem")
            fill(sessions)
        show_progress("")
        service = Service(REPOSITORY, libpq_url(cluster.url), folder / "data")
        with service.started("api", "--port", str(service.port)):
            service.await_ready()
            yield Scene(service.address, service.url, service)


def fill(sessions: Sessions) -> None:
    """Drives that say slopes only, stored and published as a worker does it."""
    with sessions() as session:
        table, ids = extracts.all_roads(session)
    grade = hilly(table)
    rng = np.random.default_rng(14)
    ways, way = np.unique(table.osm_way_id, return_inverse=True)
    for number in range(DRIVES):
        show_progress(f"drive {number + 1} of {DRIVES}")
        rows = np.flatnonzero((rng.random(len(ways)) < DRIVEN_SHARE)[way])
        sigma = np.exp(rng.uniform(np.log(0.15), np.log(3.0), len(ways)))[way]
        slope = np.clip(grade + sigma * rng.standard_normal(len(ways))[way] * 0.3, -30, 30)
        first_s = START_S + number * APART_S
        estimates = [
            SegmentSlope(int(k), float(slope[k]), float(sigma[k]), 5, 1, first_s + n, first_s + n + 0.9)
            for n, k in enumerate(rows)
        ]
        _add(sessions, ids, estimates, first_s)
    show_progress("publishing")
    solve_all_marked(sessions)
    publishing.finish(sessions, BlobStore("memory://clients"))


def _add(sessions: Sessions, ids: Ints, estimates: list[SegmentSlope], first_s: float) -> None:
    with sessions.begin() as session:
        drive = begun_drive(session, "raw")
        claims.mark_publishing(
            session,
            drive.id,
            report={},
            bounds=(-180.0, -85.0, 180.0, 85.0),
            epochs=5 * len(estimates),
            distance_m=1000.0,
            drive_time=datetime.fromtimestamp(first_s, UTC),
        )
        version = road_store.current_road_version(session)
        if version is None:
            raise RuntimeError("there are no roads")
        provenance = slopes.RunProvenance("raw", {"min_epochs": 4}, "benchmark", version.id, None)
        slopes.append_result(session, MarkedBy(drive.id, 1), ids, estimates, provenance)


def hilly(table: RoadTable) -> Floats:
    """Slopes of segments over smooth hills, percent."""

    def height_m(lon_deg: Floats, lat_deg: Floats) -> Floats:
        return HILL_M * (np.sin(lon_deg / HILL_DEG) + np.cos(lat_deg / HILL_DEG * 1.3))

    rise_m = height_m(table.lon1_deg, table.lat1_deg) - height_m(table.lon0_deg, table.lat0_deg)
    return np.asarray(100 * rise_m / np.maximum(table.length_m, 0.1), float)
