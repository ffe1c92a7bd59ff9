"""What the profile's picture says below: the datum of its heights, and where segments' bars are not on the line."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from app.drives.outputs.profile import Profile
from app.drives.outputs.profile_picture import BARS, profile_figure
from fusion.types import Floats

UNKNOWN = float("nan")
DATUM = "Heights: sea level of the standard atmosphere (by pressure alone: the day's weather is in it)."


@pytest.fixture
def profile() -> Profile:
    """Four segments of ten epochs on a line of 2 %, the third's slope being another."""
    n = 40
    zero, no, segment = np.zeros(n), np.zeros(n, bool), np.arange(n) // 10
    return Profile(
        time_s=np.arange(n, dtype=float),
        lon_deg=zero,
        lat_deg=zero,
        distance_m=11.0 * np.arange(n),
        alt_m=200 + 0.22 * np.arange(n),
        alt_sigma_m=zero + 1,
        slope_percent=np.array([2.0, 2.1, 4.0, 1.9])[segment],
        slope_sigma_percent=zero + 0.3,
        grade_percent=zero + 2.0,
        grade_sigma_percent=zero + 0.5,
        segment_id=segment,
        forward=np.ones(n, np.int64),
        gap=np.arange(n) == 0,
        has_gnss=~no,
        bridge=no,
        tunnel=no,
        dem_height_m=zero,
        road_name=np.full(n, None),
    )


def notes(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts][2:]


def circles(figure: Figure) -> Floats:
    (found,) = [c for c in figure.axes[1].collections if isinstance(c, PathCollection)]
    return np.asarray(found.get_offsets())


def test_the_datum_and_what_bars_are_stand_below_and_are_not_cut(profile: Profile) -> None:
    figure = profile_figure(profile, "a", datum=DATUM)
    assert notes(figure)[:2] == [DATUM, BARS]
    figure.canvas.draw()
    axis = min(axes.get_tightbbox().y0 for axes in figure.axes)  # type: ignore[union-attr]
    below = [text.get_window_extent() for text in figure.texts][2:]
    assert len(below) == 3
    for box in below:
        assert 0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert 0 <= box.y0 < box.y1 <= axis
    assert not any(one.overlaps(other) for k, one in enumerate(below) for other in below[:k])


def test_bars_off_the_line_are_circled_and_counted(profile: Profile) -> None:
    figure = profile_figure(profile, "a")
    assert re.findall(r"circles: (\d) of (\d) bars", notes(figure)[-1]) == [("1", "4")]
    (place,) = circles(figure)
    assert place == pytest.approx([11 * 24.5 / 1000, 4.0])


def test_where_nothing_differs_nothing_is_circled(profile: Profile) -> None:
    figure = profile_figure(replace(profile, slope_percent=np.full(40, 2.0)), "a")
    assert not len(circles(figure))
    assert "circles" not in notes(figure)[-1]


def test_without_bars_nothing_is_said_of_them(profile: Profile) -> None:
    assert notes(profile_figure(replace(profile, slope_percent=np.full(40, UNKNOWN)), "a")) == []
