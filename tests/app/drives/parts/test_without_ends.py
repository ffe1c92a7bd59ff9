"""A drive handed on without the ends of the trip: what is left of every part, and that nothing tells the rest."""

from __future__ import annotations

import csv
import io
import re
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import gpxpy
import numpy as np
import pytest
from sqlalchemy import text

from access_support import Keyed, asking_for_keys
from app.core.settings import Settings
from app.drives import tracks
from app.drives.parts.without_ends import rows_of_track
from app.releases.ends import FARTHEST_M, Circle
from fusion.types import DrawnMeasurements, Track
from problem_support import check
from release_support import LONG, Public, public

__all__ = ["public"]

SECONDS = 10
"""Over each segment of the street."""
STOP, STOP_S = 20, 300
"""Behind so many segments the vehicle stands for so long."""
ZONE = {"lon": 8.5305, "radius_m": 100.0}
PARTS = ("track", "track?f=csv", "track?f=gpx", "segments", "profile", "profile?f=csv", "measurements")


@dataclass
class Trip:
    """A drive of anna's along the street that stops in the middle, with a zone farther on."""

    public: Public
    guarded: Keyed
    drive: uuid.UUID
    begin_s: float

    def get(self, part: str, caller: str | None = "anna", hidden: bool = True, status: int = 200) -> Any:
        """The answer."""
        asked = f"{'&' if '?' in part else '?'}ends=hidden" if hidden else ""
        answer = self.guarded.ask(caller, "GET", f"/v1/drives/{self.drive}/{part}{asked}")
        assert answer.status_code == status, answer.text
        return answer

    def points(self, **asked: Any) -> list[tuple[float, float, float]]:
        """Time, longitude and latitude of the track's rows."""
        features = self.get("track", **asked).json()["features"][1:]
        return [
            (
                moment(f["properties"]["time"]),
                *(f["geometry"] or {"coordinates": (np.nan, np.nan)})["coordinates"],
            )
            for f in features
        ]

    def segments(self, query: str = "", **asked: Any) -> list[int]:
        """The segments of which an estimate is left, by their rows of the street."""
        row_of = {int(number): row for row, number in enumerate(self.public.ids)}
        features = self.get(f"segments?f=geojson{query}", **asked).json()["features"]
        return [row_of[feature["id"]] for feature in features]

    def times_of(self, row: int) -> np.ndarray:
        """When the drive was on a segment of the street."""
        return self.begin_s + SECONDS * row + (STOP_S if row >= STOP else 0) + np.arange(SECONDS)


def moment(words: str) -> float:
    return datetime.fromisoformat(words).timestamp()


def street_track(public: Public, begin_s: float, rows: int) -> Track:
    """A row each second over so many segments; before and behind them some without a place."""
    row = np.repeat(np.arange(rows), SECONDS)
    share = np.tile(np.arange(SECONDS) / SECONDS, rows)
    if rows > STOP:
        at = STOP * SECONDS
        row, share = (
            np.insert(row, at, np.full(STOP_S, STOP - 1)),
            np.insert(share, at, np.full(STOP_S, 0.99)),
        )
    n, unplaced = len(row), np.full(3, np.nan)
    table = public.table

    def column(values: Any) -> np.ndarray:
        return np.concatenate([unplaced, np.broadcast_to(np.asarray(values, float), n), unplaced])

    return Track(
        time_s=begin_s - 3 + np.arange(n + 6.0),
        lon_deg=column(table.lon0_deg[row] + share * (table.lon1_deg[row] - table.lon0_deg[row])),
        lat_deg=column(table.lat0_deg[row]),
        alt_m=column(100 + 0.1 * np.arange(n)),
        h_sigma_m=column(1.0),
        alt_sigma_m=column(1.0),
        speed_mps=column(7.3),
        heading_rad=column(np.pi / 2),
        pitch_rad=column(0.03),
        pitch_sigma_rad=column(0.01),
        segment=np.concatenate([[-1] * 3, row, [-1] * 3]),
        distance_m=column(share * table.length_m[row]),
        has_gnss=np.isfinite(column(0)),
        after_outage=np.zeros(n + 6, bool),
    )


def make_trip(public: Public, guarded: Keyed, rows: int = LONG) -> Trip:
    """A drive of anna's over so many segments of the street, with track and measurements, done."""
    if guarded.owners["anna"] not in public.owners:
        public.owners.append(guarded.owners["anna"])
    drive = public.drive(public.owners.index(guarded.owners["anna"]), range(rows))
    with public.sessions.begin() as session:
        later = text(
            "UPDATE drive_passes SET entered_s = entered_s + :stop WHERE drive_id = :id AND sequence >= :at"
        )
        session.execute(later, {"stop": STOP_S, "id": drive, "at": STOP})
        first = text("SELECT min(entered_s) FROM drive_passes WHERE drive_id = :id")
        begin_s = float(session.execute(first, {"id": drive}).scalar_one())
        track = street_track(public, begin_s, rows)
        time_s = np.arange(track.time_s[0], track.time_s[-1], 0.5)
        n = len(time_s)
        heights = DrawnMeasurements(
            ("altitude",), np.zeros(n, int), time_s, np.zeros(n), np.full(n, 120.0), np.ones(n, bool)
        )
        tracks.save_track(session, drive, tracks.EncodedTrack.of(track, public.ids, heights))
        done = text("UPDATE drives SET status = 'done', finished_at = clock_timestamp() WHERE id = :id")
        session.execute(done, {"id": drive})
    return Trip(public, guarded, drive, begin_s)


