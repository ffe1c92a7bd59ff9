"""A drive's profile drawn: height above, grade and segment slopes below, measurements behind, over the distance.

Loads matplotlib: import it where a picture is wanted. What is drawn where is worked out in ``profile_marks``.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from app.core.messages import say
from app.drives.outputs.profile import Profile
from app.drives.outputs.profile_marks import (
    LEAST_HEIGHT_M,
    LEAST_SLOPE_PERCENT,
    NORMAL_95,
    Dots,
    Steps,
    apart,
    broken,
    dots_of,
    interruptions,
    limits,
    steps_of,
    stretches,
)
from fusion.messages import told
from fusion.types import DrawnMeasurements, Floats

HEIGHT, GRADE, SEGMENT, MUTED = "#17507a", "#b3471a", "#1c2328", "#5f6b73"
BAND_ALPHA = 0.24
SIZE_IN, DPI = (14.0, 8.0), 100
TITLE_Y, NOTES_Y, NOTE_STEP = 0.965, 0.066, 0.021
"""Where the title begins and the notes end, and from line to line of these, shares of the height."""
BARS = "Bars: slope of the whole segment, from this drive alone. Line: grade at each place."
DIFFER = "They differ where the grade changes inside a segment, and where only a part of it was driven"
DOTS_PER_OPACITY, EPOCHS_DRAWN_FULL, STEPS_DRAWN_FULL = 250, 2500, 150
"""Dots, epochs or segments that are drawn at full strength; more of them are paler or thinner."""
MOST_SLOPE_PERCENT = 50.0
"""Estimates beyond this do not widen the axis of slopes."""
LEAST_OUTAGE_S = 3.0
"""Shorter times without a position are not shaded, seconds."""
LEAST_SHARE = 0.0015
"""Share of the axis below which a stretch is widened to be seen, and a step has no room for its error bar."""

_LOOKS: dict[str, dict[str, Any]] = {
    "no GNSS": {"color": "#7a8288", "alpha": 0.14},
    "bridge": {"color": "#3c7fb8", "alpha": 0.22},
    "tunnel": {"color": "#3a3f44", "alpha": 0.20},
    "nothing recorded": {"facecolor": "none", "edgecolor": "#b9bfc4", "hatch": "////"},
}


def profile_png(
    profile: Profile,
    title: str,
    measurements: DrawnMeasurements | None = None,
    *,
    datum: str | None = None,
) -> bytes:
    """A PNG with height above and slope below, each with its 95 % band, over the distance driven.

    ``measurements``: what the sensors said, drawn as pale dots behind. ``datum``: a sentence on what heights refer to.
    """
    return written(profile_figure(profile, printable(title), measurements, datum=datum), "png")


def written(figure: Figure, kind: str) -> bytes:
    """A figure as png, pdf or svg."""
    buffer = BytesIO()
    figure.savefig(buffer, format=kind, metadata={"Software" if kind == "png" else "Creator": "Versant"})
    return buffer.getvalue()


def profile_figure(
    profile: Profile,
    title: str,
    measurements: DrawnMeasurements | None = None,
    *,
    datum: str | None = None,
) -> Figure:
    """The figure: two axes over the distance driven, of which nothing is drawn across an interruption."""
    figure = Figure(
        figsize=SIZE_IN, dpi=DPI, layout=ConstrainedLayoutEngine(rect=(0, NOTES_Y, 1, TITLE_Y - NOTES_Y))
    )
    FigureCanvasAgg(figure)
    height, slope = figure.subplots(2, 1, sharex=True, height_ratios=(1, 1))
    dots = () if measurements is None else tuple(dots_of(profile, measurements))
    heights, grades = [d for d in dots if d.is_height], [d for d in dots if not d.is_height]
    _draw_heights(height, profile, heights)
    _draw_slopes(slope, profile, grades)
    _dress(height, profile, heights, keyed=True)
    _dress(slope, profile, grades, keyed=False)
    height.set_ylabel("Height of the road (m)")
    slope.set_ylabel("Grade in the direction of travel (%)")
    slope.set_xlabel("Distance driven (km)")
    figure.text(0.008, TITLE_Y, title, ha="left", fontsize=13, color=SEGMENT)
    figure.text(0.995, TITLE_Y, _summary(profile), ha="right", fontsize=10, color=MUTED)
    for k, line in enumerate(_notes(profile, datum)):
        y = NOTES_Y - NOTE_STEP * (k + 0.9)
        figure.text(0.008, y, printable(told(line), 180), fontsize=9, color=MUTED)
    return in_words(figure)


def in_words(figure: Figure) -> Figure:
    """The figure with its fixed texts in the language that is spoken here."""
    for text in figure.findobj(Text):
        if (words := told(text.get_text())) != text.get_text():
            text.set_text(words)
    return figure


def printable(text: str, most: int = 90) -> str:
    """A file's name, which is anyone's text, as a title: no mathtext, no control characters, no missing glyph."""
    shown = "".join(c if c.isprintable() and ord(c) < 0x250 else "?" for c in text)
    return shown[:most].replace("$", r"\$")


def _notes(profile: Profile, datum: str | None) -> list[str]:
    """What heights refer to, and why slopes of segments are not the line's, and where."""
    steps = steps_of(profile)
    off, count = int(apart(profile, steps).sum()), len(steps.slope_percent)
    marked = say("picture.circles", n=off, all=count) if off else ""
    return [
        *([datum] if datum else []),
        *([BARS, say("picture.differ", differ=DIFFER, marked=marked)] if count else []),
    ]


