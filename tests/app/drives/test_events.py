"""Following a drive by server-sent events."""

from __future__ import annotations

import json
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import httpx
import psycopg
import pytest
from sqlalchemy import text

from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.drives import claims, feed, store
from app.drives.documents import Drive
from problem_support import check
from processing_support import HEADER
from server_support import asking_from, wait_until

MakeDrive = Callable[..., uuid.UUID]
MakeServer = Callable[[Settings], Any]


def upload(web: Any) -> str:
    return str(web.client.post("/v1/drives", content=HEADER).json()["id"])


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
            claims.mark_running(session, key, 1)
        assert next(events)[1]["status"] == "running"
        with web.sessions.begin() as session:
            claims.set_progress(session, key, 1, "filter", 0.5)
        event = next(events)[1]
        assert (event["stage"], event["progress"]) == ("filter", 0.5)
        with web.sessions.begin() as session:
            claims.mark_failed(session, key, 1, kind="empty-log", reason="No position.", stage="filter")
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
        assert [event for event, _ in events] == ["deleted"]  # no worker has begun yet


def look_counter(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many drives each look was at."""
    looks: list[int] = []
    look = store.get_drives

    def counted(session: Any, ids: Any) -> Any:
        looks.append(len(ids))
        return look(session, ids)

    monkeypatch.setattr("app.main.get_drives", counted)
    return looks


def threads() -> int:
    return sum("AnyIO" in thread.name for thread in threading.enumerate())


def test_a_reader_that_leaves_stops_the_looking(
    settings: Settings, server_maker: MakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = look_counter(monkeypatch)
    with server_maker(settings.model_copy(update={"events_poll_s": 0.02})) as web:
        drive = upload(web)
        with following(web, drive) as events:
            next(events)
            wait_until(lambda: len(looks) > 3)
        calm = threading.Event()

        def silent() -> bool:
            seen = len(looks)
            calm.wait(0.5)
            return len(looks) == seen

        wait_until(silent)


def test_sixty_readers_cost_no_thread_and_one_look_each_time(
    settings: Settings, server_maker: MakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = look_counter(monkeypatch)
    with server_maker(settings.model_copy(update={"events_poll_s": 60})) as web, ExitStack() as readers:
        drive = upload(web)
        before = threads()
        streams = [readers.enter_context(following(web, drive)) for _ in range(60)]
        for events in streams:
            assert next(events)[1]["status"] == "queued"
        looks.clear()
        with web.sessions.begin() as session:
            claims.mark_running(session, uuid.UUID(drive), 1)
        for events in streams:
            assert next(events)[1]["status"] == "running"
        assert looks == [1]
        assert threads() <= before + 1  # the one that looks


def test_more_readers_than_are_served_are_told_to_ask_now_and_then(
    settings: Settings, server_maker: MakeServer
) -> None:
    # Of three, one client may have two: the last is for others.
    with server_maker(settings.model_copy(update={"events_max": 3})) as web:
        drive = upload(web)
        path = f"/v1/drives/{drive}/events"
        with following(web, drive) as first, following(web, drive) as second:
            assert next(first) == next(second)
            answer = web.client.get(path)
            assert check(answer, 503)["type"] == "/problems/busy"
            assert int(answer.headers["retry-after"]) > 0
            assert web.client.get(f"/v1/drives/{drive}").status_code == 200

        def served_again() -> bool:
            with httpx.stream("GET", web.base + path, trust_env=False) as answer:
                return answer.status_code == 200

        wait_until(served_again)
        assert web.client.get(f"/v1/drives/{uuid.uuid4()}/events").status_code == 404
        wait_until(served_again)  # who follows nothing takes no place


@pytest.mark.parametrize("client", ["127.0.0.1", "127.0.0.2"])
def test_one_client_leaves_streams_of_both_kinds_to_others(
    settings: Settings, server_maker: MakeServer, client: str
) -> None:
    few = {"events_max": 800, "events_per_client": 3, "trusted_proxies": "127.0.0.2"}
    with server_maker(settings.model_copy(update=few)) as web, asking_from(web, client) as asking:
        drive = upload(web)
        told = {
            "X-Forwarded-For": "203.0.113.1"
        }  # believed from the proxy alone: here it is the one client or not
        paths = [f"/v1/drives/{drive}/events", "/v1/changes/events"]
        with ExitStack() as open_ones:
            for path in [*paths, paths[0]]:
                assert open_ones.enter_context(asking.stream("GET", path, headers=told)).status_code == 200
            for path in paths:
                answer = asking.get(path, headers=told)
                assert check(answer, 503)["type"] == "/problems/busy"
                assert "3 of them yours" in answer.json()["detail"]
                with asking_from(web, "127.0.0.3") as other, other.stream("GET", path) as stream:
                    assert stream.status_code == 200
                if client == "127.0.0.2":
                    another = {"X-Forwarded-For": "203.0.113.2"}
                    with asking.stream("GET", path, headers=another) as stream:
                        assert stream.status_code == 200


def test_what_changes_while_the_stream_is_silent_is_sent_afterwards(
    settings: Settings, server_maker: MakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a restart of PostgreSQL: all connections are gone, and what was announced meanwhile is lost."""
    monkeypatch.setattr("app.drives.feed.AGAIN_S", 0.3)
    with server_maker(settings.model_copy(update={"events_poll_s": 60})) as web:
        drive = upload(web)
        with following(web, drive) as events:
            assert next(events)[1]["status"] == "queued"
            with web.sessions.begin() as session:
                ended = session.execute(
                    text(
                        "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity "
                        "WHERE datname = current_database() AND pid <> pg_backend_pid()"
                    )
                ).scalar_one()
                assert ended >= 1
                claims.mark_running(session, uuid.UUID(drive), 1)
            assert next(events)[1]["status"] == "running"
            wait_until(lambda: listening(web) == 1)
            with web.sessions.begin() as session:
                claims.set_progress(session, uuid.UUID(drive), 1, "filter", 0.5)
            assert next(events)[1]["progress"] == 0.5


def listening(web: Any) -> int:
    query = text(
        "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND query LIKE 'LISTEN%'"
    )
    with web.sessions() as session:
        return int(session.execute(query).scalar_one())


def test_a_change_that_nobody_announces_is_found_after_a_while(
    settings: Settings, server_maker: MakeServer
) -> None:
    with server_maker(settings.model_copy(update={"events_poll_s": 0.1})) as web:
        drive = upload(web)
        with following(web, drive) as events:
            next(events)
            with web.sessions.begin() as session:
                session.execute(text("ALTER TABLE drives DISABLE TRIGGER USER"))
                claims.mark_running(session, uuid.UUID(drive), 1)
            assert next(events)[1]["status"] == "running"


def test_many_drives_changed_at_once_are_announced_as_many(web: Any) -> None:
    drive = upload(web)
    with following(web, drive) as events:
        next(events)
        with web.sessions.begin() as session:
            session.execute(
                text(
                    "INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options) "
                    "SELECT gen_random_uuid(), i, 'f', 1, 'k', 'queued', 'raw', '{}' FROM generate_series(1, 200) AS i"
                )
            )
        with psycopg.connect(libpq_url(str(web.settings.database_url)), autocommit=True) as listener:
            listener.execute("LISTEN versant_drives")
            with web.sessions.begin() as session:
                session.execute(text("UPDATE drives SET generation = generation + 1, stage = 'x'"))
            assert [note.payload for note in listener.notifies(timeout=30, stop_after=1)] == ["*"]
        assert next(events)[1]["stage"] == "x"


def test_a_status_is_announced_and_no_step(web: Any) -> None:
    drive = upload(web)
    with psycopg.connect(libpq_url(str(web.settings.database_url)), autocommit=True) as listener:
        listener.execute("LISTEN versant_drives")
        for change in (
            "UPDATE drives SET epochs = 7",
            "UPDATE drives SET progress = 0.3, stage = 'roads'",
            "UPDATE drives SET status = 'running'",
            "DELETE FROM drives",
        ):
            with web.sessions.begin() as session:
                session.execute(text(change))
        assert [note.payload for note in listener.notifies(timeout=1, stop_after=3)] == [drive, drive]


def test_events_of_no_drive(web: Any) -> None:
    assert web.client.get(f"/v1/drives/{uuid.uuid4()}/events").status_code == 404


def test_all_who_follow_a_drive_are_told_one_text(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Six hundred that are made anew each time would keep everybody else waiting."""
    made: list[str] = []
    genuine = feed.linked

    def counted(base: str, drive: Drive) -> Drive:
        made.append(base)
        return genuine(base, drive)

    monkeypatch.setattr(feed, "linked", counted)
    drive = upload(web)
    with ExitStack() as readers:
        streams = [readers.enter_context(following(web, drive)) for _ in range(20)]
        for events in streams:
            next(events)
        made.clear()
        with web.sessions.begin() as session:
            claims.mark_running(session, uuid.UUID(drive), 1)
        told = [next(events) for events in streams]
    assert all(one == told[0] for one in told)
    assert made == [web.base]
