"""What the smoother shows piece by piece, in one place."""

from __future__ import annotations

import numpy as np

from fusion.filters.smoother import LinearModel, Smoothed


def smoothed_with_covariances(model: LinearModel) -> tuple[Smoothed, np.ndarray]:
    """The smoothed model, and the covariance of each step (n, d, d)."""
    d = len(model.mean)
    covariance = np.full((model.steps, d, d), np.nan)

    def look(piece: slice, shown: np.ndarray) -> None:
        covariance[piece] = shown

    return model.smooth(look), covariance
