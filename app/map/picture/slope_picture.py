"""A picture of the slopes of a road network: colour is steepness, arrows point uphill, width is certainty.

The paper is laid out in inches, so that every line of text has its room whatever shape the roads have: the title
above, the map, the column that explains it to its right, scale and attribution below. Importing this imports
matplotlib: import it where a picture is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from app.core.messages import say
from app.core.text import whole_file
from app.map.picture import key, slope_map
from app.map.picture.lettering import is_writable, place_names, points_along, width_pt, wrapped
from app.map.picture.slope_map import MapError, MapSegments
from app.map.segment import OSM_ATTRIBUTION
from fusion.frames import LocalProjection
from fusion.messages import told
from fusion.types import Floats

if TYPE_CHECKING:
    from app.core.db import Bounds

SCALE_FLOOR_PERCENT = 4.0  # a colour scale of a flat town must not dramatise tenths of a percent
MAP_IN, EDGE_IN, BETWEEN_IN = 9.0, 0.3, 0.3
"""Inches: longer side of the map, what stays empty at the figure's edge and between map and key."""
TITLE_PT, NAME_PT = 13.0, 7.5
TITLE_ROW_IN, FOOT_ROW_IN, SCALE_ROW_IN = 0.26, 0.165, 0.3
DENSE_SHARE, CELL_IN, LEAST_THICKNESS = 0.25, 0.3, 0.3
"""Where the surest lines would cover more than that share of the cells of paper that they run through, all lines are
thinner, else streets merge; never thinner than the last share of their width."""


