"""A study of satellite residuals drawn: the sky, residuals by satellite, quantiles against laws, residuals by time.

Loads matplotlib: import it where a picture is wanted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.projections.polar import PolarAxes

from app.core.messages import say
from app.drives.outputs.profile_picture import MUTED, SEGMENT, in_words, printable, written
from fusion.gnss.measurements import Measurements, Solution
from fusion.messages import told
from fusion.published.positioning.laws import LawTest, fit_law, quantile_pairs
from fusion.types import Floats

SIZE_IN, DPI = (15.0, 9.0), 100
TITLE_Y = 0.965
MIDDLE, SPREAD = "#17507a", "#b3471a"
"""Blue and orange that stay apart for colour-blind eyes and in grey."""
MOST_DOTS = 20_000
"""Rows drawn in the sky and by satellite; of more, every second, third ... is drawn."""
MOST_QUANTILES = 800
LEAST_RANGE_M = 5.0
"""A scale of residuals reaches at least so far to either side: centimetres must not look like reflections."""
_OUTER = 0.002
"""Share of the quantiles at either end that may lie outside the picture."""
_CN0_DBHZ = (25.0, 50.0)
_ASIDE, _ABOVE, _CLEAR = 8.0, 4.5, 14.0
"""From a satellite to the middle of its name, and what keeps two names apart, in degrees of the sky's plot."""
_STRIP_PT = 190.0
"""Height of the plot by satellite in points, about: its rows share it."""


def gnss_png(measured: Measurements, solution: Solution, laws: list[LawTest], title: str) -> bytes:
    """A PNG of ``gnss_figure``."""
    return written(gnss_figure(measured, solution, laws, printable(title)), "png")


def gnss_figure(measured: Measurements, solution: Solution, laws: list[LawTest], title: str) -> Figure:
    """The figure. ``laws`` are the tests of all residuals together; without any, no quantiles are drawn."""
    figure = Figure(
        figsize=SIZE_IN, dpi=DPI, layout=ConstrainedLayoutEngine(rect=(0, 0, 1, TITLE_Y), hspace=0.06)
    )
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 3, width_ratios=(1, 1, 1.25))
    sky: Any = figure.add_subplot(grid[0, 0], projection="polar")
    _draw_sky(figure, sky, measured, solution)
    _draw_satellites(figure, figure.add_subplot(grid[0, 1:]), measured, solution)
    best, worst = (figure.add_subplot(grid[1, k]) for k in (0, 1))
    _draw_laws(best, worst, solution.residual_m, laws)
    _draw_time(figure.add_subplot(grid[1, 2]), measured, solution)
    figure.text(0.008, TITLE_Y + 0.008, title, ha="left", fontsize=13, color=SEGMENT)
    figure.text(0.995, TITLE_Y + 0.008, _summary(measured, solution), ha="right", fontsize=10, color=MUTED)
    return in_words(figure)


def _draw_sky(figure: Figure, axes: PolarAxes, measured: Measurements, solution: Solution) -> None:
    """Where satellites stood; the colour is the solver's probability of a reflection, or C/N0 where it says none."""
    rows = _thinned(np.flatnonzero(np.isfinite(measured.elevation_rad)))
    nlos = bool(np.isfinite(solution.nlos).any())
    value = solution.nlos if nlos else measured.cn0_dbhz
    low, high = (0.0, 1.0) if nlos else _CN0_DBHZ
    dots = axes.scatter(
        measured.azimuth_rad[rows],
        90 - np.degrees(measured.elevation_rad[rows]),
        c=value[rows],
        s=7,
        cmap="cividis_r" if nlos else "cividis",
        vmin=low,
        vmax=high,
        linewidths=0,
    )
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_rlim(0, 90)
    axes.set_rgrids([30, 60], labels=["60°", "30°"], angle=112, fontsize=8, color=MUTED)
    axes.set_thetagrids([0, 90, 180, 270], labels=["N", "E", "S", "W"], fontsize=9)
    axes.grid(alpha=0.4, linewidth=0.6)
    _name_satellites(axes, measured)
    label = "Probability of having been reflected" if nlos else "C/N0 (dB-Hz)"
    figure.colorbar(dots, ax=axes, orientation="horizontal", shrink=0.75, aspect=26, pad=0.04).set_label(
        label, fontsize=9
    )


