"""Where an antenna truly was: along a winding route at constant speed, or on a simulated drive.

Streets and fronts live on a local plane (x east, y north, z up, metres); satellites in ECEF. A ride holds both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from fusion.frames import LocalProjection
from fusion.gnss.earth import ecef
from fusion.signals import gps_from_unix
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.town import GEOID_UNDULATION_M
from fusion.types import Floats

ANTENNA_M = 1.5
"""Height of the antenna above the road."""
ROUEN = LocalProjection(1.09, 49.44)
"""Where the thesis's bus line runs; only latitude matters, for the sky."""
ROUEN_EPOCHS, ROUEN_LENGTH_M = 594, 8236.0
"""Thesis section 3.3.6.1: 8236 m at 50 km/h, 1 Hz."""
ROUEN_START_S = 1_304_323_200.0
"""2011-05-02T08:00:00Z: any day would do."""
_BEND_M = 25.0
"""Width of the Gaussian that rounds corners: a right angle gets a radius of about 40 m, which is hard at 50 km/h."""
_LEG_M = (120.0, 600.0)
"""Shortest and longest way between two corners."""
_TURN_RAD = np.radians(60.0)
"""Legs leave the route's general direction by up to this."""
_SWEEP_RAD = np.radians(120.0)
"""The general direction turns by up to this over the whole route."""


@dataclass(frozen=True)
class Ride:
    """The antenna's truth at m epochs, ``time_s`` UTC Unix seconds.

    ``local_m`` and ``local_mps`` (m, 3) on the plane, ``position_m`` and ``velocity_mps`` (m, 3) in ECEF.
    """

    time_s: Floats
    local_m: Floats
    local_mps: Floats
    position_m: Floats
    velocity_mps: Floats

    def __len__(self) -> int:
        """How many epochs there are."""
        return len(self.time_s)

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

    def stretch(self, from_m: float, to_m: float) -> Floats:
        """The points between two distances, (j, 3), at least two."""
        along = self.along_m
        inside = along[(along > from_m) & (along < to_m)]
        at = np.concatenate([[from_m], inside, [to_m]])
        return np.column_stack([np.interp(at, along, self.points_m[:, k]) for k in range(3)])


def winding_route(length_m: float, rng: np.random.Generator) -> Route:
    """A route with corners and gentle hills, which does not cross itself."""
    legs: list[float] = []
    while sum(legs) < length_m + 100.0:
        legs.append(rng.uniform(*_LEG_M))
    share = np.arange(len(legs)) / len(legs)
    heading = rng.uniform(0, 2 * np.pi) + rng.uniform(-_SWEEP_RAD, _SWEEP_RAD) * share
    heading = heading + rng.uniform(-_TURN_RAD, _TURN_RAD, len(legs))
    leg = np.searchsorted(np.cumsum(legs), np.arange(0.0, length_m + 50.0))
    step = np.column_stack([np.sin(heading[leg]), np.cos(heading[leg])])
    step = gaussian_filter1d(step, _BEND_M, axis=0, mode="nearest")
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    xy = np.cumsum(step, axis=0)
    way, phases = np.arange(len(xy)), rng.uniform(0, 2 * np.pi, 3)
    waves = zip((2.0, 5.0, 12.0), (400.0, 1100.0, 3000.0), phases, strict=True)
    z = sum(height * np.sin(2 * np.pi * way / wave + phase) for height, wave, phase in waves)
    return Route(np.column_stack([xy, z]))


def ride_along(
    route: Route,
    epochs: int,
    speed_mps: float,
    *,
    interval_s: float = 1.0,
    start_time_s: float = ROUEN_START_S,
    plane: LocalProjection = ROUEN,
) -> Ride:
    """Drive a route at constant horizontal speed. Raises ``ValueError`` where it is too short for that."""
    along = route.along_m
    at = speed_mps * interval_s * np.arange(epochs, dtype=np.float64)
    if at[-1] > along[-1]:
        raise ValueError(
            f"the route is {along[-1]:.0f} m long, {epochs} epochs at {speed_mps:.1f} m/s take {at[-1]:.0f} m"
        )
    line = CubicSpline(along, route.points_m + np.array([0.0, 0.0, ANTENNA_M]))
    time_s = start_time_s + interval_s * np.arange(epochs, dtype=np.float64)
    return Ride.on_plane(time_s, line(at), line(at, 1) * speed_mps, plane)


def ride_of(drive: SimulatedDrive) -> Ride:
    """The antenna's truth on a simulated drive, on the town's plane."""
    truth = drive.truth
    local = np.column_stack([truth.x_m, truth.y_m, truth.z_m + drive.antenna_m])
    return Ride.on_plane(drive.time_s, local, truth.velocity_mps, drive.town.projection, GEOID_UNDULATION_M)
