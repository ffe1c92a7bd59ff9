"""What a drive yielded in each form: fewer points, measurements, files to be kept."""

from __future__ import annotations

import csv
import io
import json
import uuid
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gpxpy
import numpy as np
import pytest
from jsonschema import Draft202012Validator
from sqlalchemy import text

from app.drives import tracks
from app.drives.outputs.measurements import MEASUREMENTS_SCHEMA
from app.drives.outputs.profile_document import PROFILE_SCHEMA
from fusion.formats import read_log
from fusion.types import DrawnMeasurements
from problem_support import check

MakeDrive = Callable[..., uuid.UUID]


@pytest.fixture
def done(filled: Any, drive_maker: MakeDrive) -> str:
    return str(drive_maker(filled.sessions, [0, 1, 2], 3.0))


def measured(filled: Any, drive: str, n: int = 500) -> None:
    """Let the drive have measurements: heights 50 m above the estimate, and grades with one peak."""
    with filled.sessions.begin() as session:
        stored = tracks.read_track(session, uuid.UUID(drive))
        assert stored is not None
        time_s = np.sort(np.r_[np.linspace(stored.time_s[0], stored.time_s[14], n), stored.time_s[14] + 900])
        value = np.r_[np.full(n, 170.0), 0.05 + np.zeros(n)]
        value[n + n // 3] = 0.25
        said = DrawnMeasurements(
            ("altitude", "doppler"),
            np.repeat([0, 1], n),
            np.r_[time_s[:n], time_s[1:]],
            np.zeros(2 * n),
            value,
            np.repeat([True, False], n),
        )
        tracks.save_track(session, uuid.UUID(drive), tracks.EncodedTrack.of(stored, np.arange(100), said))


def get(filled: Any, drive: str, part: str, **headers: str) -> Any:
    return filled.client.get(f"/v1/drives/{drive}/{part}", headers=headers)


# --- profile ---------------------------------------------------------------------------------------------------


def test_the_profile_says_where_and_when_and_what_the_elevation_model_says(filled: Any, done: str) -> None:
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE segments SET dem_heights_m = '{100, 110}' WHERE id = 1"))
        session.execute(text("UPDATE segments SET dem_heights_m = '{NaN, 110, 120}' WHERE id = 2"))
    profile = get(filled, done, "profile").json()
    Draft202012Validator(PROFILE_SCHEMA).validate(profile)
    track = get(filled, done, "track").json()["features"][1:16]
    assert list(zip(profile["lon_deg"], profile["lat_deg"], strict=True)) == [
        tuple(point["geometry"]["coordinates"]) for point in track
    ]
    assert profile["time_s"] == [1_700_000_000.0 + k for k in range(15)]
    assert profile["dem_height_m"][:5] == pytest.approx([101, 103, 105, 107, 109])
    assert profile["dem_height_m"][5:10] == [None, None, 110, 114, 118]
    assert profile["dem_height_m"][10:] == [None] * 5
    assert profile["bridge"] == [True] * 5 + [False] * 10


def test_fewer_points_are_rows_of_the_whole(filled: Any, done: str) -> None:
    whole, few = get(filled, done, "profile").json(), get(filled, done, "profile?points=8").json()
    assert list(few) == list(whole)
    assert few["epochs"] <= 8
    names = [name for name, column in whole.items() if isinstance(column, list)]
    rows = [json.dumps([whole[name][k] for name in names]) for k in range(15)]
    assert [json.dumps([few[name][k] for name in names]) for k in range(few["epochs"])] == [
        row for row in rows if row in {json.dumps([few[n][k] for n in names]) for k in range(few["epochs"])}
    ]
    assert (few["alt_m"][0], few["alt_m"][-1]) == (whole["alt_m"][0], whole["alt_m"][-1])
    assert get(filled, done, "profile?points=100000").json() == whole


def over_a_hill(filled: Any, drive: str) -> None:
    """Let the drive climb 50 m over the first two of its three streets, with a known grade, and go down the third."""
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE segments SET name = 'Bergstraße' WHERE id < 3"))
        stored = tracks.read_track(session, uuid.UUID(drive))
        assert stored is not None
        known = np.r_[np.full(15, 0.004), np.nan]
        height = np.r_[np.linspace(100, 150, 10), np.linspace(148, 140, 5), np.nan]
        hill = replace(stored, alt_m=height, pitch_rad=0 * known, pitch_sigma_rad=known)
        tracks.save_track(session, uuid.UUID(drive), tracks.EncodedTrack.of(hill, np.arange(100)))


def test_the_figures_of_a_ride(filled: Any, done: str) -> None:
    flat = get(filled, done, "profile").json()["ride"]
    assert (flat["ascent_m"], flat["descent_m"], flat["climbs"]) == (1.4, 0, [])
    assert flat["least_rise_m"] == 10, "heights of a method without grades"
    over_a_hill(filled, done)
    whole = get(filled, done, "profile").json()
    Draft202012Validator(PROFILE_SCHEMA).validate(whole)
    ride = whole["ride"]
    assert ride["distance_m"] == whole["distance_m"][-1]
    assert ride["duration_s"] == 14
    assert (ride["ascent_m"], ride["descent_m"], ride["least_rise_m"]) == (50, 10, 2)
    assert ride["ascent_sigma_m"] == ride["descent_sigma_m"] == pytest.approx(np.sqrt(8), abs=1e-3)
    (climb,) = ride["climbs"]
    top = whole["distance_m"][9]
    assert (climb["from_m"], climb["to_m"]) == (0, pytest.approx(top, abs=10))
    assert climb["percent"] == pytest.approx(100 * climb["gain_m"] / climb["length_m"], abs=1e-3)
    assert climb["maximum_percent"] == pytest.approx(ride["steepest"]["percent"], abs=0.5)
    assert climb["category"] is None
    assert ride["steepest"]["sigma_percent"] == pytest.approx(0.4, abs=1e-3)
    assert climb["name"] == ride["steepest"]["name"] == "Bergstraße"
    assert get(filled, done, "profile?points=5").json()["ride"] == ride, "of the whole, however few points"


@pytest.mark.parametrize("part", ["profile", "measurements"])
@pytest.mark.parametrize("points", ["1", "100001", "many", "-5", ""])
def test_a_number_of_points_that_cannot_be(filled: Any, done: str, part: str, points: str) -> None:
    assert check(get(filled, done, f"{part}?points={points}"), 422)["errors"][0]["field"] == "points"


def test_the_profile_as_a_table(filled: Any, done: str) -> None:
    whole = get(filled, done, "profile").json()
    answer = get(filled, done, "profile?f=csv")
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    assert answer.headers["content-disposition"].startswith("attachment;")
    rows = list(csv.DictReader(io.StringIO(answer.text, newline="")))
    assert list(rows[0]) == [name for name, column in whole.items() if isinstance(column, list)]
    assert [float(row["alt_m"]) for row in rows] == whole["alt_m"]
    assert {row["grade_percent"] for row in rows} == {""}
    assert {row["forward"] for row in rows} == {"true"}
    few = get(filled, done, "profile?points=5", Accept="text/csv")
    assert len(few.text.splitlines()) <= 6


# --- measurements ----------------------------------------------------------------------------------------------


def test_measurements_stand_on_the_axis_of_the_profile(filled: Any, done: str) -> None:
    measured(filled, done)
    document = get(filled, done, "measurements").json()
    Draft202012Validator(MEASUREMENTS_SCHEMA).validate(document)
    profile = get(filled, done, "profile").json()
    height, grade = document["sensors"]
    assert (height["name"], height["is_height"], grade["name"], grade["is_height"]) == (
        "altitude",
        True,
        "doppler",
        False,
    )
    assert set(height["value"]) == {170.0}
    assert height["shift_m"] == pytest.approx(-49.3, abs=0.5)
    assert grade["shift_m"] is None
    assert (height["along_m"][0], height["along_m"][-1]) == (0, profile["distance_m"][-1])
    assert max(grade["value"]) == 25.0
    assert len(grade["value"]) == 499, "one lies where the profile knows no place"
    few = get(filled, done, "measurements?points=20").json()["sensors"]
    assert [len(sensor["value"]) <= 20 for sensor in few] == [True, True]
    assert max(few[1]["value"]) == 25.0


def test_a_method_without_measurements_has_none(filled: Any, done: str) -> None:
    assert get(filled, done, "measurements").json() == {"drive_id": done, "sensors": []}


@pytest.mark.parametrize("part", ["measurements", "profile", "track", "segments", "log"])
def test_parts_of_no_drive(filled: Any, part: str) -> None:
    check(get(filled, str(uuid.uuid4()), part), 404)


# --- track and estimates -----------------------------------------------------------------------------------------


def test_the_track_as_a_log_and_for_other_programs(filled: Any, done: str) -> None:
    answer = get(filled, done, "track?f=csv")
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    assert answer.headers["content-disposition"].endswith('-track.csv"')
    assert len(read_log(io.BytesIO(answer.content)).fix) == 15
    answer = get(filled, done, "track", Accept="application/gpx+xml")
    assert answer.headers["content-type"] == "application/gpx+xml"
    assert answer.headers["vary"].startswith("Accept")
    assert gpxpy.parse(answer.text).get_points_no() == 15


@pytest.mark.parametrize(
    ("part", "accept", "media_type"),
    [
        ("track", "application/json", "application/geo+json"),
        ("track", "text/html,application/xhtml+xml,*/*;q=0.8", "application/geo+json"),
        ("track", "text/csv;q=0.9, application/geo+json;q=0.1", "text/csv; charset=utf-8"),
        ("segments", "application/json", "application/geo+json"),
        ("segments", "text/csv", "text/csv; charset=utf-8"),
    ],
)
def test_the_form_asked_for(filled: Any, done: str, part: str, accept: str, media_type: str) -> None:
    assert get(filled, done, part, Accept=accept).headers["content-type"] == media_type


@pytest.mark.parametrize("part", ["track", "segments"])
def test_a_form_that_there_is_not(filled: Any, done: str, part: str) -> None:
    assert check(get(filled, done, part, Accept="image/png"), 406)["errors"][0]["field"] == "Accept"
    assert check(get(filled, done, f"{part}?f=shp"), 422)["errors"][0]["field"] == "f"


def test_all_estimates_at_once(filled: Any, drive_maker: MakeDrive) -> None:
    """The service's pages hold fifty."""
    drive = str(drive_maker(filled.sessions, list(range(60)), 3.0))
    page = get(filled, drive, "segments").json()
    assert (page["numberReturned"], [one["rel"] for one in page["links"]]) == (50, ["self", "next"])
    whole = get(filled, drive, "segments?f=geojson").json()
    assert (whole["numberReturned"], len(whole["features"])) == (60, 60)
    assert [one["rel"] for one in whole["links"]] == ["self"]
    assert whole["features"][:50] == page["features"]
    paged = get(filled, drive, "segments?f=geojson&limit=20").json()
    assert paged["features"] == page["features"][:20]
    answer = get(filled, drive, "segments?f=csv")
    rows = list(csv.DictReader(io.StringIO(answer.text, newline="")))
    assert [int(row["id"]) for row in rows] == [feature["id"] for feature in whole["features"]]
    assert {row["slope_percent"] for row in rows} == {"3.0"}
    first = whole["features"][0]["geometry"]["coordinates"]
    assert [
        [float(rows[0][f"{end}_{axis}_deg"]) for axis in ("lon", "lat")] for end in ("from", "to")
    ] == first


def test_estimates_of_a_drive_that_has_none_as_a_table(web: Any) -> None:
    drive = web.client.post("/v1/drives", content=b"time_s,lat_deg,lon_deg\n1,49,8\n").json()["id"]
    assert get(web, drive, "segments?f=csv").text.startswith("id,")
    assert get(web, drive, "segments?f=geojson").json()["features"] == []