def _name_satellites(axes: PolarAxes, measured: Measurements) -> None:
    """Beside the last place of each satellite, at the corner of it that is farthest from names already there."""
    labelled: list[tuple[float, float]] = []
    for k, name in enumerate(measured.names):
        rows = np.flatnonzero((measured.satellite == k) & np.isfinite(measured.elevation_rad))
        if not len(rows):
            continue
        turn, out = measured.azimuth_rad[rows[-1]], 90 - np.degrees(measured.elevation_rad[rows[-1]])
        x, y = out * np.sin(turn), out * np.cos(turn)
        places = [(x + right * _ASIDE, y + up * _ABOVE) for right in (1, -1) for up in (1, -1)]
        clear = [
            min((np.hypot(px - a, 2 * (py - b)) for a, b in labelled), default=99.0) for px, py in places
        ]
        best = int(np.argmax(np.minimum(clear, _CLEAR)))
        labelled.append(places[best])
        right, up = (1, 1, -1, -1)[best], (1, -1, 1, -1)[best]
        axes.annotate(
            name, (turn, out), (3 * right, 3 * up), textcoords="offset points", fontsize=8, color=SEGMENT,
            ha="left" if right > 0 else "right", va="bottom" if up > 0 else "top",
        )  # fmt: skip


def _draw_satellites(figure: Figure, axes: Axes, measured: Measurements, solution: Solution) -> None:
    """One line for each satellite over time, its residuals as colour."""
    rows = _thinned(np.flatnonzero(np.isfinite(solution.residual_m)))
    minutes, reach = _minutes(measured), _reach(solution.residual_m)
    dots = axes.scatter(
        minutes[measured.epoch[rows]],
        measured.satellite[rows],
        c=solution.residual_m[rows],
        s=min(22.0, 0.8 * _STRIP_PT / len(measured.names)) ** 2,
        marker="|",
        cmap="PuOr_r",
        vmin=-reach,
        vmax=reach,
        linewidths=1.2,
    )
    axes.set_facecolor("#e4e8ea")  # white is the scale's zero, and must not look like nothing
    count = len(measured.names)
    axes.set_yticks(range(count), measured.names, fontsize=9 if count <= 24 else 6)
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlim(-0.01 * minutes[-1], 1.01 * minutes[-1] + 0.01)
    axes.set_xlabel("Time from the beginning (min)")
    axes.set_title("Residuals by satellite", loc="left", fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    bar = figure.colorbar(dots, ax=axes, pad=0.015, aspect=26, extend="both")
    bar.set_label("Measured minus predicted (m)", fontsize=9)


def _draw_laws(best: Axes, worst: Axes, residual_m: Floats, laws: list[LawTest]) -> None:
    """Quantiles against those of the law that is nearest by Kolmogorov-Smirnov, and of the one that is farthest."""
    sample = residual_m[np.isfinite(residual_m)]
    ranked = sorted(laws, key=lambda test: test.ks)
    for axes, word, test in ((best, "Nearest", ranked[:1]), (worst, "Farthest", ranked[-1:])):
        axes.set_xlabel("Quantile of the law (m)")
        axes.set_ylabel("Quantile of the residuals (m)")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25, linewidth=0.6)
        if not test:
            axes.text(0.5, 0.5, "too few residuals", transform=axes.transAxes, ha="center", color=MUTED)
            continue
        law, seen = quantile_pairs(sample, fit_law(test[0].law, sample))
        keep = np.unique(np.linspace(0, len(law) - 1, MOST_QUANTILES).astype(np.int64))
        ends = _ends(law, seen)
        axes.set_xlim(*ends)
        axes.set_ylim(*ends)
        axes.plot(ends, ends, color=MUTED, lw=1.0, ls=(0, (4, 3)), zorder=1)
        axes.plot(law[keep], seen[keep], ls="none", marker="o", ms=3, mew=0, color=MIDDLE, zorder=2)
        axes.set_title(
            told(say("picture.law", which=word, law=test[0].law, ks=test[0].ks)), loc="left", fontsize=10
        )


