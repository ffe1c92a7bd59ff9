"""One simulated drive: the truth, and what the receiver read of it.

Knows no file: a drive becomes one in ``write``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.simulate.motion.routes import Route, plan_route
from fusion.simulate.motion.vehicle import Driver, Motion, MotionState, move
from fusion.simulate.receiver.readings import (
    RECEIVERS,
    GnssReadings,
    InertialReadings,
    Mounting,
    ReceiverProfile,
    observe_gnss,
    observe_inertial,
)
from fusion.simulate.receiver.wheels import WheelReadings, WheelSet, observe_wheels
from fusion.simulate.scene.town import Town
from fusion.types import Floats, Ints

FIRST_START_S = 1_717_394_400.0
"""2024-06-03T06:00:00Z, when the drive of seed 0 begins."""
_BETWEEN_DRIVES_S = 5400.0


class Pass(NamedTuple):
    """One passage over a segment; times in seconds from the drive's beginning."""

    segment: int
    forward: bool
    start_s: float
    end_s: float
    driven_m: float


@dataclass(frozen=True)
class SimulatedDrive:
    """A drive through a town. ``time_s`` (Unix seconds, whole milliseconds) are the GNSS epochs.

    ``truth`` is the true state at the epochs; ``gnss``, ``inertial`` and, where asked for, ``wheels`` are the
    readings there. ``has_gnss`` is False in tunnels and outages, where the GNSS readings must not be used.
    """

    town: Town
    seed: int
    receiver: str
    rate_hz: float
    antenna_m: float
    start_time_s: float
    motion: Motion
    mounting: Mounting
    elapsed_s: Floats
    truth: MotionState
    gnss: GnssReadings
    inertial: InertialReadings
    has_gnss: NDArray[np.bool_]
    wheels: WheelReadings | None = None

    @property
    def profile(self) -> ReceiverProfile:
        """The receiver's error figures."""
        return RECEIVERS[self.receiver]

    @property
    def time_s(self) -> Floats:
        """Epochs, Unix seconds."""
        return self.start_time_s + self.elapsed_s

    def lonlat(self) -> tuple[Floats, Floats]:
        """Logged positions, degrees (lon, lat)."""
        return self.town.projection.to_lonlat(self.gnss.x_m, self.gnss.y_m)

    def inertial_at(self, elapsed_s: Floats) -> InertialReadings:
        """Inertial readings at other instants than the epochs, with noise of their own."""
        rng = np.random.default_rng([self.town.seed, self.seed, 24])
        return observe_inertial(self.motion.at(elapsed_s), self.profile, self.mounting, rng)

    @cached_property
    def _passes(self) -> tuple[Pass, ...]:
        t = np.arange(0.0, self.motion.duration_s, 0.1)
        state = self.motion.at(t)
        cuts = np.flatnonzero(np.diff(state.arc)) + 1
        first, stop = np.r_[0, cuts], np.r_[cuts, len(t)]
        driven = [np.ptp(state.distance_m[a:b]) for a, b in zip(first, stop, strict=True)]
        columns = (state.segment[first], state.forward[first], t[first], t[stop - 1], np.array(driven))
        return tuple(map(Pass._make, zip(*(c.tolist() for c in columns), strict=True)))

    def passes(self) -> tuple[Pass, ...]:
        """Every passage over a segment, in order."""
        return self._passes


def simulate_drive(
    town: Town,
    seed: int,
    duration_s: float = 600.0,
    *,
    rate_hz: float = 1.0,
    receiver: str = "m8",
    outages: Sequence[tuple[float, float]] = (),
    antenna_m: float = 1.55,
    start_time_s: float | None = None,
    visits: Ints | None = None,
    first: NDArray[np.bool_] | None = None,
    route: Route | None = None,
    wheels: WheelSet | None = None,
    driver: Driver = Driver(),  # noqa: B008  a tuple of numbers, never changed
) -> SimulatedDrive:
    """Drive a random route for ``duration_s``; everything random comes from the town's seed and ``seed``.

    ``outages`` are (start, length) in seconds from the drive's beginning, without GNSS as in tunnels.
    ``visits`` and ``first`` steer the route (``routes.plan_route``); the passes of this drive are added to
    ``visits``. A ``route`` is driven as it is, to its end at most. ``wheels`` adds readings of theirs from a
    stream of random numbers of its own: the rest of the drive is the same with and without.
    Raises ``UnknownNameError`` for an unknown receiver, ``ValueError`` for a duration, rate or top speed that is
    not positive.
    """
    if duration_s <= 0 or rate_hz <= 0 or driver.top_speed_mps <= 0:
        raise ValueError(
            f"a drive needs a positive duration and rate, not {duration_s} s at {rate_hz} Hz, and a top speed, not "
            f"{driver.top_speed_mps} m/s"
        )
    profile = RECEIVERS[receiver]

    def chance(k: int) -> np.random.Generator:
        return np.random.default_rng([town.seed, seed, k])

    if route is None:
        earlier = None if visits is None else visits.copy()
        route = plan_route(town, 1.3 * duration_s + 120.0, chance(20), visits=earlier, first=first)
    motion = move(town, route, duration_s, chance(21), springs=profile.springs, driver=driver)
    mounting = Mounting.draw(profile, chance(22))
    noise = chance(23)
    phase = float(noise.random()) / rate_hz
    elapsed = np.round(np.arange(phase, motion.duration_s, 1 / rate_hz), 3)
    truth = motion.at(elapsed)
    lost = town.roads.tunnel[truth.segment].copy()
    for begin, length in outages:
        lost |= (elapsed >= begin) & (elapsed < begin + length)
    start = FIRST_START_S + _BETWEEN_DRIVES_S * (seed % 5000) if start_time_s is None else start_time_s
    drive = SimulatedDrive(
        town=town,
        seed=seed,
        receiver=receiver,
        rate_hz=rate_hz,
        antenna_m=antenna_m,
        start_time_s=start,
        motion=motion,
        mounting=mounting,
        elapsed_s=elapsed,
        truth=truth,
        gnss=observe_gnss(truth, 1 / rate_hz, antenna_m, profile, mounting, noise),
        inertial=observe_inertial(truth, profile, mounting, noise),
        has_gnss=~lost,
        wheels=None if wheels is None else observe_wheels(motion, elapsed, wheels, chance(26)),
    )
    if visits is not None:
        np.add.at(visits, [p.segment for p in drive.passes()], 1)
    return drive
