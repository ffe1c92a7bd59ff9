"""A small network in a real database, and drives with made-up estimates on it."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest

from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.drives import claims
from app.network import extracts
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.roads import store as road_store
from fusion.network.unknowns import knot_positions
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints, SegmentSlope
from network_support import new_drive
from processing_support import publish_all
from road_support import replace_roads

AddDrive = Callable[..., uuid.UUID]
FIRST_GENERATION = 1
T0_S = 1_700_000_000.0


@pytest.fixture
def sessions(database_url: str) -> Iterator[Sessions]:
    """Sessions on this test's own database."""
    engine = make_engine(database_url)
    yield session_factory(engine)
    engine.dispose()


@pytest.fixture
def chain() -> Callable[..., RoadTable]:
    """``chain(n, lon, lat)``: a way of n segments that runs east, each 0.001 degrees long."""

    def make(n: int = 10, lon: float = 8.5, lat: float = 49.0, way: int = 7, **columns: object) -> RoadTable:
        k = np.arange(n)
        whole = {
            "osm_way_id": np.full(n, way),
            "from_node": 100 + k,
            "to_node": 101 + k,
            "lon0_deg": lon + 0.001 * k,
            "lat0_deg": np.full(n, lat),
            "lon1_deg": lon + 0.001 * (k + 1),
            "lat1_deg": np.full(n, lat),
            "oneway": np.zeros(n),
            "bridge": np.zeros(n, bool),
            "tunnel": np.zeros(n, bool),
            "layer": np.zeros(n),
            "highway": ["residential"] * n,
            "name": ["Straße"] * n,
        }
        return RoadTable.from_columns(**(whole | columns))  # type: ignore[arg-type]

    return make


@pytest.fixture
def segment_ids(sessions: Sessions, chain: Callable[..., RoadTable]) -> Ints:
    """The ids of an imported chain of ten segments, from west to east."""
    table = chain()
    with sessions.begin() as session:
        replace_roads(session, table, "chain.osm", "0" * 64)
    with sessions() as session:
        return extracts.all_roads(session)[1]


@pytest.fixture
def streets_apart(sessions: Sessions, chain: Callable[..., RoadTable]) -> tuple[RoadTable, Ints]:
    """Two streets of eight segments each, 73 km apart, each in one cell; imported, with their ids."""
    k = np.arange(16)
    lon = np.where(k < 8, 8.505, 9.505) + 0.001 * (k % 8)
    table = chain(
        16, osm_way_id=7 + k // 8, from_node=100 + k + k // 8, to_node=101 + k + k // 8, lon0_deg=lon,
        lon1_deg=lon + 0.001,
    )  # fmt: skip
    with sessions.begin() as session:
        replace_roads(session, table, "apart.osm", "0" * 64)
        return extracts.all_roads(session)


@pytest.fixture
def streets(sessions: Sessions, town: Town) -> tuple[RoadTable, Ints]:
    """The town's roads, imported, and their ids."""
    with sessions.begin() as session:
        lon, lat = knot_positions(town.roads)
        replace_roads(
            session,
            town.roads,
            "town.osm",
            "0" * 64,
            dem_slope_percent=town.true_slope_percent + 1.0,
            dem_heights_m=town.height(*town.projection.to_xy(lon, lat)),
        )
        return extracts.all_roads(session)


@pytest.fixture
def add_drive(sessions: Sessions) -> AddDrive:
    """``add_drive(ids, {index: (slope, sigma)})`` stores a done drive with these estimates; returns its id."""
    return lambda ids, estimates, **options: _add_drive(sessions, ids, estimates, **options)


def _add_drive(
    sessions: Sessions,
    ids: Ints,
    estimates: dict[int, tuple[float, float]],
    name: str | None = None,
) -> uuid.UUID:
    drive_id = new_drive(sessions, name, method="raw")
    with sessions.begin() as session:
        slopes.begin_change(session, drive_id)
        assert claims.lock_running(session, drive_id, FIRST_GENERATION)
        claims.mark_publishing(
            session,
            drive_id,
            report={"epochs": 5},
            bounds=(8.5, 49.0, 8.51, 49.0),
            epochs=5,
            distance_m=100.0,
            drive_time=None,
        )
        version = road_store.current_road_version(session)
        assert version is not None
        provenance = slopes.RunProvenance("raw", {"min_epochs": 4}, "1.0", version.id, None)
        slopes.append_result(
            session, MarkedBy(drive_id, FIRST_GENERATION), ids, _slopes(estimates), provenance
        )
    publish_all(sessions, BlobStore("memory://blobs"))
    return drive_id


def _slopes(estimates: dict[int, tuple[float, float]]) -> Sequence[SegmentSlope]:
    return [
        SegmentSlope(index, slope, sigma, 5, 1, T0_S + index, T0_S + index + 0.5)
        for index, (slope, sigma) in estimates.items()
    ]
