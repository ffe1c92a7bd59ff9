"""The change feed as those who follow the map see it."""

from __future__ import annotations

import pytest
from sqlalchemy import text

from web_fixtures import Web, add_drive


def followed(web: Web, address: str) -> tuple[dict[int, bool], str]:
    """All pages from here: what changed, and whether it is gone; the version to go on from."""
    seen: dict[int, bool] = {}
    while True:
        document = web.client.get(address).raise_for_status().json()
        assert not seen.keys() & {one["id"] for one in document["changes"]}
        seen |= {one["id"]: one["gone"] for one in document["changes"]}
        following = [link["href"] for link in document["links"] if link["rel"] == "next"]
        if not following:
            return seen, document["version"]
        (address,) = following


def test_a_follower_begins_with_all_and_goes_on_with_what_changed(filled: Web) -> None:
    begun = filled.client.get("/v1/changes").raise_for_status().json()
    assert begun["changes"] == []
    assert begun["since"] is None
    links = {link["rel"]: link["href"] for link in begun["links"]}
    assert filled.client.get(links["items"]).raise_for_status().json()["features"]
    assert followed(filled, f"/v1/changes?since={begun['version']}") == ({}, begun["version"])

    add_drive(filled.sessions, [0, 1, 2])
    with filled.sessions.begin() as session:
        session.execute(text("DELETE FROM segments WHERE id = 9"))
    for limit in (1, 3, 1000):
        seen, version = followed(filled, f"/v1/changes?since={begun['version']}&limit={limit}")
        assert seen == {1: False, 2: False, 3: False, 9: True}
    assert followed(filled, f"/v1/changes?since={version}") == ({}, version)
    seen, _ = followed(filled, f"/v1/changes?since={begun['version']}&bbox=0,0,1,1")
    assert seen == {}


def test_nothing_is_sent_twice_to_who_has_it(filled: Web) -> None:
    first = filled.client.get("/v1/changes").raise_for_status()
    address = f"/v1/changes?since={first.json()['version']}"
    answer = filled.client.get(address).raise_for_status()
    assert answer.headers["cache-control"] == "public, no-cache"
    known = {"If-None-Match": answer.headers["etag"]}
    same = filled.client.get(address, headers=known)
    assert (same.status_code, same.content, same.headers["etag"]) == (304, b"", answer.headers["etag"])
    add_drive(filled.sessions, [5])
    new = filled.client.get(address, headers=known)
    assert (new.status_code, [one["id"] for one in new.json()["changes"]]) == (200, [6])


@pytest.mark.parametrize(
    ("query", "status", "kind", "field"),
    [
        ("since=yesterday", 422, "invalid-request", "since"),
        ("since=", 422, "invalid-request", "since"),
        ("since=aaaaaaaaaa-5", 410, "gone", "since"),
        ("limit=0", 422, "invalid-request", "limit"),
        ("limit=1000000", 422, "invalid-request", "limit"),
        ("bbox=a,b,c,d", 422, "invalid-request", "bbox"),
        ("sinse=5", 422, "invalid-request", "sinse"),
    ],
)
def test_what_cannot_be_answered_is_said_with_what_is_allowed(
    reading: Web, query: str, status: int, kind: str, field: str
) -> None:
    answer = reading.client.get(f"/v1/changes?{query}")
    problem = answer.json()
    assert (answer.status_code, problem["type"], problem["errors"][0]["field"]) == (
        status,
        f"/problems/{kind}",
        field,
    )


def test_a_version_of_before_a_restore_is_refused_with_how_to_begin_anew(filled: Web) -> None:
    before = filled.client.get("/v1/changes").json()["version"]
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE change_epoch SET place = 'another server', xid = versant_xid()"))
    answer = filled.client.get(f"/v1/changes?since={before}")
    assert answer.status_code == 410
    assert "GET /v1/changes" in answer.json()["detail"]
    now = filled.client.get("/v1/changes").json()["version"]
    assert filled.client.get(f"/v1/changes?since={now}").status_code == 200
