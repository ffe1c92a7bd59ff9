"""A service with a small map, of which each test finds no exports, and the worker's part in a word."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import pytest
from sqlalchemy import text

from app.core import databases
from app.core.blobs import EXPORTS, BlobStore
from app.core.db import Sessions
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.exports.run import EXPORT
from app.jobs.context import JobContext
from app.jobs.requests.run import perform
from app.jobs.task import Work
from web_fixtures import Web, add_drive, fill_roads

_FIVE_WAYS = """
    INSERT INTO ways (id, osm_way_id, from_node, to_node, segments, length_m, highway, name, oneway, bridge, tunnel,
                      slope_percent, slope_sigma_percent, drives, observations, dem_slope_percent, updated_at,
                      measured_share, steepest_percent, steepest_from_m, steepest_to_m, geom, geom_3857)
    SELECT s.id, s.osm_way_id, s.from_node, s.to_node, 1, s.length_m, s.highway, s.name, s.oneway, s.bridge, s.tunnel,
           a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0), coalesce(a.observations, 0),
           s.dem_slope_percent, a.updated_at, CASE WHEN a.drives > 0 THEN 1 ELSE 0 END, NULL, NULL, NULL,
           ST_MakeLine(ARRAY[ST_StartPoint(s.geom), ST_Centroid(s.geom), ST_EndPoint(s.geom)]), s.geom_3857
    FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id ORDER BY s.id LIMIT 5
"""


@pytest.fixture(scope="session")
def fill_map() -> Callable[[Sessions], None]:
    """``fill_map(sessions)``: the grid, of which three segments are driven, and five ways."""

    def fill(sessions: Sessions) -> None:
        fill_roads(sessions)
        add_drive(sessions, [0, 1, 2], 3.0)
        with sessions.begin() as session:
            session.execute(text(_FIVE_WAYS))

    return fill


@pytest.fixture(scope="module")
def service(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    fill_map: Callable[[Sessions], None],
    tmp_path_factory: pytest.TempPathFactory,
    server_maker: Callable[[Settings], AbstractContextManager[Web]],
) -> Iterator[Web]:
    """A service with that map, for all tests of a module."""
    name = new_database(template_db)
    settings = Settings(database_url=cluster.url_of(name), data_dir=tmp_path_factory.mktemp("exports"))
    with server_maker(settings) as running:
        fill_map(running.sessions)
        yield running
    databases.drop_database(cluster.url, name)


@pytest.fixture
def driven(service: Web) -> Web:
    """The same without exports, files and jobs of tests before."""
    with service.sessions.begin() as session:
        session.execute(text("DELETE FROM exports"))
        session.execute(text("DELETE FROM procrastinate_jobs"))
    blobs = BlobStore(service.settings.blob_store_url, EXPORTS)
    for key in blobs.keys():  # noqa: SIM118 - no mapping
        blobs.delete(key)
    return service


@pytest.fixture(scope="session")
def work() -> Callable[..., list[str]]:
    """``work(web, settings=...)``: what a worker does with all exports that wait; how each ended."""

    def run(web: Web, **changes: Any) -> list[str]:
        context = JobContext(web.settings.model_copy(update=changes), web.sessions)
        query = "SELECT id FROM exports WHERE status IN ('queued', 'running') ORDER BY created_at, id"
        with web.sessions() as session:
            numbers = list(session.execute(text(query)).scalars())
        return [perform(EXPORT, context, number, Work(bool, nullcontext)) for number in numbers]

    return run
