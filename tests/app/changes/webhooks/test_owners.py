"""Whose webhooks a caller sees, and whose drives they are told of."""

from __future__ import annotations

from typing import Any

import pytest
from sqlalchemy import text

from access_support import Holder, Keyed
from app.changes.webhooks.store import DRIVE_DONE, announce_drive
from app.changes.webhooks.telling import note_changes
from problem_support import check
from web_fixtures import add_drive

EVERYTHING = ["segments.changed", "drive.done", "drive.failed"]


def add(holder: Holder, **more: Any) -> str:
    answer = holder.post("/v1/webhooks", json={"url": "https://example.org/", "events": EVERYTHING, **more})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def test_an_owner_sees_and_changes_its_own(keyed: Keyed) -> None:
    of_a, of_b = add(keyed.a.own), add(keyed.b.own)
    lists = [one.get("/v1/webhooks").json()["webhooks"] for one in (keyed.a.own, keyed.b.own, keyed.operator)]
    assert [[one["id"] for one in found] for found in lists] == [[of_a], [of_b], [of_a, of_b]]
    here = f"/v1/webhooks/{of_a}"
    for answer in (
        keyed.b.own.get(here),
        keyed.b.own.client.patch(here, json={"active": False}),
        keyed.b.own.delete(here),
        keyed.b.own.post(f"{here}/test"),
    ):
        check(answer, 404)
    check(keyed.a.upload.get(here), 403)
    assert keyed.a.own.post(f"{here}/test").status_code == 202
    assert keyed.a.own.get(here).json()["deliveries"][0]["event"] == "test"
    assert keyed.a.own.client.patch(here, json={"active": False}).json()["active"] is False
    assert keyed.a.own.delete(here).status_code == 204


def test_there_are_so_many_at_most_of_all_owners(keyed: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.changes.webhooks.routes.MOST", 1)
    add(keyed.a.own)
    check(keyed.b.own.post("/v1/webhooks", json={"url": "https://example.org/", "events": EVERYTHING}), 422)


def told(keyed: Keyed) -> set[tuple[str, str]]:
    query = text("SELECT CAST(webhook_id AS text), event FROM webhook_deliveries")
    with keyed.web.sessions() as session:
        return {(row[0], row[1]) for row in session.execute(query)}


def test_drives_are_told_to_their_owner_and_changes_of_the_map_to_all(keyed_filled: Keyed) -> None:
    keyed = keyed_filled
    add_drive(keyed.web.sessions, [9])  # there is a version to follow from
    of_a, of_b, of_operator = add(keyed.a.own), add(keyed.b.own, bbox=[8, 48, 9, 50]), add(keyed.operator)
    drive = keyed.give(add_drive(keyed.web.sessions, [0, 1]), keyed.b)
    with keyed.web.sessions.begin() as session:
        session.execute(text("DELETE FROM webhook_deliveries"))
        announce_drive(session, DRIVE_DONE, drive, {})  # type: ignore[arg-type]
    assert told(keyed) == {(of_b, DRIVE_DONE)}
    note_changes(keyed.web.sessions, 0.0)
    assert told(keyed) == {(of_b, DRIVE_DONE)} | {
        (one, "segments.changed") for one in (of_a, of_b, of_operator)
    }
    # Who removes a drive lets nobody be told of it any more.
    assert keyed.b.own.delete(f"/v1/drives/{drive}").status_code == 202
    assert (of_b, DRIVE_DONE) not in told(keyed)
