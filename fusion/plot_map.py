"""A picture of the slopes of a road network: colour is steepness, arrows point uphill, width is certainty."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from fusion.frames import LocalProjection
from fusion.types import Floats

# Lightness falls steadily with steepness, and the flat end is still well visible on white: flat is a
# measurement, and must not look like the grey of an unknown road.
STEEPNESS = LinearSegmentedColormap.from_list(
    "steepness", ["#58b7c8", "#8fbf5f", "#e8b52b", "#e2622b", "#a3123f", "#4a0634"]
)
UNKNOWN_COLOUR = "#b9b9b9"
SURE_SIGMA_PERCENT, UNSURE_SIGMA_PERCENT = 0.3, 3.0
SURE_WIDTH_PT, UNSURE_WIDTH_PT = 5.0, 1.2
SCALE_FLOOR_PERCENT = 4.0  # a colour scale of a flat town must not dramatise tenths of a percent
DOUBT = 1.96  # an arrow needs a slope whose sign is beyond 95 % doubt


@dataclass(frozen=True)
class MapSegments:
    """What the map draws, n segments: ends in degrees, slope and sigma in percent (NaN where unknown)."""

    lon0_deg: Floats
    lat0_deg: Floats
    lon1_deg: Floats
    lat1_deg: Floats
    slope_percent: Floats
    slope_sigma_percent: Floats
    bridge: NDArray[np.bool_]
    tunnel: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which segments have a slope."""
        return np.isfinite(self.slope_percent)


def line_widths(sigma_percent: Floats) -> Floats:
    """Width in points per sigma in percent: wide where sure; logarithmic, clipped; NaN is unsure."""
    sigma = np.where(np.isfinite(sigma_percent), sigma_percent, UNSURE_SIGMA_PERCENT)
    sigma = np.clip(sigma, SURE_SIGMA_PERCENT, UNSURE_SIGMA_PERCENT)
    doubt = np.log(sigma / SURE_SIGMA_PERCENT) / np.log(UNSURE_SIGMA_PERCENT / SURE_SIGMA_PERCENT)
    return np.asarray(SURE_WIDTH_PT + doubt * (UNSURE_WIDTH_PT - SURE_WIDTH_PT), float)


def arrow_choice(
    middle_m: Floats, slope_percent: Floats, sigma_percent: Floats, spacing_m: float
) -> NDArray[np.int64]:
    """Indices of segments that get an uphill arrow: sign beyond doubt, steepest first, ``spacing_m`` apart.

    ``middle_m`` has shape (n, 2).
    """
    doubt = DOUBT * np.where(np.isfinite(sigma_percent), sigma_percent, np.inf)
    sure = np.abs(slope_percent) > np.maximum(doubt, 0.5)
    chosen: list[int] = []
    for i in np.argsort(-np.abs(np.where(sure, slope_percent, 0.0)), kind="stable"):
        if not sure[i]:
            break
        apart = np.hypot(*(middle_m[chosen] - middle_m[i]).T)
        if not chosen or apart.min() >= spacing_m:
            chosen.append(int(i))
    return np.array(chosen, np.int64)


