"""Surveyed heights: files of them, their places on roads, and what they do to the heights."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from drive_factors import PLANE, drive_along, street_east
from fusion.errors import ControlError
from fusion.network.adjust import adjust
from fusion.network.control import DEFAULT_SIGMA_M, ControlPoint, place, read_control
from fusion.network.segment_slopes import Adjustment
from fusion.roads.table import RoadTable
from fusion.types import Floats

STREET = street_east(*[60.0, 15.0, 100.0, 330.0, 45.0] * 5)


def wave(at: Floats) -> Floats:
    return np.asarray(200 + 5 * np.sin(at / 60))


def point(east_m: float, above_m: float = 0.0, north_m: float = 8.0, sigma_m: float = 0.05) -> ControlPoint:
    """Beside the street, so much above it."""
    lon, lat = PLANE.to_lonlat(np.array([east_m]), np.array([north_m]))
    height = float(wave(np.array([east_m]))[0]) + above_m
    return ControlPoint(float(lon[0]), float(lat[0]), height, sigma_m)


def solved(*points: ControlPoint, offset_m: float = 7.0) -> Adjustment:
    control, far = place(points, STREET)
    assert not far
    return adjust(STREET, {0: drive_along(STREET, wave, offset_m=offset_m)}, None, control)


def node_heights() -> Floats:
    return wave(np.concatenate([[0.0], np.cumsum(STREET.length_m)[:-1]]))


def moved_sigmas(before: Adjustment, after: Adjustment) -> float:
    return float(np.max(np.abs(after.slope_percent - before.slope_percent) / before.slope_sigma_percent))


@pytest.mark.parametrize("offset_m", [7.0, -60.0])
def test_one_point_brings_its_datum_and_leaves_the_slopes(offset_m: float) -> None:
    before, after = solved(offset_m=offset_m), solved(point(500.0), offset_m=offset_m)
    assert np.all(np.abs(before.height_from_m - node_heights() - offset_m) < 0.1)
    assert np.all(np.abs(after.height_from_m - node_heights()) < 0.1)
    assert moved_sigmas(before, after) < 0.01
    assert np.all(after.height_sigma_m < before.height_sigma_m / 20)
    assert after.height_sigma_m.argmin() == pytest.approx(3, abs=1), "surest beside the point"
    assert not after.remarks


def test_points_that_agree_sharpen_each_other() -> None:
    one, many = solved(point(500.0)), solved(*(point(e) for e in (100.0, 500.0, 1500.0, 2500.0)))
    assert np.all(many.height_sigma_m < one.height_sigma_m)
    assert not many.remarks


@pytest.mark.parametrize("apart_m", [0.5, 2.0, 5.0, 20.0])
def test_two_points_that_contradict_each_other_do_not_tear_the_road(apart_m: float) -> None:
    before, after = solved(), solved(point(500.0), point(540.0, apart_m, -8.0))
    assert moved_sigmas(before, after) < 0.5
    assert len(after.remarks) == (2 if apart_m >= 2 else 0)
    assert all(remark.startswith("Control point at 4") for remark in after.remarks)
    if apart_m >= 2:
        assert np.median(after.height_sigma_m) > apart_m / 4, "nobody knows which of the two is right"


def test_one_slip_among_several_points_is_left_aside_and_named() -> None:
    slip = ControlPoint(  # type: ignore[call-arg]
        *(getattr(point(540.0, 10.0), n) for n in ("lon_deg", "lat_deg", "height_m")), 0.05, "line 4"
    )
    after = solved(*(point(e) for e in (100.0, 500.0, 1500.0)), slip)
    assert np.all(np.abs(after.height_from_m - node_heights()) < 0.2)
    (remark,) = after.remarks
    assert re.fullmatch(r"Control point line 4 is (9\.9|10\.0)\d m above what the drives and the .*", remark)


def test_a_point_goes_to_the_nearest_road_within_reach() -> None:
    found, far = place([point(70.0), point(300.0, north_m=19.5), point(300.0, north_m=20.5)], STREET)
    assert found.row.tolist() == [1, 3]
    assert found.along_m == pytest.approx([10.0, 125.0], abs=0.01)
    assert len(far) == 1
    assert far[0].called == "at 49.000184, 8.504100"
    kept = np.zeros(len(STREET), bool)
    kept[3:] = True
    assert found.among(kept).row.tolist() == [0]
    assert found.among(kept).height_m == found.height_m[1:]
    nothing, all_far = place([point(70.0)], RoadTable.empty())
    assert (len(nothing), len(all_far)) == (0, 1)


def test_beyond_the_ends_of_a_road_the_end_counts() -> None:
    found, _ = place([point(-10.0, north_m=0.0)], STREET)
    assert (found.row.tolist(), found.along_m.tolist()) == ([0], [0.0])


def write(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_of_points(tmp_path: Path) -> None:
    text = "\ufeffname, lat_deg,lon_deg,height_m,sigma_m\nA,49.0,8.5,115.25,0.02\n\nB,49.1,8.6,-3,\n"
    assert read_control(write(tmp_path, text)) == [
        ControlPoint(8.5, 49.0, 115.25, 0.02, "line 2 of points.csv"),
        ControlPoint(8.6, 49.1, -3.0, DEFAULT_SIGMA_M, "line 4 of points.csv"),
    ]
    assert read_control(write(tmp_path, "lat_deg,lon_deg,height_m\n")) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "lacks lat_deg, lon_deg, height_m"),
        ("lat_deg;lon_deg;height_m\n49;8;1\n", "separated by commas"),
        ("lat,lon,height_m\n49,8,1\n", "lacks lat_deg, lon_deg"),
        (
            "lat_deg,lon_deg,height_m\n49,8,1\n49,8\n",
            "Line 3 of points.csv: height_m is '', which is no number",
        ),
        ("lat_deg,lon_deg,height_m\n49,8,high\n", "Line 2 of points.csv: height_m is 'high'"),
        ("lat_deg,lon_deg,height_m\n49,8,nan\n", "height_m is nan, outside of -1000 to 10000"),
        ("lat_deg,lon_deg,height_m\n8.5,490,1\n", "lon_deg is 490, outside of -180 to 180"),
        ("lat_deg,lon_deg,height_m,sigma_m\n49,8,1,0\n", "sigma_m is 0, outside of 0.001 to 100"),
    ],
)
def test_a_file_that_cannot_be_used_names_the_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ControlError, match=said) as error:
        read_control(write(tmp_path, text))
    assert str(error.value.where).startswith("line ")


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ControlError, match="is no text"):
        read_control(path)
