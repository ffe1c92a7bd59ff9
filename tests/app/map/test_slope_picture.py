"""The picture of the slopes: what is drawn how, and that unknown never looks flat."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.quiver import Quiver

from app.map.attribution import OSM_ATTRIBUTION
from app.map.segment import Segment
from app.map.slope_map import MapSegments, line_widths
from app.map.slope_picture import STEEPNESS, UNKNOWN_COLOUR, draw_slope_map, slope_figure, slope_map_png
from factor_support import street as road
from fusion.types import Floats

LAT, LON = 48.0, 8.0
UNKNOWN = float("nan")


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


def drawn(figure: Figure, label: str) -> LineCollection:
    (found,) = [c for c in figure.axes[0].collections if c.get_label() == label]
    assert isinstance(found, LineCollection)
    return found


def lightness(colours: Floats) -> Floats:
    """CIE L* of sRGB colours, shape (n, 3): what is left of them for eyes that see no colour."""
    linear = np.where(colours > 0.04045, ((colours + 0.055) / 1.055) ** 2.4, colours / 12.92)
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722])
    return np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)


def test_steeper_is_darker_without_any_colour() -> None:
    steps = lightness(np.asarray(STEEPNESS(np.linspace(0, 1, 21)))[:, :3])
    assert np.all(np.diff(steps) < -2)
    assert steps[0] < 90, "flat is to be seen on white"


def test_unknown_is_unlike_every_colour_of_the_scale() -> None:
    scale = np.asarray(STEEPNESS(np.linspace(0, 1, 101)))[:, :3]
    assert np.abs(scale - np.array(to_rgb(UNKNOWN_COLOUR))).max(axis=1).min() > 0.15


def test_unknown_segments_are_thin_and_dashed_and_known_ones_are_not() -> None:
    slope = np.array([0.0, UNKNOWN, 2.0, UNKNOWN, UNKNOWN])
    figure = slope_figure(street(slope, np.full(5, 9.0)))
    unknown, known = drawn(figure, "unknown"), drawn(figure, "known")
    assert (len(unknown.get_segments()), len(known.get_segments())) == (3, 2)
    assert unknown.get_linestyle()[0][1] is not None
    assert known.get_linestyle()[0][1] is None
    assert np.max(unknown.get_linewidth()) < np.min(known.get_linewidth())
    assert np.asarray(unknown.get_color())[0, :3] == pytest.approx(to_rgb(UNKNOWN_COLOUR))


def test_colours_are_those_of_the_steepness_and_widths_those_of_the_certainty() -> None:
    figure = slope_figure(street(np.array([-8.0, 0.0, 8.0]), np.array([0.2, 1.0, 5.0])))
    known = drawn(figure, "known")
    width, colour = np.asarray(known.get_linewidth()), np.asarray(known.get_color())
    order = np.argsort(width)
    assert width[order] == pytest.approx(line_widths(np.array([5.0, 1.0, 0.2])))
    assert colour[order][0] == pytest.approx(colour[order][2])
    assert colour[order][1] == pytest.approx(STEEPNESS(0.0))
    assert colour[order][0] != pytest.approx(STEEPNESS(0.0))


def test_arrows_point_uphill() -> None:
    slope = np.array([5.0, -6.0, 0.9, 4.0, UNKNOWN])
    figure = slope_figure(street(slope, np.array([0.5, 0.5, 0.1, 3.0, UNKNOWN])))
    (arrows,) = [c for c in figure.axes[0].collections if isinstance(c, Quiver)]
    lower = np.argsort(np.asarray(arrows.XY)[:, 1])  # the streets lie from south to north and lead east
    assert np.asarray(arrows.U)[lower] == pytest.approx([1, -1])
    assert np.asarray(arrows.V)[lower] == pytest.approx([0, 0], abs=1e-4)


def test_the_map_says_whose_data_it_shows_and_in_which_units() -> None:
    figure = slope_figure(street(np.array([4.0]), np.array([0.5])))
    axes, bar = figure.axes
    assert axes.xaxis.label.get_text() == OSM_ATTRIBUTION
    assert "%" in bar.yaxis.label.get_text()
    (legend,) = figure.legends
    assert "slope unknown" in [text.get_text() for text in legend.get_texts()]
    assert any(text.get_text().endswith(" m") for text in axes.texts)


@pytest.mark.parametrize(("east", "north"), [(1e-1, 1e-4), (1e-4, 1e-1), (0.0, 0.0)])
def test_maps_of_any_shape_have_a_sensible_size(east: float, north: float) -> None:
    one = street(np.array([4.0]), np.array([0.5]))
    stretched = replace(one, lon1_deg=one.lon0_deg + east, lat1_deg=one.lat0_deg + north)
    width, height = slope_figure(stretched).get_size_inches()
    assert 4 < width < 12
    assert 4 < height < 12


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


def test_any_name_may_stand_in_the_credit(tmp_path: Path) -> None:
    path, roads = tmp_path / "map.png", road(50.0, 60.0, 70.0)
    steep = Segment(
        id=None,
        osm_way_id=int(roads.osm_way_id[1]),
        from_node=int(roads.from_node[1]),
        to_node=int(roads.to_node[1]),
        length_m=60.0,
        highway="residential",
        name=None,
        oneway=0,
        bridge=False,
        tunnel=False,
        slope_percent=4.0,
        slope_sigma_percent=0.3,
        drives=1,
        observations=1,
        dem_slope_percent=None,
        updated_at=None,
        coordinates=(),
    )
    slope_map_png(path, roads, [steep], title="x", credit=r"a $\nonsense$ b")
    assert path.read_bytes().startswith(b"\x89PNG")
