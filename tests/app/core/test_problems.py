"""Every error is answered by a problem document."""

from __future__ import annotations

import json
import logging
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi import Request

from app.core.errors import KINDS, BadRequestError, FieldError
from app.core.problems import problem_response
from app.core.settings import Settings
from app.main import create_app
from problem_support import OPERATIONS, check

BAD = {
    "drive_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "owner_id": ("x", "0", "-1", "999999999", "99999999999999999999"),
    "key_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "trial_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "operation_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "export_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "name": ("x", "%00"),
    "webhook_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "segment_id": ("x", "0", "-1", "999999999", "99999999999999999999"),
    "item_id": ("x", "0", "-1", "999999999", "99999999999999999999"),
    "z": ("x", "99"),
    "x": ("x", "-1"),
    "y": ("x", "-1"),
    "upload_id": ("x", "%00"),
    "removal_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "number": ("x", "0", "-1", "999999999", "99999999999999999999"),
    "slug": ("no-such-problem",),
    "collection": ("roads", "%00"),
    "tileMatrix": ("x", "-1", "31"),
    "tileRow": ("x", "-1", "1"),
    "tileCol": ("x", "-1", "1"),
    "file": ("x", "versant.svg", "%00"),
    "fontstack": ("Arial", "%00"),
    "range": ("x", "0-254", "%00"),
    "sender": ("x", "%00"),
    "capability": ("x", "vsk_x", "%00"),
}


NEEDED = {("DELETE", "/v1/owners/{owner_id}"): {"name": "x"}}
"""What a request has to say before it is looked whether there is such a thing."""
PUT_TO = {path for method, path, _ in (one.values for one in OPERATIONS) if method == "PUT"}


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_addresses_of_nothing_are_404(reading: Any, method: str, path: str, operation: Any) -> None:
    names = re.findall(r"{(\w+)}", path)
    for name in names:
        for value in BAD[name]:
            others = dict.fromkeys(names, "0") | {name: value}
            needed = NEEDED.get((method, path), {})
            status = 401 if "capability" in names else 404  # which is a key as well
            problem = check(reading.client.request(method, path.format(**others), params=needed), status)
            assert str(status) in operation["responses"], problem


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_methods_that_an_address_does_not_have(reading: Any, method: str, path: str, operation: Any) -> None:
    address = re.sub(r"{\w+}", "0", path)
    answer = reading.client.request("PATCH" if path in PUT_TO else "PUT", address)
    check(answer, 405)
    assert method in answer.headers["allow"]


@pytest.mark.parametrize(
    "path", ["/nowhere", "/v1", "/v1/drives/a/b/c", "/tiles/1/2/3.png", "/redoc", "/%2e%2e/x"]
)
def test_unknown_addresses(reading: Any, path: str) -> None:
    check(reading.client.get(path), 404)


@pytest.mark.parametrize(
    ("path", "field"),
    [
        ("/v1/drives?limit=0", "limit"),
        ("/v1/drives?limit=1001", "limit"),
        ("/v1/drives?status=lost", "status"),
        ("/v1/drives?after=1", "after"),
        ("/v1/drives?after=00000000-0000-0000-0000-000000000000", "after"),
        ("/v1/drives?after=f" + "_" * 31, "after"),
        ("/v1/drives?bogus=1", "bogus"),
        ("/v1/admin/stats?days=0", "days"),
    ],
)
def test_unusable_queries_name_the_field(reading: Any, path: str, field: str) -> None:
    problem = check(reading.client.get(path), 422)
    assert [error["field"] for error in problem["errors"]] == [field]


@pytest.mark.parametrize("body", [b'{"method": "\xff"}', b'{"options":' + b"[" * 60_000])
def test_a_body_that_is_no_text_or_too_deep_is_a_kind_of_its_own(reading: Any, body: bytes) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    answer = reading.client.post(
        f"/v1/drives/{drive}/reprocess", content=body, headers={"Content-Type": "application/json"}
    )
    assert check(answer, 400)["type"] == "/problems/unreadable-body"
    operation = create_app(Settings()).openapi()["paths"]["/v1/drives/{drive_id}/reprocess"]["post"]
    assert "400" in operation["responses"]


