"""Large files in parts, over connections that break; and when a request is asked again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.cli.client import Client, ClientError
from app.cli.uploads import delivering
from app.cli.uploads.delivering import MOST_TRIES, deliver, ends_all, patiently
from ride_archive import FIRST, csv_ride

DATA = csv_ride(FIRST)


class Broken(httpx.HTTPTransport):
    """A network on which every second part gets lost: half of the time before the service has it, else after."""

    def __init__(self) -> None:
        super().__init__()
        self.patches: list[int] = []

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        if request.method != "PATCH":
            return super().handle_request(request)
        self.patches.append(int(request.headers["Upload-Offset"]))
        turn = len(self.patches) % 4
        if turn == 1:
            raise httpx.ConnectError("lost")
        answer = super().handle_request(request)
        if turn == 3:
            answer.read()
            raise httpx.ReadError("lost")
        return answer


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delivering, "IN_PARTS_BYTES", 100)
    monkeypatch.setattr(delivering, "PART_BYTES", 100)
    monkeypatch.setattr("app.cli.uploads.delivering.FIRST_PAUSE_S", 0.0)


def test_a_large_file_goes_in_parts_over_a_network_that_breaks(web: Any, tmp_path: Path) -> None:
    path, network, counted = tmp_path / "ride.csv", Broken(), list[int]()
    path.write_bytes(DATA)
    with Client(web.base, transport=network) as client:
        sent = deliver(client, (path,), {"method": "raw", "options": {"min_epochs": 5}}, sent=counted.append)
        again = client.send(path)
    assert len(network.patches) > len(set(network.patches)) > 3
    assert (again.drives[0].id, again.documents[0]["known"]) == (sent.drives[0].id, True)
    document = web.client.get(f"/v1/drives/{sent.drives[0].id}").json()
    assert (document["filename"], document["method"]) == ("ride.csv", "raw")
    assert web.client.get(f"/v1/drives/{sent.drives[0].id}/log").content == DATA


def test_an_older_service_gets_one_request(tmp_path: Path) -> None:
    path, asked = tmp_path / "ride.csv", list[str]()
    path.write_bytes(DATA)

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(f"{request.method} {request.url.path}")
        if request.url.path == "/v1/uploads":
            return httpx.Response(404, json={"detail": "There is nothing.", "type": "/problems/not-found"})
        request.read()
        return httpx.Response(202, content=json.dumps({"id": "1", "status": "queued"}))

    with Client("http://there", transport=httpx.MockTransport(answer)) as client:
        assert deliver(client, (path,), {}).drives[0].id == "1"
    assert asked == ["POST /v1/uploads", "POST /v1/drives", "GET /v1/drives/1"]


def refusal(status: int | None = None, wish_s: int | None = None, *, lost: bool = False) -> ClientError:
    error = ClientError("No.", status=status, retry_after_s=wish_s)
    error.is_lost = lost
    return error


@pytest.mark.parametrize(
    ("error", "tries", "ends"),
    [
        (refusal(lost=True), MOST_TRIES, True),
        (refusal(503), MOST_TRIES, True),
        (refusal(429, 30), MOST_TRIES, True),
        (refusal(429, 40_000), 1, True),
        (refusal(507), 1, True),
        (refusal(415), 1, False),
        (refusal(422), 1, False),
    ],
)
def test_what_may_be_another_answer_is_asked_again(error: ClientError, tries: int, ends: bool) -> None:
    asked, pauses = [], list[float]()

    def ask() -> None:
        asked.append(1)
        raise error

    with pytest.raises(ClientError):
        patiently(ask, pauses.append)
    assert (len(asked), ends_all(error)) == (tries, ends)
    assert all(pause >= (error.retry_after_s or 0) for pause in pauses)
