"""What is published of a segment, made of what the network and single drives say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.combine import CombinedSlope, combine


@dataclass(frozen=True)
class Part:
    """One slope of a segment: the network's, in which any number of drives is heard, or a slope-only drive's.

    A gap between driven segments has a slope in the network and no drive.
    """

    slope_percent: float
    slope_sigma_percent: float
    drives: int
    observations: int
    network: bool = False


def published(parts: Sequence[Part]) -> CombinedSlope:
    """The parts (at least one) made into one slope; a gap's is a guess that gives way to anything measured."""
    measured = [part for part in parts if part.drives] or parts
    if len(measured) == 1 and measured[0].network:
        only = measured[0]
        return CombinedSlope(only.slope_percent, only.slope_sigma_percent, only.drives, only.observations)
    whole = combine(
        np.array([part.slope_percent for part in measured]),
        np.array([part.slope_sigma_percent for part in measured]),
        np.array([part.observations for part in measured]),
    )
    drives = sum(part.drives for part in measured)
    return CombinedSlope(whole.slope_percent, whole.slope_sigma_percent, drives, whole.observations)
