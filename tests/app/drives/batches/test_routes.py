"""Many drives processed again at once."""

from __future__ import annotations

from typing import Any

import pytest
from sqlalchemy import text

from app.drives.batches import enqueuing
from app.drives.batches.documents import Selection, Which
from app.drives.worker import run_worker
from fusion.registry import DEFAULT_METHOD
from processing_support import HEADER, carry_out_removals
from road_support import replace_roads

LOG = b"time_s,lat_deg,lon_deg\n" + b"".join(b"17000000%02d,49.0,8.4\n" % k for k in range(20))
"""It can be read; without roads the drive fails all the same."""


@pytest.fixture
def made(web: Any) -> list[str]:
    """Two failed drives of ``raw``, one of ``dem``, and one of ``dem`` that still waits."""
    found = []
    for number, method in enumerate(("raw", "raw", "dem")):
        answer = web.client.post(
            f"/v1/drives?method={method}", content=LOG + b"170000002%d,49,8.4\n" % number
        )
        found.append(str(answer.json()["id"]))
    run_worker(web.settings, wait=False)
    assert {web.client.get(f"/v1/drives/{drive}").json()["status"] for drive in found} == {"failed"}
    answer = web.client.post("/v1/drives?method=dem", content=HEADER + b"later")
    return [*found, str(answer.json()["id"])]


def methods(web: Any, made: list[str]) -> list[tuple[str, str]]:
    documents = [web.client.get(f"/v1/drives/{drive}").json() for drive in made]
    return [(document["method"], document["status"]) for document in documents]


def test_drives_of_other_methods_are_queued_and_followed(web: Any, made: list[str]) -> None:
    answer = web.client.post("/v1/drives/reprocess?method=dem")
    assert answer.status_code == 202, answer.text
    assert (answer.json()["queued"], answer.json()["method"]) == (2, "dem")
    (link,) = answer.json()["links"]
    assert (link["href"], link["rel"]) == (answer.headers["location"], "monitor")
    assert methods(web, made) == [("dem", "queued"), ("dem", "queued"), ("dem", "failed"), ("dem", "queued")]
    seen = web.client.get(link["href"]).json()
    assert (seen["drives"], seen["queued"], seen["running"], seen["progress"]) == (2, 2, 0, 0.0)
    run_worker(web.settings, wait=False)
    seen = web.client.get(link["href"]).json()
    assert (seen["drives"], seen["queued"], seen["failed"], seen["done"], seen["progress"]) == (
        2,
        0,
        2,
        0,
        1.0,
    )
    assert web.client.post("/v1/drives/reprocess?method=dem").json()["queued"] == 0


def test_without_a_batch_all_that_is_under_way_is_shown(web: Any, made: list[str]) -> None:
    address = f"{web.base}/v1/drives/reprocess"
    seen = web.client.get(address).json()
    assert (seen["drives"], seen["queued"], seen["links"][0]["href"]) == (1, 1, address)
    web.client.post("/v1/drives/reprocess?method=dem")
    assert web.client.get(address).json()["queued"] == 3
    run_worker(web.settings, wait=False)
    seen = web.client.get(address).json()
    assert (seen["drives"], seen["progress"]) == (0, 1.0)


def test_only_drives_of_one_method(web: Any, made: list[str]) -> None:
    answer = web.client.post("/v1/drives/reprocess?method=particle&from_method=dem")
    assert answer.json()["queued"] == 1
    assert methods(web, made)[:3] == [("raw", "failed"), ("raw", "failed"), ("particle", "queued")]


def test_without_a_method_the_services_default_is_taken(web: Any, made: list[str]) -> None:
    answer = web.client.post("/v1/drives/reprocess").json()
    assert answer["method"] == web.settings.default_method == "raw"
    assert answer["queued"] == 1


def test_uploads_go_before_drives_that_are_processed_again(web: Any, made: list[str]) -> None:
    web.client.post("/v1/drives/reprocess?method=particle")
    query = text("SELECT args->>'drive_id' FROM procrastinate_jobs WHERE status = 'todo' "
                 "ORDER BY priority DESC, id")  # fmt: skip
    with web.sessions() as session:
        assert session.execute(query).scalars().first() == made[3]


def test_a_drive_asked_for_anew_leaves_the_batch(web: Any, made: list[str]) -> None:
    batch = web.client.post("/v1/drives/reprocess?method=dem").headers["location"]
    assert web.client.post(f"/v1/drives/{made[0]}/reprocess").status_code == 202
    assert web.client.delete(f"/v1/drives/{made[1]}").status_code == 202
    carry_out_removals(web.sessions, web.blobs)
    found = web.client.get(batch).json()
    assert (found["drives"], found["progress"]) == (0, 1.0)


