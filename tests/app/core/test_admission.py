"""What is slow waits for its own kind."""

from __future__ import annotations

import asyncio
from typing import Any

import httpx
import pytest
from starlette.types import Receive, Scope, Send

from app.core.admission import (
    MORE_CONNECTIONS,
    Admission,
    RequestClass,
    Turnstile,
    class_of_request,
    make_request_classes,
)
from app.core.errors import BusyError
from problem_support import check
from server_support import Gate, asked_at_once, holding, wait_until
from web_fixtures import TLS

QUICK = ("/healthz", "/readyz", "/v1/drives", "/v1/segments/999")


@pytest.mark.parametrize(
    ("method", "path", "kind"),
    [
        ("GET", "/tiles/8/133/87.mvt", "wide tiles"),
        ("HEAD", "/tiles/11/1/1.geojson", "wide tiles"),
        ("GET", "/tiles/12/1/1.mvt", "tiles"),
        ("GET", "/collections/segments/items", "wide tiles"),
        ("GET", "/collections/segments/items/7", None),
        ("GET", "/v1/drives/x/track", "parts"),
        ("GET", "/v1/drives/x/events", None),
        ("GET", "/v1/drives/x", None),
        ("GET", "/v1/segments/7/observations", "parts"),
        ("GET", "/v1/admin/stats", "figures"),
        ("DELETE", "/v1/drives/x", "changes"),
        ("POST", "/v1/drives/x/reprocess", "changes"),
        ("POST", "/v1/drives", None),
        ("GET", "/readyz", None),
    ],
)
def test_each_request_has_its_class(method: str, path: str, kind: str | None) -> None:
    assert class_of_request(method, path) == kind
    assert kind is None or kind in make_request_classes(5)


def test_the_classes_leave_connections_for_what_is_quick() -> None:
    for connections in (1, 5, 100):
        needed = sum(
            request_class.places + request_class.for_others
            for request_class in make_request_classes(connections).values()
        )
        assert needed <= connections + MORE_CONNECTIONS - 3


