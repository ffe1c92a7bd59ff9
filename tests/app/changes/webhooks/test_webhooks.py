"""Who is told of what, over HTTP."""

from __future__ import annotations

from typing import Any

import pytest

from web_fixtures import Web
from webhook_support import GRID, add, seen


def test_an_address_is_made_looked_at_changed_and_forgotten(told: Web) -> None:
    made = add(told, "https://example.org/told", "drive.failed", "segments.changed", bbox=GRID)
    assert made["secret"].startswith("whsec_")
    assert made["events"] == ["segments.changed", "drive.failed"]
    (listed,) = told.client.get("/v1/webhooks").raise_for_status().json()["webhooks"]
    one = seen(told, made)
    assert one.pop("deliveries") == []
    assert listed == one == {name: value for name, value in made.items() if name != "secret"}
    assert (one["url"], one["bbox"], one["active"]) == ("https://example.org/told", GRID, True)

    here = f"/v1/webhooks/{made['id']}"
    changed = told.client.patch(here, json={"active": False, "bbox": None}).raise_for_status().json()
    assert (changed["active"], changed["bbox"], changed["events"]) == (False, None, made["events"])
    assert told.client.post(f"{here}/test").status_code == 422
    assert told.client.patch(here, json={"active": True, "events": ["drive.done"]}).status_code == 200
    assert told.client.delete(here).status_code == 204
    assert told.client.delete(here).status_code == told.client.get(here).status_code == 404


@pytest.mark.parametrize(
    "wrong",
    [
        {"url": "ftp://example.org/"},
        {"events": []},
        {"events": ["everything"]},
        {"bbox": [1, 2, 3]},
        {"bbox": [1, 2, 3, 200]},
        {"bbox": "1,2,3,4"},
        {"secret": "mine"},
    ],
)
def test_what_cannot_be_told_is_refused(told: Web, wrong: dict[str, Any]) -> None:
    wanted = {"url": "https://example.org/", "events": ["drive.done"], **wrong}
    answer = told.client.post("/v1/webhooks", json=wanted)
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/invalid-request")
    made = add(told)
    answer = told.client.patch(f"/v1/webhooks/{made['id']}", json=wrong)
    assert (answer.status_code, answer.json()["type"]) == (422, "/problems/invalid-request")
    assert told.client.patch(f"/v1/webhooks/{made['id']}", json={"url": None}).status_code == 422


def test_there_are_so_many_at_most(told: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.changes.webhooks.routes.MOST", 1)
    add(told)
    answer = told.client.post("/v1/webhooks", json={"url": "http://[::1]/", "events": ["drive.done"]})
    assert answer.status_code == 422


def test_unless_it_is_said_no_private_address_is_taken(reading: Web) -> None:
    wanted = {"url": "https://127.0.0.1/", "events": ["drive.done"]}
    answer = reading.client.post("/v1/webhooks", json=wanted)
    assert answer.status_code == 422
    assert "VERSANT_WEBHOOK_PRIVATE" in answer.json()["detail"]
