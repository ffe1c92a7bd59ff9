"""Exports over HTTP and in a worker: asked for, made from one moment, fetched in parts, removed."""

from __future__ import annotations

import base64
import hashlib
import json
import threading
import uuid
from collections.abc import Callable
from contextlib import nullcontext
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.core.blobs import EXPORTS, BlobStore
from app.exports import run as runs
from app.jobs import task
from app.jobs.context import JobContext
from app.jobs.requests import run, upkeep
from problem_support import check
from web_fixtures import Web

Maker = Callable[..., uuid.UUID]
Work = Callable[..., list[str]]
BOX = [8.39, 48.99, 8.41, 49.02]


def ask(web: Web, status: int = 202, **body: Any) -> dict[str, Any]:
    answer = web.client.post("/v1/exports", json={"format": "csv"} | body)
    assert answer.status_code == status, answer.text
    found: dict[str, Any] = answer.json()
    if status < 300:
        assert answer.headers["location"] == f"{web.base}/v1/exports/{found['id']}"
    return found


def seen(web: Web, export: dict[str, Any]) -> dict[str, Any]:
    answer: dict[str, Any] = web.client.get(f"/v1/exports/{export['id']}").json()
    return answer


def fetch(web: Web, export: dict[str, Any], **headers: str) -> httpx.Response:
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    return web.client.get(f"/v1/exports/{export['id']}/file", headers=sent)


def files(web: Web) -> list[str]:
    return BlobStore(web.settings.blob_store_url, EXPORTS).keys()


def test_an_export_is_made_of_one_moment_and_says_so(driven: Web, work: Work) -> None:
    export = ask(driven, format="geojson", bbox=BOX, driven=True)
    assert (export["status"], export["progress"], export["data_version"]) == ("queued", 0, None)
    assert work(driven) == ["done"]
    done = seen(driven, export)
    assert done["status"] == "done"
    assert {link["rel"] for link in done["links"]} == {"self", "enclosure", "related"}
    answer = fetch(driven, done, accept_encoding="gzip")
    assert "content-encoding" not in answer.headers, "ranges and digests speak of the file's own bytes"
    content = answer.content
    digest = hashlib.sha256(content).digest()
    assert answer.headers["content-type"] == "application/geo+json"
    assert answer.headers["etag"] == f'"{digest.hex()}"' == f'"{done["sha256"]}"'
    assert answer.headers["repr-digest"] == f"sha-256=:{base64.b64encode(digest).decode()}:"
    assert answer.headers["content-disposition"] == 'attachment; filename="versant-geojson.geojson"'
    assert int(answer.headers["content-length"]) == len(content) == done["size_bytes"]
    document = json.loads(content)
    assert len(document["features"]) == done["entries"] == 3
    assert document["provenance"] == done["provenance"]
    origin = done["provenance"]
    assert origin["data_version"] == done["data_version"]
    assert origin["licences"][0]["url"] == "https://opendatacommons.org/licenses/odbl/1-0/"
    assert origin["roads"] == [
        {
            "region": "roads",
            "file": "grid.osm",
            "sha256": "0" * 64,
            "imported_at": origin["roads"][0]["imported_at"],
        }
    ]
    assert origin["request"] == done["request"]
    assert origin["request"] | {"bbox": BOX, "driven": True, "format": "geojson"} == origin["request"]


def test_the_same_request_is_the_same_export_until_the_data_change(
    driven: Web, work: Work, drive_maker: Maker
) -> None:
    first = ask(driven)
    assert ask(driven)["id"] == first["id"], "one that waits"
    assert ask(driven, driven=True)["id"] != first["id"]
    assert work(driven) == ["done", "done"]
    assert ask(driven, 200)["id"] == first["id"], "one that is done"
    drive_maker(driven.sessions, [5], 1.0)
    second = ask(driven)
    assert second["id"] != first["id"]
    assert work(driven) == ["done"]
    assert seen(driven, second)["sha256"] != seen(driven, first)["sha256"]


