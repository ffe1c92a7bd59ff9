"""The database of a command: a server that is named, or the embedded cluster, which is migrated when it is opened."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from app.cli.console import Console
from app.core import migrate
from app.core.background import lower_priority
from app.core.databases import require_reachable
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings, load_settings
from app.core.telemetry.ledger import counting
from app.core.telemetry.logs import begin_logging
from app.core.telemetry.tracing import begin_tracing, end_tracing
from app.embedded.cluster import EmbeddedPostgres
from app.embedded.data_folder import has_cluster
from app.embedded.errors import NothingHereError


def settings_for(data_dir: Path | None, **changes: Any) -> Settings:
    """The environment's settings with a command's options over them; an option not given is None."""
    changed = {name: value for name, value in {"data_dir": data_dir, **changes}.items() if value is not None}
    return load_settings(lambda: Settings(**changed))


@contextmanager
def sessions(data_dir: Path | None, *, make: Console | None = None) -> Iterator[tuple[Settings, Sessions]]:
    """Settings and sessions of the database that ``--data-dir`` or the environment names.

    The command works at background priority. A missing embedded database is made where ``make`` is given, which is told
    so; else ``NothingHereError``. What the command counts is added to the service's figures. It logs if the environment
    says how.
    """
    named, embedded = settings_for(data_dir), True if data_dir else None
    see_to_cluster(named, embedded, make)
    with database(named, embedded=embedded) as settings:
        assert settings.database_url is not None  # noqa: S101 - what the block above is for
        lower_priority()
        if settings.model_fields_set & {"log_level", "log_format"}:
            begin_logging(settings, "command")
        begin_tracing(settings, "command")
        engine = make_engine(settings.database_url, pool_size=1, background=True)
        try:
            with counting(session_factory(engine), "command"):
                yield settings, session_factory(engine)
        finally:
            engine.dispose()
            end_tracing()


@contextmanager
def as_it_is(
    settings: Settings, *, embedded: bool | None, make: bool = False
) -> Iterator[tuple[Settings, Sessions]]:
    """Settings and sessions of a database as it is, not migrated: for its inspection, backup and restoration.

    ``embedded`` as of ``database``. ``make``: where there is no embedded database, an empty one is made.
    """
    if not make:
        see_to_cluster(settings, embedded)
    with ExitStack() as stack:
        if embedded or (embedded is None and settings.database_url is None):
            close_files(settings)
            cluster = stack.enter_context(EmbeddedPostgres(settings.data_dir))
            settings = settings.model_copy(update={"database_url": cluster.url})
        assert settings.database_url is not None  # noqa: S101 - what the lines above are for
        require_reachable(settings.database_url)
        lower_priority()
        engine = make_engine(settings.database_url, pool_size=1, background=True)
        stack.callback(engine.dispose)
        yield settings, session_factory(engine)


def see_to_cluster(settings: Settings, embedded: bool | None, make: Console | None = None) -> None:
    """Refuse to start a cluster where there is none (``NothingHereError``), unless ``make`` is given, which is told.

    So no mistyped folder becomes an empty database.
    """
    uses_cluster = settings.database_url is None if embedded is None else embedded
    if not uses_cluster or has_cluster(settings.data_dir):
        return
    if make is None:
        raise NothingHereError(
            f"There is no Versant database in {settings.data_dir}. `versant up --data-dir {settings.data_dir}` or "
            "`versant import-roads` makes one; --data-dir or VERSANT_DATA_DIR names the folder of one that is there."
        )
    make.note(f"There is no database in {settings.data_dir} yet: a new one is made.")


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
    close_files(settings)
    with EmbeddedPostgres(settings.data_dir) as cluster:
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
