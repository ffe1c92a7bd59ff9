"""Bodies that come slowly, or not at all."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from app.core.receiving.pace import LEAST_PACE_BYTES_PER_S
from app.core.settings import Settings
from server_support import answered, holding

LOG = b"time_s,lat_deg,lon_deg\n1700000000,49.0,8.4\n1700000001,49.0001,8.4\n"
UPLOAD = b"POST /v1/drives?filename=a.csv HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d\r\n\r\n"


@pytest.fixture
def impatient(settings: Settings, server_maker: Callable[[Settings], Any]) -> Iterator[Any]:
    with server_maker(settings.model_copy(update={"body_timeout_s": 0.5, "upload_stall_s": 0.5})) as web:
        yield web


def problem_of(answer: bytes) -> dict[str, Any]:
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 408 "), answer
    assert b"connection: close" in head.lower()
    problem: dict[str, Any] = json.loads(body)
    assert problem["type"] == "/problems/slow-client"
    return problem


@pytest.mark.parametrize(
    "request_line", ["POST /v1/exports", "POST /v1/webhooks", "DELETE /v1/drives/x", "PUT /nowhere"]
)
def test_a_small_body_has_to_come_in_time(impatient: Any, request_line: str) -> None:
    head = f"{request_line} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{{".encode()
    with holding(impatient, head) as (client,):
        assert "not whole within 0.5 s" in problem_of(answered(client))["detail"]


@pytest.mark.parametrize(
    "path", ["/v1/drives?filename=a.csv", "/v1/operations?kind=import-dem&filename=a.tif"]
)
@pytest.mark.parametrize("dripping", [False, True])
def test_an_upload_that_stalls_ends_and_leaves_nothing(impatient: Any, path: str, dripping: bool) -> None:
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n".encode()
    with holding(impatient, head + LOG) as (client,):
        if dripping:
            client.settimeout(0.05)
            for _ in range(600):
                client.sendall(b"\n")
                try:
                    answer = client.recv(65536)
                    break
                except TimeoutError:
                    pass
        else:
            answer = answered(client)
    assert "stalled" in problem_of(answer)["detail"]
    assert list((impatient.settings.data_dir / "blobs").rglob("*.part")) == []
    assert impatient.client.get("/v1/drives").json()["drives"] == []


def test_an_upload_that_is_slow_but_goes_on_is_taken(impatient: Any) -> None:
    """Twice the least pace, several times as long as it may stall."""
    rows = b"".join(b"17000000%02d,49.0,8.4\n" % k for k in range(2, 99))
    body = LOG + rows * 2
    pieces = [body[k : k + 300] for k in range(0, len(body), 300)]
    with holding(impatient, UPLOAD % len(body)) as (client,):
        for piece in pieces:
            client.sendall(piece)
            time.sleep(300 / LEAST_PACE_BYTES_PER_S / 2)
        assert client.recv(65536).startswith(b"HTTP/1.1 202 ")


def test_a_client_that_leaves_within_a_small_body_is_no_fault(
    web: Any, caplog: pytest.LogCaptureFixture
) -> None:
    with holding(web, b"POST /v1/exports HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{"):
        pass
    assert web.client.get("/healthz").status_code == 200
    assert [one for one in caplog.records if one.exc_info] == []
