"""How long a request waits for the database, and that nobody else is hurried."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy import text

from app.core.admission import MORE_CONNECTIONS
from app.core.db import Patience, make_engine
from app.core.settings import Settings
from problem_support import check
from server_support import Gate, asked_at_once, sleep, wait_until

MakeServer = Callable[[Settings], Any]


def shown(url: str, patience: Patience | None) -> list[str]:
    engine = make_engine(url, patience=patience)
    with engine.connect() as connection:
        found = [
            connection.execute(text(f"SHOW {name}")).scalar_one()
            for name in ("statement_timeout", "lock_timeout")
        ]
    engine.dispose()
    return found


def test_only_who_has_little_patience_is_hurried(database_url: str) -> None:
    assert shown(database_url, Patience(7.5, 0.25, 1.0)) == ["7500ms", "250ms"]
    assert shown(database_url, None) == ["0", "0"]


@pytest.mark.parametrize("background", [False, True])
def test_what_a_pool_does_is_told_to_nobody(
    database_url: str, background: bool, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    engine = make_engine(database_url, background=background)
    with engine.connect() as connection:
        connection.invalidate()
    engine.dispose()
    assert caplog.messages == []


def test_a_connection_that_comes_back_after_the_end_is_closed(database_url: str) -> None:
    engine = make_engine(database_url)
    with engine.connect() as kept, engine.connect() as late:
        kept.close()
        driver = late.connection.dbapi_connection
        engine.dispose()
        assert late.execute(text("SELECT 1")).scalar_one() == 1
    assert driver is not None
    assert driver.closed


def test_a_statement_that_takes_too_long_is_a_503(
    settings: Settings, server_maker: MakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.drives.routes.drives.list_drives", sleep)
    with server_maker(settings.model_copy(update={"statement_timeout_s": 0.2})) as web:
        answer = web.client.get("/v1/drives")
    problem = check(answer, 503)
    assert problem["type"] == "/problems/too-slow"
    assert "VERSANT_STATEMENT_TIMEOUT_S" in problem["detail"]
    assert int(answer.headers["retry-after"]) > 0


def test_a_lock_that_is_not_had_is_a_503(settings: Settings, server_maker: MakeServer) -> None:
    with server_maker(settings.model_copy(update={"lock_timeout_s": 0.1})) as web:
        with web.sessions.begin() as session:
            session.execute(text("LOCK TABLE drives"))
            answer = web.client.get("/v1/drives")
        assert web.client.get("/v1/drives").status_code == 200
    assert check(answer, 503)["type"] == "/problems/locked"
    assert int(answer.headers["retry-after"]) > 0


def test_when_all_connections_are_in_use_others_are_told_soon_and_the_service_stays_ready(
    settings: Settings, server_maker: MakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look(session: Any, **_: object) -> list[Any]:
        session.execute(text("SELECT 1"))
        gate()
        return []

    gate = Gate(lambda: None)
    monkeypatch.setattr("app.drives.routes.drives.list_drives", look)
    changed = {"db_pool_size": 2, "pool_timeout_s": 0.2}
    with (
        server_maker(settings.model_copy(update=changed)) as web,
        asked_at_once(web, ["/v1/drives"] * (2 + MORE_CONNECTIONS)) as answers,
    ):
        try:
            wait_until(lambda: gate.inside == 2 + MORE_CONNECTIONS)
            answer = web.client.get("/v1/segments/1")
            assert web.client.get("/readyz").status_code == 200
        finally:
            gate.open.set()
        assert {one.result() for one in answers} == {200}
    assert check(answer, 503)["type"] == "/problems/no-connection"
    assert int(answer.headers["retry-after"]) > 0
