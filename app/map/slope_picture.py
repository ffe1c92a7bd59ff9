"""A picture of the slopes of a road network: colour is steepness, arrows point uphill, width is certainty.

Importing this imports matplotlib: import it where a picture is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from app.map.attribution import OSM_ATTRIBUTION
from app.map.segment import Segment
from app.map.slope_map import (
    ARROW_PERCENT,
    SURE_SIGMA_PERCENT,
    UNSURE_SIGMA_PERCENT,
    MapSegments,
    arrow_choice,
    line_widths,
    map_segments,
)
from fusion.frames import LocalProjection
from fusion.roads.table import RoadTable
from fusion.types import Floats

# Lightness falls steadily with steepness, so that colour-blind people and grey printers see the order; the flat end,
# without viridis' palest tenth, is well visible on white: flat is a measurement, and must not look like the grey of
# an unknown road.
STEEPNESS = LinearSegmentedColormap.from_list("steepness", colormaps["viridis_r"](np.linspace(0.1, 1.0, 256)))
UNKNOWN_COLOUR = "#a9a9a9"
UNKNOWN_WIDTH_PT, UNKNOWN_DASHES = 0.8, (0, (3, 2.5))
SCALE_FLOOR_PERCENT = 4.0  # a colour scale of a flat town must not dramatise tenths of a percent
ARROW_COLOUR, INK = "white", "#20262b"
ARROWS_ACROSS = 28  # at most, over the longer side of the map
MAP_IN, LEAST_IN, BESIDE_IN, BELOW_IN = 9.0, 6.5, 1.1, 1.4
"""Inches: longer side of the map, least width, room for the colour bar, room for title and key."""


def slope_map_png(
    path: Path, roads: RoadTable, segments: Iterable[Segment], *, title: str, credit: str
) -> None:
    """Draw all ``roads``; those of which no segment has a slope are unknown. Raises ``ValueError`` without any road."""
    draw_slope_map(path, map_segments(roads, segments), title=title, credit=credit.replace("$", r"\$"))


def draw_slope_map(
    out: Path | BinaryIO,
    segments: MapSegments,
    *,
    title: str = "Road slopes",
    credit: str = OSM_ATTRIBUTION,
    dpi: int = 130,
) -> None:
    """Write a PNG of the segments to ``out``; see ``slope_figure``."""
    slope_figure(segments, title=title, credit=credit, dpi=dpi).savefig(out, format="png")


def slope_figure(
    segments: MapSegments, *, title: str = "Road slopes", credit: str = OSM_ATTRIBUTION, dpi: int = 130
) -> Figure:
    """The map; an unknown slope is a thin dashed grey line, never a colour.

    ``credit`` is the attribution printed below the map. Raises ``ValueError`` when there is no segment.
    """
    if not len(segments.lon0_deg):
        raise ValueError("There is no segment to draw.")
    lines = _lines_m(segments)
    figure = Figure(figsize=_size_in(lines), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    scale = _colour_scale(segments)
    _draw_unknown(axes, lines[~segments.known])
    _draw_known(axes, lines, segments, scale)
    _dress(axes, lines, title, credit)
    bar = figure.colorbar(
        ScalarMappable(scale, STEEPNESS), ax=axes, shrink=0.6, pad=0.02, aspect=28, extend="max"
    )
    bar.set_label("Steepness, % (arrows point uphill)")
    return figure


def _size_in(lines: Floats) -> tuple[float, float]:
    """Width and height of a figure in which the map, of the roads' own shape, leaves no empty margins."""
    width, height = np.maximum(np.ptp(lines.reshape(-1, 2), axis=0), 0.4 * max(_extent_m(lines), 1.0))
    scale = MAP_IN / max(width, height)
    return max(width * scale, LEAST_IN) + BESIDE_IN, height * scale + BELOW_IN


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
        LineCollection(
            list(lines),
            colors=UNKNOWN_COLOUR,
            linewidths=UNKNOWN_WIDTH_PT,
            linestyles=UNKNOWN_DASHES,
            zorder=1,
            label="unknown",
        )
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
        LineCollection(
            list(lines[known]), colors=colours, linewidths=widths, capstyle="round", zorder=3, label="known"
        )
    )
    _draw_arrows(axes, lines[known], slope, sigma, _extent_m(lines) / ARROWS_ACROSS)


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
        scale=1 / 12,
        width=1.0,
        headwidth=12,
        headlength=12,
        headaxislength=9,
        facecolor=ARROW_COLOUR,
        edgecolor=INK,
        linewidth=0.8,
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
    axes.figure.legend(  # below the map: any corner inside it may hold roads
        handles=_keys(),
        loc="outside lower left",
        fontsize=8,
        frameon=False,
        handlelength=3,
        ncols=3,
        title="Width: how certain the slope is (1 sigma)",
        title_fontsize=8,
        alignment="left",
    )


def _keys() -> list[Line2D]:
    """What the legend explains, column by column."""
    widths = [
        Line2D([], [], color="#777777", lw=float(line_widths(np.array([s]))[0]), label=label)
        for s, label in (
            (SURE_SIGMA_PERCENT, f"{SURE_SIGMA_PERCENT:g} % or less"),
            (1.0, "1 %"),
            (UNSURE_SIGMA_PERCENT, f"{UNSURE_SIGMA_PERCENT:g} % or more"),
        )
    ]
    unknown = Line2D(
        [], [], color=UNKNOWN_COLOUR, lw=UNKNOWN_WIDTH_PT, ls=UNKNOWN_DASHES, label="slope unknown"
    )
    uphill = Line2D(
        [],
        [],
        ls="none",
        marker=">",
        ms=7,
        mfc=ARROW_COLOUR,
        mec=INK,
        label=f"uphill, above {ARROW_PERCENT:g} %",
    )
    bridge = Line2D([], [], color="black", lw=6, label="bridge (cased)")
    tunnel = Line2D([], [], color="black", lw=6, ls=(0, (0.5, 0.35)), label="tunnel (dashed case)")
    return [*widths, unknown, uphill, bridge, tunnel]


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
