"""What a connection may hold before there is a request, and after its answer."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from app.cli.service import GRACEFUL_S
from app.core.receiving import connections
from app.core.receiving.connections import HEAD_BYTES, MOST_HEADERS
from app.core.settings import Settings
from server_support import answered, asking_from, holding, wait_until

HALF = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX-Slow: "
LIMITS = {"connections_max": 60, "connections_per_client": 20, "head_timeout_s": 600.0}


@pytest.fixture
def bounded(settings: Settings, server_maker: Callable[[Settings], Any]) -> Iterator[Any]:
    """A service with room for few connections, on which nothing ends by itself."""
    with server_maker(settings.model_copy(update=LIMITS)) as web:
        yield web


@pytest.fixture
def impatient(settings: Settings, server_maker: Callable[[Settings], Any]) -> Iterator[Any]:
    with server_maker(settings.model_copy(update={"head_timeout_s": 0.5})) as web:
        yield web


def problem_in(answer: bytes, status: int) -> str:
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(f"HTTP/1.1 {status} ".encode()), answer
    assert b"application/problem+json" in head
    problem = json.loads(body)
    assert problem["status"] == status
    return str(problem["type"])


@pytest.mark.parametrize("attacker", ["127.0.0.2", "127.0.0.1"])
@pytest.mark.parametrize("sent", [b"", HALF])
def test_a_thousand_half_requests_leave_room_for_a_probe(bounded: Any, attacker: str, sent: bytes) -> None:
    """Also to who shares the attacker's address: the oldest silent connections give way."""
    with holding(bounded, sent, 300, client=attacker):
        for path in ("/healthz", "/readyz", "/v1/drives"):
            with asking_from(bounded, "127.0.0.1") as client:
                assert client.get(path, timeout=10).status_code == 200


def test_a_connection_in_use_is_not_the_one_that_gives_way(bounded: Any) -> None:
    with asking_from(bounded, "127.0.0.3") as other, holding(bounded, HALF, 1, client="127.0.0.3") as first:
        assert other.get("/healthz").status_code == 200
        with holding(bounded, HALF, 300, client="127.0.0.2"):
            first[0].sendall(b"\r\nConnection: close\r\n\r\n")
            assert answered(first[0]).startswith(b"HTTP/1.1 200 ")


def test_a_server_that_stops_ends_its_streams(
    settings: Settings, server_maker: Callable[[Settings], Any], caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody waits for the grace of requests, and nothing is cancelled, which the log would be full of."""
    stream = b"GET /v1/changes/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with ExitStack() as held:
        with server_maker(settings) as web:
            (client,) = held.enter_context(holding(web, stream))
            begun = client.recv(65536)
            while b"event: " not in begun:
                begun += client.recv(65536)
            stopped = time.monotonic()
        assert time.monotonic() - stopped < GRACEFUL_S
        assert answered(client).endswith(b"0\r\n\r\n"), "it is whole"
    assert [one for one in caplog.messages if "Cancel" in one or "Exception" in one] == []


def test_beyond_its_requests_at_once_a_client_gets_probes_alone(bounded: Any) -> None:
    stream = b"GET /v1/changes/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
    body = b"POST /v1/drives HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nx"
    with (
        holding(bounded, stream, 5, client="127.0.0.2"),
        holding(bounded, body, 15, client="127.0.0.2"),
        asking_from(bounded, "127.0.0.2") as same,
        asking_from(bounded, "127.0.0.1") as other,
    ):
        wait_until(lambda: same.get("/v1/drives").status_code == 503)
        refused = same.get("/v1/drives")
        assert refused.json()["type"] == "/problems/busy"
        assert int(refused.headers["retry-after"]) > 0
        assert same.get("/healthz").status_code == 200
        assert other.get("/v1/drives").status_code == 200
    with asking_from(bounded, "127.0.0.2") as same:
        wait_until(lambda: same.get("/v1/drives").status_code == 200)


def test_connections_of_a_trusted_proxy_are_those_of_many(
    settings: Settings, server_maker: Callable[[Settings], Any]
) -> None:
    with (
        server_maker(settings.model_copy(update={**LIMITS, "trusted_proxies": "127.0.0.2"})) as web,
        holding(web, HALF, 30, client="127.0.0.2") as held,
        asking_from(web, "127.0.0.2") as proxy,
    ):
        assert proxy.get("/healthz").status_code == 200
        held[0].sendall(b"\r\nConnection: close\r\n\r\n")
        assert answered(held[0]).startswith(b"HTTP/1.1 200 ")


@pytest.mark.parametrize(("sent", "said"), [(b"", b""), (b"\r\n", None), (HALF, None)])
def test_a_head_that_does_not_come_ends_its_connection(
    impatient: Any, sent: bytes, said: bytes | None
) -> None:
    with holding(impatient, sent) as (client,):
        answer = answered(client)
    assert answer == said or problem_in(answer, 408) == "/problems/slow-client"


def test_a_head_that_drips_ends_its_connection_too(impatient: Any) -> None:
    """Also between two requests, where each byte would else begin the waiting anew."""
    whole = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
    for before, drop in ((b"", b"x"), (whole, b"\r\n")):
        with holding(impatient, before or HALF) as (client,):
            started = time.monotonic()
            try:
                while time.monotonic() - started < 20:
                    client.sendall(drop)
                    time.sleep(0.05)
            except OSError:
                pass
            assert time.monotonic() - started < 15


@pytest.mark.parametrize(
    "head",
    [
        b"X-Long: " + b"a" * 2_000_000,
        b"".join(b"X-%d: a\r\n" % k for k in range(MOST_HEADERS + 5)) + b"\r\n",
        b"X-Long: " + b"a" * HEAD_BYTES + b"\r\n\r\n",
    ],
)
def test_a_head_without_end_is_refused(reading: Any, head: bytes) -> None:
    with holding(reading, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n" + head) as (client,):
        assert problem_in(answered(client), 431) == "/problems/head-too-large"


def test_an_address_as_long_as_programs_send_is_taken(reading: Any) -> None:
    assert reading.client.get("/healthz", params={"q": "a" * 8000}).status_code == 200


def test_trailers_without_end_are_refused(reading: Any) -> None:
    head = b"POST /v1/drives HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\nX-Long: "
    with holding(reading, head) as (client,):
        try:
            for _ in range(40):
                client.sendall(b"a" * 100_000)
                time.sleep(0.01)
        except OSError:
            return
        assert answered(client)
        pytest.fail("four megabytes of a trailer were taken")


def test_a_packet_of_a_thousand_requests_is_refused(reading: Any) -> None:
    slow = b"GET /v1/changes/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
    one = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with holding(reading, slow + one * 1000) as (client,):
        assert answered(client).count(b"HTTP/1.1 200") <= 1
    with holding(reading, one * 5 + one.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")) as (client,):
        assert answered(client).count(b"HTTP/1.1 200") == 6


def test_an_answer_that_nobody_takes_is_given_up(reading: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "UNREAD_S", 0.2)
    ask = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with holding(reading, b"") as (client,):
        client.settimeout(1.0)
        started = time.monotonic()
        with pytest.raises(OSError):
            while time.monotonic() - started < 60:
                client.sendall(ask)
                time.sleep(0.02)
        assert time.monotonic() - started < 60


def test_there_are_never_more_connections_than_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1024, 1500))
    raised: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: raised.append(limits))
    assert connections._as_files_allow(2000) == 1500 - connections.OWN_FILES - connections.SPARE
    assert raised == [(1500, 1500)]
    assert connections._as_files_allow(500) == 500
    assert len(raised) == 1
