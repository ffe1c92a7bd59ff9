"""What needs a person first, how drives flowed, how coverage grew: each of it made to happen."""

from __future__ import annotations

from typing import Any

import pytest
from sqlalchemy import text

from app.map import figures
from app.map.derived import following
from app.ops.admin.attention import attention
from app.ops.admin.queries import QUERIES
from app.ops.admin.store import Parameters
from web_fixtures import Web, add_drive


def rows(web: Web, name: str, **query: Any) -> list[dict[str, Any]]:
    answer = web.client.get(f"/v1/admin/{name}", params=query)
    assert answer.status_code == 200, answer.text
    return list(answer.json()["rows"])


def wrong(web: Web) -> dict[str, tuple[str, int]]:
    return {row["kind"]: (row["severity"], row["count"]) for row in rows(web, "attention")}


def run(web: Web, statement: str) -> None:
    with web.sessions.begin() as session:
        session.execute(text(statement))


WORKER = "INSERT INTO procrastinate_workers (last_heartbeat) VALUES (now())"


@pytest.fixture
def followed(filled: Web) -> Web:
    """The grid as a worker leaves it, however long ago its roads were made: ways and low zooms follow them."""
    following.follow_all(filled.sessions)
    return filled


def test_nothing_is_said_while_all_is_well(followed: Web) -> None:
    run(followed, WORKER)
    add_drive(followed.sessions, [0, 1])
    assert rows(followed, "attention") == []


def test_each_trouble_is_named_and_what_is_urgent_comes_first(followed: Web) -> None:
    assert wrong(followed) == {"worker": ("look", 0)}
    run(followed, WORKER)
    ids = [add_drive(followed.sessions, [k]) for k in range(6)]
    changes = [
        "status = 'failed', failure_kind = 'no-match', failure_reason = 'x'",
        "status = 'failed', failure_kind = 'internal', failure_reason = 'x'",
        "status = 'running', started_at = now() - interval '2 h', finished_at = NULL",
        "status = 'queued', queued_at = now() - interval '20 min', finished_at = NULL",
        "status = 'cancelled', finished_at = now() - interval '20 min'",
        "status = 'queued', queued_at = now() - interval '1 min', finished_at = NULL",
    ]
    for drive, change in zip(ids, changes, strict=True):
        run(followed, f"UPDATE drives SET {change} WHERE id = '{drive}'")
    mark = "(cell, touched, combined, due_at, tries) VALUES (7, '{}', '{}', now(), 5)"
    run(followed, f"INSERT INTO network_marks {mark}")
    hook = "(id, url, secret, events, active, off_reason)"
    run(
        followed, f"INSERT INTO webhooks {hook} VALUES (gen_random_uuid(), 'u', 's', '{{}}', false, 'silent')"
    )
    run(followed, "UPDATE segment_changes SET changed_at = now() - interval '20 min'")
    for status in ("planned", "failed", "done"):
        run(
            followed,
            "INSERT INTO operations (id, kind, subject, request, status, finished_at) "
            f"VALUES (gen_random_uuid(), 'settle', 'map', '{{}}', '{status}', now())",
        )
    found = rows(followed, "attention")
    assert {(row["kind"], row["severity"], row["count"]) for row in found} == {
        ("failed", "look", 1),
        ("failed", "act", 1),
        ("stuck", "act", 1),
        ("wait", "look", 1),
        ("removal", "look", 1),
        ("cell", "act", 1),
        ("derived", "look", 1),
        ("webhook", "look", 1),
        ("operation-planned", "act", 1),
        ("operation-failed", "look", 1),
    }
    severities = [row["severity"] for row in found]
    assert severities == sorted(severities)
    stuck = next(row for row in found if row["kind"] == "stuck")
    assert stuck["oldest_s"] == pytest.approx(7200, abs=60)
    links = {row["link"] for row in found if row["kind"] == "failed"}
    assert links == {"/drives?status=failed&failure=no-match", "/drives?status=failed&failure=internal"}
    for row in found:  # every link that is the API's leads somewhere
        assert row["what"].endswith(".")
        if str(row["link"]).startswith("/v1/admin"):
            assert followed.client.get(row["link"]).status_code == 200


def test_little_room_is_told_before_there_is_too_little(web: Web) -> None:
    run(web, WORKER)
    with web.sessions() as session:

        def said(free: int | None) -> list[str]:
            return [row["severity"] for row in attention(session, free, 100)]

        assert [said(free) for free in (None, 1000, 399, 99)] == [[], [], ["look"], ["act"]]


