"""Where a command finds its database."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings, load_settings
from app.embedded.access import open_database


def settings_for(data_dir: Path | None, **changes: Any) -> Settings:
    """The environment's settings with a command's options over them; an option not given is None."""
    given = {name: value for name, value in {"data_dir": data_dir, **changes}.items() if value is not None}
    return load_settings(lambda: Settings(**given))


@contextmanager
def database(settings: Settings, *, embedded: bool | None = None) -> Iterator[Settings]:
    """Yield the settings with ``database_url`` set, for as long as the block lasts.

    ``embedded``: see ``app.embedded.access.open_database``. The embedded cluster is started if it does not run, and
    migrated.
    """
    with open_database(settings, embedded=embedded) as url:
        yield settings.model_copy(update={"database_url": url})


@contextmanager
def sessions(data_dir: Path | None) -> Iterator[tuple[Settings, Sessions]]:
    """Settings and sessions of the database that ``--data-dir`` or the environment names."""
    with database(settings_for(data_dir), embedded=True if data_dir else None) as settings:
        assert settings.database_url is not None  # noqa: S101 - what the block above is for
        engine = make_engine(settings.database_url, pool_size=1)
        try:
            yield settings, session_factory(engine)
        finally:
            engine.dispose()
