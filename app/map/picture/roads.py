"""Roads drawn on a map: colour is steepness, width is certainty, arrows point uphill, dashed grey is unknown.

Importing this imports matplotlib: import it where a picture is drawn.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize

from app.map.picture.key import CASE_PT, INK
from app.map.picture.slope_map import MapSegments, arrow_choice, line_widths
from app.map.style.scale import UNKNOWN_COLOUR
from fusion.types import Floats

# Lightness falls steadily with steepness, so that colour-blind people and grey printers see the order; the flat end,
# without viridis' palest tenth, is well visible on white: flat is a measurement, and must not look like the grey of
# an unknown road.
STEEPNESS = LinearSegmentedColormap.from_list("steepness", colormaps["viridis_r"](np.linspace(0.1, 1.0, 256)))
UNKNOWN_WIDTH_PT, UNKNOWN_DASHES = 0.8, (0, (3, 2.5))
ARROW_COLOUR = "white"
ARROWS_ACROSS = 28  # at most, over the longer side of the map


def unknown_look(thinner: float) -> dict[str, Any]:
    """How the line of an unknown slope looks."""
    return {"color": UNKNOWN_COLOUR, "lw": UNKNOWN_WIDTH_PT * max(thinner, 0.6), "ls": UNKNOWN_DASHES}


def draw_unknown(axes: Axes, lines: Floats, thinner: float) -> None:
    """Draw roads of unknown slope, ends (n, 2, 2) in metres."""
    axes.add_collection(
        LineCollection(
            list(lines),
            **unknown_look(thinner),
            zorder=1,
            label="unknown",
        ),
        autolim=False,
    )


def draw_known(axes: Axes, lines: Floats, segments: MapSegments, scale: Normalize, thinner: float) -> None:
    """Draw the roads among ``segments`` that have a slope, bridges and tunnels cased, and arrows on the steepest."""
    known = np.flatnonzero(segments.known)
    # Narrow first, so that what is sure lies on top where roads cross.
    known = known[np.argsort(-np.nan_to_num(segments.slope_sigma_percent[known], nan=np.inf), kind="stable")]
    slope, sigma = segments.slope_percent[known], segments.slope_sigma_percent[known]
    widths = thinner * line_widths(sigma)
    for structure, style in ((segments.bridge[known], "solid"), (segments.tunnel[known], (0, (1.2, 0.8)))):
        axes.add_collection(
            LineCollection(
                list(lines[known][structure]),
                colors="black",
                linewidths=widths[structure] + CASE_PT * max(thinner, 0.5),
                linestyles=style,
                capstyle="butt",
                zorder=2,
            ),
            autolim=False,
        )
    colours = STEEPNESS(scale(np.abs(slope)))
    axes.add_collection(
        LineCollection(
            list(lines[known]), colors=colours, linewidths=widths, capstyle="round", zorder=3, label="known"
        ),
        autolim=False,
    )
    _draw_arrows(axes, lines[known], slope, sigma, thinner)


def _draw_arrows(axes: Axes, lines: Floats, slope: Floats, sigma: Floats, thinner: float) -> None:
    middle = lines.mean(axis=1)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    inside = (middle[:, 0] > left) & (middle[:, 0] < right) & (middle[:, 1] > bottom) & (middle[:, 1] < top)
    inside &= np.any(lines[:, 0] != lines[:, 1], axis=1)
    lines, slope, sigma, middle = lines[inside], slope[inside], sigma[inside], middle[inside]
    chosen = arrow_choice(middle, slope, sigma, max(right - left, top - bottom) / ARROWS_ACROSS)
    if not len(chosen):
        return
    along = lines[chosen, 1] - lines[chosen, 0]
    uphill = along / np.hypot(*along.T)[:, None] * np.sign(slope[chosen])[:, None]
    # The shafts must not lie over the road's own colour, so that only heads are drawn, of one size on paper.
    axes.quiver(
        *middle[chosen].T,
        *uphill.T,
        angles=np.degrees(np.arctan2(uphill[:, 1], uphill[:, 0])),
        pivot="middle",
        units="inches",
        scale_units="inches",
        scale=1 / (0.09 * max(thinner, 0.6)),
        width=0.0077 * max(thinner, 0.6),
        headwidth=12,
        headlength=12,
        headaxislength=9,
        facecolor=ARROW_COLOUR,
        edgecolor=INK,
        linewidth=0.8 * max(thinner, 0.6),
        zorder=4,
    )
