"""Every error is a problem document; the API description says what there is."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from app.core.errors import KINDS, STATUS_KINDS, all_kinds, kind_of
from app.core.settings import Settings
from app.main import create_app
from fusion import errors as fusion_errors
from fusion.errors import FusionError

BAD = {
    "drive_id": ("no-uuid", "00000000-0000-0000-0000-000000000000", "%00"),
    "segment_id": ("x", "0", "-1", "999999999", "99999999999999999999"),
    "z": ("x", "99"),
    "x": ("x", "-1"),
    "y": ("x", "-1"),
    "slug": ("no-such-problem",),
}


def operations() -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, item in create_app(Settings()).openapi()["paths"].items():
        for method, operation in item.items():
            yield method.upper(), path, operation


OPERATIONS = [pytest.param(*operation, id=f"{operation[0]} {operation[1]}") for operation in operations()]


def check(answer: Any, *statuses: int) -> dict[str, Any]:
    assert answer.status_code in statuses, f"{answer.request.url}: {answer.status_code} {answer.text}"
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert set(problem) == {"type", "title", "status", "detail", "instance", "errors"}
    assert problem["status"] == answer.status_code
    assert problem["instance"] == answer.request.url.path
    assert problem["type"].removeprefix("/problems/") in all_kinds()
    assert problem["detail"].endswith(".")
    return problem


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_addresses_of_nothing_are_404(reading: Any, method: str, path: str, operation: Any) -> None:
    names = re.findall(r"{(\w+)}", path)
    for name in names:
        for value in BAD[name]:
            others = dict.fromkeys(names, "0") | {name: value}
            problem = check(reading.client.request(method, path.format(**others)), 404)
            assert "404" in operation["responses"], problem


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_methods_that_an_address_does_not_have(reading: Any, method: str, path: str, operation: Any) -> None:
    address = re.sub(r"{\w+}", "0", path)
    answer = reading.client.request("PATCH", address)
    check(answer, 405)
    assert method in answer.headers["allow"]


@pytest.mark.parametrize(
    "path", ["/nowhere", "/v1", "/v1/drives/a/b/c", "/tiles/1/2/3.png", "/docs", "/%2e%2e/x"]
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


def test_every_error_of_the_library_has_a_row() -> None:
    found = [
        cls for cls in vars(fusion_errors).values() if isinstance(cls, type) and issubclass(cls, FusionError)
    ]
    assert len(found) > 10
    for cls in found:
        assert cls in KINDS, cls
        assert KINDS[cls].slug == cls.kind
        assert 400 <= KINDS[cls].status < 500


def test_kinds_are_told_apart_by_their_type() -> None:
    rows = {kind.slug: kind for kind in KINDS.values()}
    assert len(rows) == len(set(KINDS.values()))
    assert kind_of(OperationalError("x", {}, Exception())).status == 503
    assert kind_of(ZeroDivisionError()).status == 500
    assert all(STATUS_KINDS[status].status == status for status in STATUS_KINDS)


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


def test_without_a_database_the_service_lives_and_is_not_ready(
    tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    nowhere = "postgresql://versant@/none?host=" + str(tmp_path / "no-socket")
    with server_maker(Settings(database_url=nowhere, data_dir=tmp_path)) as web:
        assert web.client.get("/healthz").json()["status"] == "ok"
        problem = check(web.client.get("/readyz"), 503)
        assert [error["field"] for error in problem["errors"]] == ["database"]
        answer = web.client.get("/v1/drives")
        check(answer, 503)
        assert answer.headers["retry-after"]
        assert "no-socket" not in answer.text
        assert "versant_database_up 0.0" in web.client.get("/metrics").text


def test_a_database_that_is_not_migrated_is_not_ready(
    blank_database_url: str, tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    with server_maker(Settings(database_url=blank_database_url, data_dir=tmp_path)) as web:
        assert "versant migrate" in check(web.client.get("/readyz"), 503)["detail"]


def test_a_store_that_cannot_be_written_to_is_not_ready(
    database_url: str, tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    (tmp_path / "blobs").write_text("a file where a folder should be")
    with server_maker(Settings(database_url=database_url, data_dir=tmp_path)) as web:
        problem = check(web.client.get("/readyz"), 503)
        assert [error["field"] for error in problem["errors"]] == ["blobs"]


# --- the OpenAPI document -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_every_route_is_described_with_an_example(method: str, path: str, operation: Any) -> None:
    schemas = create_app(Settings()).openapi()["components"]["schemas"]
    assert operation["summary"]
    assert operation["description"]
    assert operation["tags"]
    good = [answer for status, answer in operation["responses"].items() if status in {"200", "202"}]
    if method == "DELETE":
        return
    for answer in good:
        for media_type, content in answer["content"].items():
            if media_type.startswith(("image/", "application/vnd.mapbox")):
                continue
            assert content.get("example") or _examples(content["schema"], schemas), (method, path, media_type)
    for status, answer in operation["responses"].items():
        if int(status) >= 400:
            (content,) = answer["content"].items()
            assert content[0] == "application/problem+json"
            assert content[1]["example"]["status"] == int(status)


def _examples(schema: dict[str, Any], schemas: dict[str, Any]) -> Any:
    schema = schema.get("items", schema)
    return schemas[schema["$ref"].rsplit("/", 1)[-1]].get("examples") if "$ref" in schema else None


def test_every_reference_of_the_description_resolves(reading: Any) -> None:
    document = reading.client.get("/openapi.json").json()
    schemas = document["components"]["schemas"]
    references = set(re.findall(r"#/components/schemas/(\w+)", reading.client.get("/openapi.json").text))
    assert references <= set(schemas)
    assert "HTTPValidationError" not in schemas
    assert "loopback" in document["info"]["description"]


def test_head_is_get_without_a_body(reading: Any) -> None:
    for path in ("/", "/collections/segments/items", "/tiles.json", "/v1/drives", "/healthz"):
        head, get = reading.client.head(path), reading.client.get(path)
        assert head.status_code == get.status_code == 200
        assert not head.content
        assert head.headers["content-type"] == get.headers["content-type"]


def test_metrics_count_requests_by_route(reading: Any) -> None:
    reading.client.get("/v1/segments/1")
    reading.client.get("/v1/segments/999999")
    text = reading.client.get("/metrics").text
    for status in (200, 404):
        assert f'route="/v1/segments/{{segment_id}}",status="{status}"' in text
    assert 'versant_drives{status="done"} 2.0' in text
    assert "versant_queue_depth 0.0" in text
    assert "versant_database_up 1.0" in text
    assert "/v1/segments/1" not in text, "a series per segment would never end"


def test_ready_with_everything_in_place(reading: Any) -> None:
    assert reading.client.get("/readyz").json() == {
        "status": "ready",
        "checks": {"database": "ok", "blobs": "ok"},
    }
    assert not list((reading.settings.data_dir / "blobs" / "incoming").iterdir())
