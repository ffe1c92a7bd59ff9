"""Everything of an owner as one archive: what is in it, what is not, and what sending it takes."""

from __future__ import annotations

import io
import json
import threading
import tracemalloc
import zipfile
from datetime import UTC, datetime
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from access_support import Holder, Keyed
from app.core.caller import Caller, as_caller
from app.core.http import Service
from app.drives.person import archive
from app.drives.person.archive import PIECE_BYTES, ZipStream
from many_drives import execute, make_drives, rows
from person_support import NAME, Anna
from problem_support import check
from server_support import wait_until

ZONES = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [8.67, 49.41]},
            "properties": {"name": "home", "radius_m": 300.0},
        }
    ],
}


def fetched(holder: Holder, path: str = "/v1/owner/archive") -> zipfile.ZipFile:
    answer = holder.get(path)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/zip"
    assert "content-encoding" not in answer.headers
    file = zipfile.ZipFile(io.BytesIO(answer.content))
    assert file.testzip() is None
    return file


def document(file: zipfile.ZipFile, name: str) -> Any:
    return json.loads(file.read(name))


def folder_of(file: zipfile.ZipFile, drive: str) -> str:
    (name,) = [one for one in file.namelist() if one.endswith(f"{drive}/drive.json")]
    return name.removesuffix("/drive.json")


def test_it_holds_all_as_the_routes_give_it(anna: Anna) -> None:
    own = anna.keyed.a.own
    assert own.client.put("/v1/owner/zones", json=ZONES).status_code == 204
    hook = {"url": "https://example.org/x", "events": ["drive.done"]}
    secret = own.post("/v1/webhooks", json=hook).json()["secret"]
    file = fetched(own)
    folder = folder_of(file, anna.done)
    for name, path in (
        ("segments.geojson", "segments?f=geojson"),
        ("track.geojson", "track"),
    ):
        there, told = document(file, f"{folder}/{name}"), own.get(f"/v1/drives/{anna.done}/{path}").json()
        assert there["features"] == told["features"]
        assert there["features"]
    for name in ("profile", "measurements"):
        told = own.get(f"/v1/drives/{anna.done}/{name}").json()
        assert document(file, f"{folder}/{name}.json") == told
    assert document(file, f"{folder}/drive.json") == own.get(f"/v1/drives/{anna.done}").json()
    assert file.read(f"{folder}/log/{NAME}") == anna.logs[anna.done]
    waiting = folder_of(file, anna.waiting)
    assert {one for one in file.namelist() if one.startswith(waiting)} == {
        f"{waiting}/drive.json",
        f"{waiting}/log/{NAME}",
    }
    assert document(file, "zones.geojson") == ZONES == own.get("/v1/owner/zones").json()
    assert document(file, "owner.json")["name"] == "anna"
    assert document(file, "owner.json")["today"] == own.get("/v1/owner").json()["today"]
    assert [one["label"] for one in document(file, "keys.json")["keys"]] == ["anna", "anna upload", "revoked"]
    assert document(file, "webhooks.json")["webhooks"][0]["url"] == "https://example.org/x"
    assert [row["action"] for row in document(file, "audit.json")] == ["zones changed"]
    index = document(file, "index.json")
    assert (index["drives"], index["logs"], index["complete"], index["problems"]) == (2, 2, True, [])
    everything = b"".join(file.read(name) for name in file.namelist())
    for holder in (anna.keyed.a.own, anna.keyed.a.upload):
        assert holder.secret.encode() not in everything
    assert secret.encode() not in everything


def test_it_is_of_one_owner_whoever_asks(anna: Anna) -> None:
    keyed = anna.keyed
    path = f"/v1/owners/{keyed.a.id}/archive"
    assert document(fetched(keyed.operator, path), "index.json")["drives"] == 2
    assert document(fetched(keyed.b.own), "index.json")["drives"] == 0
    assert document(fetched(keyed.operator), "owner.json")["name"] == "operator"
    check(keyed.b.own.get(path), 403)
    check(keyed.a.upload.get("/v1/owner/archive"), 403)
    check(keyed.operator.get("/v1/owners/999/archive"), 404)


