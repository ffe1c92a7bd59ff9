"""One normal per window: the white Gaussian error that receivers assume, with its moments measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.gnss.error_models.base import ErrorLaw, Series
from fusion.gnss.reception import WINDOW_S
from fusion.types import Floats


@dataclass(frozen=True)
class GaussianModel:
    """``window_s``: how long an error is remembered; ``floor_m2``: the least variance, that of a quiet receiver."""

    window_s: float = WINDOW_S
    floor_m2: float = 0.25**2
    name = "gaussian"
    source = "Viandier 2011, 3.3.2 and Algorithm 10 for line of sight"
    description = "One normal law, with mean and variance of the last 40 seconds."

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The normal with the moments of the whole series; ``seed`` is not needed."""
        one = np.ones(1)
        variance = max(float(np.var(series.error_m)), self.floor_m2)
        return ErrorLaw.of_normals(one, one * np.mean(series.error_m), one * variance)

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """Moments of each epoch's window."""
        begin = series.begins(self.window_s)
        count = np.arange(1, len(series) + 1) - begin
        # About the mean of all, since differences of running sums of squares lose digits.
        centre = series.error_m.mean()
        sums, squares = (
            np.concatenate([[0.0], np.cumsum((series.error_m - centre) ** power)]) for power in (1, 2)
        )
        mean = (sums[1:] - sums[begin]) / count
        variance = (squares[1:] - squares[begin]) / count - mean**2
        return mean + centre, np.maximum(variance, self.floor_m2)