def set_zone(guarded: Keyed) -> None:
    place = {"type": "Point", "coordinates": [ZONE["lon"], 49.0]}
    zone = {"type": "Feature", "geometry": place, "properties": {"name": "x", "radius_m": ZONE["radius_m"]}}
    document = {"type": "FeatureCollection", "features": [zone]}
    assert guarded.ask("anna", "PUT", "/v1/owner/zones", json=document).status_code == 204


@pytest.fixture
def guarded(public: Public, settings: Settings) -> Iterator[Keyed]:
    with asking_for_keys(settings, public_map="releases") as guarded:
        yield guarded


@pytest.fixture
def trip(public: Public, guarded: Keyed) -> Trip:
    set_zone(guarded)
    return make_trip(public, guarded)


def circles_of(trip: Trip) -> list[Circle]:
    """Those that editions keep, and the zone."""
    query = text("SELECT lon_deg, lat_deg, radius_m FROM told.places WHERE owner_id = :owner ORDER BY id")
    with trip.public.sessions() as session:
        kept = [Circle(*row) for row in session.execute(query, {"owner": trip.guarded.owners["anna"]})]
    return [*kept, Circle(ZONE["lon"], 49.0, ZONE["radius_m"])]


def hidden_by_edition(trip: Trip) -> set[int]:
    query = text("SELECT hidden FROM told.examined WHERE drive_id = :id")
    with trip.public.sessions() as session:
        return set(session.execute(query, {"id": trip.drive}).scalar_one())


def test_the_cut_is_that_of_editions_before_and_after_they_are_made(trip: Trip) -> None:
    before = trip.points(), trip.segments()
    trip.public.release()
    assert (trip.points(), trip.segments()) == before
    out = hidden_by_edition(trip)
    assert {0, STOP - 1, STOP, 30, LONG - 1} <= out
    left = set(range(LONG)) - out
    assert len(left) > 8
    assert trip.segments() == sorted(left)
    assert {time_s for time_s, *_ in before[0]} == {t for row in left for t in trip.times_of(row)}
    circles = circles_of(trip)
    assert len(circles) == 4
    for circle in circles:
        lon, lat = np.array([place for _, *place in before[0]]).T
        assert circle.beyond_m(lon, lat).min() > 0
    for caller in ("anna", "operate"):
        assert trip.points(caller=caller) == before[0]


def test_a_place_that_is_kept_has_its_radius_in_files(trip: Trip) -> None:
    kept = Circle(8.5004, 49.0, FARTHEST_M - 1)
    add = "INSERT INTO told.places (owner_id, lon_deg, lat_deg, radius_m) VALUES (:owner, :lon, 49, :radius)"
    values = {"owner": trip.guarded.owners["anna"], "lon": kept.lon_deg, "radius": kept.radius_m}
    with trip.public.sessions.begin() as session:
        session.execute(text(add), values)
    rows = trip.segments()
    beyond = 1 + int((kept.lon_deg - 8.5) / 0.001 + kept.radius_m / trip.public.table.length_m[0])
    assert rows[0] == beyond


def test_what_is_left_tells_nothing_of_the_rest(trip: Trip) -> None:
    whole, points = trip.points(hidden=False), trip.points()
    assert len(whole) == LONG * SECONDS + STOP_S + 6
    assert 0 < len(points) < len(whole) / 2
    path, *_ = trip.get("track").json()["features"]
    assert path["properties"]["epochs"] == len(points)
    assert (moment(path["properties"]["start"]), moment(path["properties"]["end"])) == (
        points[0][0],
        points[-1][0],
    )
    assert "ends=hidden" in trip.get("track").json()["links"][0]["href"]
    profile, all_of_it = trip.get("profile").json(), trip.get("profile", hidden=False).json()
    assert profile["epochs"] == len(points)
    assert (profile["time_s"][0], profile["time_s"][-1]) == (points[0][0], points[-1][0])
    assert profile["distance_m"][0] == 0
    assert profile["distance_m"][-1] < all_of_it["distance_m"][-1] - 300
    assert profile["gap"][0] and sum(profile["gap"]) == len(pieces(points))
    rows = list(csv.DictReader(io.StringIO(trip.get("profile?f=csv").text, newline="")))
    assert [float(row["distance_m"]) for row in rows] == profile["distance_m"]
    rows = list(csv.DictReader(io.StringIO(trip.get("track?f=csv").text, newline="")))
    assert [float(row["time_s"]) for row in rows] == [time_s for time_s, *_ in points]