def draw_slope_map(
    out: Path | BinaryIO,
    segments: MapSegments,
    *,
    title: str = "Road slopes",
    credit: str = "",
    dpi: int = 130,
) -> None:
    """Write a PNG of the segments to ``out``; an unknown slope is a thin dashed grey line, never a colour.

    ``credit`` is the attribution printed below the map. Raises ``ValueError`` when there is no segment.
    """
    if not len(segments.lon0_deg):
        raise ValueError("There is no segment to draw.")
    lines = _lines_m(segments)
    figure = Figure(figsize=(10.5, 9.0), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    scale = _colour_scale(segments)
    _draw_unknown(axes, lines[~segments.known])
    _draw_known(axes, lines, segments, scale)
    _dress(axes, lines, title, credit)
    bar = figure.colorbar(ScalarMappable(scale, STEEPNESS), ax=axes, shrink=0.6, pad=0.02, extend="max")
    bar.set_label("steepness, % (arrows point uphill)")
    figure.savefig(out, format="png")


def _lines_m(segments: MapSegments) -> Floats:
    """Ends of every segment in local metres, shape (n, 2, 2)."""
    lon = np.column_stack([segments.lon0_deg, segments.lon1_deg])
    lat = np.column_stack([segments.lat0_deg, segments.lat1_deg])
    x, y = LocalProjection.around(lon, lat).to_xy(lon, lat)
    return np.stack([x, y], axis=-1)


def _colour_scale(segments: MapSegments) -> Normalize:
    steep = np.abs(segments.slope_percent[segments.known])
    top = float(np.quantile(steep, 0.97)) if len(steep) else 0.0
    return Normalize(0.0, max(SCALE_FLOOR_PERCENT, float(np.ceil(top))))


def _draw_unknown(axes: Axes, lines: Floats) -> None:
    axes.add_collection(
        LineCollection(list(lines), colors=UNKNOWN_COLOUR, linewidths=0.9, linestyles=(0, (3, 2)), zorder=1)
    )


def _draw_known(axes: Axes, lines: Floats, segments: MapSegments, scale: Normalize) -> None:
    known = np.flatnonzero(segments.known)
    # Narrow first, so that what is sure lies on top where roads cross.
    known = known[np.argsort(-np.nan_to_num(segments.slope_sigma_percent[known], nan=np.inf), kind="stable")]
    slope, sigma = segments.slope_percent[known], segments.slope_sigma_percent[known]
    widths = line_widths(sigma)
    for structure, style in ((segments.bridge[known], "solid"), (segments.tunnel[known], (0, (1.2, 0.8)))):
        axes.add_collection(
            LineCollection(
                list(lines[known][structure]),
                colors="black",
                linewidths=widths[structure] + 2.6,
                linestyles=style,
                capstyle="butt",
                zorder=2,
            )
        )
    colours = STEEPNESS(scale(np.abs(slope)))
    axes.add_collection(
        LineCollection(list(lines[known]), colors=colours, linewidths=widths, capstyle="round", zorder=3)
    )
    _draw_arrows(axes, lines[known], slope, sigma, _extent_m(lines) / 28)


def _draw_arrows(axes: Axes, lines: Floats, slope: Floats, sigma: Floats, spacing_m: float) -> None:
    middle = lines.mean(axis=1)
    chosen = arrow_choice(middle, slope, sigma, spacing_m)
    if not len(chosen):
        return
    along = lines[chosen, 1] - lines[chosen, 0]
    uphill = along / np.maximum(np.hypot(*along.T), 1e-9)[:, None] * np.sign(slope[chosen])[:, None]
    # The shafts must not lie over the road's own colour, so that only heads are drawn, of one size on paper.
    axes.quiver(
        *middle[chosen].T,
        *uphill.T,
        angles="xy",
        pivot="middle",
        units="dots",
        scale_units="dots",
        scale=1 / 11,
        width=1.0,
        headwidth=11,
        headlength=11,
        headaxislength=8,
        color="black",
        edgecolor="white",
        linewidth=0.5,
        zorder=4,
    )


def _extent_m(lines: Floats) -> float:
    corners = lines.reshape(-1, 2)
    return float(np.max(np.ptp(corners, axis=0)))


def _dress(axes: Axes, lines: Floats, title: str, credit: str) -> None:
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.03)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(title, loc="left", fontsize=12)
    axes.set_xlabel(credit, fontsize=8, loc="left")
    for side in axes.spines.values():
        side.set_color("#dddddd")
    _scale_bar(axes, lines)
    keys: list[Line2D] = [
        Line2D([], [], color="#777777", lw=float(line_widths(np.array([s]))[0]), label=f"sigma {s:g} %")
        for s in (SURE_SIGMA_PERCENT, 1.0, UNSURE_SIGMA_PERCENT)
    ]
    keys.append(Line2D([], [], color=UNKNOWN_COLOUR, lw=0.9, ls=(0, (3, 2)), label="unknown"))
    keys.append(Line2D([], [], color="black", lw=6, label="bridge (cased)"))
    keys.append(Line2D([], [], color="black", lw=6, ls=(0, (0.5, 0.35)), label="tunnel (dashed case)"))
    axes.figure.legend(  # beside the map: any corner inside it may hold roads
        handles=keys, loc="outside lower right", fontsize=8, frameon=False, handlelength=3, ncols=len(keys)
    )


def _scale_bar(axes: Axes, lines: Floats) -> None:
    extent = _extent_m(lines)
    length = 10 ** np.floor(np.log10(max(extent, 1.0) / 4))
    length *= max(m for m in (1, 2, 5) if m * length <= extent / 4 or m == 1)
    x, y = lines.reshape(-1, 2).min(axis=0) - [0.0, 0.03 * extent]
    label = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    axes.plot([x, x + length], [y, y], color="black", lw=2, solid_capstyle="butt", zorder=5)
    axes.annotate(
        label, (x + length / 2, y), (0, 4), textcoords="offset points", ha="center", fontsize=8, zorder=5
    )