@pytest.mark.parametrize(
    ("verb", "query"),
    [
        ("POST", "method=nonsense"),
        ("POST", "from_method=nonsense"),
        ("POST", "methods=raw"),
        ("GET", "batch=x"),
        ("GET", "batch=-1"),
        ("GET", f"batch={2**63}"),
        ("GET", "batches=1"),
        ("POST", "which=some"),
        ("POST", "bbox=1,2,3"),
        ("POST", "created_after=yesterday"),
        ("POST", "failure="),
        ("DELETE", ""),
        ("DELETE", "batch=x"),
    ],
)
def test_what_cannot_be_asked(web: Any, verb: str, query: str) -> None:
    answer = web.client.request(verb, f"/v1/drives/reprocess?{query}")
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_dry_run_counts_and_changes_nothing(web: Any, made: list[str]) -> None:
    answer = web.client.post("/v1/drives/reprocess?which=all&dry_run=true")
    assert answer.status_code == 200, answer.text
    counted = {"queued": 3, "skipped": {}, "note": None, "note_said": None}
    assert answer.json() == {"complete": True, "method": None, "dry_run": True, "links": []} | counted
    assert [status for _, status in methods(web, made)] == ["failed"] * 3 + ["queued"]
    assert web.client.get("/v1/drives/reprocess?batch=1").status_code == 404
    narrowed = "which=failed&failure=unknown-format&created_after=2026-01-01&bbox=8,49,9,50"
    assert web.client.post(f"/v1/drives/reprocess?dry_run=true&{narrowed}").json()["queued"] == 0


def test_a_batch_says_what_it_is_and_is_called_off(web: Any, made: list[str]) -> None:
    before = methods(web, made)
    address = web.client.post("/v1/drives/reprocess?which=failed&method=dem").headers["location"]
    seen = web.client.get(address).json()
    assert (seen["state"], seen["method"], seen["selection"]) == ("running", "dem", {"which": "failed"})
    assert (seen["queued"], methods(web, made)[0]) == (3, ("dem", "queued"))
    failure = web.client.get(f"/v1/drives/{made[0]}").json()["failure"]
    assert failure is None
    cancelled = web.client.delete(address)
    assert cancelled.status_code == 200, cancelled.text
    assert (cancelled.json()["state"], cancelled.json()["drives"]) == ("cancelled", 0)
    assert methods(web, made) == before
    assert web.client.get(f"/v1/drives/{made[0]}").json()["failure"]["reason"]
    with web.sessions() as session:
        assert (
            session.execute(text("SELECT count(*) FROM procrastinate_jobs WHERE status = 'todo'")).scalar()
            == 1
        )
    run_worker(web.settings, wait=False)
    assert [method for method, _ in methods(web, made)] == [method for method, _ in before]


def test_a_worker_goes_on_with_what_a_request_left(
    web: Any, made: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.drives.batches.store.PIECE_DRIVES", 1)
    number, count = enqueuing.reprocess_all(web.sessions, Selection(which=Which.ALL), "dem", for_s=0)
    address = f"/v1/drives/reprocess?batch={number}"
    assert (count, web.client.get(address).json()["state"]) == (1, "enqueuing")
    run_worker(web.settings, wait=False)
    seen = web.client.get(address).json()
    assert (seen["state"], seen["drives"], seen["failed"], seen["progress"]) == ("done", 3, 3, 1.0)


@pytest.mark.parametrize("verb", ["GET", "DELETE"])
def test_a_batch_that_there_is_not(web: Any, verb: str) -> None:
    answer = web.client.request(verb, "/v1/drives/reprocess?batch=77")
    assert (answer.status_code, answer.json()["detail"][:20]) == (404, "There is no batch 77")


def test_pages_of_other_sites_may_not_ask(web: Any) -> None:
    answer = web.client.post("/v1/drives/reprocess", headers={"Origin": "https://elsewhere.example"})
    assert answer.status_code == 403


def test_the_default_is_the_librarys_where_no_setting_says_otherwise(
    reading: Any,
) -> None:
    assert reading.settings.default_method is None
    answer = reading.client.post("/v1/drives/reprocess?from_method=dem").json()
    assert (answer["method"], answer["queued"]) == (DEFAULT_METHOD, 0)


def test_drives_of_a_region(web: Any, made: list[str], chain: Any) -> None:
    """Failed ones are there where their positions are, which nonsense has none of."""
    with web.sessions.begin() as session:
        replace_roads(session, chain(), "x", "0" * 64, region="chain")
    name = "chain"
    assert web.client.post(f"/v1/drives/reprocess?which=all&region={name}&dry_run=true").json()["queued"] == 0
    with web.sessions.begin() as session:
        session.execute(
            text(
                "UPDATE drives SET bounds = (SELECT ST_Envelope(ST_Buffer(geom, 0.001)) FROM segments LIMIT 1) "
                "WHERE id = :id"
            ),
            {"id": made[0]},
        )
    assert web.client.post(f"/v1/drives/reprocess?which=failed&region={name}").json()["queued"] == 1
    answer = web.client.post("/v1/drives/reprocess?region=nowhere")
    assert answer.status_code == 422
    assert "There is no region 'nowhere'" in answer.text
    assert "region" in answer.text
