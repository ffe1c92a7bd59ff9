"""The gate itself: how a key is shown, what nobody is told, and that a revoked key is void at once."""

from __future__ import annotations

import base64
import threading
import time
from dataclasses import replace
from typing import Any

import httpx
import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from access_support import Keyed, asking_for_keys
from app.access import callers, store
from app.core.settings import Settings
from problem_support import check
from processing_support import HEADER
from server_support import wait_until
from web_fixtures import TLS, served

BASIC = ("", "anybody", "vsk")


@pytest.mark.parametrize("user", BASIC)
def test_a_key_may_be_a_password(guarded: Keyed, user: str) -> None:
    auth = (user, guarded.secrets["anna"])
    assert guarded.web.client.get("/v1/drives", auth=auth).status_code == 200
    check(guarded.web.client.get("/v1/drives", auth=(user, "wrong")), 401)


@pytest.mark.parametrize(
    "header",
    [
        "",
        "Bearer",
        "Basic",
        "Basic !!!",
        "Basic " + base64.b64encode(b"\xff:\xff").decode(),
        "Digest x",
        "x" * 9000,
    ],
)
def test_a_header_that_is_no_key_is_refused(guarded: Keyed, header: str) -> None:
    problem = check(guarded.web.client.get("/v1/drives", headers={"Authorization": header}), 401)
    assert problem["type"] == "/problems/unauthorized"


def test_a_wrong_key_is_refused_where_none_is_needed(settings: Settings) -> None:
    """Who sends a key wants to be known by it: the public map in its place would hide that it is wrong."""
    with asking_for_keys(settings) as guarded:
        assert guarded.web.client.get("/collections").status_code == 200
        check(guarded.ask("wrong", "GET", "/collections"), 401)
        assert guarded.ask("anna upload", "GET", "/collections").status_code == 200


@pytest.mark.parametrize("public_map", ["live", "off"])
@pytest.mark.parametrize(
    "path", ["/tiles/12/2143/1401.mvt", "/tiles/12/2143/1401.geojson", "/collections/segments/items"]
)
def test_the_map_is_public_or_is_not(settings: Settings, public_map: str, path: str) -> None:
    with asking_for_keys(settings, public_map=public_map) as guarded:
        client = guarded.web.client
        there = guarded.ask("ben", "GET", path).status_code
        assert there in {200, 204}
        for answer in (client.get(path), client.head(path)):
            assert answer.status_code == (there if public_map == "live" else 401)


@pytest.mark.parametrize(
    ("path", "caching"),
    [
        ("/tiles/12/2143/1401.mvt", "private, no-cache"),
        ("/v1/drives", "private"),
        ("/v1/keys", "private"),
        ("/v1/methods", "max-age=300"),
    ],
)
def test_no_cache_keeps_for_others_what_needed_a_key(guarded: Keyed, path: str, caching: str) -> None:
    assert guarded.ask("anna", "GET", path).headers["cache-control"] == caching


def test_programs_are_asked_for_a_password_and_browsers_are_not(guarded: Keyed) -> None:
    program = guarded.web.client.get("/v1/drives")
    assert program.headers["www-authenticate"] == 'Bearer realm="Versant", Basic realm="Versant"'
    browser = guarded.web.client.get("/v1/drives", headers={"Sec-Fetch-Mode": "cors"})
    assert browser.headers["www-authenticate"] == 'Bearer realm="Versant"'


def test_an_upload_is_refused_before_it_is_read(guarded: Keyed) -> None:
    sent = 0

    def body() -> Any:
        nonlocal sent
        for _ in range(20_000):
            sent += 1000
            yield b"x" * 1000

    try:
        answer = guarded.web.client.post("/v1/drives", content=body())
        assert answer.status_code == 401
    except httpx.WriteError:  # the connection was closed while it was being sent
        pass
    assert sent < 20_000_000
    with guarded.web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == 0


