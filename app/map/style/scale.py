"""What the colours of maps stand for: classes of slopes, for files for QGIS and web maps, and which roads have one.

What is steep, or sure, stands out most: darkest on light ground, brightest on dark ground. The numbers are taken from
matplotlib's viridis (steepness) and plasma (certainty), of which the lightness rises steadily, so that colour-blind
people see the order; tests hold them equal, and nothing that serves a map has to load matplotlib.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from app.map.picture.slope_map import DOUBT, UNSURE_SIGMA_PERCENT

BREAKS_PERCENT = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 15.0)
"""Steepness from which on each class begins; the last has no end."""
COLOURS = ("#bddf26", "#73d056", "#38b977", "#1f9f88", "#25838e", "#31688e", "#3e4989", "#482878", "#440154")
"""One a class on light ground, evenly taken from the map's colours, of which the lightness falls steadily."""
COLOURS_ON_DARK = (
    "#355f8d", "#2b758e", "#238a8d", "#1fa088", "#2fb47c", "#56c667", "#8bd646", "#c5e021", "#fde725",
)  # fmt: skip
UNKNOWN_COLOUR = "#a9a9a9"

SIGMA_BREAKS_PERCENT = (0.0, 0.2, 0.3, 0.5, 1.0, 2.0)
"""Sigma from which on each class of certainty begins; the last has no end."""
SIGMA_COLOURS = ("#0d0887", "#5e01a6", "#9e199d", "#cd4a76", "#ef7e50", "#feba2c")
SIGMA_COLOURS_ON_DARK = ("#f0f921", "#feba2c", "#f2844b", "#d6556d", "#b12a90", "#7e03a8")


@dataclass(frozen=True)
class ColourScale:
    """Classes of a figure in percent, each from its break up to the next, and their colours."""

    title: str
    breaks_percent: tuple[float, ...]
    colours: tuple[str, ...]

    def classes(self) -> list[tuple[str, str]]:
        """Label and colour of each class: what a legend says."""
        labels = [f"{low:g} to {high:g} %" for low, high in pairwise(self.breaks_percent)]
        return list(zip([*labels, f"{self.breaks_percent[-1]:g} % and more"], self.colours, strict=True))


def scale_of(colour: str, *, dark: bool) -> ColourScale:
    """The scale of one of ``COLOUR_NAMES``; KeyError for anything else."""
    return _SCALES[colour][dark]


_STEEPNESSES = (BREAKS_PERCENT, COLOURS, COLOURS_ON_DARK)
_SIGMAS = (SIGMA_BREAKS_PERCENT, SIGMA_COLOURS, SIGMA_COLOURS_ON_DARK)
_SCALES = {
    name: (ColourScale(title, breaks, on_light), ColourScale(title, breaks, on_dark))
    for name, title, (breaks, on_light, on_dark) in (
        ("steepness", "Steepness", _STEEPNESSES),
        ("certainty", "Uncertainty of the slope, one standard deviation", _SIGMAS),
        ("elevation-model", "Steepness by the elevation model alone", _STEEPNESSES),
        ("difference", "Measured slope against the elevation model's", _STEEPNESSES),
    )
}
COLOUR_NAMES = tuple(_SCALES)
"""What the colour of a web map can stand for."""


Expression = list[Any]

SLOPE: Expression = ["get", "slope_percent"]
MODELLED: Expression = ["get", "dem_slope_percent"]
SIGMA: Expression = ["coalesce", ["get", "slope_sigma_percent"], UNSURE_SIGMA_PERCENT]
_MEASURED: Expression = ["has", "slope_percent"]
_BOTH: Expression = ["all", _MEASURED, ["has", "dem_slope_percent"]]


@dataclass(frozen=True)
class Shown:
    """In the language of MapLibre's style specification."""

    known: Expression
    """Whether a road has a colour."""
    value: Expression
    """The figure of the scale, 0 or more, where it is known."""
    figure: Expression
    """The figure beside the road, 0 or more."""
    sigma: Expression | None
    """Of that figure; None: it has none."""
    uphill: Expression | None
    """The slope whose sign arrows follow; None: there are no arrows."""
    sure: Expression | bool
    """Whether its sign is beyond doubt."""
    widths_tell: bool
    """Whether lines are narrower where the slope is less sure."""
    singles_only: bool = False
    """Whether it is known of single segments alone, and not of what low zooms or ways draw."""

    @property
    def rank(self) -> Expression:
        """What matters most lies on top where roads meet: the steepest, or the surest."""
        return self.value if self.value != SIGMA else ["-", 0, SIGMA]


_SLOPE_SIZE: Expression = ["abs", SLOPE]
_MODEL_SIZE: Expression = ["abs", MODELLED]
_DIFFERENCE: Expression = ["abs", ["-", SLOPE, MODELLED]]
_SURE: Expression = [">", _SLOPE_SIZE, ["*", DOUBT, SIGMA]]

SHOWN = {
    "steepness": Shown(_MEASURED, _SLOPE_SIZE, _SLOPE_SIZE, SIGMA, SLOPE, _SURE, widths_tell=True),
    "certainty": Shown(_MEASURED, SIGMA, _SLOPE_SIZE, SIGMA, SLOPE, _SURE, widths_tell=False),
    "elevation-model": Shown(
        ["has", "dem_slope_percent"], _MODEL_SIZE, _MODEL_SIZE, None, MODELLED, True, False, singles_only=True
    ),
    "difference": Shown(
        _BOTH, _DIFFERENCE, _DIFFERENCE, None, None, True, widths_tell=True, singles_only=True
    ),
}


def linear(*zooms_and_values: Any) -> Expression:
    """Between the values at these zooms."""
    return ["interpolate", ["linear"], ["zoom"], *zooms_and_values]
