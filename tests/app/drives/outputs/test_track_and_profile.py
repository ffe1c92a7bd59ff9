"""Tracks and profiles: gaps stay gaps, directions are those of travel, pictures show something."""

from __future__ import annotations

import json
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from PIL import Image
from pyproj import Geod

from app.drives.outputs.profile import Profile, build_profile
from app.drives.outputs.profile_document import profile_json
from app.drives.outputs.profile_picture import profile_png
from app.drives.outputs.track import path_feature, point_features, track_chunks
from fusion.types import Track

UNKNOWN = float("nan")


def track(
    time_s: ArrayLike, lat: ArrayLike, lon: ArrayLike, segment: ArrayLike, distance: ArrayLike
) -> Track:
    n = len(np.asarray(time_s))
    nothing = np.full(n, UNKNOWN)
    return Track(
        time_s=np.asarray(time_s, float),
        lat_deg=np.asarray(lat, float),
        lon_deg=np.asarray(lon, float),
        alt_m=np.linspace(100, 110, n),
        h_sigma_m=np.full(n, 2.0),
        alt_sigma_m=np.full(n, 1.0),
        speed_mps=nothing,
        heading_rad=nothing,
        pitch_rad=nothing,
        pitch_sigma_rad=nothing,
        segment=np.asarray(segment, np.int64),
        distance_m=np.asarray(distance, float),
        has_gnss=np.ones(n, bool),
        after_outage=np.zeros(n, bool),
    )


def straight(n: int = 6) -> Track:
    """North along segment 5, then back along it; one epoch on segment 6; then off the roads."""
    return track(
        time_s=np.arange(n + 2.0),
        lat=49 + 1e-4 * np.arange(n + 2),
        lon=np.full(n + 2, 8.4),
        segment=[5] * 3 + [7] * (n - 3) + [6, -1],
        distance=[0, 10, 20, *(30.0 - 10 * np.arange(n - 3)), 3, UNKNOWN],
    )


def test_slopes_are_in_the_direction_of_travel() -> None:
    t = straight()
    profile = build_profile(t, t.segment, {5: (4.0, 0.5), 7: (2.0, 0.25), 6: (1.0, 1.0)})
    assert profile.forward.tolist() == [1, 1, 1, -1, -1, -1, 0, 0]
    assert profile.slope_percent[:6].tolist() == [4.0] * 3 + [-2.0] * 3
    assert np.isnan(profile.slope_percent[6:]).all(), "one epoch does not tell a direction"
    assert profile.slope_sigma_percent[:6].tolist() == [0.5] * 3 + [0.25] * 3


def test_a_segment_without_an_estimate_is_unknown() -> None:
    t = straight()
    document = profile_json(build_profile(t, t.segment, {}))
    assert document["slope_percent"] == [None] * 8
    assert document["segment_id"][-1] is None
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_the_distance_is_driven_over_ground() -> None:
    t = straight()
    expected = Geod(ellps="WGS84").line_length(t.lon_deg, t.lat_deg)
    profile = build_profile(t, t.segment, {})
    # The sphere is off by less than 0.6 % anywhere.
    assert profile.distance_m[-1] == pytest.approx(expected, rel=6e-3)


def test_nothing_is_drawn_over_an_interruption() -> None:
    t = track([0, 1, 2, 60, 61], [49, 49.1, 49.2, 50, 50.1], [8.0] * 5, [-1] * 5, [UNKNOWN] * 5)
    lines = path_feature(t)["geometry"]["coordinates"]
    assert [len(line) for line in lines] == [3, 2]
    assert build_profile(t, t.segment, {}).gap.tolist() == [True, False, False, True, False]


def test_a_single_epoch_after_a_gap_is_no_line() -> None:
    t = track([0, 1, 60], [49, 49.1, 50], [8.0] * 3, [-1] * 3, [UNKNOWN] * 3)
    assert [len(line) for line in path_feature(t)["geometry"]["coordinates"]] == [2]
    alone = track([0.0], [49.0], [8.0], [-1], [UNKNOWN])
    assert path_feature(alone)["geometry"] is None


@given(st.lists(st.tuples(st.sampled_from([49.0, UNKNOWN]), st.sampled_from([-1, 3])), max_size=12))
def test_any_track_is_valid_json_with_a_point_per_epoch(rows: list[tuple[float, int]]) -> None:
    lat = np.array([row[0] for row in rows], float)
    segment = [row[1] for row in rows]
    t = track(np.arange(len(rows)), lat, np.full(len(rows), 8.0), segment, np.arange(len(rows)))
    text = "".join(track_chunks(t, t.segment))
    document = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    points = list(point_features(t, t.segment))
    assert document == {"type": "FeatureCollection", "features": [path_feature(t), *points]}
    assert len(document["features"]) == len(rows) + 1
    for feature, (latitude, matched) in zip(document["features"][1:], rows, strict=True):
        assert (feature["geometry"] is None) == np.isnan(latitude)
        assert feature["properties"]["segment_id"] == (None if matched < 0 else matched)
    profile_json(build_profile(t, t.segment, {3: (1.0, 0.1)}))


def colours(picture: bytes) -> int:
    with Image.open(BytesIO(picture)) as image:
        assert image.format == "PNG"
        return len(image.convert("RGB").getcolors(1_000_000) or [])


def profile(**changes: object) -> Profile:
    t = straight()
    return replace(build_profile(t, t.segment, {5: (4.0, 0.5), 7: (2.0, 0.25)}), **changes)  # type: ignore[arg-type]


def test_the_picture_shows_the_profile() -> None:
    drawn = profile_png(profile(), "monday.ubx")
    blank = profile_png(profile(alt_m=np.full(8, UNKNOWN), slope_percent=np.full(8, UNKNOWN)), "monday.ubx")
    assert colours(drawn) > colours(blank) + 20


@pytest.mark.parametrize("title", ["", "$x^2$ \\frac{", "日本語.ubx", "a\x00\n\tb", "x" * 4000, "%s {0}"])
def test_any_file_name_can_stand_above_the_picture(title: str) -> None:
    assert colours(profile_png(profile(), title)) > 20


def test_a_picture_of_an_empty_track() -> None:
    empty = build_profile(track([], [], [], [], []), np.empty(0, np.int64), {})
    assert colours(profile_png(empty, "nothing.csv")) > 1