def test_sixty_slow_tiles_keep_nobody_else_waiting(reading: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, made = Gate(lambda *_, **__: []), Gate(lambda *_, **__: (None, b""))
    monkeypatch.setattr("app.map.tiles.routes.geojson_rows", gate)
    monkeypatch.setattr("app.map.tiles.store.kept_or_made", made.waited_for)
    paths = [f"/tiles/8/{x}/87.{suffix}" for x in range(30) for suffix in ("mvt", "geojson")]
    with asked_at_once(reading, paths) as answers:
        try:
            wait_until(lambda: gate.inside + made.inside == 2)
            for path in QUICK:
                assert reading.client.get(path).status_code in {200, 404}

            async def tile(*_: object) -> tuple[None, bytes]:
                return None, b"tile"

            monkeypatch.setattr("app.map.tiles.store.kept_or_made", tile)
            assert reading.client.get("/tiles/14/0/1.mvt").content == b"tile"
        finally:
            made.open.set()
            gate.open.set()
        assert {one.result() for one in answers} <= {200, 204}
    assert 1 <= max(gate.most, made.most) <= 2


def test_sixty_deletions_keep_nobody_else_waiting(reading: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gate = Gate(lambda *_, **__: None)
    monkeypatch.setattr("app.drives.routes.intake.reprocess", gate)
    drive = "00000000-0000-0000-0000-000000000000"

    def ask(web: Any) -> None:
        with httpx.Client(base_url=web.base, trust_env=False, timeout=60, verify=TLS) as client:
            client.post(f"/v1/drives/{drive}/reprocess")

    from threading import Thread  # noqa: PLC0415 - the only use

    clients = [Thread(target=ask, args=(reading,)) for _ in range(60)]
    for client in clients:
        client.start()
    try:
        wait_until(lambda: gate.inside == 2)
        for path in QUICK:
            assert reading.client.get(path).status_code in {200, 404}
    finally:
        gate.open.set()
        for client in clients:
            client.join()
    assert gate.most == 2


def test_life_and_readiness_need_no_thread_that_others_use(
    reading: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More requests than there are threads, of no class."""
    gate = Gate(lambda *_, **__: [])
    monkeypatch.setattr("app.drives.routes.drives.list_drives", gate)
    with asked_at_once(reading, ["/v1/drives"] * 50) as answers:
        try:
            wait_until(lambda: gate.inside == 40)
            assert reading.client.get("/healthz", timeout=10).status_code == 200
            assert reading.client.get("/readyz", timeout=10).status_code == 200
        finally:
            gate.open.set()
        assert {one.result() for one in answers} == {200}


def test_who_comes_when_too_many_wait_is_sent_away() -> None:
    async def scenario() -> None:
        request_class = RequestClass(places=1, most_waiting=1, longest_wait_s=0.05)
        async with request_class.place():
            waiting = asyncio.create_task(request_class.place().__aenter__())
            await asyncio.sleep(0)
            with pytest.raises(BusyError, match="wait already"):
                await request_class.place().__aenter__()
            with pytest.raises(BusyError, match="took more than"):
                await waiting
        async with request_class.place():
            pass

    asyncio.run(scenario())


def test_being_sent_away_is_a_503_that_says_when_to_come_again() -> None:
    async def route(scope: Scope, receive: Receive, send: Send) -> None:
        raise AssertionError("nothing of a request begins before it has a place")

    async def scenario() -> httpx.Response:
        request_class = RequestClass(places=1, most_waiting=0)
        app = Admission(route, {"tiles": request_class})
        async with (
            request_class.place(),
            httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client,
        ):
            return await client.get("/tiles/14/1/1.mvt")

    answer = asyncio.run(scenario())
    assert check(answer, 503)["type"] == "/problems/busy"
    assert int(answer.headers["retry-after"]) > 0


def test_a_crowd_is_begun_one_after_the_other_and_a_probe_passes() -> None:
    begun: list[str] = []

    async def route(scope: Scope, receive: Receive, send: Send) -> None:
        begun.append(scope["path"])

    async def scenario() -> None:
        app = Turnstile(route)
        asked = ["/a"] * 100 + ["/healthz"]
        scopes = [{"type": "http", "path": path} for path in asked]
        await asyncio.gather(*(app(scope, None, None) for scope in scopes))  # type: ignore[arg-type]

    asyncio.run(scenario())
    assert len(begun) == 101
    assert begun.index("/healthz") <= 1


def test_a_client_that_reads_slowly_holds_no_place() -> None:
    sent = asyncio.Event()

    async def route(scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def scenario() -> None:
        request_class = RequestClass(places=1)

        async def slow(message: Any) -> None:
            if message["type"] == "http.response.body":
                async with request_class.place():
                    sent.set()

        scope = {"type": "http", "method": "GET", "path": "/tiles/14/1/1.mvt", "query_string": b""}
        await Admission(route, {"tiles": request_class})(scope, None, slow)  # type: ignore[arg-type]

    asyncio.run(scenario())
    assert sent.is_set()


def test_streams_that_come_by_the_hundred_let_others_pass() -> None:
    begun: list[str] = []

    async def route(scope: Scope, receive: Receive, send: Send) -> None:
        begun.append(scope["path"])

    async def scenario() -> None:
        app = Turnstile(route)
        asked = [f"/v1/drives/{k}/events" for k in range(100)] + ["/v1/drives"]
        scopes = [{"type": "http", "path": path} for path in asked]
        await asyncio.gather(*(app(scope, None, None) for scope in scopes))  # type: ignore[arg-type]

    asyncio.run(scenario())
    assert len(begun) == 101
    assert begun.index("/v1/drives") <= 2


@pytest.mark.parametrize(
    ("query", "kind"),
    [
        ("", "wide tiles"),
        ("bbox=8,49,9,50&limit=10&f=html&after=x", "wide tiles"),
        ("filter=drives%3E1", "searches"),
        ("f%69lter=drives%3E1", "searches"),
        ("bbox=8,49,9,50&sortby=-drives", "searches"),
        ("drives=3", "searches"),
    ],
)
def test_searches_keep_no_plain_page_waiting(query: str, kind: str) -> None:
    assert class_of_request("GET", "/collections/segments/items", query.encode()) == kind


@pytest.mark.parametrize("path", ["/v1/exports", "/v1/drives/00000000-0000-0000-0000-000000000000/reprocess"])
def test_a_body_that_does_not_come_holds_nothing(reading: Any, path: str) -> None:
    """Bodies are read before a request has a place: silent ones would else answer all changes with 503."""
    silent = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{{".encode()
    nothing = "/v1/drives/00000000-0000-0000-0000-000000000000"
    with holding(reading, silent, 20):
        for _ in range(5):
            assert reading.client.post(f"{nothing}/reprocess", timeout=5).status_code == 404
