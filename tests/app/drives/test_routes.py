"""Drives: listing, events, track, profile, estimates, removal, processing again."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import fields
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from sqlalchemy import text

from app.drives import claims, store, tracks
from app.drives.outputs.profile_document import PROFILE_EXAMPLE, PROFILE_SCHEMA
from app.drives.process import Outcome
from app.map.segment import PROPERTIES
from fusion.simulate.drive import simulate_drive
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from fusion.types import DrawnMeasurements, Track
from processing_support import HEADER, carry_out_removals, process_drive

MakeDrive = Callable[..., uuid.UUID]


def upload(web: Any, data: bytes = b"nonsense") -> str:
    answer = web.client.post("/v1/drives", content=HEADER + data)
    assert answer.status_code == 202
    return str(answer.json()["id"])


@pytest.fixture
def done(filled: Any, drive_maker: MakeDrive) -> str:
    """A drive over the first three segments of the grid."""
    return str(drive_maker(filled.sessions, [0, 1, 2], 3.0))


# --- listing -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [1, 2, 3, 7, 100])
def test_pages_reach_each_drive_once_newest_first(web: Any, limit: int) -> None:
    expected = [upload(web, b"%d" % number) for number in range(7)][::-1]
    found: list[str] = []
    address = f"/v1/drives?limit={limit}&status=queued"
    while address:
        page = web.client.get(address).json()
        assert 0 < len(page["drives"]) <= limit
        found += [drive["id"] for drive in page["drives"]]
        address = next((link["href"] for link in page["links"] if link["rel"] == "next"), "")
    assert found == expected


def test_pages_go_on_past_a_drive_deleted_meanwhile(web: Any) -> None:
    made = [upload(web, b"%d" % number) for number in range(4)][::-1]
    page = web.client.get("/v1/drives?limit=2").json()
    following = next(link["href"] for link in page["links"] if link["rel"] == "next")
    assert web.client.delete(f"/v1/drives/{made[1]}").status_code == 202
    carry_out_removals(web.sessions, web.blobs)
    answer = web.client.get(following)
    assert answer.status_code == 200, answer.text
    assert [drive["id"] for drive in answer.json()["drives"]] == made[2:]


def test_drives_by_status(filled: Any, done: str) -> None:
    waiting = upload(filled)
    by_status = {
        status: [d["id"] for d in filled.client.get(f"/v1/drives?status={status}").json()["drives"]]
        for status in ("queued", "running", "done", "failed", "cancelled")
    }
    assert by_status == {"queued": [waiting], "running": [], "done": [done], "failed": [], "cancelled": []}


def test_a_failure_is_told_with_its_place(web: Any) -> None:
    drive = upload(web)
    assert process_drive(web.context, uuid.UUID(drive), 1) is Outcome.FAILED
    document = web.client.get(f"/v1/drives/{drive}").json()
    assert document["status"] == "failed"
    assert document["failure"]["kind"] == "empty-log"
    assert document["failure"]["stage"]
    assert document["failure"]["reason"].endswith(".")
    for part in ("track", "profile"):
        answer = web.client.get(f"/v1/drives/{drive}/{part}")
        assert answer.status_code == 404
        assert document["failure"]["reason"] in answer.json()["detail"]
    assert web.client.get(f"/v1/drives/{drive}/segments").json()["features"] == []
    stats = web.client.get("/v1/admin/stats").json()
    assert stats["failures_by_kind"] == {"empty-log": 1}
    assert stats["drives_by_status"] == {"failed": 1}


# --- what a drive yields -----------------------------------------------------------------------------------


def test_the_track_is_a_path_and_points_with_sigmas(filled: Any, done: str) -> None:
    answer = filled.client.get(f"/v1/drives/{done}/track")
    assert answer.headers["content-type"] == "application/geo+json"
    path, *points = answer.json()["features"]
    assert path["geometry"]["type"] == "MultiLineString"
    assert [len(line) for line in path["geometry"]["coordinates"]] == [15]
    assert len(points) == 16
    for point in points[:-1]:
        properties = point["properties"]
        assert point["geometry"]["type"] == "Point"
        assert properties["h_sigma_m"] == 1.5
        assert properties["alt_sigma_m"] == 2.0
        assert properties["pitch_deg"] is None
        assert properties["heading_deg"] == 90
        assert properties["segment_id"] in {1, 2, 3}
        assert properties["has_gnss"] is True
    assert points[-1]["geometry"] is None
    assert points[-1]["properties"]["segment_id"] is None
    assert points[-1]["properties"]["alt_m"] is None
    assert "NaN" not in answer.text


def test_the_profile_as_columns(filled: Any, done: str) -> None:
    profile = filled.client.get(f"/v1/drives/{done}/profile").json()
    columns = {name: value for name, value in profile.items() if isinstance(value, list)}
    assert {len(column) for column in columns.values()} == {profile["epochs"]} == {15}
    assert profile["distance_m"][0] == 0
    assert all(a < b for a, b in pairwise(profile["distance_m"]))
    assert set(profile["slope_percent"]) == {3.0}
    assert set(profile["forward"]) == {True}
    assert profile["alt_m"][:2] == [120.0, 120.1]
    assert set(profile["grade_percent"]) == set(profile["grade_sigma_percent"]) == {None}
    assert set(profile["has_gnss"]) == {True}
    assert list(profile) == list(PROFILE_EXAMPLE) == list(PROFILE_SCHEMA["properties"])


def test_a_segment_with_one_epoch_has_its_direction_from_the_heading(filled: Any, done: str) -> None:
    """The road's bearing is compared with the vehicle's heading."""
    with filled.sessions.begin() as session:
        stored = tracks.read_track(session, uuid.UUID(done))
        assert stored is not None
        columns = {spec.name: getattr(stored, spec.name)[:15:5] for spec in fields(Track)}
        east, north = np.diff(columns["lon_deg"]) * np.cos(np.radians(49)), np.diff(columns["lat_deg"])
        columns["heading_rad"] = np.arctan2(east, north)[[0, 0, 1]]
        tracks.save_track(session, uuid.UUID(done), tracks.EncodedTrack.of(Track(**columns), np.arange(100)))
    profile = filled.client.get(f"/v1/drives/{done}/profile").json()
    assert profile["forward"] == [True] * 3
    assert profile["slope_percent"] == [3.0] * 3


def test_the_picture_shows_what_was_measured(filled: Any, done: str) -> None:
    address = f"/v1/drives/{done}/profile?f=png"
    without = filled.client.get(address).content
    with filled.sessions.begin() as session:
        stored = tracks.read_track(session, uuid.UUID(done))
        assert stored is not None
        time_s = stored.time_s[:15]
        along, height = np.linspace(0, 100, 15), np.full(15, 121.0)
        said = DrawnMeasurements(("altitude",), np.zeros(15, int), time_s, along, height, np.ones(15, bool))
        tracks.save_track(session, uuid.UUID(done), tracks.EncodedTrack.of(stored, np.arange(100), said))
        session.execute(text("UPDATE drives SET finished_at = now()"))
    assert filled.client.get(address).content != without


@pytest.mark.parametrize(
    ("accept", "query", "media_type"),
    [
        ("*/*", "", "application/json"),
        ("image/png", "", "image/png"),
        ("image/avif,image/webp,image/png,image/svg+xml,image/*;q=0.8,*/*;q=0.5", "", "image/png"),
        ("text/html,application/xhtml+xml,*/*;q=0.8", "", "application/json"),
        ("application/json;q=0.2, image/png;q=0.9", "", "image/png"),
        ("application/json, image/png;q=0", "", "application/json"),
        ("application/json", "?f=png", "image/png"),
        ("image/png", "?f=json", "application/json"),
    ],
)
def test_the_profile_in_the_form_asked_for(
    filled: Any, done: str, accept: str, query: str, media_type: str
) -> None:
    answer = filled.client.get(f"/v1/drives/{done}/profile{query}", headers={"Accept": accept})
    assert answer.headers["content-type"] == media_type
    assert answer.headers["vary"].startswith("Accept")
    if media_type == "image/png":
        with Image.open(BytesIO(answer.content)) as picture:
            assert picture.width > 500
            assert len(picture.convert("RGB").getcolors(100_000) or []) > 20, "an empty picture"


def test_a_profile_in_no_form_that_there_is(filled: Any, done: str) -> None:
    answer = filled.client.get(f"/v1/drives/{done}/profile", headers={"Accept": "application/xml"})
    assert answer.status_code == 406
    assert answer.json()["errors"][0]["field"] == "Accept"


def test_a_drive_s_estimates_are_its_own(filled: Any, done: str, drive_maker: MakeDrive) -> None:
    drive_maker(filled.sessions, [2], 1.0)
    answer = filled.client.get(f"/v1/drives/{done}/segments")
    features = answer.json()["features"]
    assert [f["id"] for f in features] == [1, 2, 3]
    for feature in features:
        properties = feature["properties"]
        assert tuple(properties)[: len(PROPERTIES)] == PROPERTIES
        assert properties["slope_percent"] == 3.0
        assert properties["drives"] == 1
        assert properties["passes"] == 1
    assert [f["properties"]["combined_slope_percent"] for f in features] == [3.0, 3.0, 2.0]
    assert [f["properties"]["combined_drives"] for f in features] == [1, 1, 2]


# --- removal and processing again --------------------------------------------------------------------------


def test_a_removed_drive_leaves_every_aggregate(filled: Any, done: str, drive_maker: MakeDrive) -> None:
    other = drive_maker(filled.sessions, [2, 3], 1.0)

    def slopes() -> dict[int, tuple[float, int]]:
        found = filled.client.get("/collections/segments/items?driven=true").json()["features"]
        return {f["id"]: (f["properties"]["slope_percent"], f["properties"]["drives"]) for f in found}

    assert slopes() == {1: (3.0, 1), 2: (3.0, 1), 3: (2.0, 2), 4: (1.0, 1)}
    assert filled.client.delete(f"/v1/drives/{done}").status_code == 202
    assert slopes()[1] == (3.0, 1)  # until a worker has taken it back
    carry_out_removals(filled.sessions, filled.blobs)
    assert slopes() == {3: (1.0, 1), 4: (1.0, 1)}
    assert filled.client.delete(f"/v1/drives/{other}").status_code == 202
    assert filled.client.delete(f"/v1/drives/{other}").status_code == 404  # once more
    carry_out_removals(filled.sessions, filled.blobs)
    assert slopes() == {}
    assert filled.client.delete(f"/v1/drives/{other}").status_code == 404


@pytest.mark.parametrize("status", ["queued", "running", "failed"])
def test_removal_works_in_any_state(web: Any, status: str) -> None:
    drive = uuid.UUID(upload(web))
    if status != "queued":
        with web.sessions.begin() as session:
            assert claims.mark_running(session, drive, 1)
            if status == "failed":
                claims.mark_failed(session, drive, 1, kind="x", reason="x.", stage="x")
    answer = web.client.delete(f"/v1/drives/{drive}")
    assert answer.status_code == 202
    assert answer.json()["status"] == "cancelled"
    assert web.client.get(f"/v1/drives/{drive}").status_code == 404
    assert web.client.post(f"/v1/drives/{drive}/reprocess").status_code == 404
    carry_out_removals(web.sessions, web.blobs)
    assert web.client.get(f"/v1/drives/{drive}").status_code == 404
    assert web.blobs.keys() == []


@pytest.mark.parametrize(
    ("request_", "method", "options"),
    [
        ({}, "particle", {"particles": 700}),
        ({"params": {"method": "raw"}}, "raw", {}),
        ({"json": {"method": "raw"}}, "raw", {}),
        ({"params": {"option": "particles:900"}}, "particle", {"particles": 900}),
        ({"json": {"options": {"particles": 900}}}, "particle", {"particles": 900}),
        ({"json": {}}, "particle", {"particles": 700}),
    ],
)
def test_processing_again(web: Any, request_: dict[str, Any], method: str, options: dict[str, Any]) -> None:
    first = web.client.post("/v1/drives?method=particle&option=particles:700", content=HEADER)
    answer = web.client.post(f"{first.headers['location']}/reprocess", **request_)
    assert answer.status_code == 202, answer.text
    assert answer.json()["id"] == first.json()["id"]
    assert answer.headers["location"] == first.headers["location"]
    drive = web.client.get(answer.headers["location"]).json()
    assert (drive["status"], drive["method"], drive["options"]) == ("queued", method, options)
    with web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 2


@pytest.mark.parametrize(
    ("request_", "status", "field"),
    [
        ({"json": {"method": "guess"}}, 422, None),
        ({"json": {"options": {"no_such": 1}}}, 422, "no_such"),
        ({"json": {"methods": "raw"}}, 422, "methods"),
        ({"json": [1]}, 422, "body"),
        ({"content": b"{", "headers": {"Content-Type": "application/json"}}, 422, "body"),
        ({"content": b" " * 70_000, "headers": {"Content-Type": "application/json"}}, 413, None),
    ],
)
def test_processing_again_as_it_cannot_be(
    web: Any, request_: dict[str, Any], status: int, field: str | None
) -> None:
    drive = upload(web)
    answer = web.client.post(f"/v1/drives/{drive}/reprocess", **request_)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert [error["field"] for error in answer.json()["errors"]] == ([field] if field else [])
    with web.sessions() as session:
        assert store.get_drive(session, uuid.UUID(drive)).generation == 1


# --- the whole way -----------------------------------------------------------------------------------------


def test_an_uploaded_drive_through_the_town_ends_as_slopes_on_the_map(
    web: Any, town: Any, tmp_path: Path
) -> None:
    from app.roads.imports import import_roads  # noqa: PLC0415 - beside their only use
    from app.terrain.imports import import_dem  # noqa: PLC0415 - beside their only use

    write_osm(town, tmp_path / "town.osm")
    write_dem(town, tmp_path / "town.tif")
    import_roads(web.sessions, tmp_path / "town.osm", web.settings.dem_dir)
    import_dem(web.sessions, [tmp_path / "town.tif"], web.settings.dem_dir)
    write_csv(simulate_drive(town, seed=1, duration_s=240), tmp_path / "drive.csv")
    with (tmp_path / "drive.csv").open("rb") as file:
        location = web.client.post("/v1/drives?method=raw", files={"file": file}).headers["location"]
    drive = uuid.UUID(location.rsplit("/", 1)[-1])
    assert process_drive(web.context, drive, 1) is Outcome.DONE

    document = web.client.get(location).json()
    assert (document["status"], document["progress"]) == ("done", 1.0)
    assert document["epochs"] > 200
    own = web.client.get(f"{location}/segments").json()["features"]
    assert len(own) > 5
    items = web.client.get("/collections/segments/items?driven=true&limit=50").json()["features"]
    assert {f["id"] for f in items} <= {f["id"] for f in own}
    assert {f["id"]: f["properties"]["slope_percent"] for f in items} == {
        f["id"]: f["properties"]["slope_percent"] for f in own if f["id"] in {i["id"] for i in items}
    }
    assert web.client.get(f"{location}/profile?f=png").content.startswith(b"\x89PNG")
    assert "town.tif" in web.client.get("/tiles.json").json()["attribution"]
    assert len(web.client.get(f"{location}/track").json()["features"]) == document["epochs"] + 1
