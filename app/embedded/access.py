"""Which database a command works on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from app.core import migrate
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres


@contextmanager
def open_database(settings: Settings, *, embedded: bool | None = None) -> Iterator[str]:
    """Yield the SQLAlchemy URL of the database, for as long as the block lasts.

    ``embedded`` True means the cluster in ``settings.data_dir`` (a command given ``--data-dir``), False the
    server of ``settings.database_url``, None that server if it is set and the cluster otherwise. The cluster
    is started if it does not run, and migrated; another server is migrated by ``versant migrate`` alone.
    """
    if embedded is None:
        embedded = settings.database_url is None
    if not embedded and settings.database_url is not None:
        yield settings.database_url
        return
    with open_cluster(settings) as cluster:
        yield cluster.url


@contextmanager
def open_cluster(settings: Settings) -> Iterator[EmbeddedPostgres]:
    """Yield the cluster in ``settings.data_dir``, started and migrated, for as long as the block lasts."""
    with EmbeddedPostgres(settings.data_dir) as cluster:
        migrate.upgrade(cluster.url)
        yield cluster