def test_a_damaged_or_lost_log_is_said_in_the_index(anna: Anna) -> None:
    web = anna.keyed.web
    keys = {}
    with web.sessions() as session:
        for row in session.execute(text("SELECT CAST(id AS text) AS id, blob_key FROM drives")):
            keys[row.id] = row.blob_key
    web.blobs.delete(keys[anna.done])
    place = web.settings.data_dir / "blobs" / keys[anna.waiting]
    place.write_bytes(place.read_bytes()[:-40] + b"x" * 80)  # longer than it was, too
    file = fetched(anna.keyed.a.own)
    index = document(file, "index.json")
    problems = {one["drive_id"]: one["problem"] for one in index["problems"]}
    assert "cannot be read" in problems[anna.done]
    assert "damaged" in problems[anna.waiting]
    assert not index["complete"]
    folder = folder_of(file, anna.done)
    assert not any(one.startswith(f"{folder}/log") for one in file.namelist())
    assert document(file, f"{folder}/track.geojson")["features"]
    damaged = file.read(f"{folder_of(file, anna.waiting)}/log/{NAME}")
    assert len(damaged) == len(anna.logs[anna.waiting])


def test_more_drives_than_a_page_come_once_each(keyed: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "_PAGE", 5)
    make_drives(keyed.web.sessions, 12)
    execute(keyed.web.sessions, "UPDATE drives SET owner_id = :a", a=keyed.a.id)
    file = fetched(keyed.a.own)
    assert len([one for one in file.namelist() if one.endswith("/drive.json")]) == 12
    assert document(file, "index.json")["drives"] == 12


def test_whoever_reads_slowly_holds_no_connection_and_a_few_are_sent_at_once(
    anna: Anna, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two archives of one client wait for it; a third is told so. The database knows of no transaction."""
    keyed, web = anna.keyed, anna.keyed.web
    monkeypatch.setattr(web.app.state.archives, "_longest_wait_s", 0.2)
    held, goes_on = threading.Semaphore(0), threading.Event()
    whole = archive.Archive.pieces

    def slowly(self: archive.Archive) -> Any:
        for number, piece in enumerate(whole(self)):
            if number == 0:
                held.release()
                goes_on.wait(30)
            yield piece

    monkeypatch.setattr(archive.Archive, "pieces", slowly)
    answers: list[httpx.Response] = []
    readers = [
        threading.Thread(target=lambda: answers.append(keyed.a.own.get("/v1/owner/archive")))
        for _ in range(2)
    ]
    for reader in readers:
        reader.start()
    assert held.acquire(timeout=30)
    assert held.acquire(timeout=30)
    open_ones = (
        "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND state LIKE 'idle in%'"
    )
    wait_until(lambda: rows(web.sessions, open_ones) == [(0,)])  # others come and go
    problem = check(keyed.a.own.get("/v1/owner/archive"), 503)
    assert problem["type"] == "/problems/busy"
    goes_on.set()
    for reader in readers:
        reader.join(30)
    assert [answer.status_code for answer in answers] == [200, 200]
    wait_until(lambda: web.app.state.archives._held.total == 0)


def test_it_breaks_off_when_the_key_is_revoked(anna: Anna) -> None:
    keyed = anna.keyed
    with keyed.a.own.client.stream("GET", "/v1/owner/archive") as answer:
        pieces = answer.iter_raw()
        first = next(pieces)
        assert keyed.operator.delete(f"/v1/keys/{keyed.a.own.key_id}").status_code == 204
        rest = b"".join(pieces)
    # What fits into the buffers of the connection may have been sent before.
    assert first.startswith(b"PK")
    assert len(first + rest) > 0
    check(keyed.a.own.get("/v1/owner/archive"), 401)


def test_a_large_file_is_never_held() -> None:
    zipped = ZipStream(datetime.now(UTC))
    chunk = bytes(PIECE_BYTES)
    tracemalloc.start()
    sizes = [len(piece) for piece in zipped.add("log", (chunk for _ in range(400)), 400 * PIECE_BYTES)]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sum(sizes) + len(zipped.end()) > 400 * PIECE_BYTES
    assert max(sizes) < 2 * PIECE_BYTES
    assert peak < 10 * PIECE_BYTES


def test_a_file_beyond_four_gigabytes_is_read_by_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the format ended at a megabyte."""
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", 2**20)
    zipped = ZipStream(datetime.now(UTC))
    content = bytes(3 * 2**20)
    written = b"".join(zipped.add("log", iter([content]), len(content))) + zipped.end()
    assert zipfile.ZipFile(io.BytesIO(written)).read("log") == content


def test_reading_is_the_owners_own(anna: Anna) -> None:
    """Row level security confines the archive, not the routes: an operator's request reads as the owner."""
    service: Service = anna.keyed.web.app.state.service
    with as_caller(Caller("operate", 1)):
        made = archive.Archive(service, "http://x", anna.keyed.b.id)
        content = b"".join(made.pieces())
    assert document(zipfile.ZipFile(io.BytesIO(content)), "index.json")["drives"] == 0
