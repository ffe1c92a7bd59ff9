"""Uploads: streamed, bounded, recognised when they come again; errors leave nothing behind."""

from __future__ import annotations

import gzip
import hashlib
import json
import socket
import threading
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import fsspec
import httpx
import pytest
from sqlalchemy import text

from app.core.settings import Settings
from processing_support import carry_out_removals
from web_fixtures import TLS

LOG = b"time_s,lat_deg,lon_deg\n1700000000,49.0,8.4\n"


def nothing_left(web: Any) -> bool:
    """Neither a drive, nor a job, nor a blob, nor a part of one."""
    with web.sessions() as session:
        drives = session.execute(text("SELECT count(*) FROM drives")).scalar_one()
        jobs = session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one()
    folder = web.settings.data_dir / "blobs"
    return drives == jobs == 0 and not [path for path in folder.rglob("*") if path.is_file()]


def test_a_form_and_a_bare_body_are_the_same_upload(web: Any) -> None:
    first = web.client.post("/v1/drives", files={"file": ("C:\\logs\\monday.csv", LOG)})
    assert first.status_code == 202
    document = first.json()
    assert document["status"] == "queued"
    assert {link["rel"] for link in document["links"]} >= {"self", "events", "track", "segments"}
    assert first.headers["location"] == f"{web.base}/v1/drives/{document['id']}"
    drive = web.client.get(first.headers["location"]).json()
    assert drive["sha256"] == hashlib.sha256(LOG).hexdigest()
    assert drive["size_bytes"] == len(LOG)
    assert drive["filename"] == "monday.csv"
    assert drive["method"] == "raw"

    again = web.client.post("/v1/drives", content=LOG, headers={"X-Filename": "other.csv"})
    assert again.status_code == 200
    assert again.json()["id"] == document["id"]
    assert again.headers["location"] == first.headers["location"]
    with web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 1
    assert len(web.blobs.keys()) == 1


def test_the_bytes_are_stored_as_they_came(web: Any) -> None:
    data = gzip.compress(LOG + b"\n" * 5000 + bytes(range(256)) * 500)
    headers = {"Content-Type": "application/x-www-form-urlencoded", "Content-Encoding": "gzip"}
    answer = web.client.post("/v1/drives?filename=a/b/log.ubx.gz", content=data, headers=headers)
    assert answer.status_code == 202
    assert web.client.get(answer.headers["location"]).json()["filename"] == "log.ubx.gz"
    (key,) = web.blobs.keys()
    with web.blobs.open(key) as file:
        assert file.read() == data


def test_the_same_bytes_many_times_at_once_are_one_drive(web: Any) -> None:
    def upload(_: int) -> Any:
        return httpx.post(
            f"{web.base}/v1/drives", files={"file": LOG}, trust_env=False, timeout=60, verify=TLS
        )

    with ThreadPoolExecutor(6) as pool:
        answers = list(pool.map(upload, range(12)))
    assert sorted(answer.status_code for answer in answers) == [200] * 11 + [202]
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert len(web.blobs.keys()) == 1


def test_an_announced_size_above_the_limit_is_refused_before_anything_is_read(web: Any) -> None:
    host, port = web.base.removeprefix("http://").split(":")
    head = f"POST /v1/drives HTTP/1.1\r\nHost: {host}\r\nContent-Length: 999999999\r\n\r\n"
    with socket.create_connection((host, int(port)), timeout=30) as connection:
        connection.sendall(head.encode())
        answer = connection.makefile("rb").read()  # nothing of the body is ever sent
    assert answer.startswith(b"HTTP/1.1 413")
    assert b"application/problem+json" in answer
    assert b"200000 bytes" in answer
    assert nothing_left(web)


@pytest.mark.parametrize("multipart", [False, True])
def test_an_endless_body_is_cut_at_the_limit(web: Any, multipart: bool) -> None:
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        if multipart:
            yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="x"\r\n\r\n'
        while sent < 500_000_000:
            sent += 50_000
            yield b"x" * 50_000

    headers = {"Content-Type": "multipart/form-data; boundary=b"} if multipart else {}
    answer = web.client.post("/v1/drives", content=endless(), headers=headers)
    assert answer.status_code == 413
    assert answer.json()["type"] == "/problems/too-large"
    assert answer.headers["connection"] == "close"
    assert sent < 100_000_000, "the body was read to its end"
    assert nothing_left(web)


def test_exactly_the_limit_is_taken(web: Any) -> None:
    most = web.settings.max_upload_bytes
    first, second = LOG.ljust(most, b"a"), LOG.ljust(most, b"b")
    for content in ({"content": first}, {"files": {"file": second}}):
        assert web.client.post("/v1/drives", **content).status_code == 202
    for content in ({"content": b"a" * (most + 1)}, {"files": {"file": b"b" * (most + 1)}}):
        assert web.client.post("/v1/drives", **content).status_code == 413


def form(*parts: tuple[str, bytes], end: bytes = b"--b--\r\n") -> dict[str, Any]:
    body = b"".join(
        f'--b\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n'.encode() + data + b"\r\n"
        for name, data in parts
    )
    return {"content": body + end, "headers": {"Content-Type": "multipart/form-data; boundary=b"}}


