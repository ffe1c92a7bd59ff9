"""Roads drawn on a map, and the column beside it that explains them: colours, widths, signs.

Colour is steepness, width is certainty, arrows point uphill, dashed grey is unknown. Only what is drawn is explained.
Importing this imports matplotlib: import it where a picture is drawn. Lengths of the column are inches of paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D, Transform

from app.core.messages import say
from app.map.picture import slope_map
from app.map.picture.lettering import wrapped
from app.map.style.scale import UNKNOWN_COLOUR
from fusion.messages import told
from fusion.types import Floats

INK, MUTED = "#20262b", "#5f6b73"
TEXT_PT, SMALL_PT = 9.0, 8.0
WIDTH_IN = 2.3
CASE_PT = 2.6
"""By so much the case of a bridge or tunnel is wider than its road."""
_SAMPLE_IN, _TEXT_AT_IN = 0.45, 0.58
_ROW_IN, _SMALL_ROW_IN, _APART_IN = 0.215, 0.165, 0.14
_BAR_IN, _BAR_WITH_TICKS_IN = 0.17, 0.44


@dataclass(frozen=True)
class Row:
    """One line of the key: its text, and the lines of a sample before it, the lowest first."""

    text: str
    samples: tuple[dict[str, Any], ...] = ()
    bold: bool = False
    small: bool = False

    @property
    def height_in(self) -> float:
        return _SMALL_ROW_IN if self.small else _ROW_IN


def rows_of(segments: slope_map.MapSegments, thinner: float) -> list[list[Row]]:
    """What stands below the bar of colours, in groups."""
    widths = [
        Row(text, ({"color": "#777777", "lw": thinner * float(slope_map.line_widths(np.array([sigma]))[0])},))
        for sigma, text in (
            (slope_map.SURE_SIGMA_PERCENT, say("picture.sure", percent=slope_map.SURE_SIGMA_PERCENT)),
            (1.0, "± 1 %"),
            (slope_map.UNSURE_SIGMA_PERCENT, say("picture.unsure", percent=slope_map.UNSURE_SIGMA_PERCENT)),
        )
    ]
    certainty = [
        Row("Width: how certain the slope is", bold=True),
        *widths,
        *_small("One standard deviation: 95 of 100 slopes are within twice of it. Thin lines are guesses."),
    ]
    return [certainty, _sign_rows(segments, thinner)]


def _sign_rows(segments: slope_map.MapSegments, thinner: float) -> list[Row]:
    known, sigma = segments.known, segments.slope_sigma_percent
    width = thinner * float(slope_map.line_widths(np.array([slope_map.SURE_SIGMA_PERCENT]))[0])
    inside = {"color": STEEPNESS(0.5), "lw": width}
    case = {"color": "black", "lw": width + CASE_PT * max(thinner, 0.5)}
    arrow = {
        "ls": "none", "marker": ">", "ms": 7, "mfc": ARROW_COLOUR, "mec": INK, "mew": 0.8, "single": True,
    }  # fmt: skip
    return [
        row
        for where, row in (
            (
                slope_map.certain_signs(segments.slope_percent, sigma),
                Row(say("picture.uphill", percent=slope_map.ARROW_PERCENT), (arrow,)),
            ),
            (segments.bridge & known, Row("bridge", (case, inside))),
            (segments.tunnel & known, Row("tunnel", ({**case, "ls": (0, (1.2, 0.8))}, inside))),
            (~known, Row("slope unknown", (unknown_look(thinner),))),
        )
        if where.any()
    ]


def _small(text: str) -> list[Row]:
    return [Row(line, small=True) for line in wrapped(told(text), SMALL_PT, 72 * WIDTH_IN)]


def colour_rows(scale: Normalize, given: bool) -> list[Row]:
    """What is said of the range of colours."""
    top = f"{scale.vmax:g} %"
    how = "as asked" if given else "chosen by the slopes shown"
    return _small(say("picture.darkest", top=top, how=how))


def height_in(colours: Sequence[Row], groups: Sequence[Sequence[Row]]) -> float:
    """How high the whole column is."""
    below = sum(_APART_IN + sum(row.height_in for row in group) for group in groups if group)
    return _ROW_IN + _BAR_WITH_TICKS_IN + sum(row.height_in for row in colours) + below


def draw_key(
    figure: Figure,
    left_in: float,
    top_in: float,
    scale: Normalize,
    colours: Sequence[Row],
    groups: Sequence[Sequence[Row]],
) -> None:
    """Draw the column with its upper left corner there, measured from the upper left of the figure."""
    from_top = from_upper_left(figure)
    y = _draw_rows(figure, from_top, left_in, top_in, [Row("Colour: steepness, %", bold=True)])
    width, height = figure.get_size_inches()
    bar = figure.add_axes(
        (left_in / width, 1 - (y + 0.03 + _BAR_IN) / height, (WIDTH_IN - 0.1) / width, _BAR_IN / height)
    )
    drawn = figure.colorbar(ScalarMappable(scale, STEEPNESS), cax=bar, orientation="horizontal", extend="max")
    if drawn.solids is not None:  # in a file of lines it would be the only picture of pixels
        drawn.solids.set_rasterized(False)
        drawn.solids.set_edgecolor("face")
    bar.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    bar.tick_params(labelsize=SMALL_PT, length=2.5)
    y = _draw_rows(figure, from_top, left_in, y + _BAR_WITH_TICKS_IN, colours)
    for group in groups:
        if group:
            y = _draw_rows(figure, from_top, left_in, y + _APART_IN, group)


def from_upper_left(figure: Figure) -> Transform:
    """Inches to the right and downwards from a figure's upper left corner."""
    return Affine2D().scale(1, -1).translate(0, figure.get_size_inches()[1]) + figure.dpi_scale_trans


def _draw_rows(figure: Figure, place: Transform, left_in: float, y_in: float, rows: Sequence[Row]) -> float:
    for row in rows:
        middle = y_in + row.height_in / 2
        for sample in row.samples:
            look = dict(sample)
            ends = [0.5] if look.pop("single", False) else [0.0, 1.0]
            x = [left_in + share * _SAMPLE_IN for share in ends]
            figure.add_artist(
                Line2D(
                    x, [middle] * len(x), transform=place, solid_capstyle="butt", dash_capstyle="butt", **look
                )
            )
        figure.text(
            left_in + (_TEXT_AT_IN if row.samples else 0.0), middle, told(row.text), transform=place,
            va="center_baseline",
            fontsize=SMALL_PT if row.small else TEXT_PT, fontweight="bold" if row.bold else "normal",
            color=MUTED if row.small else INK, parse_math=False,
        )  # fmt: skip
        y_in += row.height_in
    return y_in


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
        LineCollection(list(lines), **unknown_look(thinner), zorder=1, label="unknown"), autolim=False
    )


def draw_known(
    axes: Axes, lines: Floats, segments: slope_map.MapSegments, scale: Normalize, thinner: float
) -> None:
    """Draw the roads among ``segments`` that have a slope, bridges and tunnels cased, and arrows on the steepest."""
    known = np.flatnonzero(segments.known)
    # Narrow first, so that what is sure lies on top where roads cross.
    known = known[np.argsort(-np.nan_to_num(segments.slope_sigma_percent[known], nan=np.inf), kind="stable")]
    slope, sigma = segments.slope_percent[known], segments.slope_sigma_percent[known]
    widths = thinner * slope_map.line_widths(sigma)
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
    chosen = slope_map.arrow_choice(middle, slope, sigma, max(right - left, top - bottom) / ARROWS_ACROSS)
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
