"""The picture of the slopes: what is drawn how, and that unknown never looks flat."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D
from matplotlib.quiver import Quiver

from app.map.picture.key import STEEPNESS
from app.map.picture.slope_map import MapError, MapSegments, line_widths
from app.map.picture.slope_picture import MAP_IN, slope_figure
from app.map.segment import OSM_ATTRIBUTION, attribution
from app.map.style.scale import UNKNOWN_COLOUR
from fusion.types import Floats
from map_support import LAT, LON, lines, street

UNKNOWN = float("nan")
AROUND = (LON - 1e-3, LAT - 1e-3, LON + 3e-3, LAT + 3e-3)


def picture(segments: MapSegments) -> Floats:
    """Red, green, blue of every pixel, 0..1."""
    out = BytesIO()
    slope_figure(segments, dpi=60).savefig(out, format="png")
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
    figure = slope_figure(street(slope, np.full(5, 9.0)), box_deg=AROUND)
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


def texts(figure: Figure) -> list[str]:
    """What is written beside the map, line by line."""
    return [text.get_text() for text in figure.texts]


def said(figure: Figure) -> str:
    return " ".join(texts(figure))


def test_the_map_says_whose_data_it_shows_and_in_which_units() -> None:
    figure = slope_figure(street(np.array([4.0, UNKNOWN]), np.array([0.5, UNKNOWN])), box_deg=AROUND)
    assert OSM_ATTRIBUTION in texts(figure)
    assert "Colour: steepness, %" in texts(figure)
    assert "slope unknown" in texts(figure)
    (bar,) = [line for line in figure.artists if line.get_label() == "scale"]
    assert isinstance(bar, Line2D)
    length_in = float(np.ptp(bar.get_xdata()))  # type: ignore[arg-type]
    metres = next(float(text.split(" m;")[0]) for text in texts(figure) if text.endswith("north is up"))
    left, right = figure.axes[0].get_xlim()
    across_in = figure.axes[0].get_position().width * figure.get_size_inches()[0]
    assert length_in / across_in == pytest.approx(metres / (right - left))


SHAPES = {
    "narrow, north to south": (1e-4, 1e-1),
    "narrow, east to west": (1e-1, 1e-4),
    "a town": (4e-2, 3e-2),
    "a few metres": (1e-5, 1e-5),
    "a point": (0.0, 0.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_whatever_the_shape_nothing_is_cut_and_nothing_overlaps(shape: str) -> None:
    east, north = SHAPES[shape]
    one = street(np.array([4.0, -2.0, 1.0, UNKNOWN, 3.0]), np.full(5, 0.5))
    along = np.linspace(0, 1, 6)
    lon, lat = LON + east * along, LAT + north * along
    stretched = replace(one, ends_deg=lines(lon[:-1], lat[:-1], lon[1:], lat[1:]))
    credit = attribution([f"a_raster_with_quite_a_long_name_{k}.tif" for k in range(9)])
    figure = slope_figure(
        stretched, title="Slopes from " + 12 * "a_long_name_", credit=credit, notes=["Note."]
    )
    figure.canvas.draw()
    width, height = figure.get_size_inches()
    assert 5 < width < 13
    assert 4 < height < 13
    assert width * height > 30
    paper = figure.bbox
    (map_box, bar_box) = (axes.get_window_extent() for axes in figure.axes)
    assert paper.x0 < map_box.x0 < map_box.x1 < bar_box.x0 < bar_box.x1 < paper.x1
    boxes = [text.get_window_extent() for text in figure.texts]
    for box in boxes:
        assert paper.x0 <= box.x0 < box.x1 <= paper.x1, "cut at a side"
        assert paper.y0 <= box.y0 < box.y1 <= paper.y1, "cut above or below"
        assert not box.overlaps(map_box)
    assert not [
        (a, b) for a in boxes for b in boxes if a is not b and a.shrunk(0.9, 0.6).overlaps(b.shrunk(0.9, 0.6))
    ]
    words = "".join(text.split("\n")[0] for text in texts(figure)).replace(" ", "")
    assert credit.replace(" ", "") in words, "the attribution is whole"
    sides = np.array([np.ptp(figure.axes[0].get_xlim()), np.ptp(figure.axes[0].get_ylim())])
    assert sides.min() / sides.max() > 0.35
    paper_sides = np.array([map_box.width, map_box.height]) / figure.dpi
    assert paper_sides / paper_sides.max() == pytest.approx(sides / sides.max()), "metres are alike both ways"
    assert paper_sides.max() == pytest.approx(MAP_IN)


def test_roads_end_at_the_frame_and_those_outside_are_not_in_the_file() -> None:
    measured = street(np.array([4.0, UNKNOWN, UNKNOWN]), np.array([0.5, UNKNOWN, UNKNOWN]))
    begins, ends = np.array([LON, LON - 1, LON + 0.5]), np.array([LON + 1e-3, LON + 1, LON + 0.6])
    far = replace(measured, ends_deg=lines(begins, LAT, ends, LAT))
    figure = slope_figure(far)
    left, right = figure.axes[0].get_xlim()
    assert 70 < right - left < 200, "some land around the measured road"
    unknown = drawn(figure, "unknown")
    assert len(unknown.get_segments()) == 1
    assert np.ptp(np.asarray(unknown.get_segments()[0])[:, 0]) > 1000
    assert unknown.get_clip_on()
    clip = unknown.get_clip_box()
    assert clip is not None
    assert clip.bounds == pytest.approx(figure.axes[0].bbox.bounds)


def test_a_box_is_what_is_shown() -> None:
    figure = slope_figure(street(np.array([4.0]), np.array([0.5])), box_deg=(7.99, 47.99, 8.01, 48.01))
    assert np.ptp(figure.axes[0].get_xlim()) == pytest.approx(1492, rel=0.01)
    assert np.ptp(figure.axes[0].get_ylim()) == pytest.approx(2224, rel=0.01)


def test_only_what_is_drawn_is_explained() -> None:
    slope, sigma = np.array([4.0, 3.0, 2.0]), np.full(3, 0.5)
    plain = replace(street(slope, sigma), bridge=np.zeros(3, bool), tunnel=np.zeros(3, bool))
    signs = {"bridge", "tunnel", "slope unknown", "uphill, steeper than 1 %"}
    assert signs & set(texts(slope_figure(plain))) == {"uphill, steeper than 1 %"}
    everything = slope_figure(street(np.array([4.0, 3.0, 2.0, UNKNOWN]), np.full(4, 0.5)))
    assert signs <= set(texts(everything))
    flat = replace(plain, slope_percent=np.zeros(3), bridge=np.array([True, False, False]))
    assert signs & set(texts(slope_figure(flat))) == {"bridge"}
    elsewhere = replace(plain, bridge=np.ones(3, bool), slope_percent=np.array([1.5, np.nan, np.nan]))
    assert "bridge" in texts(slope_figure(elsewhere))
    unknown_bridge = replace(
        plain, bridge=np.array([False, True, False]), slope_percent=np.array([4, np.nan, 1])
    )
    assert "bridge" not in texts(slope_figure(unknown_bridge)), "it is drawn dashed and grey, without a case"


def test_what_is_uncertain_is_explained() -> None:
    figure = slope_figure(street(np.array([4.0]), np.array([0.5])))
    assert "Width: how certain the slope is" in texts(figure)
    assert "Thin lines are guesses." in said(figure)
    by_label = {"± 0.3 % or better": 0.3, "± 1 %": 1.0, "± 3 % or worse": 3.0}
    assert set(by_label) <= set(texts(figure))
    samples = [a for a in figure.artists if isinstance(a, Line2D) and a.get_color() == "#777777"]
    assert [a.get_linewidth() for a in samples] == pytest.approx(
        line_widths(np.array(list(by_label.values())))
    )


def test_lines_are_thinner_where_streets_are_crowded_and_only_there() -> None:
    def sample_widths(count: int, rows: float) -> list[float]:
        lat = LAT + rows * np.arange(count)
        sure = replace(
            street(np.full(count, 2.0), np.full(count, 0.2)), ends_deg=lines(LON, lat, LON + 1.3e-3, lat)
        )
        figure = slope_figure(sure)
        keyed = [
            a.get_linewidth() for a in figure.artists if isinstance(a, Line2D) and a.get_color() == "#777777"
        ]
        assert keyed[0] == pytest.approx(np.asarray(drawn(figure, "known").get_linewidth())[0]), (
            "as the key says"
        )
        return keyed

    alone, crowd, far_apart = sample_widths(1, 1e-5), sample_widths(80, 1e-5), sample_widths(40, 1e-2)
    assert alone[0] == far_apart[0] == pytest.approx(5.0)
    assert crowd[0] < 3.0


def test_the_range_of_colours_can_be_fixed_and_is_said() -> None:
    steep = street(np.array([4.0, 16.0]), np.full(2, 0.5))
    fixed, chosen = slope_figure(steep, scale_percent=8), slope_figure(steep)
    assert "Darkest from 8 % on, as asked." in said(fixed)
    assert "Darkest from 16 % on, chosen by the slopes shown." in said(chosen)
    for figure, top in ((fixed, 8.0), (chosen, 16.0)):
        colours = np.asarray(drawn(figure, "known").get_color())
        assert colours == pytest.approx(STEEPNESS(np.array([4.0, 16.0]) / top))
        assert figure.axes[1].get_xlim()[1] == pytest.approx(top)


def test_names_of_measured_streets_are_written_and_nothing_the_font_lacks() -> None:
    n = 4
    streets = street(np.array([4.0, 1.0, UNKNOWN, 2.0]), np.full(n, 0.5))
    spaced = LAT + 4e-4 * np.arange(n)
    named = replace(
        streets,
        ends_deg=lines(LON, spaced, LON + 1.3e-3, spaced),
        name=np.array(["Weg $x$", None, "Unbekannt", "日本"], object),
    )
    figure = slope_figure(named)
    (label,) = [text for text in figure.axes[0].texts if text.get_label() == "street"]
    assert label.get_text() == "Weg $x$"
    assert not label.get_parse_math()
    assert label.get_rotation() == pytest.approx(0, abs=0.1)


def test_every_kind_of_segment_can_be_drawn_together() -> None:
    slope = np.array([0.0, -3.0, 12.0, np.nan, 5.0, 40.0])
    sigma = np.array([0.1, 0.5, 2.0, np.nan, np.nan, 9.0])
    image = picture(street(slope, sigma))
    assert np.ptp(image) == 1.0


def test_nothing_to_draw_is_an_error() -> None:
    with pytest.raises(MapError, match="no segment"):
        picture(street(np.empty(0), np.empty(0)))


def test_continents_are_no_map() -> None:
    wide = replace(street(np.array([4.0]), np.array([0.5])), ends_deg=lines(LON, LAT, [40.0], LAT))
    with pytest.raises(MapError, match=r"2\d+ km.*--bbox"):
        slope_figure(wide)


@pytest.mark.parametrize("unknown", [False, True])
def test_single_segment(unknown: bool) -> None:
    assert picture(street(np.array([UNKNOWN if unknown else 4.0]), np.array([0.5]))).size