def _draw_heights(axes: Axes, profile: Profile, dots: Sequence[Dots]) -> None:
    _scatter(axes, dots)
    _curve(axes, profile, profile.alt_m, profile.alt_sigma_m, HEIGHT, "height")
    _limit(axes, limits(profile.alt_m, profile.alt_sigma_m, LEAST_HEIGHT_M, _values(dots)), dots)


def _draw_slopes(axes: Axes, profile: Profile, dots: Sequence[Dots]) -> None:
    steps = steps_of(profile)
    _scatter(axes, dots)
    axes.axhline(0, color=MUTED, linewidth=0.8, zorder=1.5)
    drawn = len(steps.slope_percent) > 0
    _curve(axes, profile, profile.grade_percent, profile.grade_sigma_percent, GRADE, "grade", quiet=drawn)
    if drawn:
        _staircase(axes, steps, _length_km(profile))
        off = apart(profile, steps)
        km = (steps.from_m + steps.to_m)[off] / 2000
        axes.scatter(
            km, steps.slope_percent[off], s=50, facecolors="none", edgecolors=SEGMENT, linewidths=1.0, zorder=6
        )  # fmt: skip
    # 0 belongs to the picture, or a long climb would look level.
    value = np.r_[0.0, profile.grade_percent, steps.slope_percent].clip(
        -MOST_SLOPE_PERCENT, MOST_SLOPE_PERCENT
    )
    sigma = np.r_[0.0, profile.grade_sigma_percent, steps.sigma_percent]
    _limit(axes, limits(value, sigma, LEAST_SLOPE_PERCENT, _values(dots)), dots)


def _scatter(axes: Axes, dots: Sequence[Dots]) -> None:
    for one in dots:
        opacity = float(np.clip(np.sqrt(DOTS_PER_OPACITY / len(one.value)), 0.15, 0.65))
        axes.plot(
            one.distance_m / 1000, one.value, ls="none", marker="o", ms=3.0, mew=0, color=one.colour, alpha=opacity,
            zorder=1, label="_",
        )  # fmt: skip


def _curve(
    axes: Axes, profile: Profile, value: Floats, sigma: Floats, colour: str, name: str, *, quiet: bool = False
) -> None:
    """A line and its band; where nothing is known, that is said, unless ``quiet``."""
    if not np.isfinite(value).any():
        if not quiet:
            axes.text(0.5, 0.5, "not estimated", transform=axes.transAxes, ha="center", color=MUTED)
        return
    km, value, sigma = (broken(column, profile) for column in (profile.distance_m / 1000, value, sigma))
    half = NORMAL_95 * sigma
    axes.plot(km, value, color=colour, lw=_thinner(1.5, len(value), EPOCHS_DRAWN_FULL), zorder=3, label=name)
    axes.fill_between(
        km,
        value - half,
        value + half,
        color=colour,
        alpha=BAND_ALPHA,
        lw=0,
        zorder=2,
        label=f"{name}, 95 % band",
    )