def _ends(law: Floats, seen: Floats) -> tuple[float, float]:
    """The ends of both axes: all but the outermost quantiles, of which one wild residual would flatten the rest."""
    low, high = np.quantile([law, seen], (_OUTER, 1 - _OUTER), axis=1)
    margin = 0.08 * max(float(high.max() - low.min()), 1e-6)
    return float(low.min()) - margin, float(high.max()) + margin


def _draw_time(axes: Axes, measured: Measurements, solution: Solution) -> None:
    """How large residuals are, epoch by epoch, and what the solution states of itself."""
    minutes = _minutes(measured)
    size = np.abs(solution.residual_m)
    middle, most = _by_epoch(measured, size)
    stated = np.sqrt(np.trace(solution.covariance[:, :3, :3], axis1=1, axis2=2))
    axes.plot(minutes, most, color=SPREAD, lw=0.7, alpha=0.8, label="largest residual")
    axes.plot(minutes, middle, color=MIDDLE, lw=1.3, label="median residual")
    axes.plot(minutes, stated, color=SEGMENT, lw=1.2, ls=(0, (4, 2)), label="stated sigma (3-D)")
    axes.set_ylim(0, _top([middle, most, stated]))
    axes.set_xlim(float(minutes[0]), max(float(minutes[-1]), float(minutes[0]) + 0.1))
    axes.set_xlabel("Time from the beginning (min)")
    axes.set_ylabel("Metres")
    axes.grid(alpha=0.25, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2, ncols=3, fontsize=8.5, frameon=False,
        handlelength=1.6, columnspacing=1.1,
    )  # fmt: skip


def _by_epoch(measured: Measurements, value: Floats) -> tuple[Floats, Floats]:
    """Median and largest of each epoch's known values, (m,) each; NaN without any."""
    middle, most = np.full(len(measured), np.nan), np.full(len(measured), np.nan)
    for k in range(len(measured)):
        part = value[measured.first[k] : measured.first[k + 1]]
        part = part[np.isfinite(part)]
        if len(part):
            middle[k], most[k] = np.median(part), part.max()
    return middle, most


def _top(series: list[Floats]) -> float:
    """The upper end of an axis that single wild values do not stretch."""
    finite = np.concatenate([s[np.isfinite(s)] for s in series])
    return max(LEAST_RANGE_M, 1.15 * float(np.quantile(finite, 0.99))) if len(finite) else LEAST_RANGE_M


def _reach(residual_m: Floats) -> float:
    finite = np.abs(residual_m[np.isfinite(residual_m)])
    return max(LEAST_RANGE_M, float(np.quantile(finite, 0.95))) if len(finite) else LEAST_RANGE_M


def _minutes(measured: Measurements) -> Floats:
    return np.asarray((measured.time_s - measured.time_s[0]) / 60.0)


def _thinned(rows: Any) -> Any:
    return rows[:: max(1, -(-len(rows) // MOST_DOTS))]


def _summary(measured: Measurements, solution: Solution) -> str:
    solved, epochs = int(solution.solved.sum()), len(measured)
    predicted = int(np.sum(solution.predicted & solution.solved))
    positions = say("picture.epochs", n=solved, all=epochs, predicted=predicted)
    return told(say("picture.satellites", positions=positions, n=len(measured.names)))
