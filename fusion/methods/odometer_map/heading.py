"""The heading of a vehicle that stands or creeps, where its velocity says nothing about it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fusion.methods.nine_state.measurements import heading_row
from fusion.methods.nine_state.motion import VX, VY
from fusion.types import Floats

_VAGUE_RAD = 0.5
_LEAST_SIGMA_RAD = 0.02
_BEND_PER_M = 0.05


@dataclass(frozen=True)
class RememberedHeading:
    """Where the nose points, radians from east, with its variance; infinite while that was never seen."""

    angle_rad: float = 0.0
    variance: float = math.inf

    @property
    def known(self) -> bool:
        """Whether it is good for anything."""
        return self.variance < _VAGUE_RAD**2

    def turned(self, turn_rad: float, variance: float) -> RememberedHeading:
        """After a turn to the left that wheels measured."""
        return RememberedHeading(self.angle_rad + turn_rad, self.variance + variance)

    def after_way(self, way_m: float) -> RememberedHeading:
        """After a way whose bends nobody measured."""
        return RememberedHeading(self.angle_rad, self.variance + (_BEND_PER_M * way_m) ** 2)

    def behind(self) -> RememberedHeading:
        """Turned about: what was taken for the nose is the tail."""
        return RememberedHeading(self.angle_rad + math.pi, self.variance)

    def renewed(
        self, state: Floats, covariance: Floats, slowest_mps: float, *, trust_reversal: bool = True
    ) -> RememberedHeading:
        """By the direction of a state (9,) that goes forwards and knows where to; else the old one.

        A velocity that swings through zero while a vehicle brakes points backwards. Without ``trust_reversal`` the
        nose does not follow it.
        """
        if math.hypot(state[VX], state[VY]) < slowest_mps:
            return self
        angle, row = heading_row(state)
        variance = float(row @ covariance @ row)
        reverse = self.known and math.cos(angle - self.angle_rad) < 0
        if variance > _VAGUE_RAD**2 or (reverse and not trust_reversal):
            return self
        return RememberedHeading(angle, max(variance, _LEAST_SIGMA_RAD**2))