def test_two_that_ask_at_once_get_one_export(driven: Web) -> None:
    found: list[str] = []

    def one() -> None:
        with httpx.Client(base_url=driven.base, trust_env=False) as client:
            found.append(client.post("/v1/exports", json={"format": "csv"}).json()["id"])

    threads = [threading.Thread(target=one) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(found)) == 1
    with driven.sessions() as session:
        jobs = session.execute(
            text("SELECT priority, lock FROM procrastinate_jobs WHERE task_name = 'make_export'")
        ).all()
    assert jobs == [(-50, "exports")], "behind uploads, one at a time"


@pytest.mark.parametrize(
    ("asked", "part"),
    [("bytes=0-9", (0, 9)), ("bytes=10-", (10, -1)), ("bytes=-7", (-7, -1)), ("bytes=5-999999999", (5, -1))],
)
def test_a_file_comes_in_parts(driven: Web, work: Work, asked: str, part: tuple[int, int]) -> None:
    export = ask(driven)
    work(driven)
    whole = fetch(driven, export)
    first, last = (len(whole.content) + n if n < 0 else n for n in part)
    answer = fetch(driven, export, range=asked)
    assert answer.status_code == 206
    assert answer.content == whole.content[first : last + 1]
    assert answer.headers["content-range"] == f"bytes {first}-{last}/{len(whole.content)}"
    assert answer.headers["etag"] == whole.headers["etag"]
    same = fetch(driven, export, range=asked, if_range=whole.headers["etag"])
    assert same.status_code == 206
    other = fetch(driven, export, range=asked, if_range='"another"')
    assert (other.status_code, other.content) == (200, whole.content)
    assert fetch(driven, export, if_none_match=whole.headers["etag"]).status_code == 304


def test_ranges_that_are_none(driven: Web, work: Work) -> None:
    export = ask(driven)
    work(driven)
    whole = fetch(driven, export)
    for odd in ("bytes=0-1,5-6", "lines=1-2", "bytes=9-2", "bytes=", "bytes=x-y", f"bytes={'9' * 40}-"):
        answer = fetch(driven, export, range=odd)
        assert (answer.status_code, answer.content) == (200, whole.content), odd
    for beyond in (f"bytes={len(whole.content)}-", "bytes=-0"):
        problem = fetch(driven, export, range=beyond)
        check(problem, 416)
        assert problem.headers["content-range"] == f"bytes */{len(whole.content)}"
    head = driven.client.head(f"/v1/exports/{export['id']}/file")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-length"] == str(len(whole.content))


@pytest.mark.parametrize(
    ("body", "field", "says"),
    [
        ({"format": "shp"}, "format", "flatgeobuf"),
        ({"bbox": "a,b,c,d"}, "bbox", "is no number"),
        ({"bbox": [1, 2, 3]}, "bbox", "4 numbers"),
        ({"bbox": [8, 50, 9, 49]}, "bbox", "south"),
        ({"region": "atlantis"}, "region", "There are: roads"),
        ({"options": {"zoom": 3}}, "options.zoom", "takes"),
        ({"format": "pmtiles", "options": {"max_zoom": 99}}, "options.max_zoom", "14"),
        ({"format": "pmtiles", "driven": True}, "driven", "no such filter"),
        ({"suffix": ".tsv"}, "suffix", ".csv"),
        ({"speed": 3}, "speed", "xtra"),
        ({"gaps": "maybe"}, "gaps", "bool"),
    ],
)
def test_what_cannot_be_made_is_refused_at_once(
    reading: Web, body: dict[str, Any], field: str, says: str
) -> None:
    problem = check(reading.client.post("/v1/exports", json={"format": "csv"} | body), 422)
    assert [error["field"] for error in problem["errors"]] == [field]
    assert says in problem["detail"]


