"""What tests of webhooks do again and again."""

from __future__ import annotations

import uuid
from typing import Any

from sqlalchemy import text

from app.changes.webhooks import store
from app.changes.webhooks.telling import deliver
from app.drives import claims
from app.drives import store as drives
from web_fixtures import Web

GRID = [8.0, 48.0, 9.0, 50.0]
ELSEWHERE = [0.0, 0.0, 1.0, 1.0]


def add(web: Web, url: str = "http://127.0.0.1:9/", *events: str, **more: Any) -> dict[str, Any]:
    wanted = {"url": url, "events": list(events or ["segments.changed"]), **more}
    answer = web.client.post("/v1/webhooks", json=wanted)
    assert answer.status_code == 201, answer.text
    document: dict[str, Any] = answer.json()
    return document


def seen(web: Web, webhook: dict[str, Any]) -> dict[str, Any]:
    document: dict[str, Any] = web.client.get(f"/v1/webhooks/{webhook['id']}").raise_for_status().json()
    return document


def change(web: Web, *ids: int) -> None:
    with web.sessions.begin() as session:
        value = {"ids": list(ids), "name": uuid.uuid4().hex}
        session.execute(text("UPDATE segments SET name = :name WHERE id = ANY(:ids)"), value)


def send_due(web: Web) -> int:
    """Send all that is due, one after the other; how many."""
    count = 0
    while True:
        with web.sessions.begin() as session:
            due = store.claim(session)
        if due is None:
            return count
        deliver(web.sessions, web.settings, due)
        count += 1


def later(web: Web, seconds: float) -> None:
    """Let so much time have passed for all that waits."""
    step = {"s": seconds}
    with web.sessions.begin() as session:
        by = "- make_interval(secs => :s)"
        session.execute(
            text(f"UPDATE webhook_deliveries SET due_at = due_at {by}, created_at = created_at {by}"), step
        )
        session.execute(
            text(f"UPDATE webhooks SET next_at = next_at {by}, failing_since = failing_since {by}"), step
        )


def followed(web: Web, since: str) -> list[int]:
    answer = web.client.get(f"/v1/changes?since={since}").raise_for_status()
    return [one["id"] for one in answer.json()["changes"]]


def waiting_drive(web: Web, bounds: tuple[float, float, float, float]) -> uuid.UUID:
    key = uuid.uuid4().hex
    with web.sessions.begin() as session:
        drive, _ = drives.create_drive(
            session, sha256=key, filename="a.csv", size_bytes=1, blob_key=key, method="raw", options={}
        )
        assert claims.mark_running(session, drive.id, drive.generation)
        claims.note_bounds(session, drive.id, drive.generation, bounds)
    return drive.id
