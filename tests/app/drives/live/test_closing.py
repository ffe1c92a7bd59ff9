"""Silence makes a drive of points, whatever order they came in, and whoever dies meanwhile."""

from __future__ import annotations

import uuid
from typing import Any

import pytest
from sqlalchemy import text

from app.drives import intake
from app.drives.live.closing import Closer
from app.drives.live.points import US, LivePoint
from live_senders import BEGAN_S, SAMPLES, osmand, owntracks, way
from live_support import Live, close, expected, logs
from many_drives import rows
from processing_support import process_drive, publish_all
from web_fixtures import SOUTH, WEST

HOUR_S = 3600


@pytest.mark.parametrize("sender", SAMPLES)
def test_a_closed_drive_is_what_an_upload_of_its_points_is(live: Live, sender: str) -> None:
    sent = SAMPLES[sender](way(40), "pixel")
    for one in (sent, sent[::-1], sent):
        live.send(sender, one)
    close(live.web)
    (drive,) = live.drives()
    assert drive["filename"] == f"{sender}-pixel-2025-11-27T08-15Z.csv"
    assert drive["status"] == "queued"
    assert live.waiting() == 0
    log = live.log(drive)
    assert log.count(b"\n") == 41
    answer = live.keyed.a.own.post("/v1/drives", content=log, params={"filename": "mine.csv"})
    assert (answer.status_code, answer.json()["id"]) == (200, drive["id"])
    (stream,) = live.keyed.a.own.get("/v1/live").json()["streams"]
    assert (stream["drive"], stream["under_way"], stream["last"]) == (drive["id"], False, None)


@pytest.mark.usefixtures("grid_database")
def test_its_slopes_are_those_of_an_upload(live: Live) -> None:
    """Anna's tracker sends points along a street of the grid; Ben uploads the same as a file."""
    points = [p._replace(lat_deg=p.lat_deg - 48.1 + SOUTH, lon_deg=WEST) for p in way(80)]
    live.send("osmand", osmand(points[40:], "x"))
    live.send("osmand", osmand(points[:50], "x"))
    close(live.web)
    sent = live.keyed.b.own.post("/v1/drives", content=expected(points), params={"filename": "x.csv"})
    assert sent.status_code == 202
    whose = ((live.keyed.a.own, live.drives()[0]["id"]), (live.keyed.b.own, sent.json()["id"]))
    slopes = []
    for holder, drive_id in whose:
        assert process_drive(live.web.context, uuid.UUID(drive_id), 1).value == "done"
        publish_all(live.web.sessions, live.web.blobs)
        features = holder.get(f"/v1/drives/{drive_id}/segments").json()["features"]
        slopes.append(
            [(f["properties"]["id"], f["properties"]["slope_percent"], f["geometry"]) for f in features]
        )
    assert slopes[0] == slopes[1]
    assert len(slopes[0]) >= 4
    assert all(abs(slope - 3.0) < 0.1 for _, slope, _ in slopes[0])


def test_its_log_is_the_points_and_nothing_else(live: Live) -> None:
    points = way(30)
    live.send("osmand", osmand(points, "x"))
    close(live.web)
    assert logs(live) == [expected(points)]
    assert rows(live.web.sessions, "SELECT owner_id, sent_by FROM drives") == [
        (live.keyed.a.id, live.keyed.ids["phone"])
    ]
    assert rows(live.web.sessions, "SELECT drives FROM owner_use") == [(1,)]


def test_two_devices_with_one_address_are_two_drives(live: Live) -> None:
    mine, others = way(30), way(30, first=7)
    both = [one for pair in zip(osmand(mine, "a"), osmand(others, "b"), strict=True) for one in pair]
    live.send("osmand", both)
    close(live.web)
    assert logs(live) == [expected(mine), expected(others)]


