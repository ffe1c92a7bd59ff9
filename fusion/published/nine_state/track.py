"""What a filter said at each epoch of a drive, collected: as a track, and as figures about the run.

Plain arrays, which compiled loops fill as well. No slope is drawn here.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from fusion.errors import MissingSensorError
from fusion.published.epochs.table import Epochs
from fusion.published.nine_state.motion import STATES, STEEPEST_RAD, VX, VY, X, Y, Z
from fusion.published.nine_state.protocol import Estimate
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints, Track

Flags = NDArray[np.bool_]


class EpochRows(NamedTuple):
    """What a filter said at each of n epochs; plain arrays, which compiled loops fill as well.

    ``done`` marks epochs that were filtered: at the others nothing counts. ``start`` marks those where the estimate
    begins anew, ``ground`` those that the terrain corrected, ``outlier`` fixes that can't be where the vehicle was.
    ``segment`` is -1 without a match. ``n_eff`` and ``resampled`` are about clouds of particles.
    """

    done: Flags
    start: Flags
    ground: Flags
    outlier: Flags
    resampled: Flags
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
        self.done[e] = True
        self.resampled[e], self.n_eff[e] = estimate.resampled, estimate.n_eff
        self.state[e], self.heading_rad[e] = estimate.state, estimate.heading_rad
        self.pitch_rad[e], self.pitch_sigma_rad[e] = estimate.pitch_rad, estimate.pitch_sigma_rad
        self.h_sigma_m[e], self.z_sigma_m[e] = estimate.h_sigma_m, estimate.z_sigma_m
        self.segment[e] = segment

    def track(self, epochs: Epochs, network: RoadNetwork, antenna_m: float) -> Track:
        """The filtered epochs; raises ``MissingSensorError`` where there is none."""
        if not self.done.any():
            raise MissingSensorError(
                "No epoch of the log has both a position and a height: it has no altitude (alt_msl_m or height_ell_m), "
                "and no elevation model that this method uses knows one along it. Record altitudes, or import a DEM "
                "that covers the drive."
            )
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
