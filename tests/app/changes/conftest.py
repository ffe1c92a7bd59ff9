"""One database with the grid's roads for the tests of a module; each leaves it as it was, or does not mind."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from app.core import databases
from app.core.db import Sessions, make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from web_fixtures import fill_roads


@pytest.fixture(scope="module")
def mapped(
    cluster: EmbeddedPostgres, template_db: str, new_database: Callable[[str], str]
) -> Iterator[Sessions]:
    name = new_database(template_db)
    engine = make_engine(cluster.url_of(name))
    sessions = session_factory(engine)
    fill_roads(sessions)
    yield sessions
    engine.dispose()
    databases.drop_database(cluster.url, name)
