"""A server with a hot standby, for a module of tests: the second cluster follows the first one by streaming."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psycopg
import pytest

from app.core import migrate
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from server_support import wait_until
from soak.servers import await_replayed, kill_server, make_primary, make_standby
from web_fixtures import Web, fill_roads, served


@dataclass
class Pair:
    """A primary with the grid's roads, and its standby."""

    primary: EmbeddedPostgres
    standby: EmbeddedPostgres
    standby_dir: Path

    def ask_standby(self, statement: str) -> list[tuple[Any, ...]]:
        """The rows of a statement there."""
        with psycopg.connect(libpq_url(self.standby.url), autocommit=True) as connection:
            cursor = connection.execute(statement.encode())
            return cursor.fetchall() if cursor.description else []

    def set_standby(self, **options: str | None) -> None:
        """Give these settings of the server the values until they are set otherwise; None: the usual one."""
        for name, value in options.items():
            to = "DEFAULT" if value is None else f"'{value}'"
            self.ask_standby(f"ALTER SYSTEM SET {name} TO {to}")
        self.ask_standby("SELECT pg_reload_conf()")

    def catch_up(self) -> None:
        """Wait until the standby shows what the primary does."""
        await_replayed(self.primary.url, self.standby.url)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Within the block the standby stays as it is, once it shows all that there was before."""
        self.catch_up()
        self.ask_standby("SELECT pg_wal_replay_pause()")
        wait_until(lambda: self.ask_standby("SELECT pg_get_wal_replay_pause_state()") == [("paused",)])
        try:
            yield
        finally:
            self.ask_standby("SELECT pg_wal_replay_resume()")

    def kill(self) -> None:
        """SIGKILL to the standby; ``revive`` of it starts it again."""
        assert kill_server(self.standby_dir)
        wait_until(lambda: self.standby.lost)

    @contextmanager
    def served(self, folder: Path, **settings: Any) -> Iterator[Web]:
        """A service that reads the map from the standby as soon as the block begins."""
        urls = {"database_url": self.primary.url, "database_read_url": self.standby.url}
        with served(Settings(data_dir=folder, **(urls | settings))) as web:
            wait_until(lambda: uses_standby(web))
            yield web


def uses_standby(web: Web) -> bool:
    """Whether the service reads the map from the standby just now."""
    return bool(web.app.state.service.standby.used)


@pytest.fixture(scope="module")
def pair() -> Iterator[Pair]:
    """One for all tests of a module."""
    with tempfile.TemporaryDirectory(prefix="versant-pair-") as folder:
        places = Path(folder) / "primary", Path(folder) / "standby"
        for place in (Path(folder), *places):
            place.mkdir(exist_ok=True)
            place.chmod(0o755)
        make_primary(places[0], durable=False)
        with EmbeddedPostgres(places[0], durable=False) as primary:
            migrate.upgrade(primary.url)
            with make_standby(primary, places[1], durable=False) as standby:
                yield Pair(primary, standby, places[1])


__all__ = ["Pair", "fill_roads", "pair", "uses_standby"]
