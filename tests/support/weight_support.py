"""The two measures of degeneracy that triggers of resampling look at, by their definitions."""

from __future__ import annotations

import math

import numpy as np

from fusion.types import Floats


def effective_number(weights: Floats) -> float:
    """N_eff = 1 / sum w^2 (1.50) of weights that sum to 1: from 1, one particle has it all, to N, all are equal."""
    return float(1.0 / np.sum(weights**2))


def entropy(weights: Floats) -> float:
    """S_w = log N + sum w log w (1.49) of weights that sum to 1, in nats: from 0, all are equal, to log N."""
    positive = weights[weights > 0.0]
    return float(math.log(len(weights)) + np.sum(positive * np.log(positive)))
