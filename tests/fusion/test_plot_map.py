"""The slope map: what is drawn how, and that unknown never looks flat."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.image import imread

from fusion.plot_map import (
    STEEPNESS,
    SURE_WIDTH_PT,
    UNSURE_WIDTH_PT,
    MapSegments,
    arrow_choice,
    draw_slope_map,
    line_widths,
)
from fusion.types import Floats

LAT, LON = 48.0, 8.0


def street(slope: Floats, sigma: Floats) -> MapSegments:
    """Parallel streets of about 100 m, one per slope, going east."""
    n = len(slope)
    lat: Floats = np.linspace(LAT, LAT + 2e-4 * n, n)
    return MapSegments(
        lon0_deg=np.full(n, LON),
        lat0_deg=lat,
        lon1_deg=np.full(n, LON + 1.3e-3),
        lat1_deg=lat,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        bridge=np.arange(n) % 5 == 1,
        tunnel=np.arange(n) % 5 == 2,
    )


def picture(segments: MapSegments) -> Floats:
    """Red, green, blue of every pixel, 0..1."""
    out = BytesIO()
    draw_slope_map(out, segments, dpi=60)
    out.seek(0)
    return np.asarray(imread(out)[..., :3], float)


def count(image: Floats, colour: tuple[float, float, float, float]) -> int:
    return int(np.sum(np.all(np.abs(image - np.array(colour[:3], float)) < 0.02, axis=-1)))


def greys(image: Floats) -> int:
    """Pixels that are neither coloured nor white nor black."""
    light = image.mean(axis=-1)
    return int(np.sum((np.ptp(image, axis=-1) < 0.02) & (light > 0.5) & (light < 0.97)))


def test_unknown_is_grey_and_flat_is_a_colour() -> None:
    n = 4
    unknown = picture(street(np.full(n, np.nan), np.full(n, np.nan)))
    flat = picture(street(np.zeros(n), np.full(n, 0.3)))
    flat_colour = STEEPNESS(0.0)
    # Key and colour bar are the same in both pictures: what counts is the difference.
    assert count(flat, flat_colour) > count(unknown, flat_colour) + 200
    assert greys(unknown) > greys(flat) + 100


def test_every_kind_of_segment_can_be_drawn_together() -> None:
    slope = np.array([0.0, -3.0, 12.0, np.nan, 5.0, 40.0])
    sigma = np.array([0.1, 0.5, 2.0, np.nan, np.nan, 9.0])
    image = picture(street(slope, sigma))
    assert np.ptp(image) == 1.0


def test_nothing_to_draw_is_an_error() -> None:
    with pytest.raises(ValueError, match="no segment"):
        picture(street(np.empty(0), np.empty(0)))


def test_single_segment() -> None:
    assert picture(street(np.array([4.0]), np.array([0.5]))).size


@given(st.lists(st.floats(0.001, 100) | st.just(float("nan")), min_size=2, max_size=20))
def test_surer_is_never_narrower(sigmas: list[float]) -> None:
    sigma = np.array(sigmas)
    width = line_widths(sigma)
    assert np.all((width >= UNSURE_WIDTH_PT - 1e-9) & (width <= SURE_WIDTH_PT + 1e-9))
    order = np.argsort(np.where(np.isnan(sigma), np.inf, sigma))
    assert np.all(np.diff(width[order]) <= 1e-9)


@given(
    st.lists(
        st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000), st.floats(-20, 20), st.floats(0.01, 10)),
        min_size=1,
        max_size=30,
    )
)
def test_arrows_stand_where_the_sign_is_certain_and_apart(rows: list[tuple[float, ...]]) -> None:
    x, y, slope, sigma = np.array(rows).T
    middle = np.column_stack([x, y])
    chosen = arrow_choice(middle, slope, sigma, 100.0)
    certain = np.abs(slope) > np.maximum(1.96 * sigma, 0.5)
    assert np.all(certain[chosen])
    assert bool(len(chosen)) == bool(certain.any())
    for k, i in enumerate(chosen):
        assert all(np.hypot(*(middle[i] - middle[j])) >= 100 for j in chosen[:k])


def test_an_unknown_sigma_gets_no_arrow() -> None:
    assert not len(arrow_choice(np.zeros((1, 2)), np.array([9.0]), np.array([np.nan]), 10.0))
