"""The elevation profile as a picture."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from app.outputs.profile import Profile
from fusion.types import Floats

NORMAL_95 = 1.96
HEIGHT, SLOPE, MUTED = "#1f5f8b", "#b3541e", "#5f6b73"
MOST_PERCENT = 40.0


def profile_png(profile: Profile, title: str, *, dpi: int = 110) -> bytes:
    """A PNG with height above and slope below, each with its 95 % band, over the distance driven."""
    figure = Figure(figsize=(11, 5.6), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    height, slope = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    _band(height, profile, profile.alt_m, profile.alt_sigma_m, HEIGHT)
    _band(slope, profile, profile.slope_percent, profile.slope_sigma_percent, SLOPE)
    slope.axhline(0, color=MUTED, linewidth=0.8)
    _keep_readable(slope, profile.slope_percent)
    height.set_ylabel("Height of the road (m)")
    slope.set_ylabel("Slope, direction\nof travel (%)")
    slope.set_xlabel("Distance driven (km)")
    height.set_title(_printable(title), loc="left", fontsize=11, color="#22282c")
    height.set_title("line: estimate   band: 95 %", loc="right", fontsize=9, color=MUTED)
    for axes in (height, slope):
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(x=0.01)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": "Versant"})
    return buffer.getvalue()


def _band(axes: Axes, profile: Profile, value: Floats, sigma: Floats, colour: str) -> None:
    km, value, sigma = (_broken(column, profile) for column in (profile.distance_m / 1000, value, sigma))
    if not np.isfinite(value).any():
        axes.text(0.5, 0.5, "not estimated", transform=axes.transAxes, ha="center", color=MUTED)
        return
    low, high = value - NORMAL_95 * sigma, value + NORMAL_95 * sigma
    axes.fill_between(km, low, high, color=colour, alpha=0.18, linewidth=0)
    axes.plot(km, value, color=colour, linewidth=1.4)


def _broken(column: Floats, profile: Profile) -> Floats:
    """The column with a NaN before each interruption, so that nothing is drawn across it."""
    gaps = np.flatnonzero(profile.gap[1:]) + 1
    return np.insert(column.astype(float), gaps, np.nan)


def _keep_readable(axes: Axes, slope: Floats) -> None:
    # One estimate with a huge sigma would flatten everything else.
    known = slope[np.isfinite(slope)]
    if len(known):
        reach = min(max(1.5 * float(np.quantile(np.abs(known), 0.99)), 2.0), MOST_PERCENT)
        axes.set_ylim(-reach, reach)


def _printable(text: str) -> str:
    # A file's name is anyone's text: no mathtext, no control characters, no missing glyph.
    kept = "".join(c if c.isprintable() and ord(c) < 0x250 else "?" for c in text)
    return kept.replace("$", r"\$")[:90]
