"""The elevation model's part in the dense reference: an Ornstein-Uhlenbeck process along each segment."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dense_equations import Equation, observed
from fusion.network.terrain import STEP_FREEDOM, Terrain
from fusion.roads.table import RoadTable


class DenseTerrain:
    """Nothing at first; then rises from knot to knot, and heights, that count less where the model errs badly.

    ``heights`` are the unknowns of the knots of each row. What is learned of the model as a whole is given: its error
    is as large as ``sigma_m`` and alike over ``length_m``.
    """

    def __init__(
        self, table: RoadTable, lengths_m: np.ndarray, heights: Sequence[Sequence[int]],
        terrain: Terrain | None, sigma_m: float, length_m: float,
    ) -> None:  # fmt: skip
        self.sigma_m = sigma_m
        self.steps: list[tuple[Equation, float, float]] = []
        self.levels: list[tuple[int, Equation, float, float]] = []
        if terrain is None:
            return
        place = 0
        structure = table.bridge | table.tunnel
        spoilt = {*table.from_node[structure].tolist(), *table.to_node[structure].tolist()}
        for row, knots in enumerate(heights):
            said = terrain.height_m[place : place + len(knots)]
            place += len(knots)
            if {int(table.from_node[row]), int(table.to_node[row])} & spoilt:
                continue
            apart = float(lengths_m[row]) / (len(knots) - 1) / length_m
            variance = 2 * sigma_m**2 * np.sinh(apart)
            end = np.tanh(apart / 2) / (2 * sigma_m**2)
            for (a, b), (low, high) in zip(pairwise(knots), pairwise(said.tolist()), strict=True):
                if np.isfinite(high - low):
                    self.steps.append((observed({a: -1.0, b: 1.0}, high - low, 1.0), high - low, variance))
                    self.levels += [
                        (row, observed({u: 1.0}, h, 1.0), h, end) for u, h in ((a, low), (b, high))
                    ]
        for one in self.equations():
            one.weight = 0.0

    def equations(self) -> list[Equation]:
        """All of them."""
        return [*(e for e, _, _ in self.steps), *(e for _, e, _, _ in self.levels)]

    def learn(self, solution: np.ndarray, covariance: np.ndarray, first: bool, driven: set[int]) -> None:
        """Weights after a solution; the ``first`` did not know the model, so both err on their own."""
        free = STEP_FREEDOM
        for step, rise, variance in self.steps:
            low, high = step.at
            own = covariance[low, low] + covariance[high, high] - 2 * covariance[low, high]
            missed = (solution[high] - solution[low] - rise) ** 2
            misfit = missed / (variance + own) if first else (missed + own) / variance
            # Student's t tells (free + 1) / (free + 3) of what a Gaussian error would.
            step.weight = (free + 1) / (free + misfit) / (variance * (free + 3) / (free + 1))
        above = [height - solution[e.at[0]] for _, e, height, _ in self.levels]
        usual = np.median(
            [up for up, (row, *_) in zip(above, self.levels, strict=True) if row in driven] or [0]
        )
        for up, (row, equation, _, end) in zip(above, self.levels, strict=True):
            far = ((up - usual) / self.sigma_m) ** 2 if row in driven or not first else 0.0
            equation.weight = end * (free + 1) / (free + max(far, 1.0))