def test_what_ended_is_told_by_hour_and_by_day(filled: Web) -> None:
    for minutes, status in ((5, "done"), (6, "failed"), (60 * 30, "done"), (60 * 24 * 5, "done")):
        drive = add_drive(filled.sessions, [0, 1])
        run(
            filled,
            f"""
            UPDATE drives SET status = '{status}', queued_at = e - interval '10 s', started_at = e - interval '7 s',
                computed_at = e - interval '2 s', finished_at = e, distance_m = 500
            FROM (SELECT now() - interval '{minutes} min' AS e) AS x WHERE id = '{drive}'
            """,
        )
    hours, days = (rows(filled, "throughput", days=n) for n in (2, 30))
    assert sum(row["done"] for row in hours) == 2
    assert sum(row["done"] for row in days) == 3
    assert sum(row["failed"] for row in days) == sum(row["failed"] for row in hours) == 1
    assert sum(row["km"] for row in days) == pytest.approx(1.5)
    medians = {
        (row["waited_p50_s"], row["computed_p50_s"], row["published_p50_s"]) for row in days if row["done"]
    }
    assert medians == {(3.0, 5.0, 2.0)}
    assert [row["at"] for row in days] == sorted(row["at"] for row in days)
    assert all(row["at"].endswith("T00:00:00.000Z") for row in days)


def test_coverage_grows_day_by_day(filled: Web) -> None:
    assert rows(filled, "growth") == []
    add_drive(filled.sessions, [0, 3])  # two residential streets
    figures.note_today(filled.sessions)
    run(filled, "UPDATE driven_by_day SET day = day - 1")
    add_drive(filled.sessions, [1, 6])
    figures.note_today(filled.sessions)
    figures.note_today(filled.sessions)
    found = [(row["highway"], row["driven_segments"]) for row in rows(filled, "growth")]
    assert found == [("residential", 2), ("residential", 3), ("primary", 1)]
    now = rows(filled, "growth")
    covered = {row["highway"]: row["driven_km"] for row in rows(filled, "coverage") if row["driven_km"]}
    assert {row["highway"]: row["driven_km"] for row in now[1:]} == pytest.approx(covered)
    run(filled, "UPDATE cells SET driven = '{}'")
    figures.note_today(filled.sessions)
    assert [row["driven_segments"] for row in rows(filled, "growth")] == [2, 0, 0]


def test_kept_tiles_are_counted_and_those_that_are_old_told(filled: Web) -> None:
    for _ in range(2):
        assert filled.client.get("/tiles/14/8574/5626.mvt").status_code == 200
        assert filled.client.get("/tiles/13/4287/2813.mvt").status_code == 200
    with filled.sessions() as session:
        before = figures.make(session, "tiles")
        assert [(row["zoom"], row["tiles"]) for row in before] == [(13, 1), (14, 1)]
        assert {row["stale"] for row in before} == {0}
        assert sum(row["bytes"] for row in before) > 100
    add_drive(filled.sessions, [0, 1])
    with filled.sessions() as session:
        after = figures.make(session, "tiles")
    assert sum(row["stale"] for row in after) == sum(row["tiles"] for row in after) > 0


def test_versions_of_everything_are_told(filled: Web) -> None:
    found = {row["what"]: row for row in rows(filled, "versions")}
    assert list(found) == ["code", "schema", "postgresql", "postgis", "roads", "elevation"]
    assert found["postgis"]["version"].startswith("3.")
    assert "grid.osm" in found["roads"]["detail"]
    assert found["elevation"]["version"] is None


def test_no_query_reads_a_whole_table_that_grows(filled: Web) -> None:
    """By the server's own word, where rows are many by its statistics: neither segments nor drives from end to end."""
    asked = ("attention", "throughput", "growth", "audit", "versions", "drives", "failures", "queue")
    with filled.sessions() as session:
        session.execute(text("SET enable_seqscan = off"))
        for name in asked:
            before = session.execute(text(_SCANS)).scalar_one()
            QUERIES[name].read(session, Parameters(days=30))
            assert session.execute(text(_SCANS)).scalar_one() == before, name


_SCANS = """
    SELECT sum(pg_stat_get_xact_numscans(relid)) FROM pg_stat_user_tables
    WHERE relname IN ('segments', 'drive_segments', 'segment_slopes', 'drive_passes', 'drives')
"""
