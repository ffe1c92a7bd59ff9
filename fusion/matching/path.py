"""The result of matching a whole drive: the path driven, and where on it each sample lies.

Knows nothing of how it was found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion.types import Floats, Ints

NO_ROAD = "no road near"
NO_CONNECTION = "no plausible connection"
OUTAGE = "outage of the recording"


@dataclass(frozen=True, slots=True)
class Break:
    """The drive leaves the network, or the path cannot be followed: ``time_s`` is the last time before it.

    ``reason`` is one of ``NO_ROAD``, ``NO_CONNECTION``, ``OUTAGE``.
    """

    time_s: float
    reason: str


@dataclass(frozen=True, eq=False)
class PathMatch:
    """A drive on the network: m traversals in the order driven, and n samples as they were given.

    A traversal is one uninterrupted stay on one segment in one direction. Its columns have shape (m,):

    - ``segment`` indexes the network; ``forward``: it was driven from from_node to to_node.
    - ``enter_m`` and ``leave_m`` are distances from from_node, where the stay begins and ends: (0, length) when driven
      whole forward, (length, 0) backward, parts of that at the ends of a run and at U-turns.
    - ``start_m`` is the distance along the path at entry. It grows through the whole drive and does not jump at breaks.
    - ``enter_time_s`` and ``leave_time_s`` are interpolated linearly between samples, by distance along the path.
    - ``run`` numbers the connected stretches: within one, consecutive traversals meet at a node or turn on the segment.
    - ``confidence`` is the probability, 0..1, that the traversal is right if the matcher's model is (``DriveMatcher``).

    Columns of the samples have shape (n,):

    - ``traversal`` is the row above, -1 where unmatched: off the road, without a position, or an outlier.
    - ``distance_m`` is the distance along the path (on the scale of ``start_m``) of the nearest point on the path
      between the neighbouring kept samples. It is not forced to grow: within a run it may fall by the noise of the
      positions.
    - ``offset_m`` is the distance to that point. Both are NaN where unmatched.
    """

    segment: Ints
    forward: NDArray[np.bool_]
    enter_m: Floats
    leave_m: Floats
    start_m: Floats
    enter_time_s: Floats
    leave_time_s: Floats
    run: Ints
    confidence: Floats
    traversal: Ints
    distance_m: Floats
    offset_m: Floats
    breaks: tuple[Break, ...]

    def __len__(self) -> int:
        return len(self.segment)

    @property
    def length_m(self) -> float:
        """The length of the whole path, metres."""
        return float(np.abs(self.leave_m - self.enter_m).sum())

    def position_on(self, path_m: ArrayLike) -> tuple[Ints, Floats]:
        """Where on the network distances along the path lie: (traversal, distance from from_node in metres).

        Any shape; the results have the same. Where two traversals meet, the later one is given. Distances
        outside the path, and NaN, give (-1, NaN).
        """
        at = np.asarray(path_m, np.float64)
        if not len(self):
            return np.full(at.shape, -1, np.int64), np.full(at.shape, np.nan)
        stay = np.abs(self.leave_m - self.enter_m)
        end = float(self.start_m[-1] + stay[-1])
        inside = (at >= self.start_m[0]) & (at <= end)
        row = np.clip(np.searchsorted(self.start_m, at, side="right") - 1, 0, len(self) - 1)
        moved = np.clip(at - self.start_m[row], 0.0, stay[row])
        distance = self.enter_m[row] + np.where(self.forward[row], moved, -moved)
        return np.where(inside, row, -1).astype(np.int64), np.where(inside, distance, np.nan)


def empty_match(n: int, breaks: tuple[Break, ...] = ()) -> PathMatch:
    """A match of n samples that lie on no road."""
    none, nothing = np.empty(0, np.int64), np.empty(0)
    return PathMatch(
        segment=none,
        forward=np.empty(0, np.bool_),
        enter_m=nothing,
        leave_m=nothing,
        start_m=nothing,
        enter_time_s=nothing,
        leave_time_s=nothing,
        run=none,
        confidence=nothing,
        traversal=np.full(n, -1, np.int64),
        distance_m=np.full(n, np.nan),
        offset_m=np.full(n, np.nan),
        breaks=breaks,
    )
