"""Operators' queries over HTTP: one contract for all of them, and what each counts."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import pytest
from sqlalchemy import text

from app.map import figures
from app.network import extracts
from app.network.widenings import learn
from app.ops.admin.queries import QUERIES
from network_support import drive_over, new_drive, pass_over, publish
from problem_support import check

NAMES = [name for name, _ in QUERIES.items()]
KEPT = [name for name, query in QUERIES.items() if query.kept]


def ask(web: Any, name: str, **query: Any) -> list[dict[str, Any]]:
    answer = web.client.get(f"/v1/admin/{name}", params=query)
    assert answer.status_code == 200, answer.text
    return list(answer.json()["rows"])


def test_the_list_describes_every_query(reading: Any) -> None:
    listed = reading.client.get("/v1/admin").json()["queries"]
    assert [one["name"] for one in listed] == NAMES
    for one in listed:
        assert one["description"].endswith(".")
        assert reading.client.get(one["links"][0]["href"]).json()["columns"] == one["columns"]
        assert reading.client.get(one["links"][1]["href"]).headers["content-type"].startswith("text/csv")


@pytest.mark.parametrize("name", NAMES)
def test_every_query_answers_on_an_empty_service_and_on_a_small_one(
    web: Any, reading: Any, name: str
) -> None:
    for service in (web, reading):
        document = service.client.get(f"/v1/admin/{name}").json()
        assert document["as_of"].endswith("Z")
        for row in document["rows"]:
            assert set(row) == set(document["columns"])
        rows = list(csv.DictReader(io.StringIO(service.client.get(f"/v1/admin/{name}?f=csv").text)))
        assert len(rows) == len(document["rows"])
    may_be_empty = {
        "attention",
        "queue",
        "failures",
        "disagreements",
        "repeats",
        "device-classes",
        "tiles",
        "audit",
    }
    if name not in may_be_empty:
        assert document["rows"]


def test_repeats_are_told_by_class_with_their_widening(filled: Any) -> None:
    """Kept like other figures of the whole map; widenings as they are now."""
    table, ids = extracts.all_roads(session := filled.sessions())
    session.close()
    for day in range(3):
        drive_over(filled.sessions, table, ids, {0: (2.0 + day, 0.5), 1: (3.0, 0.5)}, 1.7e9 + 86_400.0 * day)
    with filled.sessions.begin() as session:
        report = json.dumps({"format": "nmea", "sensors": {"altitude": {}}, "altimeter": False})
        session.execute(text("UPDATE drives SET report = CAST(:report AS jsonb)"), {"report": report})
    assert ask(filled, "repeats")[1]["widening"] is None
    learn(filled.sessions)
    every, of_class, *_ = ask(filled, "repeats")
    assert (every["kind"], every["pairs"], every["drive_pairs"], every["segments"]) == ("all", 4, 2, 2)
    assert (of_class["group"], of_class["widening"]) == ("altitude, nmea", 1.0)
    assert every["rms_z"] == of_class["rms_z"] == pytest.approx(1.0)
    [known] = ask(filled, "device-classes")
    assert (known["name"], known["drives"], known["applied"], known["marking"]) == (
        "altitude, nmea",
        3,
        1.0,
        False,
    )


def test_what_cannot_be_asked_is_said(reading: Any) -> None:
    for name in NAMES:
        assert name in check(reading.client.get("/v1/admin/nonsense"), 404)["detail"]
    check(reading.client.get("/v1/admin/drives?days=0"), 422)
    check(reading.client.get("/v1/admin/drives?days=x"), 422)
    check(reading.client.get("/v1/admin/drives?f=xml"), 422)


def test_coverage_adds_up_to_the_roads_and_to_what_is_driven(reading: Any) -> None:
    with reading.sessions() as session:
        segments, network_m = session.execute(text("SELECT count(*), sum(length_m) FROM segments")).one()
        driven, driven_m = session.execute(
            text(
                """
                SELECT count(*), sum(length_m) FROM segments AS s
                JOIN segment_slopes AS a ON a.segment_id = s.id WHERE a.drives > 0
                """
            )
        ).one()
    rows = ask(reading, "coverage")
    assert sum(row["segments"] for row in rows) == segments
    assert sum(row["network_km"] for row in rows) == pytest.approx(network_m / 1000, rel=1e-5)
    assert sum(row["driven_segments"] for row in rows) == driven > 0
    assert sum(row["driven_km"] for row in rows) == pytest.approx(driven_m / 1000, rel=1e-5)
    sigmas = ask(reading, "sigmas")
    assert sum(row["segments"] for row in sigmas) == driven
    assert all(row["drives_from"] in {1, 2, 4, 8} for row in sigmas)


def test_a_drive_that_contradicts_the_others_leads_the_disagreements(filled: Any) -> None:
    with filled.sessions() as session:
        table, ids = extracts.all_roads(session)
    for slope in (2.0, 2.1, 1.9):
        drive_over(filled.sessions, table, ids, dict.fromkeys((56, 57, 58), (slope, 0.4)))
    publish(filled.sessions, new_drive(filled.sessions), ids, [pass_over(table, 56, 9.0, 0.3)])
    (row,) = ask(filled, "disagreements")
    assert row["segment_id"] == ids[56]
    assert (row["drives"], row["drives_rejected"], row["drives_unheard"]) == (3, 1, 1)
    assert row["highest_percent"] == pytest.approx(9.0, abs=0.5)
    assert row["farthest_sigmas"] > 10


def test_a_drive_that_agrees_on_the_segment_disagrees_on_none(filled: Any) -> None:
    """Rejected there for what it says beside it; a list of the worst has no 0.0 sigmas."""
    with filled.sessions() as session:
        table, ids = extracts.all_roads(session)
    for slope in (2.0, 2.1, 1.9):
        drive_over(filled.sessions, table, ids, dict.fromkeys((56, 57, 58), (slope, 0.4)))
    publish(filled.sessions, new_drive(filled.sessions), ids, [pass_over(table, 56, 9.0, 0.3)])
    with filled.sessions.begin() as session:
        session.execute(
            text(
                "UPDATE drive_segments SET slope_percent = 2.0 WHERE slope_percent > 5 AND segment_id = :id"
            ),
            {"id": int(ids[56])},
        )
    assert ask(filled, "disagreements") == []


def test_figures_are_kept_until_the_map_changes(filled: Any) -> None:
    """Made once for each, then no more; again when something changed and they are old enough."""
    with filled.sessions() as session:
        table, ids = extracts.all_roads(session)
    drive_over(filled.sessions, table, ids, dict.fromkeys((56, 57, 58), (2.0, 0.4)))
    made = 0
    while figures.renew_one(filled.sessions):
        made += 1
    assert made == len(KEPT) == len(figures.KEPT)
    before = {name: filled.client.get(f"/v1/admin/{name}").json() for name in KEPT}
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE segments SET highway = 'motorway'"))
        session.execute(text("UPDATE cells SET version = version + 1"))
    assert {name: filled.client.get(f"/v1/admin/{name}").json() for name in KEPT} == before
    assert not figures.renew_one(filled.sessions)
    with filled.sessions.begin() as session:
        session.execute(
            text("UPDATE kept_figures SET made_at = made_at - interval '1 hour' WHERE name = 'coverage'")
        )
    assert figures.renew_one(filled.sessions)
    assert not figures.renew_one(filled.sessions)
    assert {row["highway"] for row in ask(filled, "coverage")} == {"motorway"}
    assert filled.client.get("/v1/admin/coverage").json()["as_of"] > before["coverage"]["as_of"]
