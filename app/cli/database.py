"""The database of a command: a server that is named, or the embedded cluster, which is migrated when it is opened.

What opens it is loaded then: commands import this file at their head.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.console import Console
from app.core.background import lower_priority
from app.core.messages import say

if TYPE_CHECKING:
    from app.core.db import Sessions
    from app.core.settings import Settings
    from app.embedded.cluster import EmbeddedPostgres


def settings_for(data_dir: Path | None, **changes: Any) -> Settings:
    """The environment's settings with a command's options over them; an option not given is None.

    A folder that is given names its embedded database, whatever ``VERSANT_DATABASE_URL`` says.
    """
    from app.core.settings import Settings, load_settings

    changed = {name: value for name, value in {"data_dir": data_dir, **changes}.items() if value is not None}
    settings = load_settings(lambda: Settings(**changed))
    return settings if data_dir is None else settings.model_copy(update={"database_url": None})


@contextmanager
def sessions(data_dir: Path | None, *, make: Console | None = None) -> Iterator[tuple[Settings, Sessions]]:
    """Settings and sessions of the database that ``--data-dir`` or the environment names.

    The command works at background priority. A missing embedded database is made where ``make`` is given, which is told
    so; else ``NothingHereError``. What the command counts is added to the service's figures. It logs if the environment
    says how.
    """
    from app.core.telemetry.ledger import counting
    from app.core.telemetry.logs import begin_logging
    from app.core.telemetry.tracing import begin_tracing, end_tracing

    named = settings_for(data_dir)
    see_to_cluster(named, make)
    with database(named) as settings:
        lower_priority()
        if settings.model_fields_set & {"log_level", "log_format"}:
            begin_logging(settings, "command")
        begin_tracing(settings, "command")
        try:
            with sessions_of(settings) as factory, counting(factory, "command"):
                yield settings, factory
        finally:
            end_tracing()


@contextmanager
def as_it_is(named: Settings, *, make: bool = False) -> Iterator[tuple[Settings, Sessions]]:
    """Settings and sessions of a database as it is, not migrated: for its inspection, backup and restoration.

    ``make``: where there is no embedded database, an empty one is made.
    """
    from app.core.databases import require_reachable

    if not make:
        see_to_cluster(named)
    with database(named, migrated=False) as settings:
        assert settings.database_url is not None  # noqa: S101 - what the block above is for
        require_reachable(settings.database_url)
        lower_priority()
        with sessions_of(settings) as factory:
            yield settings, factory


@contextmanager
def sessions_of(settings: Settings) -> Iterator[Sessions]:
    """Sessions of a database that is named, one at a time, of background priority there."""
    from app.core.db import make_engine, session_factory

    assert settings.database_url is not None  # noqa: S101 - the callers see to it
    engine = make_engine(settings.database_url, pool_size=1, background=True, pooled=settings.database_pooled)
    try:
        yield session_factory(engine)
    finally:
        engine.dispose()


def see_to_cluster(settings: Settings, make: Console | None = None) -> None:
    """Refuse to start a cluster where there is none (``NothingHereError``), unless ``make`` is given, which is told.

    So no mistyped folder becomes an empty database.
    """
    from app.embedded.data_folder import has_cluster
    from app.embedded.errors import NothingHereError

    if settings.database_url is not None or has_cluster(settings.data_dir):
        return
    if make is None:
        raise NothingHereError(say("cli.no_database", folder=settings.data_dir))
    make.note(say("cli.new_database", folder=settings.data_dir))


@contextmanager
def database(settings: Settings, *, migrated: bool = True) -> Iterator[Settings]:
    """Yield the settings with ``database_url`` set, for as long as the block lasts.

    That is the server which they name, or else the cluster in their ``data_dir``. The cluster is started if it does not
    run, and with ``migrated`` it is; another server is migrated by ``versant migrate`` alone.
    """
    if settings.database_url is not None:
        yield settings
        return
    with open_cluster(settings, migrated=migrated) as cluster:
        yield settings.model_copy(update={"database_url": cluster.url})


@contextmanager
def open_cluster(settings: Settings, *, migrated: bool = True) -> Iterator[EmbeddedPostgres]:
    """Yield the cluster in ``settings.data_dir``, started and ``migrated``, for as long as the block lasts."""
    from app.core import migrate
    from app.embedded.cluster import EmbeddedPostgres

    close_files(settings)
    with EmbeddedPostgres(settings.data_dir) as cluster:
        if migrated:
            migrate.upgrade(cluster.url, finish=True)  # the cluster has no programs but this installation's
        yield cluster


def close_files(settings: Settings) -> None:
    """Close the folders of logs and rasters beside the embedded cluster to other users of this machine.

    A log is where somebody lives. Folders that are named apart (``blob_url``, ``dem_url``), and those beside a database
    server, have the rights that whoever made them chose.
    """
    own = ["blobs"] * (settings.blob_url is None) + ["dem"] * (settings.dem_url is None)
    for folder in (settings.data_dir / name for name in own):
        with suppress(OSError):  # what cannot be made or is not ours says so when it is written to
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.chmod(0o700)
