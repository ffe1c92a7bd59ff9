"""Drives where no roads are: what their logs say is shown at once, and roads that come have them computed."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.drives import tracks
from app.drives.batches.touched import queue_touched
from app.drives.process import Outcome
from app.drives.store import get_drive, request_reprocess
from app.roads.imports import import_roads
from fusion.roads.table import RoadTable
from processing_support import process_drive
from region_support import bring
from web_fixtures import Web


def waiting(web: Web, files: Path) -> dict[str, Any]:
    """A drive that was sent and found no roads."""
    sent = web.client.post(
        "/v1/drives?method=raw", content=(files / "0.csv").read_bytes(), headers={"X-Filename": "0.csv"}
    ).json()
    assert process_drive(web.context, uuid.UUID(sent["id"]), 1) is Outcome.FAILED
    return now(web, sent["id"])


def now(web: Web, drive_id: str) -> dict[str, Any]:
    return dict(web.client.get(f"/v1/drives/{drive_id}").json())


def test_a_drive_without_any_roads_shows_its_way_and_is_computed_when_they_come(
    web: Web, files: Path, tmp_path: Path
) -> None:
    drive = waiting(web, files)
    assert (drive["status"], drive["failure"]["kind"], drive["report"]) == ("failed", "no-roads", None)
    assert drive["waits_for"]["kind"] == "roads"
    assert drive["waits_for"]["extract"] == drive["waits_for"]["extracts"][0]
    assert drive["waits_for"]["extract"] in drive["failure"]["reason"]
    assert drive["distance_m"] > 500 and drive["epochs"] > 100 and drive["drive_time"] is not None
    here = f"/v1/drives/{drive['id']}"
    profile = web.client.get(f"{here}/profile").json()
    assert profile["epochs"] == len(profile["alt_m"]) == drive["epochs"]
    assert all(height is not None for height in profile["alt_m"])
    assert set(profile["segment_id"]) == {None} and set(profile["slope_percent"]) == {None}
    assert profile["distance_m"][-1] == pytest.approx(drive["distance_m"], rel=0.01)
    path = web.client.get(f"{here}/track").json()["features"][0]
    assert path["geometry"]["type"] == "MultiLineString"
    assert web.client.get(f"{here}/segments").json()["features"] == []
    assert web.client.get(f"{here}/profile?f=png").headers["Content-Type"] == "image/png"
    assert len(web.client.get(f"{here}/track?ends=hidden").json()["features"]) < 1 + drive["epochs"]

    import_roads(web.sessions, files / "town.osm", tmp_path / "dem")
    assert queue_touched(web.sessions) == 1
    assert now(web, drive["id"])["waits_for"] is None
    assert process_drive(web.context, uuid.UUID(drive["id"]), 2) is Outcome.DONE
    done = now(web, drive["id"])
    assert (done["status"], done["waits_for"], done["failure"]) == ("done", None, None)
    assert done["report"]["segments_estimated"] > 5
    assert any(web.client.get(f"{here}/profile").json()["segment_id"])


def test_roads_elsewhere_do_not_help_and_lists_tell_it_from_failures(
    web: Web, files: Path, chain: Callable[..., RoadTable]
) -> None:
    bring(web.sessions, chain(3, lon=20.0), "elsewhere", dem_dir=web.context.dem_dir)
    drive = waiting(web, files)
    assert (drive["failure"]["kind"], drive["failure"]["stage"]) == ("no-match", "roads")
    assert drive["waits_for"]["kind"] == "roads"
    log = b"time_s,lat_deg,lon_deg\n"
    other = web.client.post("/v1/drives?method=raw", content=log + b"1700000000,49,8.4\n").json()["id"]
    assert process_drive(web.context, uuid.UUID(other), 1) is Outcome.FAILED
    assert now(web, other)["waits_for"] is None

    def listed(query: str) -> list[str]:
        return [one["id"] for one in web.client.get(f"/v1/drives?{query}").json()["drives"]]

    assert listed("waits_for=roads") == [drive["id"]]
    assert listed("status=done&waits_for=roads") == []
    assert set(listed("status=failed")) == {drive["id"], other}
    assert listed("status=failed&waits_for=nothing") == [other]
    assert web.client.get("/v1/drives?waits_for=rain").status_code == 422

    def rows(name: str) -> list[dict[str, Any]]:
        return list(web.client.get(f"/v1/admin/{name}").json()["rows"])

    assert {one["kind"]: (one["drives"], one["waiting"]) for one in rows("failures")} == {
        "no-match": (1, 1),
        now(web, other)["failure"]["kind"]: (1, 0),
    }
    assert [(one["status"], one["drives"], one["waiting"]) for one in rows("drives")] == [("failed", 2, 1)]
    assert [(one["failed"], one["waiting"]) for one in rows("throughput")] == [(2, 1)]
    found = {one["kind"]: (one["count"], one["link"]) for one in rows("attention")}
    assert found["roads"] == (1, "/drives?waits_for=roads")
    assert found["failed"][0] == 1


def test_what_a_result_said_stays_when_the_roads_are_gone(
    context: Any, send: Callable[..., Any], chain: Callable[..., RoadTable]
) -> None:
    drive = send(0, "raw")
    assert process_drive(context, drive.id, 1) is Outcome.DONE
    with context.sessions() as session:
        before = tracks.read_track(session, drive.id)
    bring(context.sessions, chain(3, lon=20.0), "town", dem_dir=context.dem_dir)
    with context.sessions.begin() as session:
        assert request_reprocess(session, drive.id, "raw", {}) is not None
    assert process_drive(context, drive.id, 2) is Outcome.FAILED
    with context.sessions() as session:
        again, after = get_drive(session, drive.id), tracks.read_track(session, drive.id)
    assert again is not None and again.waits_for is not None and again.report is not None
    assert before is not None and after is not None and (before.segment == after.segment).all()
