"""The profile's picture: what is drawn where, and what is never drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from app.drives.outputs.profile import Profile, RoadFacts, build_profile, table_facts
from app.drives.outputs.profile_marks import (
    LEAST_HEIGHT_M,
    MOST_DOTS,
    NORMAL_95,
    dots_of,
    steps_of,
    stretches,
)
from app.drives.outputs.profile_picture import MOST_SLOPE_PERCENT, profile_figure, profile_png
from fusion.roads.table import RoadTable
from fusion.types import DrawnMeasurements, Floats, Track

UNKNOWN = float("nan")
NAMES = ("altitude", "doppler")


def hill(n: int = 40, *, gap_at: int | None = 20) -> Track:
    """North at 11 m/s over segments of ten epochs, up and down; 100 s and a kilometre pass before ``gap_at``."""
    t, lat = np.arange(n, dtype=float), 49 + 1e-4 * np.arange(n)
    starts = np.zeros(n, bool)
    if gap_at is not None:
        t[gap_at:] += 100
        lat[gap_at:] += 9e-3
        starts[gap_at] = True
    flat = np.zeros(n)
    return Track(
        time_s=t,
        lat_deg=lat,
        lon_deg=np.full(n, 8.4),
        alt_m=200 + 15 * np.sin(np.arange(n) / 6),
        h_sigma_m=flat + 2,
        alt_sigma_m=np.linspace(1, 3, n),
        speed_mps=flat + 11,
        heading_rad=flat,
        pitch_rad=0.08 * np.cos(np.arange(n) / 6),
        pitch_sigma_rad=flat + 0.005,
        segment=(np.arange(n) // 10).astype(np.int64),
        distance_m=11.0 * (np.arange(n) % 10),
        has_gnss=np.ones(n, bool),
        after_outage=starts,
    )


SLOPES = {0: (6.0, 0.5), 1: (-4.0, 0.4), 2: (0.0, 0.3), 3: (3.0, UNKNOWN)}


def profile(track: Track | None = None) -> Profile:
    track = hill() if track is None else track
    return build_profile(track, track.segment, SLOPES)


def measured(time_s: Floats, value: Floats, sensor: int = 0) -> DrawnMeasurements:
    n = len(time_s)
    kind = np.full(n, sensor, np.int64)
    return DrawnMeasurements(NAMES, kind, time_s, np.full(n, UNKNOWN), value, np.full(n, sensor == 0))


def band(axes: Axes) -> PolyCollection:
    (found,) = [c for c in axes.collections if str(c.get_label()).endswith("band")]
    assert isinstance(found, PolyCollection)
    return found


def dots(axes: Axes) -> list[Floats]:
    return [np.asarray(line.get_xydata()) for line in axes.lines if line.get_linestyle() == "None"]


def drawn_spans_km(axes: Axes) -> Iterator[tuple[float, float]]:
    """From where to where each straight piece of ink goes, but for dots, shades and the zero line."""
    for line in axes.lines:
        if line.get_linestyle() != "None" and len(line.get_xdata()) > 2:
            x, y = np.asarray(line.get_xydata(), float).T
            for k in np.flatnonzero(np.isfinite(x[1:] + x[:-1] + y[1:] + y[:-1])):
                yield x[k], x[k + 1]
    paths = [path for c in axes.collections if isinstance(c, LineCollection) for path in c.get_paths()]
    for path in [*paths, *band(axes).get_paths()]:
        x = path.vertices[:, 0]  # type: ignore[call-overload]
        yield float(x.min()), float(x.max())


def pair(figure: Figure) -> tuple[Axes, Axes]:
    height, slope = figure.axes
    return height, slope


def test_the_bands_are_95_percent_of_their_sigmas() -> None:
    p = profile(hill(gap_at=None))
    columns = ((p.alt_m, p.alt_sigma_m), (p.grade_percent, p.grade_sigma_percent))
    for axes, (value, sigma) in zip(pair(profile_figure(p, "a")), columns, strict=True):
        corners = {
            (round(x, 9), round(y, 9))
            for path in band(axes).get_paths()
            for x, y in np.asarray(path.vertices)
        }
        for k, km in enumerate(p.distance_m / 1000):
            for end in (value[k] - NORMAL_95 * sigma[k], value[k] + NORMAL_95 * sigma[k]):
                assert (round(km, 9), round(end, 9)) in corners


def test_the_grade_is_that_of_the_road_in_percent() -> None:
    track = hill()
    grade = 100 * np.tan(track.pitch_rad)
    assert profile(track).grade_percent == pytest.approx(grade)
    steeper = 100 * np.tan(track.pitch_rad + 1e-6 * track.pitch_sigma_rad)
    assert profile(track).grade_sigma_percent == pytest.approx((steeper - grade) / 1e-6, rel=1e-4)


@pytest.mark.parametrize("marked", [True, False])
def test_nothing_is_drawn_across_an_interruption(marked: bool) -> None:
    track = hill()
    p = profile(track if marked else replace(track, after_outage=np.zeros(len(track), bool)))
    before, after = p.distance_m[19] / 1000, p.distance_m[20] / 1000
    assert after - before > 0.9
    for axes in pair(profile_figure(p, "a")):
        spans = list(drawn_spans_km(axes))
        assert len(spans) > 30
        assert not [span for span in spans if span[0] < after - 1e-9 and span[1] > before + 1e-9]


def test_a_start_without_a_pause_is_an_interruption_too() -> None:
    track = hill(gap_at=None)
    starts = np.arange(len(track)) == 25
    p = profile(replace(track, after_outage=starts))
    inside = 0.5 * (p.distance_m[24] + p.distance_m[25]) / 1000
    for axes in pair(profile_figure(p, "a")):
        assert not [span for span in drawn_spans_km(axes) if span[0] < inside < span[1]]


def test_each_segment_is_a_step_with_its_slope() -> None:
    p = profile(hill(gap_at=None))
    steps = steps_of(p)
    assert steps.slope_percent.tolist() == [6.0, -4.0, 0.0, 3.0]
    assert steps.from_m[0] == 0
    assert steps.to_m[:-1].tolist() == steps.from_m[1:].tolist()
    _, slope = pair(profile_figure(p, "a"))
    treads, bars = (c for c in slope.collections if isinstance(c, LineCollection))
    ends = np.array([path.vertices for path in treads.get_paths()])
    assert ends[:, :, 1].tolist() == [[s, s] for s in steps.slope_percent]
    assert ends[:, :, 0] == pytest.approx(np.column_stack([steps.from_m, steps.to_m]) / 1000)
    reach = np.array([path.vertices for path in bars.get_paths()])[:, :, 1]
    assert reach == pytest.approx(
        np.array([[s - 1.96 * e, s + 1.96 * e] for s, e in list(SLOPES.values())[:3]])
    )


def test_a_segment_of_unknown_slope_has_no_step() -> None:
    track = hill()
    p = build_profile(track, track.segment, {1: (2.0, 0.1)})
    assert steps_of(p).slope_percent.tolist() == [2.0]


@pytest.mark.parametrize(("heading", "forward"), [(0.3, 1), (3.0, -1), (np.pi / 2, 0), (UNKNOWN, 0)])
def test_one_epoch_on_a_segment_goes_as_the_vehicle_heads(heading: float, forward: int) -> None:
    track = hill(gap_at=None)
    segment = track.segment.copy()
    segment[15] = 9
    track = replace(track, segment=segment, heading_rad=np.full(len(track), heading))
    facts = {9: RoadFacts((8.4, 49.0), (8.4, 49.1), bridge=False, tunnel=False)}
    p = build_profile(track, segment, {9: (5.0, 1.0)}, facts)
    assert p.forward[15] == forward
    assert p.forward[14] == 1, "a run of epochs tells by itself"
    assert p.slope_percent[15] == 5 * forward or (not forward and np.isnan(p.slope_percent[15]))


def test_bridges_and_outages_are_shaded_where_they_are(small_table: RoadTable) -> None:
    track = hill(gap_at=None)
    has_gnss = ~((np.arange(40) >= 32) & (np.arange(40) < 38))
    has_gnss[3] = False  # too short to be shown
    facts = table_facts(small_table, track.segment)
    p = build_profile(replace(track, has_gnss=has_gnss), track.segment, SLOPES, facts)
    middle = 0.5 * (p.distance_m[1:] + p.distance_m[:-1])
    assert stretches(p, p.bridge).tolist() == [[middle[9], middle[19]]]
    assert not len(stretches(p, p.tunnel))
    assert stretches(p, ~p.has_gnss, 3.0).tolist() == [[middle[31], middle[37]]]
    for axes in pair(profile_figure(p, "a")):
        (bridge,) = [c for c in axes.collections if c.get_label() == "bridge"]
        (path,) = bridge.get_paths()
        ends = path.vertices[:, 0]  # type: ignore[call-overload]
        assert (ends.min(), ends.max()) == (pytest.approx(middle[9] / 1000), pytest.approx(middle[19] / 1000))
        assert [c.get_label() for c in axes.collections].count("no GNSS") == 1
        assert "tunnel" not in [c.get_label() for c in axes.collections]


@pytest.fixture
def small_table() -> RoadTable:
    """Four segments northwards, of which the second is a bridge."""
    n = 4
    lat = 49 + 1e-3 * np.arange(n)
    bridge = np.arange(n) == 1
    no = np.zeros(n, bool)
    return RoadTable(
        osm_way_id=np.arange(n),
        from_node=np.arange(n),
        to_node=np.arange(n) + 1,
        lon0_deg=np.full(n, 8.4),
        lat0_deg=lat,
        lon1_deg=np.full(n, 8.4),
        lat1_deg=lat + 1e-3,
        highway=np.array(["residential"] * n, object),
        name=np.array([None] * n, object),
        oneway=np.zeros(n, np.int64),
        bridge=bridge,
        tunnel=no,
        layer=np.zeros(n, np.int64),
    )


def test_heights_of_another_datum_are_moved_and_said_to_be() -> None:
    p = profile()
    near, far = (
        next(dots_of(p, measured(p.time_s, p.alt_m + off + np.tile([-1, 1], 20)))) for off in (4.0, 47.6)
    )
    assert near.value == pytest.approx(p.alt_m + 4 + np.tile([-1, 1], 20))
    assert "moved" not in near.label
    assert far.value == pytest.approx(p.alt_m + np.tile([-1, 1], 20), abs=1.001)
    assert far.label == "GNSS altitude, moved by -48 m"
    height, _ = pair(profile_figure(p, "a", measured(p.time_s, p.alt_m + 47.6)))
    legend = height.get_legend()
    assert legend is not None
    assert "GNSS altitude, moved by -48 m" in [text.get_text() for text in legend.get_texts()]


def test_grades_are_drawn_in_percent_and_below() -> None:
    p = profile()
    height, slope = pair(profile_figure(p, "a", measured(p.time_s, np.full(40, 0.03), sensor=1)))
    assert not dots(height)
    (drawn,) = dots(slope)
    assert drawn == pytest.approx(np.column_stack([p.distance_m / 1000, np.full(40, 3.0)]))


def test_without_measurements_there_are_no_dots() -> None:
    assert not [d for axes in pair(profile_figure(profile(), "a")) for d in dots(axes)]


def test_a_wild_measurement_does_not_move_the_axes() -> None:
    p = profile()
    plain = pair(profile_figure(p, "a"))[0].get_ylim()
    value = p.alt_m.copy()
    value[[3, 7]] = [-40_000.0, 90_000.0]
    axes = pair(profile_figure(p, "a", measured(p.time_s, value)))[0]
    assert np.diff(axes.get_ylim()) < 1.4 * np.diff(plain)
    assert "2 of 40 dots lie outside" in [text.get_text() for text in axes.texts]


def test_a_wide_band_somewhere_does_not_flatten_the_road() -> None:
    p = profile(hill(400, gap_at=None))
    sigma = p.alt_sigma_m.copy()
    sigma[5] = 1e5
    axes = pair(profile_figure(replace(p, alt_sigma_m=sigma), "a"))[0]
    assert np.diff(axes.get_ylim()) < 4 * np.ptp(p.alt_m)


def test_a_flat_road_looks_flat() -> None:
    p = profile()
    level = replace(p, alt_m=200 + 0.01 * np.arange(40), alt_sigma_m=np.full(40, 0.1))
    low, high = pair(profile_figure(level, "a"))[0].get_ylim()
    assert high - low >= LEAST_HEIGHT_M
    assert low < 200 < high


def test_zero_is_always_on_the_grade_axis() -> None:
    track = replace(hill(), pitch_rad=np.full(40, 0.1))
    low, high = pair(profile_figure(build_profile(track, track.segment, {0: (10.0, 0.2)}), "a"))[1].get_ylim()
    assert low < 0
    assert 10 < high <= 2 * MOST_SLOPE_PERCENT


def test_only_segment_slopes_can_be_drawn() -> None:
    nothing = np.full(40, UNKNOWN)
    track = replace(hill(), pitch_rad=nothing, pitch_sigma_rad=nothing, alt_m=nothing)
    height, slope = pair(profile_figure(profile(track), "a"))
    assert [text.get_text() for text in height.texts] == ["not estimated"]
    assert not slope.texts
    low, high = slope.get_ylim()
    assert low < -4 < 6 < high


def test_a_drive_of_hours_is_thinned() -> None:
    n = 12_000
    p = profile(hill(n, gap_at=None))
    many = measured(np.linspace(0, n - 1, 50_000), np.full(50_000, 0.02), sensor=1)
    _, slope = pair(profile_figure(p, "a", many))
    (drawn,) = dots(slope)
    assert MOST_DOTS / 2 < len(drawn) <= MOST_DOTS
    assert drawn[-1, 0] > 0.99 * p.distance_m[-1] / 1000, "thinned over the whole drive"
    short = pair(profile_figure(profile(), "a"))[1]
    width, usual = (
        next(x.get_linewidth() for x in a.lines if x.get_label() == "grade") for a in (slope, short)
    )
    assert width < usual


def test_the_png_is_a_picture_of_its_size() -> None:
    p = profile()
    with Image.open(BytesIO(profile_png(p, "monday.ubx", measured(p.time_s, p.alt_m)))) as image:
        assert image.size == (1400, 800)
        pixels = np.asarray(image.convert("RGB"), int)
    coloured = np.ptp(pixels, axis=-1) > 40
    upper, lower = coloured[:400], coloured[400:]
    assert upper.sum() > 1500
    assert lower.sum() > 1500
    assert coloured.mean() < 0.5


@pytest.mark.parametrize("n", [0, 1, 2])
def test_the_shortest_drives_can_be_drawn(n: int) -> None:
    p = profile(hill(n, gap_at=None))
    assert profile_png(p, "short", measured(p.time_s, p.alt_m)).startswith(b"\x89PNG")