def test_broken_json_is_told_as_the_body_s_fault(reading: Any) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    answer = reading.client.post(
        f"/v1/drives/{drive}/reprocess", content=b"{", headers={"Content-Type": "application/json"}
    )
    problem = check(answer, 422)
    assert [error["field"] for error in problem["errors"]] == ["body"]
    assert "body: JSON decode error at character 1." in problem["detail"]


def test_a_problem_s_type_leads_to_its_meaning(reading: Any) -> None:
    problem = check(reading.client.get("/nowhere"), 404)
    meaning = reading.client.get(problem["type"]).json()
    assert meaning["type"] == problem["type"]
    assert meaning["title"] == problem["title"]


def test_a_fault_of_the_service_tells_nothing_of_its_inside(
    settings: Settings, server_maker: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("the password is swordfish")

    monkeypatch.setattr("app.drives.routes.drives.list_drives", fail)
    with server_maker(settings) as web:
        answer = web.client.get("/v1/drives")
        check(answer, 500)
        assert "swordfish" not in answer.text
        assert 'route="/v1/drives",status="500"' in web.client.get("/metrics").text


def test_a_fault_takes_no_other_request_with_it(
    tmp_path: Path, server_maker: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server closes the connection after it has logged the fault; a client must not send on it till then."""

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("a fault")

    class SlowLog(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            time.sleep(0.1)

    monkeypatch.setattr("app.drives.routes.drives.list_drives", fail)
    nowhere = "postgresql://versant@/none?host=" + str(tmp_path / "no-socket")
    with server_maker(Settings(database_url=nowhere, data_dir=tmp_path)) as web:
        server_log = logging.getLogger("uvicorn.error")
        monkeypatch.setattr(server_log, "handlers", [SlowLog()])
        monkeypatch.setattr(server_log, "level", logging.ERROR)
        for _ in range(3):
            answer = web.client.get("/v1/drives")
            check(answer, 500)
            assert answer.headers["connection"] == "close"
            assert web.client.get("/healthz").status_code == 200


@pytest.mark.parametrize("path", ["/{}", "/collections/segments/items?crs={}", "/v1/drives?{}=1"])
def test_a_long_request_is_not_answered_by_a_longer_one(reading: Any, path: str) -> None:
    answer = reading.client.get(path.format("a" * 20_000))
    assert answer.is_client_error
    assert len(answer.content) < 15_000
    document = answer.json()
    assert document["detail"].endswith(".") and " ... " in document["detail"]


def test_of_very_many_faults_some_are_told() -> None:
    errors = [FieldError(field=str(k), message="wrong") for k in range(5000)]
    answer = problem_response(
        Request({"type": "http", "path": "/", "headers": []}), KINDS[BadRequestError], "No.", errors
    )
    assert len(json.loads(bytes(answer.body))["errors"]) == 100


def test_a_problem_is_said_in_the_language_that_is_asked_for(reading: Any) -> None:
    path = "/v1/drives/00000000-0000-0000-0000-000000000000"
    english, german = (
        reading.client.get(path, headers={"Accept-Language": one})
        for one in ("fr", "de-DE,de;q=0.9,en;q=0.5")
    )
    assert english.json()["title"] == "Not found"
    assert english.json()["detail"].startswith("There is no drive 00000000-")
    assert "Content-Language" not in english.headers
    assert german.json()["title"] == "Nicht gefunden"
    assert german.json()["detail"].endswith(" gibt es nicht. Vielleicht wurde es gelöscht.")
    assert german.headers["Content-Language"] == "de"
    assert german.json()["said"] == english.json()["said"]
    assert german.json()["said"]["key"] == "service.not_there"
    assert german.json()["type"] == english.json()["type"]


def test_the_reason_at_a_field_is_said_so_too(reading: Any) -> None:
    answer = reading.client.get("/v1/drives?after=x", headers={"Accept-Language": "de"}).json()
    assert answer["title"] == "Unbrauchbare Anfrage"
    assert [one["message"] for one in answer["errors"]] == [answer["detail"]]
