"""One service for all tests of webhooks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from app.core import databases
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from web_fixtures import Web, fill_roads, served


@pytest.fixture(scope="package")
def service(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Web]:
    """A service for all tests here: receivers on this machine may be called."""
    name = new_database(template_db)
    folder: Path = tmp_path_factory.mktemp("told")
    settings = Settings(
        database_url=cluster.url_of(name), data_dir=folder, webhook_private=True,
        webhook_timeout_s=2.0,
    )  # fmt: skip
    with served(settings) as running:
        fill_roads(running.sessions)
        yield running
    databases.drop_database(cluster.url, name)


@pytest.fixture
def told(service: Web) -> Iterator[Web]:
    """The same without anybody who is told."""
    yield service
    with service.sessions.begin() as session:
        session.execute(text("DELETE FROM webhooks"))
