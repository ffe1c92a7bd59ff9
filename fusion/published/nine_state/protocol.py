"""What a filter over the nine states is to the run that leads it through a drive: one protocol, and its messages.

Nothing here says how a filter represents what it knows, nor where measurements come from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fusion.types import Floats

_FEWEST_PARTICLES = 3.0  # effective ones (N_eff) of a cloud that has not collapsed


class EpochFilter(Protocol):
    """A filter over the nine states: ``restart`` once, then ``sense`` and ``locate`` at each epoch."""

    def restart(self, mean: Floats, sigma: Floats) -> None:
        """Begin anew around ``mean`` (9,) with standard deviations ``sigma`` (9,)."""
        ...

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        """Predict over ``dt_s`` (None: no prediction) and correct by what the vehicle's sensors say."""
        ...

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        """Correct by the matched road point and by the terrain's height where there are any, and estimate."""
        ...


@dataclass(frozen=True)
class Measurement:
    """What the sensors say at one epoch: values and inverse variances, 0 where a sensor says nothing.

    ``z`` and ``inv_var`` (9,) address the states directly: GNSS position, Doppler velocity, acceleration. ``wheels``
    is None where the filter is not to look at them.
    """

    z: Floats
    inv_var: Floats
    pitch_rad: float = 0.0
    inv_var_pitch: float = 0.0
    wheels: WheelReading | None = None


@dataclass(frozen=True)
class WheelReading:
    """What the wheels say over the last ``dt``: rotations in radians (left, right), or one speed in m/s.

    Any of them may be NaN; ``speed_mps`` counts only where a rotation is missing.
    """

    left_rad: float
    right_rad: float
    speed_mps: float


@dataclass(frozen=True)
class PredictedMap:
    """Zhat (2.26) and its covariance P (2.30) over x, y, heading, after the sensors' corrections."""

    x_m: float
    y_m: float
    heading_rad: float
    covariance: Floats


Road = tuple[float, float, float]
"""A matched point: x, y in metres and the direction of the road as it is driven, radians from east."""


@dataclass(frozen=True)
class Estimate:
    """State (9,), attitude and spread after all corrections, (2.36)-(2.38).

    ``n_eff`` and ``resampled`` belong to clouds of particles; other filters leave them.
    """

    state: Floats
    heading_rad: float
    pitch_rad: float
    pitch_sigma_rad: float
    h_sigma_m: float
    z_sigma_m: float
    n_eff: float = 0.0
    resampled: bool = False

    @property
    def collapsed(self) -> bool:
        """Whether one or two particles have all the weight and have just been copied to all places: such a cloud says
        nothing of its own error, and the filter has to begin anew."""
        return self.resampled and self.n_eff < _FEWEST_PARTICLES
