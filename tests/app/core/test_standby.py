"""The map is read from a hot standby while that follows closely, and from the primary whenever it does not."""

from __future__ import annotations

import logging
import os
import signal
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.settings import Settings
from app.core.standby import store
from app.core.standby.store import Replayed, Written
from app.map import segments
from app.map.tiles import store as store_of_tiles
from app.map.tiles.store import column_of, row_of
from app.network.cells import raise_versions
from app.upkeep.doctor import Patient, examine
from server_support import wait_until
from standby_fixtures import Pair, fill_roads, pair, uses_standby
from web_fixtures import SOUTH, STEP, WEST, Web, add_drive, served

__all__ = ["pair"]

X, Y = column_of(14, WEST + STEP / 4), row_of(14, SOUTH + STEP / 2)
TILE = f"/tiles/14/{X}/{Y}.mvt"
HEIGHT = f"/v1/elevation?locations={SOUTH + STEP / 2},{WEST}"
ITEMS = "/collections/segments/items?driven=true"
PATIENT_S, IMPATIENT_S = 3600.0, 5.0
"""Bounds of the lag that no test reaches, and that one waits for."""


@pytest.fixture(scope="module")
def roads(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> None:
    with pair.served(tmp_path_factory.mktemp("first"), database_read_lag_s=PATIENT_S) as web:
        fill_roads(web.sessions)
    pair.catch_up()


@pytest.fixture
def web(pair: Pair, roads: None, tmp_path: Path) -> Iterator[Web]:
    """It bears any lag."""
    with pair.served(tmp_path, database_read_lag_s=PATIENT_S) as running:
        yield running


@pytest.fixture
def impatient(pair: Pair, roads: None, tmp_path: Path) -> Iterator[Web]:
    with pair.served(tmp_path, database_read_lag_s=IMPATIENT_S) as running:
        yield running


def seen(web: Web) -> list[Any]:
    """What the map shows in each of its ways, and the tags of it."""
    tile, as_json, items = (
        web.client.get(path).raise_for_status() for path in (TILE, TILE.replace("mvt", "geojson"), ITEMS)
    )
    ways = web.client.get(f"/collections/ways/tiles/WebMercatorQuad/14/{Y}/{X}").raise_for_status()
    heights = web.client.get(HEIGHT).raise_for_status().json()["results"]
    shown = [[one["id"], one["properties"]["slope_percent"]] for one in items.json()["features"]]
    tags = [one.headers["etag"] for one in (tile, as_json, items)]
    return [tile.content, tags, as_json.json()["features"], shown, ways.content, heights]


def figure(web: Web, name: str) -> float:
    line = next(one for one in web.client.get("/metrics").text.splitlines() if one.startswith(f"{name} "))
    return float(line.split()[1])


def test_the_map_is_the_standby_s_with_its_own_tags_and_all_else_the_primary_s(pair: Pair, web: Web) -> None:
    with pair.paused():
        before = seen(web)
        drive = add_drive(web.sessions, [0, 1, 2], 3.0)
        now = seen(web)
        assert now[:3] == before[:3]
        assert now == before
        log = web.client.post("/v1/drives", content=b"time,lat,lon\n").raise_for_status().json()["id"]
        assert web.client.get(f"/v1/drives/{log}").json()["status"] == "queued"
        assert str(drive) in {one["id"] for one in web.client.get("/v1/drives").json()["drives"]}
        segment = web.client.get(f"/v1/drives/{drive}/segments").json()["features"][0]["id"]
        assert web.client.get(f"/v1/segments/{segment}").json()["properties"]["drives"] == 0
        behind = web.client.get(f"/v1/segments/{segment}/observations").json()["observations"]
        assert [one["drive_id"] for one in behind] == [str(drive)]
    pair.catch_up()
    later = seen(web)
    assert all(one != other for one, other in zip(before[1], later[1], strict=True))
    assert later[0] != before[0]
    assert len(later[3]) == len(before[3]) + 3
    known = web.client.get(TILE, headers={"If-None-Match": later[1][0]})
    assert known.status_code == 304
    assert figure(web, "versant_standby_used") == 1.0
    assert figure(web, "versant_standby_passed_on") == 0.0


def test_the_tags_of_both_servers_are_the_same_for_the_same_data(pair: Pair, web: Web) -> None:
    add_drive(web.sessions, [5], 1.0)
    pair.catch_up()
    there = seen(web)
    web.app.state.service.standby._most_s = -1.0
    assert seen(web) == there


def test_a_transaction_that_ends_after_later_ones_is_not_missed(pair: Pair, web: Web) -> None:
    """A standby's snapshot does not say which transactions run."""
    cells = [X << 14 | Y, (X + 9) << 14 | Y]
    with web.sessions() as first:
        raise_versions(first, cells[:1])
        with web.sessions.begin() as second:
            raise_versions(second, cells[1:])
        pair.catch_up()
        before = web.client.get(TILE).headers["etag"]
        first.commit()
    pair.catch_up()
    assert web.client.get(TILE).headers["etag"] != before


def test_who_follows_the_map_is_answered_by_the_primary(pair: Pair, web: Web) -> None:
    with pair.paused():
        version = web.client.get("/v1/changes").json()["version"]
        add_drive(web.sessions, [7], 2.0)
        changed = web.client.get("/collections/segments/items", params={"updated_since": version}).json()
        assert changed["numberReturned"] == 1
        assert changed["version"] != version


def test_followers_are_told_what_the_standby_shows(pair: Pair, web: Web) -> None:
    with web.client.stream("GET", "/v1/changes/events") as answer:
        lines = (line for line in answer.iter_lines() if line.startswith("data:"))
        first = next(lines)
        with pair.paused():
            add_drive(web.sessions, [8], 2.0)
            assert web.client.get(TILE).headers["etag"]
        second = next(lines)
        tag = web.client.get(TILE).headers["etag"]
    assert first != second
    pair.catch_up()
    assert web.client.get(TILE).headers["etag"] == tag


def test_a_standby_too_far_behind_is_not_read_and_is_again_when_it_follows(
    pair: Pair, impatient: Web, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "app.core.standby.use")
    before = seen(impatient)[3]
    with pair.paused():
        add_drive(impatient.sessions, [20], 4.0)
        wait_until(lambda: not uses_standby(impatient))
        assert len(seen(impatient)[3]) == len(before) + 1
        checks = impatient.client.get("/readyz").raise_for_status().json()["checks"]
        assert (
            checks["standby"] == f"It is more than {IMPATIENT_S:g} s behind, or cannot be compared any more."
        )
        assert figure(impatient, "versant_standby_used") == 0.0
        assert figure(impatient, "versant_standby_lag_seconds") > IMPATIENT_S
    wait_until(lambda: uses_standby(impatient))
    assert impatient.client.get("/readyz").json()["checks"]["standby"] == "ok"
    wait_until(lambda: [one.message for one in caplog.records[-1:]] == ["the map is read from the standby"])
    messages = [one.message for one in caplog.records]
    assert {"the map is read from the primary", "the map is read from the standby"} == set(messages)
    assert all(one != other for one, other in pairwise(messages)), (
        "a line whenever it is another one, and only then"
    )


def test_an_idle_primary_is_no_lag(pair: Pair, impatient: Web) -> None:
    pair.catch_up()
    standby = impatient.app.state.service.standby
    told = standby._as_of
    wait_until(lambda: standby._as_of > told + IMPATIENT_S)
    assert uses_standby(impatient)


def test_a_killed_standby_costs_no_answer_and_is_read_again_when_it_is_back(pair: Pair, web: Web) -> None:
    before = seen(web)
    pair.kill()
    assert seen(web) == before
    assert not uses_standby(web)
    assert figure(web, "versant_standby_passed_on") >= 1.0
    assert web.client.get("/readyz").json()["checks"]["standby"] == "It does not answer."
    assert pair.standby.revive()
    wait_until(lambda: uses_standby(web))
    with pair.paused():
        add_drive(web.sessions, [30], 4.0)
        assert seen(web)[:2] == before[:2]


def test_a_connection_that_ends_before_a_question_is_read_costs_no_answer(pair: Pair, web: Web) -> None:
    """Its last word and the error of its end arrive at once: an event loop that tells of both once is not enough."""
    before = seen(web)
    watch = web.app.state.tiles._all[-1].watch
    backend = watch._connection.info.backend_pid
    os.kill(backend, signal.SIGSTOP)
    try:
        with ThreadPoolExecutor(1) as beside:
            asked = beside.submit(seen, web)
            wait_until(lambda: bool(watch._looking))
            watch._asker._loop.call_soon_threadsafe(time.sleep, 0.5)  # it sees nothing in between
            os.kill(backend, signal.SIGTERM)
            os.kill(backend, signal.SIGCONT)
            assert asked.result() == before
    finally:
        with suppress(ProcessLookupError):
            os.kill(backend, signal.SIGCONT)


class Slow:
    """A function of a store that looks for long at segments which the primary takes away, when it is called first."""

    def __init__(self, answer: Any, web: Web) -> None:
        self.calls: list[bool] = []
        self._answer, self._web = answer, web

    def __call__(self, session: Session, *arguments: Any, **options: Any) -> Any:
        in_recovery = bool(session.execute(text("SELECT pg_is_in_recovery()")).scalar_one())
        self.calls.append(in_recovery)
        if len(self.calls) == 1:
            session.execute(text("SELECT count(*) FROM taken"))
            with self._web.sessions() as other:
                other.connection(execution_options={"isolation_level": "AUTOCOMMIT"})
                other.execute(text("DELETE FROM taken"))
                other.execute(text("VACUUM taken"))
            session.execute(text("SELECT count(*), pg_sleep(60) FROM taken"))
        return self._answer(session, *arguments, **options)


def test_what_the_standby_cancels_is_asked_there_again(
    pair: Pair, web: Web, monkeypatch: pytest.MonkeyPatch
) -> None:
    with web.sessions.begin() as session:
        session.execute(text("CREATE TABLE taken AS SELECT generate_series(1, 1000) AS n"))
        session.execute(text("GRANT SELECT ON taken TO PUBLIC"))
    pair.set_standby(max_standby_streaming_delay="0", hot_standby_feedback="off")
    try:
        segment = web.client.get("/collections/segments/items?limit=1").json()["features"][0]["id"]
        pair.catch_up()
        slow = Slow(segments.segments.get_segment, web)
        monkeypatch.setattr(segments.segments, "get_segment", slow)
        assert web.client.get(f"/v1/segments/{segment}").raise_for_status().json()["id"] == segment
    finally:
        pair.set_standby(max_standby_streaming_delay=None, hot_standby_feedback=None)
        with web.sessions.begin() as session:
            session.execute(text("DROP TABLE taken"))
    assert slow.calls == [True, True]


def test_a_fault_there_is_answered_by_the_primary(web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = segments.segments.get_segment
    segment = web.client.get("/collections/segments/items?limit=1").json()["features"][0]["id"]

    def lacking(session: Session, *arguments: Any, **options: Any) -> Any:
        if session.execute(text("SELECT pg_is_in_recovery()")).scalar_one():
            session.execute(text("SELECT FROM not_replayed_yet"))
        return asked(session, *arguments, **options)

    monkeypatch.setattr(segments.segments, "get_segment", lacking)
    web.client.get(f"/v1/segments/{segment}").raise_for_status()
    assert figure(web, "versant_standby_passed_on") == 1.0
    assert web.client.get(f"/v1/segments/{2**40}").status_code == 404


def test_a_tile_is_never_made_of_data_older_than_its_tag(web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where another standby, which is behind, answers at the same address."""
    tiles = web.app.state.tiles._all[1]
    asked = store_of_tiles.has_replayed
    monkeypatch.setattr(store_of_tiles, "has_replayed", lambda connection, _: asked(connection, "FFFFFF/0"))
    answer = web.client.get(TILE).raise_for_status()
    assert answer.content
    assert tiles.built == 0
    assert uses_standby(web)
    assert figure(web, "versant_standby_passed_on") == 1.0


def test_what_is_no_standby_of_this_database_is_not_read(pair: Pair, tmp_path: Path) -> None:
    assert store.unfit(Replayed(5, "a", in_recovery=True), Written(9, "a")) is None
    assert "another" in str(store.unfit(Replayed(5, "b", in_recovery=True), Written(9, "a")))
    url = pair.primary.url
    with served(Settings(data_dir=tmp_path, database_url=url, database_read_url=url)) as web:
        wait_until(lambda: "takes changes itself" in web.app.state.service.standby.problem)
        assert web.client.get("/readyz").is_success
        web.client.get(TILE).raise_for_status()


def test_the_doctor_looks_at_the_standby(pair: Pair, web: Web) -> None:
    def found(**changed: Any) -> tuple[str, str]:
        settings = web.settings.model_copy(update=changed)
        (one,) = (f for f in examine(Patient(settings, web.sessions)) if f.subject == "standby")
        return one.state, one.found

    assert found()[0] == "ok"
    assert found(database_read_url=web.settings.database_url) == (
        "fail",
        "It is no standby: it takes changes itself.",
    )
    state, words = found(database_read_url=f"postgresql://versant@/x?host={uuid.uuid4().hex}")
    assert state == "fail"
    assert words.startswith("It does not answer")