def test_everything_is_open_where_keys_are_not_asked_for(settings: Settings) -> None:
    with served(settings.model_copy(update={"access": "open"})) as web:
        assert web.client.post("/v1/drives", content=HEADER).status_code == 202
        assert len(web.client.get("/v1/drives").json()["drives"]) == 1
        document = web.client.get("/v1/session").json()
        assert (document["access"], document["scope"], document["owner"]) == ("open", "operate", None)


def test_a_revoked_key_is_void_in_every_process(settings: Settings) -> None:
    with asking_for_keys(settings) as guarded, served(guarded.web.settings) as other:
        elsewhere = replace(guarded, web=other)
        for where in (guarded, elsewhere):
            assert where.ask("anna", "GET", "/v1/drives").status_code == 200
        assert guarded.ask("anna", "DELETE", f"/v1/keys/{guarded.ids['anna']}").status_code == 204
        assert guarded.ask("anna", "GET", "/v1/drives").status_code == 401
        wait_until(lambda: elsewhere.ask("anna", "GET", "/v1/drives").status_code == 401)


def test_a_process_that_hears_nothing_asks_each_time(guarded: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def ask(session: Session, secret: str) -> store.Known | None:
        asked.append(secret)
        return store.by_key(session, secret)

    monkeypatch.setitem(callers._ASK, "key", ask)

    def kept() -> bool:
        before = len(asked)
        assert guarded.ask("anna", "GET", "/v1/drives").status_code == 200
        return len(asked) == before

    wait_until(kept)
    asked.clear()
    for _ in range(3):
        guarded.ask("anna", "GET", "/v1/drives")
    assert asked == []
    with guarded.web.sessions() as session:
        listening = text(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'versant listens'"
        )
        session.execute(listening)
    wait_until(lambda: guarded.ask("anna", "GET", "/v1/drives").status_code == 200 and asked != [])
    guarded.ask("anna", "GET", "/v1/drives")


def test_a_stream_ends_when_its_key_is_revoked(guarded: Keyed) -> None:
    headers = {"Authorization": f"Bearer {guarded.secrets['anna']}"}
    with httpx.Client(base_url=guarded.web.base, trust_env=False, verify=TLS, timeout=30) as client:
        drive = client.post("/v1/drives", content=HEADER, headers=headers).json()["id"]
        ended = threading.Event()
        told: list[str] = []

        def follow() -> None:
            with client.stream("GET", f"/v1/drives/{drive}/events", headers=headers) as answer:
                told.extend(answer.iter_lines())
            ended.set()

        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        wait_until(lambda: guarded.ask("anna", "GET", f"/v1/drives/{drive}").status_code == 200)
        time.sleep(0.3)
        guarded.ask("operate", "DELETE", f"/v1/keys/{guarded.ids['anna']}")
        with guarded.web.sessions.begin() as session:
            session.execute(text("UPDATE drives SET status = 'running', stage = 'secret'"))
        assert ended.wait(20)
        thread.join(20)
        assert not any("secret" in line for line in told)


def test_the_day_of_use_is_noted_and_no_more(guarded: Keyed) -> None:
    guarded.ask("anna", "GET", "/v1/drives")
    keys = {key["id"]: key for key in guarded.ask("operate", "GET", "/v1/keys").json()["keys"]}
    assert len(keys[str(guarded.ids["anna"])]["last_used_on"]) == len("2026-11-27")
    assert keys[str(guarded.ids["ben"])]["last_used_on"] is None


def test_a_database_that_is_away_is_said_as_by_any_route(
    guarded: Keyed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before any route is asked the framework answers no error; a client has to know that it may come again."""

    def away(*_: object) -> None:
        raise OperationalError("", {}, Exception("the server closed the connection"))

    monkeypatch.setitem(callers._ASK, "key", away)
    for method, path in (("GET", "/v1/drives"), ("POST", "/v1/drives"), ("GET", "/v1/session")):
        answer = guarded.ask("ben", method, path)
        assert check(answer, 503)["type"] == "/problems/database-unavailable"
        assert answer.headers["retry-after"]
