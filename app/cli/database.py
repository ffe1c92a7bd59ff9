"""Where a command finds its database: a server that is named, or the embedded cluster, which comes migrated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.core import migrate
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings, load_settings
from app.core.standing_back import stand_back
from app.core.telemetry.ledger import counting
from app.core.telemetry.logs import begin_logging
from app.core.telemetry.tracing import begin_tracing, end_tracing
from app.embedded.cluster import EmbeddedPostgres


def settings_for(data_dir: Path | None, **changes: Any) -> Settings:
    """The environment's settings with a command's options over them; an option not given is None."""
    given = {name: value for name, value in {"data_dir": data_dir, **changes}.items() if value is not None}
    return load_settings(lambda: Settings(**given))


@contextmanager
def sessions(data_dir: Path | None) -> Iterator[tuple[Settings, Sessions]]:
    """Settings and sessions of the database that ``--data-dir`` or the environment names.

    Whoever is answered by the service goes before the command that works with them. What it counts is added to the
    service's figures; it logs where the environment says how.
    """
    with database(settings_for(data_dir), embedded=True if data_dir else None) as settings:
        assert settings.database_url is not None  # noqa: S101 - what the block above is for
        stand_back()
        if settings.model_fields_set & {"log_level", "log_format"}:
            begin_logging(settings, "command")
        begin_tracing(settings, "command")
        engine = make_engine(settings.database_url, pool_size=1, behind=True)
        try:
            with counting(session_factory(engine), "command"):
                yield settings, session_factory(engine)
        finally:
            engine.dispose()
            end_tracing()


@contextmanager
def database(settings: Settings, *, embedded: bool | None = None) -> Iterator[Settings]:
    """Yield the settings with ``database_url`` set, for as long as the block lasts.

    ``embedded`` True means the cluster in ``settings.data_dir`` (a command given ``--data-dir``), False the
    server of ``settings.database_url``, None that server if it is set and the cluster otherwise. The cluster
    is started if it does not run, and migrated; another server is migrated by ``versant migrate`` alone.
    """
    if embedded is None:
        embedded = settings.database_url is None
    if not embedded and settings.database_url is not None:
        yield settings
        return
    with open_cluster(settings) as cluster:
        yield settings.model_copy(update={"database_url": cluster.url})


@contextmanager
def open_cluster(settings: Settings) -> Iterator[EmbeddedPostgres]:
    """Yield the cluster in ``settings.data_dir``, started and migrated, for as long as the block lasts."""
    with EmbeddedPostgres(settings.data_dir) as cluster:
        migrate.upgrade(cluster.url, finish=True)  # the cluster has no programs but this installation's
        yield cluster
