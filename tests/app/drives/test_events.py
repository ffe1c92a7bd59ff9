"""Following a drive by server-sent events."""

from __future__ import annotations

import json
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest

from app.drives import store

MakeDrive = Callable[..., uuid.UUID]


def upload(web: Any) -> str:
    return str(web.client.post("/v1/drives", content=b"nonsense").json()["id"])


@contextmanager
def following(web: Any, drive: str) -> Iterator[Iterator[tuple[str, dict[str, Any]]]]:
    """The events of a drive: (event, data), as they arrive."""
    with httpx.stream("GET", f"{web.base}/v1/drives/{drive}/events", timeout=30, trust_env=False) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        assert "content-encoding" not in answer.headers

        def events() -> Iterator[tuple[str, dict[str, Any]]]:
            event = ""
            for line in answer.iter_lines():
                name, _, value = line.partition(": ")
                if name == "event":
                    event = value
                elif name == "data":
                    yield event, json.loads(value)

        yield events()


def test_events_tell_the_state_at_once_then_each_change_then_end(web: Any) -> None:
    drive = upload(web)
    key = uuid.UUID(drive)
    with following(web, drive) as events:
        assert next(events) == ("drive", web.client.get(f"/v1/drives/{drive}").json())
        with web.sessions.begin() as session:
            store.mark_running(session, key, 1)
        assert next(events)[1]["status"] == "running"
        with web.sessions.begin() as session:
            store.set_progress(session, key, 1, "filter", 0.5)
        event = next(events)[1]
        assert (event["stage"], event["progress"]) == ("filter", 0.5)
        with web.sessions.begin() as session:
            store.mark_failed(session, key, 1, kind="empty-log", reason="No position.", stage="filter")
        rest = list(events)
        assert [data["status"] for _, data in rest] == ["failed"]
        assert rest[0][1]["failure"]["reason"] == "No position."


def test_events_of_a_finished_drive_are_one(filled: Any, drive_maker: MakeDrive) -> None:
    done = str(drive_maker(filled.sessions, [0, 1, 2]))
    with following(filled, done) as events:
        assert [(event, data["status"]) for event, data in events] == [("drive", "done")]


def test_events_end_when_the_drive_is_removed(web: Any) -> None:
    drive = upload(web)
    with following(web, drive) as events:
        next(events)
        web.client.delete(f"/v1/drives/{drive}")
        assert [event for event, _ in events] == ["deleted"]


def test_a_reader_that_leaves_stops_the_looking(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = upload(web)
    looks = threading.Semaphore(0)
    look = store.get_drive

    def counted(*arguments: Any) -> Any:
        looks.release()
        return look(*arguments)

    monkeypatch.setattr("app.drives.events.drives.get_drive", counted)
    with following(web, drive) as events:
        next(events)
        assert looks.acquire(timeout=30)
        assert looks.acquire(timeout=30)
    calm = threading.Event()
    for _ in range(200):
        while looks.acquire(blocking=False):
            pass
        calm.wait(0.2)  # ten polls
        if not looks.acquire(blocking=False):
            return
    raise AssertionError("the drive is still being looked at")


def test_events_of_no_drive(web: Any) -> None:
    assert web.client.get(f"/v1/drives/{uuid.uuid4()}/events").status_code == 404