def test_what_is_not_there_is_said_so(driven: Web, work: Work) -> None:
    nobody = f"/v1/exports/{uuid.uuid4()}"
    for verb, path in (
        ("GET", nobody),
        ("GET", f"{nobody}/file"),
        ("DELETE", nobody),
        ("GET", "/v1/exports/x"),
    ):
        check(driven.client.request(verb, path), 404)
    export = ask(driven)
    waiting = fetch(driven, export)
    assert "0 %" in check(waiting, 409)["detail"] or "0%" in check(waiting, 409)["detail"]
    assert int(waiting.headers["retry-after"]) > 0
    work(driven)
    check(driven.client.get(f"/v1/exports/{export['id']}/beside/nothing.qml"), 404)
    for key in files(driven):
        BlobStore(driven.settings.blob_store_url, EXPORTS).delete(key)
    assert "Ask for it again" in check(fetch(driven, export), 404)["detail"]
    anew = ask(driven)
    assert anew["id"] != export["id"]
    work(driven)
    assert fetch(driven, anew).status_code == 200


def test_what_stands_beside_a_file_is_there_too(driven: Web, work: Work) -> None:
    export = ask(driven)
    work(driven)
    (beside,) = [link["href"] for link in seen(driven, export)["links"] if link["rel"] == "related"]
    answer = driven.client.get(beside)
    assert answer.headers["content-type"] == "application/json"
    said = answer.json()
    assert said["url"] == "versant-csv.csv"
    assert json.loads(said["dc:provenance"]) == seen(driven, export)["provenance"]


def test_a_list_is_paged_newest_first(driven: Web) -> None:
    asked = [ask(driven, format=name)["id"] for name in ("csv", "geojson", "gpkg")]
    page = driven.client.get("/v1/exports", params={"limit": 2, "status": "queued"}).json()
    found = [one["id"] for one in page["exports"]]
    (following,) = [link["href"] for link in page["links"] if link["rel"] == "next"]
    rest = driven.client.get(following).json()
    assert found + [one["id"] for one in rest["exports"]] == asked[::-1]
    assert [link["rel"] for link in rest["links"]] == ["self"]
    check(driven.client.get("/v1/exports?after=nowhere"), 422)
    check(driven.client.get("/v1/exports?limit=1000000"), 422)


def test_a_removed_export_is_cancelled_and_its_file_gone(driven: Web, work: Work) -> None:
    waiting = ask(driven)
    for _ in range(2):
        assert driven.client.delete(f"/v1/exports/{waiting['id']}").status_code == 204
    assert seen(driven, waiting)["status"] == "cancelled"
    removed = uuid.UUID(waiting["id"])
    assert run.perform(runs.EXPORT, driven.context, removed, task.Work(bool, nullcontext)) == "unwanted"
    done = ask(driven)
    assert done["id"] != waiting["id"]
    work(driven)
    assert len(files(driven)) == 1
    assert driven.client.delete(f"/v1/exports/{done['id']}").status_code == 204
    assert files(driven) == []
    assert "was removed" in check(fetch(driven, done), 404)["detail"]


