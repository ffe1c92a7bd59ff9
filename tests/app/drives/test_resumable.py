"""Uploads by tus 1.0.0: begun, broken off, gone on with, given up, and the same drive as by one request."""

from __future__ import annotations

import base64
import hashlib
import socket
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from sqlalchemy import text

from app.drives.receiving import resumed
from ride_archive import FIRST, csv_ride, fit_ride, zipped
from server_support import wait_until

TUS = {"Tus-Resumable": "1.0.0"}
PATCH = TUS | {"Content-Type": "application/offset+octet-stream"}
RIDE = csv_ride(FIRST)


def begun(web: Any, size: int, query: str = "", **headers: str) -> str:
    answer = web.client.post(f"/v1/uploads{query}", headers=TUS | {"Upload-Length": str(size)} | headers)
    assert answer.status_code == 201, answer.text
    assert answer.headers["tus-resumable"] == "1.0.0"
    assert "GMT" in answer.headers["upload-expires"]
    return str(urlsplit(answer.headers["location"]).path)


def sent(web: Any, place: str, offset: int, data: bytes, **headers: str) -> httpx.Response:
    answer: httpx.Response = web.client.patch(
        place, content=data, headers=PATCH | {"Upload-Offset": str(offset)} | headers
    )
    return answer


def offset_of(web: Any, place: str) -> int:
    return int(web.client.head(place, headers=TUS).headers["upload-offset"])


def parts(web: Any) -> list[str]:
    folder = Path(urlsplit(web.settings.blob_store_url).path) / "incoming"
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def test_an_upload_in_parts_is_the_drive_of_one_request(web: Any) -> None:
    name = base64.b64encode("Fahrt Ä.csv".encode()).decode()
    place = begun(web, len(RIDE), "?method=raw", **{"Upload-Metadata": f"filename {name},other"})
    assert offset_of(web, place) == 0
    assert sent(web, place, 0, RIDE[:100]).headers["upload-offset"] == "100"
    assert offset_of(web, place) == 100
    assert web.client.get(place).json() == {"offset": 100, "length": len(RIDE)}
    last = sent(web, place, 100, RIDE[100:])
    assert (last.status_code, last.content, last.headers["upload-offset"]) == (204, b"", str(len(RIDE)))
    answer = web.client.get(place)
    document = answer.json()
    assert answer.headers["content-location"] == last.headers["content-location"]
    drive = web.client.get(urlsplit(last.headers["content-location"]).path).json()
    assert (drive["id"], drive["filename"], drive["method"]) == (document["id"], "Fahrt Ä.csv", "raw")
    again = web.client.post("/v1/drives?method=raw", content=RIDE)
    assert (again.status_code, again.json()["id"]) == (200, document["id"])
    assert web.client.get(f"/v1/drives/{document['id']}/log").content == RIDE
    assert sent(web, place, len(RIDE), b"").status_code == 204  # as often as it is asked
    assert [one for one in parts(web) if one[-1].isdigit() and one.count(".") == 3] == []


def test_what_came_before_a_connection_broke_is_kept(web: Any) -> None:
    place, base = begun(web, 150_000), urlsplit(web.base)
    head = f"PATCH {place} HTTP/1.1\r\nHost: {base.netloc}\r\nContent-Length: 150000\r\nUpload-Offset: 0\r\n"
    head += "".join(f"{name}: {value}\r\n" for name, value in PATCH.items())
    with socket.create_connection((str(base.hostname), int(base.port or 80))) as client:
        client.sendall(head.encode() + b"\r\n" + RIDE.ljust(80_000, b"\n"))
    wait_until(lambda: offset_of(web, place) > 0)
    offset = offset_of(web, place)
    assert 0 < offset <= 80_000
    rest = RIDE.ljust(150_000, b"\n")[offset:]
    assert sent(web, place, offset, rest).status_code == 204
    kept = web.client.get(f"/v1/drives/{web.client.get(place).json()['id']}/log").content
    assert kept == RIDE.ljust(150_000, b"\n")


def test_offsets_versions_types_and_sizes_are_checked(web: Any) -> None:
    place = begun(web, len(RIDE))
    assert sent(web, place, 5, RIDE).status_code == 409
    assert "stands at byte 0" in sent(web, place, 5, RIDE).json()["detail"]
    assert web.client.patch(place, content=b"x", headers={"Upload-Offset": "0"}).status_code == 412
    assert web.client.patch(place, content=b"x", headers=TUS | {"Upload-Offset": "0"}).status_code == 415
    assert sent(web, place, 0, RIDE + b"x").status_code == 413
    assert web.client.post("/v1/uploads", headers=TUS).status_code == 422
    wrong = web.client.post("/v1/uploads", headers={"Upload-Length": "5"})
    assert (wrong.status_code, wrong.headers["tus-version"]) == (412, "1.0.0")
    large = TUS | {"Upload-Length": str(web.settings.max_upload_bytes + 1)}
    assert web.client.post("/v1/uploads", headers=large).status_code == 413
    assert web.client.post("/v1/uploads?method=none", headers=TUS | {"Upload-Length": "5"}).status_code == 422
    assert offset_of(web, place) == 0
    told = web.client.options("/v1/uploads")
    assert told.status_code == 204
    assert told.headers["tus-extension"] == "creation,expiration,termination,checksum"
    assert told.headers["tus-max-size"] == str(web.settings.max_upload_bytes)