def test_a_drive_under_way_is_left_alone(live: Live) -> None:
    live.send("osmand", osmand(way(30), "x"))
    closer = Closer(live.web.sessions, live.web.blobs, live.web.settings)
    assert not closer.look()
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE live_streams SET due_at = now()"))
    assert not closer.look()
    assert (live.drives(), live.waiting()) == ([], 30)
    ((after_s,),) = rows(
        live.web.sessions, "SELECT CAST(extract(epoch FROM due_at - now()) AS float8) FROM live_streams"
    )
    assert 800 < after_s <= 900


def test_what_a_gap_ends_does_not_wait_for_silence(live: Live) -> None:
    first, second = way(30), way(30, begin_s=BEGAN_S + HOUR_S)
    live.send("osmand", osmand(first + second, "x"))
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE live_streams SET due_at = now()"))
    Closer(live.web.sessions, live.web.blobs, live.web.settings).look()
    assert logs(live) == [expected(first)]
    assert live.waiting() == 30


def test_points_that_come_late_go_into_the_drive_that_they_belong_to(live: Live) -> None:
    points = way(90)
    live.send("osmand", osmand(points[:30], "x"))
    close(live.web)
    (before,) = live.drives()
    live.send("osmand", osmand(points[60:], "x"))  # within the silence of the first
    close(live.web)
    live.send("osmand", osmand(points[30:60], "x"))
    close(live.web)
    (after,) = live.drives()
    assert after["id"] == before["id"]
    assert live.log(after) == expected(points)
    assert rows(live.web.sessions, "SELECT generation FROM drives") == [(3,)]
    keys = rows(live.web.sessions, "SELECT blob_key FROM drives")
    assert live.web.blobs.keys() == [key for (key,) in keys]
    jobs = rows(
        live.web.sessions, "SELECT count(*) FROM procrastinate_jobs WHERE task_name = 'process_drive'"
    )
    assert jobs == [(3,)]


def test_points_that_come_late_join_two_drives(live: Live) -> None:
    points = way(120, every_s=30.0)  # an hour
    first, middle, last = points[:40], points[40:80], points[80:]
    for part in (first, last):
        live.send("osmand", osmand(part, "x"))
        close(live.web)
    assert len(live.drives()) == 2
    live.send("osmand", osmand(middle, "x"))
    close(live.web)
    assert logs(live) == [expected(points)]
    assert live.waiting() == 0


def test_points_of_another_time_make_a_drive_of_their_own(live: Live) -> None:
    today, before = way(30), way(30, begin_s=BEGAN_S - 5 * HOUR_S)
    live.send("osmand", osmand(today, "x"))
    close(live.web)
    live.send("osmand", osmand(before, "x"))
    close(live.web)
    assert logs(live) == [expected(before), expected(today)]


def test_points_that_are_sent_again_change_nothing(live: Live) -> None:
    points = way(60)
    live.send("osmand", osmand(points, "x"))
    close(live.web)
    for again in (points, points[10:20], points[:1]):
        live.send("osmand", osmand(again, "x"))
        close(live.web)
        assert live.waiting() == 0
    assert logs(live) == [expected(points)]
    assert rows(live.web.sessions, "SELECT generation FROM drives") == [(1,)]


def test_a_phone_at_home_makes_no_drives(live: Live) -> None:
    home = [p._replace(lat_deg=48.1 + 1e-5 * (k % 4)) for k, p in enumerate(way(30, every_s=600.0))]
    live.send("osmand", osmand(home, "x"))
    close(live.web)
    assert (live.drives(), live.waiting()) == ([], 30)
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE live_points SET came_at = came_at - interval '49 hours'"))
    close(live.web)
    assert (live.drives(), live.waiting()) == ([], 0)


def parked(n: int, after: LivePoint, every_s: float = 60.0) -> list[LivePoint]:
    """A tracker that goes on sending from where it stands."""
    return [after._replace(time_us=after.time_us + round(k * every_s * US)) for k in range(1, n + 1)]