def write_map(
    path: Path,
    segments: MapSegments,
    *,
    title: str,
    credit: str,
    scale_percent: float | None = None,
    box_deg: Bounds | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the map to ``path``, complete or not at all, as its suffix says; see ``slope_figure``.

    What it is and whose data it shows is among its metadata.
    Raises ``UnknownNameError`` for an unknown suffix, ``MapError`` where there is nothing to draw, and ``OSError``.
    """
    kind = slope_map.picture_format(path)
    figure = slope_figure(
        segments, title=title, credit=credit, scale_percent=scale_percent, box_deg=box_deg, notes=notes
    )
    metadata = {
        "png": {"Software": "Versant", "Title": title, "Copyright": credit},
        "pdf": {"Creator": "Versant", "Title": title, "Subject": credit},
        "svg": {"Creator": "Versant", "Title": title, "Rights": credit},
    }[kind]
    with whole_file(path) as partial, mpl.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "versant"}):
        figure.savefig(partial, format=kind, metadata=metadata)


def slope_figure(
    segments: MapSegments,
    *,
    title: str = "Road slopes",
    credit: str = OSM_ATTRIBUTION,
    scale_percent: float | None = None,
    box_deg: Bounds | None = None,
    notes: Sequence[str] = (),
    dpi: int = 130,
) -> Figure:
    """The map; an unknown slope is a thin dashed grey line, never a colour.

    ``credit`` is the attribution printed below the map, ``notes`` what else is to be said there. ``scale_percent``
    is the steepness from which on the colour is the darkest, by default one that suits the slopes shown. ``box_deg``
    is what is shown; by default the measured roads with some land around them, or all roads where none is measured.
    Roads end at the frame. Raises ``MapError`` when there is no segment, or none in a map's reach.
    """
    if not len(segments):
        raise MapError(say("picture.no_segment"))
    view = _view(segments, box_deg)
    lines = view.lines
    figure = Figure(dpi=dpi)
    FigureCanvasAgg(figure)
    scale, thinner = _colour_scale(view.segments, scale_percent), _thinner(view)
    page = _page(view, title, credit, notes)
    colours, groups = key.colour_rows(scale, scale_percent is not None), key.rows_of(view.segments, thinner)
    top = EDGE_IN + TITLE_ROW_IN * len(page.title) + 0.08
    foot = top + max(page.map_in[1] + SCALE_ROW_IN, key.height_in(colours, groups))
    figure.set_size_inches(page.width_in, foot + FOOT_ROW_IN * len(page.foot) + 0.6 * EDGE_IN)
    axes = _map_axes(figure, view, page.map_in, top)
    key.draw_unknown(axes, lines[~view.segments.known], thinner)
    key.draw_known(axes, lines, view.segments, scale, thinner)
    _draw_names(axes, view)
    _draw_scale(figure, view, page.map_in[0], top + page.map_in[1])
    _write(figure, page.title, EDGE_IN, TITLE_ROW_IN, TITLE_PT, key.INK)
    _write(figure, page.foot, foot, FOOT_ROW_IN, key.SMALL_PT, key.MUTED)
    key.draw_key(figure, EDGE_IN + page.map_in[0] + BETWEEN_IN, top, scale, colours, groups)
    return figure


class _View(NamedTuple):
    """What lies in the frame: segments, their ends in metres (n, 2, 2), and the frame, (left, bottom, right, top)."""

    segments: MapSegments
    lines: Floats
    frame_m: tuple[float, float, float, float]

    @property
    def metres_per_inch(self) -> float:
        left, bottom, right, top = self.frame_m
        return max(right - left, top - bottom) / MAP_IN


class _Page(NamedTuple):
    """Lines of text that fit the paper, and the sizes of the map and of the paper."""

    title: list[str]
    foot: list[str]
    map_in: tuple[float, float]
    width_in: float


def _view(segments: MapSegments, box_deg: Bounds | None) -> _View:
    shown = segments.known | ~segments.known.any()
    box = box_deg or slope_map.frame_around(slope_map.box_of(segments.ends_deg[shown].reshape(-1, 2)))
    west, south, east, north = box
    plane = LocalProjection.around(np.array([west, east]), np.array([south, north]))
    middle = (west + east) / 2, (south + north) / 2
    (left, right), _ = plane.to_xy(np.array([west, east]), np.full(2, middle[1]))
    _, (bottom, top) = plane.to_xy(np.full(2, middle[0]), np.array([south, north]))
    near = segments.within(box)
    x, y = plane.to_xy(near.ends_deg[..., 0], near.ends_deg[..., 1])
    return _View(near, np.stack([x, y], axis=-1), (float(left), float(bottom), float(right), float(top)))


def _page(view: _View, title: str, credit: str, notes: Sequence[str]) -> _Page:
    left, bottom, right, top = view.frame_m
    map_in = (right - left) / view.metres_per_inch, (top - bottom) / view.metres_per_inch
    inner = map_in[0] + BETWEEN_IN + key.WIDTH_IN
    foot = [line for text in (credit, *notes) for line in wrapped(text, key.SMALL_PT, 72 * inner)]
    return _Page(wrapped(title, TITLE_PT, 72 * inner), foot, map_in, inner + 2 * EDGE_IN)


def _thinner(view: _View) -> float:
    """By how much lines must be thinner than on a map with room, 1 or less."""
    lines = view.lines[view.segments.known] / view.metres_per_inch
    points, _ = points_along(lines, CELL_IN / 4)
    cells = len(np.unique(np.floor(points / CELL_IN), axis=0))
    covered = float(np.hypot(*(lines[:, 1] - lines[:, 0]).T).sum()) * slope_map.SURE_WIDTH_PT / 72
    share = covered / max(cells * CELL_IN**2, 1e-9)
    return float(np.clip(DENSE_SHARE / max(share, 1e-9), LEAST_THICKNESS, 1.0))


def _colour_scale(segments: MapSegments, scale_percent: float | None) -> Normalize:
    if scale_percent is not None:
        return Normalize(0.0, scale_percent)
    steep = np.abs(segments.slope_percent[segments.known])
    top = float(np.quantile(steep, 0.97)) if len(steep) else 0.0
    return Normalize(0.0, max(SCALE_FLOOR_PERCENT, float(np.ceil(top))))


def _map_axes(figure: Figure, view: _View, map_in: tuple[float, float], top_in: float) -> Axes:
    width, height = figure.get_size_inches()
    axes = figure.add_axes(
        (EDGE_IN / width, 1 - (top_in + map_in[1]) / height, map_in[0] / width, map_in[1] / height)
    )
    left, bottom, right, top = view.frame_m
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_color("#c9ced2")
    return axes


def _draw_names(axes: Axes, view: _View) -> None:
    """A few names of streets; those that the font cannot write are left out rather than spoilt."""
    metres_per_pt = view.metres_per_inch / 72
    writable = np.array([bool(name) and is_writable(str(name)) for name in view.segments.name], np.bool_)
    placed = place_names(
        view.lines,
        view.segments.name,
        view.segments.known & writable,
        frame_m=view.frame_m,
        height_m=1.15 * NAME_PT * metres_per_pt,
        length_m=lambda text: (width_pt(text, NAME_PT) + 4.0) * metres_per_pt,
    )
    for name in placed:
        axes.text(
            name.x_m, name.y_m, name.text, rotation=float(np.degrees(name.angle_rad)), rotation_mode="anchor",
            ha="center", va="center_baseline", fontsize=NAME_PT, color=key.INK, zorder=6, parse_math=False,
            label="street", path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )  # fmt: skip


def _draw_scale(figure: Figure, view: _View, width_in: float, below_in: float) -> None:
    place = key.from_upper_left(figure)
    length_m = _round_length(width_in * view.metres_per_inch / 4)
    y, end = below_in + SCALE_ROW_IN / 2, EDGE_IN + length_m / view.metres_per_inch
    figure.add_artist(
        Line2D([EDGE_IN, end], [y, y], transform=place, color="black", lw=2.5, solid_capstyle="butt", label="scale")
    )  # fmt: skip
    label = f"{length_m / 1000:g} km" if length_m >= 1000 else f"{length_m:g} m"
    words = told(say("picture.north", scale=label))
    figure.text(
        end + 0.08, y, words, transform=place, va="center_baseline", fontsize=key.TEXT_PT,
        color=key.INK,
    )  # fmt: skip


def _write(
    figure: Figure, lines: Sequence[str], top_in: float, row_in: float, size_pt: float, colour: str
) -> None:
    place = key.from_upper_left(figure)
    for k, line in enumerate(lines):
        figure.text(
            EDGE_IN, top_in + row_in * (k + 0.5), line, transform=place, va="center_baseline", fontsize=size_pt,
            color=colour, parse_math=False,
        )  # fmt: skip


def _round_length(longest_m: float) -> float:
    """The greatest of 1, 2, 5, 10, 20 ... metres that is no longer."""
    power = 10.0 ** np.floor(np.log10(max(longest_m, 1.0)))
    return float(power * max(m for m in (1, 2, 5) if m * power <= max(longest_m, 1.0)))
