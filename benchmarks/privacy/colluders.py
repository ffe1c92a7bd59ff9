"""Accounts of the attacker: what they upload stands on every road, so that one owner more than they would tip counts.

Their drives are over the same land, by sensors like anybody's, so that nothing rejects them. Nothing joins their passes
but the account: a drive over every road of a town, whose heights went on from each to the next, could hardly be solved.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.types import Bools, Ints
from privacy.city import City
from privacy.recording import Recorder, on_its_own
from privacy.service import Service
from privacy.town import DAY_S, MONDAY_S, WEEK_S, Trip


class Colluders:
    """So many accounts of one attacker."""

    def __init__(self, city: City, service: Service, recorder: Recorder, count: int) -> None:
        self._city, self._service, self._recorder = city, service, recorder
        self._owners = [service.add_owner(f"fake {k}") for k in range(count)]

    def top_up(self, week: int, wanted: Bools) -> None:
        """Drive over these rows by every account, some day of the week."""
        rows = round_trip(self._city, wanted)
        for k, owner in enumerate(self._owners):
            if len(rows):
                start_s = MONDAY_S + week * WEEK_S + (1 + 2 * k) * DAY_S
                trip = Trip(-1 - k, week, start_s, rows, np.ones(len(rows), bool))
                driven = self._recorder.record(trip)
                alone = [on_its_own(factor) for factor in driven.factors]
                self._service.store(owner, replace(driven, factors=alone))


def round_trip(city: City, wanted: Bools) -> Ints:
    """These rows in an order in which neighbours mostly follow each other."""
    at = city.neighbours
    left = set(np.flatnonzero(wanted).tolist()) & set(city.rows.tolist())
    out: list[int] = []
    while left:
        waiting = [min(left)]
        while waiting:
            row = waiting.pop()
            if row not in left:
                continue
            left.remove(row)
            out.append(row)
            for node in (city.start[row], city.end[row]):
                waiting += [other for other in at[node] if other in left]
    return np.array(out, np.int64)
