"""What a filter over the nine states is to the run that leads it through a drive: one protocol, and its messages.

What it says at each epoch is collected in ``EpochRows``: as a track, and as figures about the run; no slope is drawn
there. Nothing here says how a filter represents what it knows, nor where measurements come from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np

from fusion.errors import MissingSensorError
from fusion.messages import say
from fusion.published.epochs.table import Epochs
from fusion.published.nine_state.motion import STATES, STEEPEST_RAD, VX, VY, X, Y, Z
from fusion.roads.network import RoadNetwork
from fusion.types import Bools, Floats, Ints, Track

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


class EpochRows(NamedTuple):
    """What a filter said at each of n epochs; plain arrays, which compiled loops fill as well.

    ``done`` marks epochs that were filtered: at the others nothing counts. ``start`` marks those where the estimate
    begins anew, ``ground`` those that the terrain corrected, ``outlier`` fixes that can't be where the vehicle was.
    ``segment`` is -1 without a match. The other columns are those of ``Estimate``.
    """

    done: Bools
    start: Bools
    ground: Bools
    outlier: Bools
    resampled: Bools
    n_eff: Floats
    state: Floats
    heading_rad: Floats
    pitch_rad: Floats
    pitch_sigma_rad: Floats
    h_sigma_m: Floats
    z_sigma_m: Floats
    segment: Ints

    @classmethod
    def blank(cls, n: int) -> Self:
        """Rows for n epochs, nothing filtered yet."""
        flags = (np.zeros(n, bool) for _ in range(5))
        numbers = [np.zeros(n), np.zeros((n, STATES)), *(np.zeros(n) for _ in range(5))]
        return cls._make([*flags, *numbers, np.full(n, -1, np.int64)])

    def put(self, e: int, estimate: Estimate, segment: int) -> None:
        """Record the estimate at epoch ``e``."""
        self.done[e], self.segment[e] = True, segment
        for name, value in vars(estimate).items():
            getattr(self, name)[e] = value

    def track(self, epochs: Epochs, network: RoadNetwork, antenna_m: float) -> Track:
        """The filtered epochs; raises ``MissingSensorError`` where there is none."""
        if not self.done.any():
            raise MissingSensorError(say("method.no_epoch_with_height"))
        rows = EpochRows._make(column[self.done] for column in self)
        x, y, on = rows.state[:, X], rows.state[:, Y], rows.segment >= 0
        distance = np.full(len(x), np.nan)
        distance[on] = network.project_points(x[on], y[on], rows.segment[on])[2]
        # While standing, vz / v is no pitch: roads are not steeper than this.
        lift = antenna_m / np.cos(np.minimum(np.abs(rows.pitch_rad), STEEPEST_RAD))
        lon, lat = network.projection.to_lonlat(x, y)
        return Track(
            time_s=epochs.time_s[self.done],
            lat_deg=lat,
            lon_deg=lon,
            alt_m=rows.state[:, Z] - lift,
            h_sigma_m=rows.h_sigma_m,
            alt_sigma_m=rows.z_sigma_m,
            speed_mps=np.hypot(rows.state[:, VX], rows.state[:, VY]),
            heading_rad=np.mod(np.pi / 2 - rows.heading_rad, 2 * np.pi),
            pitch_rad=rows.pitch_rad,
            pitch_sigma_rad=rows.pitch_sigma_rad,
            segment=rows.segment,
            distance_m=distance,
            has_gnss=epochs.has_gnss[self.done],
            after_outage=rows.start,
        )

    def report(self, epochs: Epochs) -> dict[str, object]:
        """What the run says about itself, JSON-serialisable."""
        filtered = max(int(self.done.sum()), 1)
        return {
            "epochs_filtered": int(self.done.sum()),
            "outage_share": int((self.done & ~epochs.has_gnss).sum()) / filtered,
            "dem_used_share": int(self.ground.sum()) / filtered,
            "filter_starts": int(self.start.sum()),
            "gnss_outliers": int(self.outlier.sum()),
        }

    def cloud_report(self) -> dict[str, object]:
        """What a cloud of particles says besides: share of epochs resampled (57 % in the thesis), mean N_eff."""
        filtered = max(int(self.done.sum()), 1)
        return {
            "resampled_share": int(self.resampled.sum()) / filtered,
            "mean_n_eff": float(self.n_eff.sum()) / filtered,
        }