def test_one_that_is_removed_while_it_is_made_leaves_nothing(
    driven: Web, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    export = ask(driven)
    stored = runs._store_file

    def removed_meanwhile(*arguments: Any) -> Any:
        assert driven.client.delete(f"/v1/exports/{export['id']}").status_code == 204
        return stored(*arguments)

    monkeypatch.setattr(runs, "_store_file", removed_meanwhile)
    assert work(driven) == ["unwanted"]
    assert (files(driven), seen(driven, export)["status"]) == ([], "cancelled")
    assert scratch(driven) == []


def scratch(web: Web) -> list[Path]:
    folder = web.settings.data_dir / "exports"
    return list(folder.iterdir()) if folder.exists() else []


def test_a_worker_that_stops_puts_it_back_and_one_that_died_is_replaced(driven: Web, work: Work) -> None:
    export = ask(driven)
    number, stopping = uuid.UUID(export["id"]), task.Work(lambda: True, nullcontext)
    with pytest.raises(task.Interrupted):
        run.perform(runs.EXPORT, driven.context, number, stopping)
    assert seen(driven, export)["status"] == "queued"
    assert scratch(driven) == []
    with driven.sessions.begin() as session:
        dead = runs.exports.claim(session, number)
    assert dead is not None
    assert seen(driven, export)["status"] == "running"
    assert work(driven) == ["done"]
    with driven.sessions.begin() as session:
        assert not runs.exports.update(session, dead, progress=0.5), "the older run writes nothing more"
    assert seen(driven, export)["progress"] == 1


def test_it_lets_drives_go_first_some_times_and_then_ends(
    driven: Web, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "LOOK_EVERY_S", 0.0)
    monkeypatch.setattr(run, "OTHERS_WAIT_S", 0.0)
    monkeypatch.setattr("app.exports.source.PARTS_APART", 1)
    export = ask(driven)
    with driven.sessions.begin() as session:
        session.execute(
            text("INSERT INTO procrastinate_jobs (queue_name, task_name) VALUES ('drives', 'process_drive')")
        )
    for _ in range(runs.MOST_YIELDS):
        with pytest.raises(task.Interrupted):
            work(driven)
        assert seen(driven, export)["status"] == "queued"
    assert work(driven) == ["done"]


def test_a_full_disk_and_a_file_that_is_too_large_are_failures_with_a_reason(driven: Web, work: Work) -> None:
    full = ask(driven)
    assert work(driven, min_free_bytes=2**60) == ["failed"]
    failed = seen(driven, full)
    assert (failed["status"], failed["failure"]["kind"]) == ("failed", "storage-full")
    large = ask(driven)
    assert large["id"] != full["id"], "one that failed is tried again"
    assert work(driven, exports_max_bytes=100) == ["failed"]
    assert seen(driven, large)["failure"]["kind"] == "too-large"
    assert "bbox" in check(fetch(driven, large), 404)["detail"]
    assert (files(driven), scratch(driven)) == ([], [])


def test_old_exports_go_and_so_do_files_that_nobody_refers_to(
    driven: Web, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, kept = ask(driven), ask(driven, driven=True)
    work(driven)
    with driven.sessions.begin() as session:
        session.execute(text("UPDATE exports SET expires_at = now() WHERE id = :id"), {"id": old["id"]})
    upkeep.look_after(runs.EXPORT, driven.context)
    check(driven.client.get(f"/v1/exports/{old['id']}"), 404)
    assert fetch(driven, kept).status_code == 200
    blobs = BlobStore(driven.settings.blob_store_url, EXPORTS)
    with blobs.writer() as writer:
        writer.write(b"of a worker that was killed")
        orphan = writer.finish().key
    assert upkeep.sweep_files(runs.EXPORT, driven.context) == [], "it may be about to be referred to"
    monkeypatch.setattr(upkeep, "ORPHAN_AGE", timedelta(0))
    assert upkeep.sweep_files(runs.EXPORT, driven.context) == [orphan]
    assert fetch(driven, kept).status_code == 200
    small = driven.settings.model_copy(update={"exports_max_bytes": 1})
    upkeep.look_after(runs.EXPORT, JobContext(small, driven.sessions))
    assert files(driven) == []


def test_the_newest_stay_at_once_where_all_together_are_too_large(driven: Web, work: Work) -> None:
    first = ask(driven)
    work(driven)
    size = seen(driven, first)["size_bytes"]
    second = ask(driven, gaps=True)
    assert work(driven, exports_max_bytes=int(1.5 * size)) == ["done"]
    check(driven.client.get(f"/v1/exports/{first['id']}"), 404)
    assert fetch(driven, second).status_code == 200
    assert len(files(driven)) == 1
