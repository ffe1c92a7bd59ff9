"""What is done to every request, whatever its route."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from starlette.types import Message, Receive, Scope, Send

from app.core.middleware import KnownHosts
from app.core.receiving.pace import SMALL_BODY_BYTES
from app.core.settings import Settings
from problem_support import check


def test_head_is_get_without_a_body(reading: Any) -> None:
    for path in ("/", "/collections/segments/items", "/tiles.json", "/v1/drives", "/healthz"):
        head, get = reading.client.head(path), reading.client.get(path)
        assert head.status_code == get.status_code == 200
        assert not head.content
        assert head.headers["content-type"] == get.headers["content-type"]


def in_pieces(size: int) -> Iterator[bytes]:
    for _ in range(0, size, 1000):
        yield b" " * 1000


@pytest.mark.parametrize("announced", [True, False])
def test_a_body_that_is_too_large_is_refused_in_the_service_s_words(reading: Any, announced: bool) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    size = SMALL_BODY_BYTES + 1000
    answer = reading.client.post(
        f"/v1/drives/{drive}/reprocess",
        content=b" " * size if announced else in_pieces(size),
        headers={"Content-Type": "application/json"},
    )
    problem = check(answer, 413)
    assert problem["type"] == "/problems/too-large"
    assert problem["detail"] == f"The body is larger than {SMALL_BODY_BYTES} bytes. Send less."


def test_a_body_that_nobody_reads_is_nobody_s_concern(reading: Any) -> None:
    answer = reading.client.request("GET", "/healthz", content=b" " * (SMALL_BODY_BYTES + 1))
    assert answer.status_code == 200


@pytest.fixture(scope="module")
def known() -> Callable[..., bool]:
    """``known(name, address="127.0.0.1", path="/", **settings)``: whether a request under that name is let through."""

    def ask(name: str | None, address: str = "127.0.0.1", path: str = "/", **settings: str) -> bool:
        async def route(scope: Scope, receive: Receive, send: Send) -> None:
            nonlocal passed
            passed = True

        async def drop(_: Message) -> None:
            pass

        passed = False
        headers = [] if name is None else [(b"host", name.encode("latin-1"))]
        scope = {"type": "http", "path": path, "headers": headers, "server": (address, 8000), "method": "GET"}
        scope |= {"query_string": b"", "scheme": "http"}
        asyncio.run(KnownHosts(route, Settings(**settings))(scope, None, drop))  # type: ignore[arg-type]
        return passed

    return ask


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1:8000",
        "localhost:8000",
        "LOCALHOST",
        "localhost.",
        "127.9.9.9",
        "[::1]:8000",
        "192.168.1.5:8000",
        "versant.example",
        "Maps.Example.:443",
        None,
    ],
)
def test_names_of_the_service(known: Callable[..., bool], host: str | None) -> None:
    names = {"public_url": "https://versant.example", "allowed_hosts": "api, maps.example"}
    assert known(host, "192.168.1.5", **names)


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8000",
        "192.168.1.6",
        "localhost.evil.example",
        "127.0.0.1.evil.example",
        "evil.example@localhost",
        "localhost:8000:80",
        "[::2]",
        "",
        "\xe4",
    ],
)
def test_names_of_others(known: Callable[..., bool], host: str) -> None:
    assert not known(host)
    assert known(host, path="/healthz")
    assert known(host, path="/readyz")
    assert known(host, allowed_hosts="*")


def test_the_name_that_it_was_told_to_listen_on(known: Callable[..., bool]) -> None:
    assert known("box.lan", host="box.lan")
    assert not known("box.lan", host="0.0.0.0")  # noqa: S104 - nothing is bound


@pytest.mark.parametrize("path", ["/", "/v1/drives", "/tiles.json", "/metrics", "/openapi.json", "/nowhere"])
def test_a_page_under_another_name_reads_nothing(reading: Any, path: str) -> None:
    """A name that a page's owner has led to this machine after it was loaded."""
    answer = reading.client.get(
        path, headers={"Host": "rebound.example:8000", "Origin": "http://rebound.example"}
    )
    problem = check(answer, 421)
    assert problem["type"] == "/problems/unknown-host"
    assert "VERSANT_ALLOWED_HOSTS" in problem["detail"]


def test_a_page_under_another_name_changes_nothing(reading: Any) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    own = {"Host": "rebound.example", "Origin": "http://rebound.example"}
    check(reading.client.delete(f"/v1/drives/{drive}", headers=own), 421)
    assert reading.client.get(f"/v1/drives/{drive}").status_code == 200
