"""What the colours of the map can stand for: which roads have a colour, by which figure, what is said beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from app.map.picture.slope_map import DOUBT, UNSURE_SIGMA_PERCENT

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


_STEEPNESS: Expression = ["abs", SLOPE]
_APART: Expression = ["abs", ["-", SLOPE, MODELLED]]
_SURE: Expression = [">", _STEEPNESS, ["*", DOUBT, SIGMA]]

SHOWN = {
    "steepness": Shown(_MEASURED, _STEEPNESS, _STEEPNESS, SIGMA, SLOPE, _SURE, widths_tell=True),
    "certainty": Shown(_MEASURED, SIGMA, _STEEPNESS, SIGMA, SLOPE, _SURE, widths_tell=False),
    "elevation-model": Shown(
        ["has", "dem_slope_percent"],
        ["abs", MODELLED],
        ["abs", MODELLED],
        None,
        MODELLED,
        True,
        widths_tell=False,
        singles_only=True,
    ),
    "difference": Shown(_BOTH, _APART, _APART, None, None, True, widths_tell=True, singles_only=True),
}
