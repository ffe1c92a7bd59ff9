"""What the matchers of positions have in common: how they are called, and what they answer.

Knows no rule: each stands in a file of its own beside this one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fusion.arrays import ColumnTable
from fusion.roads.network import RoadNetwork
from fusion.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Samples(ColumnTable):
    """n positions, checked: shape (n,) each. Where x or y is unknown both are NaN; so is an unknown heading."""

    time_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats

    @classmethod
    def of(cls, time_s: ArrayLike, x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike) -> Samples:
        """Raises ``ValueError`` for columns of different lengths and for times that are unknown or fall."""
        time, x, y, heading = (np.ascontiguousarray(c, np.float64) for c in (time_s, x_m, y_m, heading_rad))
        shapes = [c.shape for c in (time, x, y, heading)]
        if len(set(shapes)) != 1 or time.ndim != 1:
            raise ValueError(f"the columns of positions must be vectors of one length, not {shapes}")
        if not np.isfinite(time).all() or np.any(np.diff(time) < 0):
            raise ValueError("the times of positions must be known and must not fall")
        known = np.isfinite(x) & np.isfinite(y)
        return cls(
            time,
            np.where(known, x, np.nan),
            np.where(known, y, np.nan),
            np.where(np.isfinite(heading), heading, np.nan),
        )

    def known(self) -> Ints:
        """Indices of the samples with a position."""
        return np.flatnonzero(np.isfinite(self.x_m)).astype(np.int64)


class PointMatch(NamedTuple):
    """One position on its segment.

    ``segment`` indexes the network; (x_m, y_m) is the matched point, ``distance_m`` its distance from
    from_node along the segment; ``heading_rad`` the segment's direction as it is driven (from east,
    anticlockwise, (-pi, pi]); ``forward`` whether that is the direction in which the way is drawn.
    """

    segment: int
    x_m: float
    y_m: float
    distance_m: float
    heading_rad: float
    mahalanobis: float
    forward: bool


@dataclass(frozen=True, eq=False)
class PointMatches:
    """The matches of n positions: columns as in ``PointMatch``, shape (n,).

    The segment is -1 and the numbers NaN where none passes.
    """

    segment: Ints
    x_m: Floats
    y_m: Floats
    distance_m: Floats
    heading_rad: Floats
    mahalanobis: Floats
    forward: Bools


Matching = Callable[[ArrayLike, ArrayLike, ArrayLike, ArrayLike], PointMatches]
"""``(time_s, x_m, y_m, heading_rad)`` to the matches, on a network that has been prepared."""


class PointMatcher(ABC):
    """A rule that gives each position of a drive its road segment; its settings are its fields."""

    name: ClassVar[str]
    """The name in ``MATCHERS``."""
    description: ClassVar[str]
    """One line for people."""
    source: ClassVar[str]
    """Where the rule is published."""

    @abstractmethod
    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """The rule on a network that has segments, with whatever it needs of them made beforehand."""

    def on(self, network: RoadNetwork) -> Matching:
        """``match`` for many drives in one network, which is prepared once."""
        match = self.prepare(network) if len(network) else None

        def matching(
            time_s: ArrayLike, x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike
        ) -> PointMatches:
            samples = Samples.of(time_s, x_m, y_m, heading_rad)
            return match(samples) if match else unmatched(len(samples))

        return matching

    def match(
        self, network: RoadNetwork, time_s: ArrayLike, x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike
    ) -> PointMatches:
        """The segments of n positions in order of time; all arguments have shape (n,).

        Positions are metres in the network's plane, NaN where there is none; headings are from east,
        anticlockwise, NaN where unknown. ``mahalanobis`` of the result is NaN unless that is what the rule goes
        by. Raises ``ValueError`` for columns of different lengths and for times that are unknown or fall.
        """
        return self.on(network)(time_s, x_m, y_m, heading_rad)


def unmatched(n: int) -> PointMatches:
    """n positions without a segment."""
    x, y, distance, heading, mahalanobis = (np.full(n, np.nan) for _ in range(5))
    return PointMatches(np.full(n, -1, np.int64), x, y, distance, heading, mahalanobis, np.zeros(n, np.bool_))


def placed(network: RoadNetwork, segment: Ints, share: Floats, forward: Bools) -> PointMatches:
    """Matches from segments (-1: none), the share of each at which the match lies (0..1) and its direction."""
    s, matched = np.maximum(segment, 0), segment >= 0
    along = np.where(matched, share, np.nan)
    turned = network.heading_rad[s] + np.where(forward, 0.0, np.pi)
    return PointMatches(
        segment=segment,
        x_m=network.x0[s] + along * (network.x1[s] - network.x0[s]),
        y_m=network.y0[s] + along * (network.y1[s] - network.y0[s]),
        distance_m=along * network.length_m[s],
        heading_rad=np.where(matched, turned - 2 * np.pi * np.ceil((turned - np.pi) / (2 * np.pi)), np.nan),
        mahalanobis=np.full(len(segment), np.nan),
        forward=forward & matched,
    )
