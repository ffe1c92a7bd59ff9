"""What one pass of a drive over a segment says about the road's heights: a small Gaussian likelihood.

Given the heights along a segment, what was measured on it hardly depends on the rest of the drive: through the
vehicle's constants (mount pitch, bias, squat), which the whole drive determines and whose uncertainty is part of the
factor, and through the height error of the receiver, which drifts. Where that matters, the factor is conditional on
what was measured on the segments just before (Vecchia's approximation of the drive's likelihood), else it stands alone.
How a pass becomes a factor is the affair of the method that makes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from fusion.types import Floats

_NUMBERS = 9


@dataclass(frozen=True, eq=False)
class PassFactor:
    """A likelihood exp(-x' information x / 2 + vector' x) over the knot variables x of ``segments``.

    ``segments``: the last is the segment that was passed; those before it, in driving order, are what the factor is
    conditional on. ``slope_percent`` and its sigma are what the pass says by itself, without any prior, from from_node
    to to_node. ``start_m`` to ``end_m`` is the driven part, metres from from_node. ``roughness`` is the variance of
    the grade's change per metre that the drive learned there (1/m).
    """

    segments: tuple[int, ...]
    information: Floats
    vector: Floats
    slope_percent: float
    slope_sigma_percent: float
    start_m: float
    end_m: float
    roughness: float
    observations: int
    first_time_s: float
    last_time_s: float

    def encode(self) -> bytes:
        """Everything but ``segments``, as little-endian doubles."""
        numbers = [
            self.slope_percent, self.slope_sigma_percent, self.start_m, self.end_m, self.roughness,
            self.observations, self.first_time_s, self.last_time_s, len(self.vector),
        ]  # fmt: skip
        upper = self.information[np.triu_indices(len(self.vector))]
        return np.concatenate([numbers, self.vector, upper]).astype("<f8").tobytes()

    @classmethod
    def decode(cls, data: bytes, segments: tuple[int, ...]) -> Self:
        """The inverse of ``encode``, bit for bit."""
        values = np.frombuffer(data, "<f8").astype(np.float64)
        count = int(values[_NUMBERS - 1])
        slope, sigma, start, end, roughness, observations, first, last = (
            float(v) for v in values[: _NUMBERS - 1]
        )
        vector = values[_NUMBERS : _NUMBERS + count]
        information = symmetric(values[_NUMBERS + count :], count)
        return cls(
            segments, information, vector, slope, sigma, start, end, roughness, int(observations), first, last
        )


def decode_many(data: Sequence[bytes]) -> tuple[Floats, Floats, Floats]:
    """Encoded factors over the same segments, stacked: (numbers (n, 8), vectors (n, k), upper triangles (n, ...)).

    The numbers are those of ``PassFactor`` in the order of its fields, from ``slope_percent`` on.
    """
    stacked = np.frombuffer(b"".join(data), "<f8").reshape(len(data), -1)
    count = int(stacked[0, _NUMBERS - 1])
    return stacked[:, : _NUMBERS - 1], stacked[:, _NUMBERS : _NUMBERS + count], stacked[:, _NUMBERS + count :]


def symmetric(upper: Floats, size: int) -> Floats:
    """The symmetric matrix (size, size) with this upper triangle, row by row."""
    out = np.zeros((size, size))
    out[np.triu_indices(size)] = upper
    return np.asarray(out + np.triu(out, 1).T)