@pytest.mark.parametrize(
    ("request_", "status", "field"),
    [
        ({"content": b""}, 422, "file"),
        ({"files": {"file": b""}}, 422, "file"),
        ({"files": {"log": LOG}}, 422, "file"),
        (form(("note", b"x" * 70_000), ("file", LOG)), 422, "file"),
        (form(("file", LOG), end=b""), 422, "body"),
        ({"content": b"x", "headers": {"Content-Type": "multipart/form-data; boundary=b"}}, 422, "body"),
        ({"content": b"x", "headers": {"Content-Type": "multipart/form-data"}}, 415, "Content-Type"),
        ({"content": b"x", "headers": {"Content-Type": "multipart/mixed; boundary=b"}}, 415, "Content-Type"),
        ({"content": b"x", "headers": {"Content-Encoding": "br"}}, 415, "Content-Encoding"),
        ({"content": LOG, "params": {"method": "guess"}}, 422, None),
        ({"content": LOG, "params": {"options": "[1]"}}, 422, "options"),
        ({"content": LOG, "params": {"options": "[" * 5000}}, 422, "options"),
        ({"content": LOG, "params": {"option": "particles"}}, 422, "option"),
        ({"content": LOG, "params": {"option": "no_such:1"}}, 422, "no_such"),
        ({"content": LOG, "params": {"options": json.dumps({"no_such": 1})}}, 422, "no_such"),
    ],
)
def test_what_is_refused_and_why(web: Any, request_: dict[str, Any], status: int, field: str | None) -> None:
    answer = web.client.post("/v1/drives", **request_)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert [error["field"] for error in answer.json()["errors"]] == ([field] if field else [])
    assert nothing_left(web)


def test_options_are_kept_as_asked(web: Any) -> None:
    query = {"method": "particle", "options": '{"particles": 500}', "option": ["seed:3", "dem_window:tin"]}
    answer = web.client.post("/v1/drives", content=LOG, params=query)
    assert answer.status_code == 202, answer.text
    drive = web.client.get(answer.headers["location"]).json()
    assert drive["method"] == "particle"
    assert drive["options"] == {"particles": 500, "seed": 3, "dem_window": "tin"}


def test_a_client_that_leaves_midway_leaves_nothing(web: Any) -> None:
    host, port = web.base.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=30) as connection:
        connection.sendall(
            b"POST /v1/drives HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n" + b"x" * 50_000
        )
    waiting = threading.Event()
    for _ in range(500):  # the server notices in its own time
        counted = 'route="/v1/drives",status="499"' in web.client.get("/metrics").text
        if counted and nothing_left(web):
            return
        waiting.wait(0.02)
    raise AssertionError("the part of an upload is still there")


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
    ],
)
def test_pages_of_other_sites_change_nothing(web: Any, headers: dict[str, str]) -> None:
    answer = web.client.post("/v1/drives", files={"file": LOG}, headers=headers)
    assert answer.status_code == 403
    assert answer.json()["type"] == "/problems/cross-origin-write"
    assert nothing_left(web)
    own = {"Origin": web.base, "Sec-Fetch-Site": "same-origin"}
    assert web.client.post("/v1/drives", files={"file": LOG}, headers=own).status_code == 202


def test_an_odd_disposition_does_not_stop_an_upload(web: Any) -> None:
    answer = web.client.post(
        "/v1/drives", content=LOG, headers={"Content-Disposition": "attachment; filename*=idna''abc"}
    )
    assert answer.status_code == 202, answer.text


def test_a_full_disk_is_said_and_nothing_stays(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    incoming = web.settings.data_dir / "blobs" / "incoming"
    incoming.mkdir(parents=True)
    name = uuid.uuid4()
    (incoming / name.hex).symlink_to("/dev/full")
    with monkeypatch.context() as patch:
        patch.setattr("app.core.blobs.uuid.uuid4", lambda: name)
        answer = web.client.post("/v1/drives", content=b"x" * 100_000)
    assert answer.status_code == 507
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["type"] == "/problems/storage-full"
    assert "again later" in answer.json()["detail"]
    assert list(incoming.iterdir()) == []
    assert nothing_left(web)
    assert web.client.post("/v1/drives", content=LOG).status_code == 202


def test_gzipped_copies_are_one_drive(web: Any) -> None:
    """The same log compressed by another program, under another name, or not at all."""
    forms = [gzip.compress(LOG, 9), LOG, gzip.compress(LOG, 1, mtime=1)]
    answers = [web.client.post("/v1/drives", content=form) for form in forms]
    assert [answer.status_code for answer in answers] == [202, 200, 200]
    (location,) = {answer.headers["location"] for answer in answers}
    drive = web.client.get(location).json()
    assert drive["sha256"] == hashlib.sha256(forms[0]).hexdigest()
    assert drive["size_bytes"] == len(forms[0])
    assert "content_sha256" not in drive
    assert len(web.blobs.keys()) == 1


def test_uploads_to_a_bucket(settings: Settings, bucket: str, server_maker: Callable[..., Any]) -> None:
    with server_maker(settings.model_copy(update={"blob_url": f"{bucket}/logs"})) as web:
        assert web.client.get("/readyz").status_code == 200
        answers = [web.client.post("/v1/drives", content=content) for content in (LOG, LOG, b"x" * 200_001)]
        assert [answer.status_code for answer in answers] == [202, 200, 413]
        (key,) = web.blobs.keys()
        with web.blobs.open(key) as file:
            assert file.read() == LOG
        drive = answers[0].headers["location"]
        web.client.delete(drive)
        carry_out_removals(web.sessions, web.blobs)
        assert web.blobs.keys() == []
    assert [path for path in fsspec.filesystem("s3").find(bucket) if "/databases/" not in path] == []
