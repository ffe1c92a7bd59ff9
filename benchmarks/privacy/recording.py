"""What a worker stores of a drive: passes with their times, and the track, standing still included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from accuracy.adjustment_drives import Synthetic
from fusion.network.pass_factor import NUISANCES, PassFactor
from fusion.types import Floats, Ints, Track
from privacy.city import City
from privacy.town import STOP_S, Trip

FREE = 1e-6
"""Information on each of a drive's unknowns that is as good as none."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What came of one drive, by rows of the city."""

    factors: list[PassFactor]
    track: Track


class Recorder:
    """Receivers of the town: all drive over the same land."""

    def __init__(self, city: City, seed: int) -> None:
        self._city = city
        self._sensors = Synthetic(city.roads, seed)

    def record(self, trip: Trip) -> Recorded:
        """The passes and the track of a trip."""
        factors = self._sensors.drive(trip.rows.tolist())
        later = trip.start_s - factors[0].first_time_s
        stop = len(factors) if trip.stop_after is None else trip.stop_after
        timed = [_moved(f, later + (STOP_S if f.sequence >= stop else 0.0)) for f in factors]
        return Recorded(timed, self._track(trip, timed))

    def _track(self, trip: Trip, factors: Sequence[PassFactor]) -> Track:
        """A position a second."""
        enter = np.array([f.first_time_s for f in factors])
        leave = np.array([f.last_time_s for f in factors])
        time = np.arange(enter[0], leave[-1] + 0.5)
        k = np.searchsorted(enter, time, "right") - 1
        share = np.clip((time - enter[k]) / np.maximum(leave[k] - enter[k], 1e-9), 0, 1)
        rows, along = trip.rows[k], trip.along[k]
        at = np.where(along, share, 1 - share)
        place = self._between(self._city.degrees, rows, at)
        step = np.gradient(self._between(self._city.place, rows, at), axis=0)
        unknown = np.full(len(time), np.nan)
        return Track(
            time_s=time,
            lat_deg=place[:, 1],
            lon_deg=place[:, 0],
            alt_m=unknown,
            h_sigma_m=np.full(len(time), 2.0),
            alt_sigma_m=unknown,
            speed_mps=np.hypot(*step.T),
            heading_rad=np.arctan2(*step.T) % (2 * np.pi),
            pitch_rad=unknown,
            pitch_sigma_rad=unknown,
            segment=rows.astype(np.int64),
            distance_m=at * self._city.length_m[rows],
            has_gnss=np.ones(len(time), bool),
            after_outage=np.zeros(len(time), bool),
        )

    def _between(self, places: Floats, rows: Ints, share: Floats) -> Floats:
        """Places at shares of rows, (n, 2)."""
        start, end = places[self._city.start[rows]], places[self._city.end[rows]]
        return np.asarray(start + share[:, None] * (end - start))


def on_its_own(factor: PassFactor) -> PassFactor:
    """The same pass as if nothing of the drive were known elsewhere: what it says of grades is left."""
    information, vector = factor.information.copy(), factor.vector.copy()
    knots = len(vector) - NUISANCES
    with_drive, of_drive = information[:knots, knots:], information[knots:, knots:] + FREE * np.eye(NUISANCES)
    given = np.linalg.solve(of_drive, np.column_stack([with_drive.T, vector[knots:]]))
    left = factor.square - float(vector[knots:] @ given[:, -1])
    vector[:knots] -= with_drive @ given[:, -1]
    information[:knots, :knots] -= with_drive @ given[:, :-1]
    information[knots:] = information[:, knots:] = vector[knots:] = 0.0
    return replace(factor, information=(information + information.T) / 2, vector=vector, square=left)


def _moved(factor: PassFactor, later_s: float) -> PassFactor:
    first, last = factor.first_time_s + later_s, factor.last_time_s + later_s
    return replace(factor, first_time_s=first, last_time_s=last)