def test_a_tracker_that_is_never_silent_has_drives_all_the_same(live: Live) -> None:
    """A drive that stands still for as long as the silence is over, once; what follows waits for the next."""
    points = way(40)
    standing = parked(60, points[-1])
    live.send("osmand", osmand(points + standing[:20], "x"))

    def look() -> None:
        with live.web.sessions.begin() as session:
            session.execute(text("UPDATE live_streams SET due_at = now()"))
        Closer(live.web.sessions, live.web.blobs, live.web.settings).look()

    look()
    (drive,) = live.drives()
    kept = live.waiting()
    assert 0 < kept < 20
    live.send("osmand", osmand(standing[20:], "x"))
    look()
    assert live.waiting() == kept + 40
    close(live.web)
    assert [one["id"] for one in live.drives()] == [drive["id"]]
    assert rows(live.web.sessions, "SELECT generation FROM drives") == [(1,)]
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE live_points SET came_at = came_at - interval '49 hours'"))
        session.execute(text("UPDATE live_streams SET due_at = now()"))
    close(live.web)
    assert live.waiting() == 0


def test_what_stands_for_a_day_does_not_wait(live: Live) -> None:
    (at,) = way(1)
    live.send("osmand", osmand([at, *parked(25 * 6, at, every_s=600.0)], "x"))
    close(live.web)
    assert live.waiting() == 6


def test_a_point_that_waits_is_put_into_its_drive(live: Live) -> None:
    points = way(31)
    live.send("osmand", osmand(points[:1], "x"))
    close(live.web)
    assert (live.drives(), live.waiting()) == ([], 1)
    live.send("osmand", osmand(points[1:], "x"))
    close(live.web)
    assert logs(live) == [expected(points)]


def test_a_removed_drive_is_not_made_anew_by_what_comes_late(live: Live) -> None:
    points = way(60)
    live.send("osmand", osmand(points[:40], "x"))
    close(live.web)
    (drive,) = live.drives()
    assert live.keyed.a.own.delete(f"/v1/drives/{drive['id']}").status_code == 202
    live.send("osmand", osmand(points[40:], "x"))
    close(live.web)
    assert logs(live) == [expected(points[40:])]


def test_points_of_a_drive_whose_log_is_not_kept_are_let_go(live: Live) -> None:
    points = way(60)
    live.send("osmand", osmand(points[:20] + points[40:], "x"))
    close(live.web)
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE drives SET log_deleted_at = now()"))
    live.send("osmand", osmand(points, "x"))
    close(live.web)
    assert live.waiting() == 0
    assert len(live.drives()) == 1


def test_what_a_quota_has_no_room_for_waits(live: Live) -> None:
    live.send("osmand", osmand(way(30), "x"))
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE owners SET quota_drives = 0"))
    close(live.web)
    assert (live.drives(), live.waiting()) == ([], 30)
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE owners SET quota_drives = 1"))
    close(live.web)
    assert (len(live.drives()), live.waiting()) == (1, 0)


def test_one_stream_at_fault_keeps_no_other(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    for device in ("a", "b", "c"):
        live.send("osmand", osmand(way(30, first=ord(device)), device))
    genuine = intake.register_upload

    def faulty(*arguments: Any, **options: Any) -> Any:
        if "-b-" in options["filename"]:
            raise OSError("the disk is away")
        return genuine(*arguments, **options)

    monkeypatch.setattr(intake, "register_upload", faulty)
    close(live.web)
    assert (len(live.drives()), live.waiting()) == (2, 30)


def test_streams_are_forgotten_when_they_are_silent_for_long(live: Live) -> None:
    live.send("owntracks", owntracks(way(30), "x"))
    close(live.web)
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE live_streams SET seen_at = now() - interval '31 days'"))
    close(live.web)
    assert live.keyed.a.own.get("/v1/live").json() == {"streams": []}
    assert len(live.drives()) == 1
