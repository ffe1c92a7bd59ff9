"""Viandier's simulated run on a bus line of Rouen (3.3.6.1), drawn anew for each seed: the scene is not public."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from fusion.frames import LocalProjection
from fusion.published.canyon.drive import CanyonDrive, simulate_canyon
from fusion.published.canyon.fronts import NO_FRONTS, STREETS, Fronts, fronts_along
from fusion.published.canyon.radio import Radio
from fusion.published.canyon.ride import Ride, Route
from fusion.published.canyon.sky import synthetic_navigation
from fusion.signals import GPS
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

MIXED = {"open": 0.15, "residential": 0.3, "industrial": 0.2, "urban": 0.25, "dense": 0.1}
"""Shares of the way of a mixed run, as a bus line from suburb through centre to suburb has them (chosen by us)."""

STUDY = Radio(1.0, False, 0.0, 4.0, 0.1, 0.0, 0.0, 3.0, 12.0, 0.0, 0.0, 0.0, 0.0, 0)
"""The thesis's simulation (section 3.4 of the digest): range plus detour plus N(0, 1), clock 0, and the reception state
known: the weakest direct ray has 41.6 dB-Hz and the strongest reflected one 37.7, so that 40 tells them apart."""
BLURRED = STUDY._replace(cn0_sigma_db=1.0, fading_db=2.0, loss_db=np.nan)
"""As ``STUDY``, but C/N0 is what a receiver sees: it fades, and fronts differ in what they swallow."""


def rouen(
    seed: int,
    radio: Radio = STUDY,
    systems: tuple[int, ...] = (GPS,),
    shares: dict[str, float] | None = None,
) -> CanyonDrive:
    """A run as the thesis's on Rouen's bus line: 594 epochs at 1 Hz, 8236 m at 50 km/h, mixed surroundings.

    ``shares`` are those of the street classes along the way (``MIXED``). The thesis's scene is not public:
    route, fronts and sky are drawn anew for each seed.
    """
    rng = np.random.default_rng([seed, 12])
    route = winding_route(ROUEN_LENGTH_M, rng)
    ride = ride_along(route, ROUEN_EPOCHS, ROUEN_LENGTH_M / (ROUEN_EPOCHS - 1))
    navigation = synthetic_navigation(float(ride.gps_s[0]), float(ROUEN_EPOCHS), rng, systems)
    return simulate_canyon(ride, fronts_of_route(route, rng, shares), radio, navigation, rng)


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


def ride_along(route: Route, epochs: int, speed_mps: float, *, interval_s: float = 1.0) -> Ride:
    """Drive a route at constant horizontal speed. Raises ``ValueError`` where it is too short for that."""
    along = route.along_m
    at = speed_mps * interval_s * np.arange(epochs, dtype=np.float64)
    if at[-1] > along[-1]:
        raise ValueError(
            f"the route is {along[-1]:.0f} m long, {epochs} epochs at {speed_mps:.1f} m/s take {at[-1]:.0f} m"
        )
    line = CubicSpline(along, route.points_m + np.array([0.0, 0.0, ANTENNA_M]))
    time_s = ROUEN_START_S + interval_s * np.arange(epochs, dtype=np.float64)
    return Ride.on_plane(time_s, line(at), line(at, 1) * speed_mps, ROUEN)


def stretch(route: Route, from_m: float, to_m: float) -> Floats:
    """A route's points between two distances, (j, 3), at least two."""
    along = route.along_m
    inside = along[(along > from_m) & (along < to_m)]
    at = np.concatenate([[from_m], inside, [to_m]])
    return np.column_stack([np.interp(at, along, route.points_m[:, k]) for k in range(3)])


def fronts_of_route(route: Route, rng: np.random.Generator, shares: dict[str, float] | None = None) -> Fronts:
    """Fronts along a whole route, in stretches of 150 to 500 m whose classes are drawn by ``shares`` (``MIXED``)."""
    shares = shares or MIXED
    names, weights = list(shares), np.array(list(shares.values()))
    length, at, parts = float(route.along_m[-1]), 0.0, []
    while at < length:
        to = min(at + rng.uniform(150.0, 500.0), length)
        kind = STREETS[names[rng.choice(len(names), p=weights / weights.sum())]]
        if to - at > 2.0:
            parts.append(fronts_along(Route(stretch(route, at, to)), kind, rng))
        at = to
    return NO_FRONTS.joined(*parts).clear_of(route.points_m[:, :2])