def pieces(points: list[tuple[float, float, float]]) -> list[list[float]]:
    """The times of each uninterrupted piece."""
    times = np.array([time_s for time_s, *_ in points])
    return [piece.tolist() for piece in np.split(times, np.flatnonzero(np.diff(times) > 1) + 1)]


def test_pieces_are_pieces_in_every_form(trip: Trip) -> None:
    expected = pieces(trip.points())
    assert len(expected) >= 3
    lines = trip.get("track").json()["features"][0]["geometry"]["coordinates"]
    assert [len(line) for line in lines] == [len(piece) for piece in expected]
    answer = trip.get("track?f=gpx")
    segments = gpxpy.parse(answer.text).tracks[0].segments
    assert [[p.time.timestamp() for p in s.points] for s in segments] == expected
    assert answer.headers["content-disposition"].endswith('-track.gpx"')


def test_a_cut_of_a_moment_interrupts_as_well(public: Public) -> None:
    whole = street_track(public, 0.0, 3)
    stays = np.arange(len(whole)) != 10
    left = rows_of_track(whole, stays)
    assert np.flatnonzero(left.after_outage).tolist() == [10]
    assert left.time_s.tolist() == whole.time_s[stays].tolist()
    assert not whole.after_outage.any()


def test_measurements_are_left_where_the_track_is(trip: Trip) -> None:
    (sensor,) = trip.get("measurements").json()["sensors"]
    left = pieces(trip.points())
    assert all(any(piece[0] <= t <= piece[-1] for piece in left) for t in sensor["time_s"])
    assert len(sensor["time_s"]) == sum(2 * len(piece) - 1 for piece in left)
    assert sensor["along_m"][0] == 0
    (whole,) = trip.get("measurements", hidden=False).json()["sensors"]
    assert len(whole["time_s"]) > 2 * len(sensor["time_s"])


def test_pages_of_estimates_are_cut_as_well(trip: Trip) -> None:
    address, found = f"/v1/drives/{trip.drive}/segments?ends=hidden&limit=3", []
    while address:
        page = trip.guarded.ask("anna", "GET", address).json()
        assert page["numberReturned"] == len(page["features"]) <= 3
        found += [feature["id"] for feature in page["features"]]
        address = next((one["href"] for one in page["links"] if one["rel"] == "next"), "")
    assert found == [int(trip.public.ids[row]) for row in trip.segments()]
    rows = list(csv.DictReader(io.StringIO(trip.get("segments?f=csv").text, newline="")))
    assert [int(row["id"]) for row in rows] == found


def test_a_drive_whose_method_leaves_no_passes_is_cut_by_its_rows(trip: Trip) -> None:
    before = trip.points()
    with trip.public.sessions.begin() as session:
        session.execute(text("DELETE FROM drive_passes WHERE drive_id = :id"), {"id": trip.drive})
    assert trip.points() == before
    assert trip.segments()[0] > 1


def test_a_picture_without_ends_is_not_kept(trip: Trip) -> None:
    kept = "SELECT count(*) FROM drive_pictures"
    cut = trip.get("profile?f=png").content
    assert cut.startswith(b"\x89PNG")
    assert trip.public.count(kept) == 0
    whole = trip.get("profile?f=png", hidden=False).content
    assert trip.public.count(kept) == 1
    assert whole != cut
    assert trip.get("profile?f=png").content == cut
    assert trip.get("profile?f=png", hidden=False).content == whole


def test_where_everything_is_hidden_files_are_empty(public: Public, guarded: Keyed) -> None:
    trip = make_trip(public, guarded, rows=4)
    assert len(trip.points(hidden=False)) == 4 * SECONDS + 6
    path = trip.get("track").json()["features"]
    assert [one["geometry"] for one in path] == [None]
    assert path[0]["properties"] == {"epochs": 0, "start": None, "end": None}
    assert trip.get("track?f=csv").text.count("\r\n") == 1
    assert gpxpy.parse(trip.get("track?f=gpx").text).get_points_no() == 0
    assert trip.segments() == []
    assert trip.get("segments?f=csv").text.startswith("id,")
    assert trip.get("profile").json()["epochs"] == 0
    assert trip.get("profile?f=csv").text.count("\r\n") == 1
    assert trip.get("profile?f=png").content.startswith(b"\x89PNG")
    assert trip.get("measurements").json()["sensors"] == []


def test_whose_drive_it_is_not_gets_nothing(trip: Trip) -> None:
    for part in PARTS:
        for caller, status in (("ben", 404), ("anna upload", 403), (None, 401)):
            answer = trip.get(part, caller=caller, status=status)
            assert not re.search(r"\d+\.\d{4}", answer.text)


@pytest.mark.parametrize("part", PARTS)
def test_another_word_is_refused(trip: Trip, part: str) -> None:
    asked = f"{part}{'&' if '?' in part else '?'}ends=shown"
    assert check(trip.get(asked, hidden=False, status=422), 422)["errors"][0]["field"] == "ends"