def test_bytes_of_another_checksum_are_not_kept(web: Any) -> None:
    place = begun(web, len(RIDE))
    right = "sha1 " + base64.b64encode(hashlib.sha1(RIDE[:50]).digest()).decode()  # noqa: S324 - as tus has it
    assert sent(web, place, 0, b"y" * 50, **{"Upload-Checksum": right}).status_code == 460
    assert sent(web, place, 0, b"y", **{"Upload-Checksum": "crc x"}).status_code == 422
    assert offset_of(web, place) == 0
    assert sent(web, place, 0, RIDE[:50], **{"Upload-Checksum": right}).status_code == 204
    assert offset_of(web, place) == 50


def test_what_is_given_up_and_what_is_refused_is_forgotten(web: Any) -> None:
    place = begun(web, len(RIDE))
    sent(web, place, 0, RIDE[:50])
    assert web.client.delete(place, headers=TUS).status_code == 204
    assert web.client.head(place).status_code == 404
    assert parts(web) == []
    junk = begun(web, 5)
    assert sent(web, junk, 0, b"hello").status_code == 415
    assert web.client.head(junk).status_code == 404
    swim = fit_ride(FIRST, 5)
    other = begun(web, len(swim), "?sports=roads")
    assert sent(web, other, 0, swim).json()["type"].endswith("/not-on-roads")
    assert parts(web) == []
    assert web.blobs.keys() == []


def test_a_zip_becomes_its_drives_and_a_quota_leaves_the_bytes(web: Any) -> None:
    data = zipped({"a.csv": RIDE, "b.csv": csv_ride(FIRST + timedelta(days=1))})
    place = begun(web, len(data))
    with web.sessions.begin() as session:
        session.execute(text("UPDATE owners SET quota_drives = 0"))
    assert sent(web, place, 0, data).status_code == 429
    assert web.client.post("/v1/uploads", headers=TUS | {"Upload-Length": "5"}).status_code == 429
    assert offset_of(web, place) == len(data)
    with web.sessions.begin() as session:
        session.execute(text("UPDATE owners SET quota_drives = NULL"))
    assert sent(web, place, len(data), b"").status_code == 204
    assert [one["files"] for one in web.client.get(place).json()["drives"]] == [["a.csv"], ["b.csv"]]


def test_an_owner_has_a_bounded_number_under_way(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resumed, "MOST_OPEN", 2)
    first = begun(web, len(RIDE))
    begun(web, 9)
    assert web.client.post("/v1/uploads", headers=TUS | {"Upload-Length": "5"}).status_code == 409
    assert sent(web, first, 0, RIDE).status_code == 204  # over: it counts no more
    begun(web, 9)
    old = datetime.now(UTC) - timedelta(days=2)
    monkeypatch.setattr(resumed, "KEPT", datetime.now(UTC) - old - timedelta(days=2))  # all are of before
    begun(web, 9)
    assert web.client.head(first).status_code == 404


def test_what_is_kept_of_an_owners_uploads_is_bounded(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resumed, "MOST_ENDED", 2)
    places = []
    for _ in range(4):
        places.append(begun(web, len(RIDE)))
        assert sent(web, places[-1], 0, RIDE).status_code == 204
    under_way = begun(web, 9)
    assert [web.client.head(place).status_code for place in places] == [404, 404, 200, 200]
    monkeypatch.setattr(resumed, "MOST_PARTS", 2)
    sent(web, under_way, 0, b"a")
    sent(web, under_way, 1, b"b")
    answer = sent(web, under_way, 2, b"c")
    assert answer.status_code == 409
    assert "larger" in answer.json()["detail"]
    assert offset_of(web, under_way) == 2


def test_nobody_sees_the_uploads_of_another_owner(keyed: Any) -> None:
    web, keys = keyed.web, keyed.secrets
    anna = {"Authorization": f"Bearer {keys['anna']}"}
    ben = {"Authorization": f"Bearer {keys['ben']}"}
    answer = web.client.post("/v1/uploads", headers=TUS | anna | {"Upload-Length": str(len(RIDE))})
    place = urlsplit(answer.headers["location"]).path
    for verb, headers in (("HEAD", {}), ("PATCH", PATCH | {"Upload-Offset": "0"}), ("DELETE", TUS)):
        assert web.client.request(verb, place, headers=headers | ben, content=b"x").status_code == 404
        assert web.client.request(verb, place, headers=headers).status_code == 401
    sent_by_anna = web.client.patch(place, headers=PATCH | anna | {"Upload-Offset": "0"}, content=RIDE)
    assert sent_by_anna.status_code == 204


def test_a_full_disk_keeps_what_was_there(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    place = begun(web, len(RIDE))
    sent(web, place, 0, RIDE[:50])
    with monkeypatch.context() as full:
        full.setattr(resumed.files, "free_bytes", lambda *place: 0)
        assert sent(web, place, 50, RIDE[50:]).status_code == 507
    assert offset_of(web, place) == 50
    assert sent(web, place, 50, RIDE[50:]).status_code == 204
