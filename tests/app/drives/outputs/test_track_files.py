"""Tracks as files of other programs: GPX that follows the schema, CSV that is a log again."""

from __future__ import annotations

import io
import re
from xml.etree import ElementTree as ET

import gpxpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.drives.outputs.track_files import track_csv, track_gpx
from fusion.formats import read_log
from fusion.terrain.datum import ELLIPSOID, MEAN_SEA_LEVEL
from fusion.types import Track
from web_fixtures import START_S, grid_roads, track_along

GPX = "{http://www.topografix.com/GPX/1/1}"
TRKPT = ("ele", "time")
"""In the order of the schema's wptType."""
METADATA = ("name", "desc", "time")


@pytest.fixture(scope="module")
def track() -> Track:
    """Fifteen epochs, a gap before the sixth, and one without a place."""
    whole = track_along(grid_roads(), [0, 1, 2])
    whole.time_s[5:] += 60
    whole.alt_m[3] = np.nan
    return whole


def gpx(track: Track, name: str = "monday.ubx") -> str:
    return "".join(track_gpx(track, name, "Heights: mean sea level."))


def test_gpx_follows_the_schema(track: Track) -> None:
    root = ET.fromstring(gpx(track))  # noqa: S314 - our own
    assert root.tag == f"{GPX}gpx"
    assert (root.get("version"), root.get("creator")) == ("1.1", "Versant")
    assert [child.tag for child in root] == [f"{GPX}metadata", f"{GPX}trk"]
    assert [child.tag.removeprefix(GPX) for child in root[0]] == list(METADATA)
    assert [child.tag.removeprefix(GPX) for child in root[1]] == ["name", "trkseg", "trkseg"]
    points = root.findall(f".//{GPX}trkpt")
    assert [len(segment) for segment in root.findall(f".//{GPX}trkseg")] == [5, 10]
    for number, point in enumerate(points):
        assert set(point.attrib) == {"lat", "lon"}
        wanted = TRKPT if number != 3 else TRKPT[1:]
        assert tuple(child.tag.removeprefix(GPX) for child in point) == wanted
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", point.findtext(f"{GPX}time") or "")


def test_gpx_is_read_by_others_and_by_us(track: Track) -> None:
    read = gpxpy.parse(gpx(track))
    assert [len(s.points) for s in read.tracks[0].segments] == [5, 10]
    log = read_log(io.BytesIO(gpx(track).encode()))
    assert log.fix.lat_deg == pytest.approx(track.lat_deg[:15], abs=1e-7)
    assert log.fix.time_s == pytest.approx(track.time_s[:15], abs=1e-3)


@given(st.text())
def test_any_name_is_text_and_never_markup(track: Track, name: str) -> None:
    root = ET.fromstring(gpx(track, name))  # noqa: S314 - our own
    assert len(root.findall(f".//{GPX}trkpt")) == 15


def test_an_empty_track_is_a_valid_file(track: Track) -> None:
    nothing = Track(**{name: column[:0] for name, column in vars(track).items()})
    assert gpxpy.parse(gpx(nothing)).get_points_no() == 0
    assert "".join(track_csv(nothing, None)).count("\r\n") == 1


@pytest.mark.parametrize(("datum", "column"), [(MEAN_SEA_LEVEL, "alt_msl_m"), (ELLIPSOID, "height_ell_m")])
def test_csv_is_a_log_again(track: Track, datum: str, column: str) -> None:
    text = "".join(track_csv(track, datum))
    assert text.splitlines()[0].split(",")[:4] == ["time_s", "lat_deg", "lon_deg", column]
    log = read_log(io.BytesIO(text.encode()))
    assert (log.warnings, dict(log.skipped)) == ((), {})
    assert log.fix.time_s == pytest.approx(track.time_s[:15])
    assert log.fix.lon_deg == pytest.approx(track.lon_deg[:15], abs=1e-7)
    assert getattr(log.fix, column)[:3] == pytest.approx(track.alt_m[:3])
    assert np.isnan(getattr(log.fix, column)[3])
    assert log.fix.time_s[0] == START_S