def _thinner(width: float, count: int, full: int) -> float:
    """The line width for ``count`` points on an axis: less where they crowd, no less than half."""
    return width * float(np.clip(np.sqrt(full / max(count, 1)), 0.5, 1.0))


def _staircase(axes: Axes, steps: Steps, length_km: float) -> None:
    """A tread for each segment, and an error bar where it has room."""
    start, stop, slope = steps.from_m / 1000, steps.to_m / 1000, steps.slope_percent
    treads = np.stack([np.column_stack([start, slope]), np.column_stack([stop, slope])], axis=1)
    width = _thinner(1.8, len(slope), STEPS_DRAWN_FULL)
    name = "slope of a segment, 95 % bar"
    axes.add_collection(
        LineCollection(list(treads), colors=SEGMENT, lw=width, zorder=5, label=name), autolim=False
    )
    roomy = (stop - start > LEAST_SHARE * length_km) & np.isfinite(steps.sigma_percent)
    middle, half = 0.5 * (start + stop), NORMAL_95 * steps.sigma_percent
    bars = np.stack(
        [np.column_stack([middle, slope - half]), np.column_stack([middle, slope + half])], axis=1
    )
    axes.add_collection(
        LineCollection(list(bars[roomy]), colors=SEGMENT, lw=0.8, alpha=0.7, zorder=4), autolim=False
    )


def _values(dots: Sequence[Dots]) -> Floats:
    return np.concatenate([np.empty(0), *(d.value for d in dots)])


def _limit(axes: Axes, ends: tuple[float, float] | None, dots: Sequence[Dots]) -> None:
    if ends is None:
        return
    axes.set_ylim(*ends)
    value = _values(dots)
    outside = int(np.sum((value < ends[0]) | (value > ends[1])))
    if outside:
        text = say("picture.outside", n=outside, all=len(value))
        axes.text(
            0.995, 0.02, told(text), transform=axes.transAxes, ha="right", fontsize=8.5, color=MUTED, zorder=6,
            bbox={"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.5},
        )  # fmt: skip


def _dress(axes: Axes, profile: Profile, dots: Sequence[Dots], *, keyed: bool) -> None:
    """Ends, shades and legend; ``keyed``: the stretches shaded have their key in this legend."""
    length = max(_length_km(profile), 0.01)
    axes.set_xlim(-0.003 * length, 1.003 * length)
    _shade(axes, profile)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    handles, names = axes.get_legend_handles_labels()
    if not keyed:
        handles = [h for h, name in zip(handles, names, strict=True) if name not in _LOOKS]
    # In the axes' legend a pale dot would not be seen: it stands there larger and opaque.
    keys = [Line2D([], [], ls="none", marker="o", ms=5, mew=0, color=d.colour, label=d.label) for d in dots]
    if handles or keys:
        axes.legend(
            handles=[*handles, *keys], loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2, ncols=10,
            fontsize=9, frameon=False, handlelength=1.6, columnspacing=1.3,
        )  # fmt: skip


def _shade(axes: Axes, profile: Profile) -> None:
    """Mark stretches over the whole height, widened where they would be too narrow to be seen."""
    least = LEAST_SHARE * _length_km(profile)
    for name, spans_m in _stretches(profile).items():
        start, width = spans_m[:, 0] / 1000, np.diff(spans_m, axis=1)[:, 0] / 1000
        if not len(start):
            continue
        extra = np.maximum(least - width, 0.0)
        bars = list(zip(start - extra / 2, width + extra, strict=True))
        axes.broken_barh(
            bars, (0, 1), transform=axes.get_xaxis_transform(), zorder=0.5, lw=0, label=name, **_LOOKS[name]
        )


def _stretches(profile: Profile) -> dict[str, Floats]:
    return {
        "no GNSS": stretches(profile, ~profile.has_gnss, LEAST_OUTAGE_S),
        "bridge": stretches(profile, profile.bridge),
        "tunnel": stretches(profile, profile.tunnel),
        "nothing recorded": interruptions(profile),
    }


def _length_km(profile: Profile) -> float:
    return float(profile.distance_m[-1]) / 1000 if len(profile) else 0.0


def _summary(profile: Profile) -> str:
    if not len(profile):
        return told("no positions")
    seconds = round(float(profile.time_s[-1] - profile.time_s[0]))
    time = f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    return told(say("picture.length", km=_length_km(profile), time=time))
