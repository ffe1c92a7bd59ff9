"""Several slopes of one segment made into one: inverse variance, whatever the order of arrival.

Nothing is known here of where the slopes come from, but whether one is the network's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from fusion.types import Floats


@dataclass(frozen=True, kw_only=True)
class NetworkOnly:
    """What the network says of a segment beside its slope (``published.Adjustment``); None where it is not known."""

    driven_share: float | None = None
    height_from_m: float | None = None
    height_to_m: float | None = None
    height_sigma_m: float | None = None
    steepest_percent: float | None = None
    steepest_from_m: float | None = None
    steepest_to_m: float | None = None


@dataclass(frozen=True)
class CombinedSlope(NetworkOnly):
    """The combination of ``drives`` estimates; sigma is one standard deviation."""

    slope_percent: float
    slope_sigma_percent: float
    drives: int
    observations: int


def combine(
    slope_percent: Floats, slope_sigma_percent: Floats, observations: NDArray[np.integer]
) -> CombinedSlope:
    """Combine independent estimates of one slope by inverse variance.

    Shapes (n,), n at least 1, sigmas finite and above 0. Sums are exact (``math.fsum``), so the result does
    not depend on the order in any digit. Where the estimates scatter more than their sigmas allow, sigma is
    widened by the square root of chi-squared per degree of freedom (Birge's ratio), never narrowed.
    Raises ``ValueError`` on an empty or invalid input.
    """
    sigma = np.asarray(slope_sigma_percent, float)
    slope = np.asarray(slope_percent, float)
    if not len(slope) or not (np.isfinite(slope).all() and np.isfinite(sigma).all() and (sigma > 0).all()):
        raise ValueError("combine needs at least one estimate, with finite slopes and sigmas above 0")
    weight = 1.0 / sigma**2
    total = math.fsum(weight)
    mean = math.fsum(weight * slope) / total
    birge_squared = 1.0
    if len(slope) > 1:
        birge_squared = max(1.0, math.fsum(weight * (slope - mean) ** 2) / (len(slope) - 1))
    return CombinedSlope(mean, math.sqrt(birge_squared / total), len(slope), int(np.sum(observations)))


@dataclass(frozen=True)
class SlopePart(CombinedSlope):
    """One slope of a segment: the network's, in which any number of drives is accepted, or a slope-only drive's.

    A gap, undriven between driven segments, has a slope in the network and no drive. ``of_terrain``: it leans on the
    elevation model, as all such parts do.
    """

    network: bool = False
    of_terrain: bool = False


HEIGHTS = ("height_from_m", "height_to_m", "height_sigma_m")
STEEPEST = ("steepest_percent", "steepest_from_m", "steepest_to_m")
NETWORK_ONLY = tuple(field.name for field in fields(NetworkOnly))
"""Columns wherever slopes are stored."""


def published_slope(parts: Sequence[SlopePart]) -> CombinedSlope:
    """What is published of a segment: its parts (at least one) made into one slope.

    A gap's slope is a guess that gives way to anything measured, and so does what it says of its inside: its nodes'
    heights stay, which others measured. The network's own slope, alone, stays as it is. Of parts that lean on the
    elevation model one counts, and none beside the network's, which holds the model already.
    """
    network = next((part for part in parts if part.network), None)
    measured = [part for part in parts if part.drives] or list(parts)
    drives, observations = (
        sum(getattr(part, name) for part in measured) for name in ("drives", "observations")
    )
    if any(part.network for part in measured):
        measured = [part for part in measured if not part.of_terrain]
    measured = _one_of_terrain(measured)
    allowed = NETWORK_ONLY if network in measured else HEIGHTS
    known = {} if network is None else {name: getattr(network, name) for name in allowed}
    if len(measured) == 1 and measured[0].network:
        only = measured[0]
        return CombinedSlope(only.slope_percent, only.slope_sigma_percent, drives, observations, **known)
    return replace(_combined(measured), drives=drives, observations=observations, **known)


def _combined(parts: Sequence[SlopePart]) -> CombinedSlope:
    rows = [(part.slope_percent, part.slope_sigma_percent, part.observations) for part in parts]
    slope, sigma, observations = zip(*rows, strict=True)
    return combine(np.array(slope), np.array(sigma), np.array(observations))


def _one_of_terrain(parts: list[SlopePart]) -> list[SlopePart]:
    """The same with the parts that lean on the elevation model as one: their mean, no surer than the surest."""
    terrain = [part for part in parts if part.of_terrain]
    if len(terrain) < 2:
        return parts
    whole = _combined(terrain)
    sigma = max(whole.slope_sigma_percent, min(part.slope_sigma_percent for part in terrain))
    one = replace(terrain[0], slope_percent=whole.slope_percent, slope_sigma_percent=sigma)
    return [one, *(part for part in parts if not part.of_terrain)]
