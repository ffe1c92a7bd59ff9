"""What is kept in a connection beyond a transaction is nobody's behind a pooler: so nothing is."""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import httpx
import psycopg
import pytest
from sqlalchemy import Connection, text
from sqlalchemy.exc import OperationalError

from app.core.claims import Claim
from app.core.db import Patience, Sessions, begin_with, make_engine, session_factory, snapshot
from app.core.settings import Settings
from app.drives import claims
from app.map.tiles.connections import Connections
from pooler_fixtures import Pooler, pooler

__all__ = ["pooler"]

PATIENCE = Patience(7.0, 3.0, 5.0)
STATE = text("""
    SELECT current_schema(), current_setting('statement_timeout'), current_setting('TimeZone'),
           current_setting('jit'), pg_backend_pid()
""")

Behind = Callable[..., Sessions]


@pytest.fixture
def behind(pooler: Pooler, database_url: str) -> Iterator[Behind]:
    """``behind(schema=..., patience=...)``: sessions behind a pooler with one connection to the server."""
    with ExitStack() as stack:
        url = stack.enter_context(pooler(database_url, 1)).url

        def make(**options: Any) -> Sessions:
            engine = make_engine(url, pooled=True, **options)
            stack.callback(engine.dispose)
            return session_factory(engine)

        yield make


def test_each_transaction_has_the_settings_of_its_own_engine(behind: Behind) -> None:
    live, told = behind(patience=PATIENCE), behind(schema="told")
    seen = []
    for _ in range(2):
        for sessions in (live, told):
            with sessions() as session:
                seen.append(tuple(session.execute(STATE).one()))
    assert [row[:4] for row in seen] == [("public", "7s", "UTC", "off"), ("told", "0", "UTC", "off")] * 2
    assert len({row[4] for row in seen}) == 1, "all came to one connection"
    with snapshot(live) as session:
        assert session.execute(STATE).one()[:2] == ("public", "7s")


def test_nothing_is_prepared(behind: Behind) -> None:
    sessions = behind()
    for _ in range(12):
        with sessions() as session:
            assert session.execute(text("SELECT :x + 1"), {"x": 1}).scalar_one() == 2
            assert session.execute(text("SELECT count(*) FROM pg_prepared_statements")).scalar_one() == 0


def test_claims_hold_though_every_transaction_is_on_the_same_connection(behind: Behind) -> None:
    one, other = behind(), behind()
    with Claim(one, "something") as mine, Claim(other, "something") as theirs:
        assert mine.take([1, 2]) == {1, 2}
        assert theirs.take([2, 3]) == {3}


def test_followers_are_told_soon_where_no_announcement_comes(
    settings: Settings, server_maker: Callable[[Settings], Any]
) -> None:
    pooled = settings.model_copy(update={"database_pooled": True, "events_poll_s": 60.0})
    assert pooled.listen_url is None
    with server_maker(pooled) as web:
        log = b"time,lat,lon\n"
        drive = str(web.client.post("/v1/drives", content=log).json()["id"])
        with httpx.stream(
            "GET", f"{web.base}/v1/drives/{drive}/events", timeout=30, trust_env=False
        ) as answer:
            lines = answer.iter_lines()
            assert next(line for line in lines if line.startswith("data:"))
            with web.sessions.begin() as session:
                claims.mark_running(session, uuid.UUID(drive), 1)
            began_s = time.monotonic()
            assert '"running"' in next(line for line in lines if line.startswith("data:"))
            assert time.monotonic() - began_s < 5.0


def test_what_needs_a_connection_for_itself_goes_past_the_pooler(settings: Settings) -> None:
    direct = "postgresql+psycopg://here/direct"
    assert settings.listen_url == settings.session_url == settings.database_url
    pooled = settings.model_copy(update={"database_pooled": True})
    assert pooled.session_url == settings.database_url
    past = pooled.model_copy(update={"database_direct_url": direct})
    assert past.listen_url == past.session_url == direct


def test_what_fails_at_the_begin_of_a_transaction_is_an_error_like_any_other(
    database_url: str, caplog: pytest.LogCaptureFixture
) -> None:
    """As where a pooler that has lost its server refuses the statement with which each transaction begins."""
    engine, fails = make_engine(database_url, pool_size=1, max_overflow=0), [True]

    def begin(connection: Connection) -> None:
        driver: Any = connection.connection.driver_connection
        if fails:
            driver.execute("SELECT pg_terminate_backend(pg_backend_pid())")

    begin_with(engine, begin)
    sessions = session_factory(engine)
    try:
        with sessions() as session, pytest.raises(OperationalError):
            session.execute(text("SELECT 1"))
        fails.clear()
        with sessions() as session:
            assert session.execute(text("SELECT 1")).scalar_one() == 1
    finally:
        engine.dispose()
    assert not [one for one in caplog.records if one.levelname == "ERROR"]


@pytest.mark.parametrize("command", ["commit", "rollback"])
def test_two_results_of_one_command_are_a_lost_connection(
    database_url: str, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """The server's last word, and that of the pooler before it."""
    engine = make_engine(database_url, pool_size=1, max_overflow=0)
    try:
        with engine.connect() as connection:
            before = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
            with monkeypatch.context() as broken, pytest.raises(OperationalError):
                broken.setattr(psycopg.Connection, command, told_twice)
                getattr(connection, command)()
            assert connection.invalidated
        with engine.connect() as connection:
            assert connection.execute(text("SELECT pg_backend_pid()")).scalar_one() != before
    finally:
        engine.dispose()


def told_twice(connection: psycopg.Connection) -> None:
    raise psycopg.InternalError("received 2 results from command 'COMMIT'")


def test_and_of_a_connection_that_makes_tiles(database_url: str) -> None:
    async def use() -> None:
        connections = Connections(database_url, PATIENCE, kept=1)
        try:
            with pytest.raises(psycopg.OperationalError):
                async with connections.one():
                    raise psycopg.InternalError("received 2 results from command 'COMMIT'")
        finally:
            await connections.close()

    asyncio.run(use())
