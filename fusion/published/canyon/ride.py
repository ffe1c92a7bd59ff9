"""Where an antenna truly was on a simulated drive.

Streets and fronts live on a local plane (x east, y north, z up, metres); satellites in ECEF. A ride holds both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.arrays import ColumnTable
from fusion.frames import LocalProjection
from fusion.gnss.earth import ecef
from fusion.signals import gps_from_unix
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.town import GEOID_UNDULATION_M
from fusion.types import Floats


@dataclass(frozen=True)
class Ride(ColumnTable):
    """The antenna's truth at m epochs, ``time_s`` UTC Unix seconds.

    ``local_m`` and ``local_mps`` (m, 3) on the plane, ``position_m`` and ``velocity_mps`` (m, 3) in ECEF.
    """

    time_s: Floats
    local_m: Floats
    local_mps: Floats
    position_m: Floats
    velocity_mps: Floats

    @property
    def gps_s(self) -> Floats:
        """The times in GPS seconds, (m,)."""
        return gps_from_unix(self.time_s)

    @classmethod
    def on_plane(
        cls, time_s: Floats, local_m: Floats, local_mps: Floats, plane: LocalProjection, datum_m: float = 0.0
    ) -> Ride:
        """From places and velocities on the plane; heights above the ellipsoid are z plus ``datum_m``."""

        def places(xyz: Floats) -> Floats:
            lon, lat = plane.to_lonlat(xyz[:, 0], xyz[:, 1])
            return ecef(lon, lat, xyz[:, 2] + datum_m)

        half = 0.5 * local_mps  # a difference over one second: the plane's curvature cancels
        velocity = places(local_m + half) - places(local_m - half)
        return cls(time_s, local_m, local_mps, places(local_m), velocity)


@dataclass(frozen=True)
class Route:
    """A line on the plane, ``points_m`` (k, 3) about every metre, z the road's height."""

    points_m: Floats

    @property
    def along_m(self) -> Floats:
        """Horizontal way from the beginning, (k,)."""
        steps = np.hypot(*np.diff(self.points_m[:, :2], axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])


def ride_of(drive: SimulatedDrive) -> Ride:
    """The antenna's truth on a simulated drive, on the town's plane."""
    truth = drive.truth
    local = np.column_stack([truth.x_m, truth.y_m, truth.z_m + drive.antenna_m])
    return Ride.on_plane(drive.time_s, local, truth.velocity_mps, drive.town.projection, GEOID_UNDULATION_M)
