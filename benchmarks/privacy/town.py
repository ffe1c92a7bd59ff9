"""Two hundred people with homes, work and habits, and where they drive in four weeks: the truth of the attack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.types import Bools, Floats, Ints
from privacy.city import City, Ways

WEEK_S, DAY_S = 604_800.0, 86_400.0
MONDAY_S = 1_757_289_600.0
"""8 September 2025, 00:00 UTC."""
TASTE = 0.25
"""By how much, as a logarithm, one likes a road more than others do."""
NEAREST_M = 1_500.0
"""Work, shops and friends are at least so far away: nearer ones are walked to."""
WORK_PLACES, SHOPS, FRIENDS = 25, 30, 2
COMMUTES, ERRANDS = 0.6, 0.25
"""Shares of drives to or from work, and to shops and back; the others are to friends or home from them."""
STOP_S = 600.0
"""At the shop, with the receiver on."""


@dataclass(frozen=True, eq=False)
class Trip:
    """One drive: rows in the order of driving."""

    owner: int
    week: int
    start_s: float
    rows: Ints
    along: Bools
    """Whether each row is driven along its line."""
    stop_after: int | None = None
    """It stands still for ``STOP_S`` after so many rows."""


@dataclass(frozen=True, eq=False)
class Owner:
    """Somebody who lives at a node."""

    home: int
    work: int
    shops: tuple[int, ...]
    friends: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Town:
    """People and all of their drives, in the order of time."""

    city: City
    owners: list[Owner]
    trips: list[Trip]

    def of_week(self, week: int) -> list[Trip]:
        """The drives of a week."""
        return [trip for trip in self.trips if trip.week == week]

    @property
    def homes_m(self) -> Floats:
        """Where people live, (n, 2), m."""
        return self.city.place[[owner.home for owner in self.owners]]


def make_town(city: City, owners: int, drives: int, weeks: int, seed: int) -> Town:
    """People at random: who lives where, works where, drives when, and by which roads."""
    rng = np.random.default_rng(seed)
    work = rng.choice(city.busy, WORK_PLACES, replace=False)
    shops = rng.choice(city.busy, SHOPS, replace=False)
    homes = rng.choice(city.quiet, owners, replace=False)
    people = [_owner(city, home, homes, work, shops, rng) for home in homes.tolist()]
    tastes = [_taste(city, rng) for _ in people]
    # Everybody drives about as often as others do.
    turns = np.concatenate([rng.permutation(owners) for _ in range(-(-drives // owners))])[:drives]
    trips = [_trip(people[who], who, int(rng.integers(weeks)), tastes[who], rng) for who in turns.tolist()]
    return Town(city, people, sorted((t for t in trips if len(t.rows)), key=lambda trip: trip.start_s))


def _owner(city: City, home: int, homes: Ints, work: Ints, shops: Ints, rng: np.random.Generator) -> Owner:
    """Work places have a few large ones; shops are rather near."""

    def far(places: Ints) -> tuple[Ints, Floats]:
        distance = np.linalg.norm(city.place[places] - city.place[home], axis=1)
        return places[distance > NEAREST_M], distance[distance > NEAREST_M]

    size = 1.0 / (1.0 + np.arange(len(work)))
    kept = np.linalg.norm(city.place[work] - city.place[home], axis=1) > NEAREST_M
    job = int(rng.choice(work[kept], p=size[kept] / size[kept].sum()))
    places, distance = far(shops)
    near = places[np.argsort(distance)][:3]
    others, _ = far(homes)
    friends = rng.choice(others, FRIENDS, replace=False)
    return Owner(home, job, tuple(near.tolist()), tuple(friends.tolist()))


def _taste(city: City, rng: np.random.Generator) -> Ways:
    """Ways by time, of somebody who likes some roads better than others do."""
    way = np.unique(city.roads.osm_way_id, return_inverse=True)[1]
    liking = np.exp(TASTE * rng.normal(size=int(way.max()) + 1))
    return city.ways(city.seconds * liking[way])


def _trip(owner: Owner, who: int, week: int, ways: Ways, rng: np.random.Generator) -> Trip:
    day = MONDAY_S + week * WEEK_S + DAY_S * int(rng.integers(7))
    kind, back = rng.random(), bool(rng.random() < 0.5)
    if COMMUTES <= kind < COMMUTES + ERRANDS:
        shop = int(rng.choice(owner.shops))
        (there, along), (home, home_along) = ways.between(owner.home, shop), ways.between(shop, owner.home)
        rows, directions = np.concatenate([there, home]), np.concatenate([along, home_along])
        return Trip(who, week, day + 3600 * rng.uniform(9, 20), rows, directions, len(there))
    goal = owner.work if kind < COMMUTES else int(rng.choice(owner.friends))
    hours = (16.0, 19.0) if back else (6.5, 9.5)
    if kind >= COMMUTES:
        hours = (20.0, 23.0) if back else (14.0, 19.0)
    rows, directions = ways.between(goal, owner.home) if back else ways.between(owner.home, goal)
    return Trip(who, week, day + 3600 * rng.uniform(*hours), rows, directions)


def map_of_all(city: City, trips: Sequence[Trip]) -> Bools:
    """Which rows anybody drove."""
    driven = np.zeros(len(city.length_m), bool)
    for trip in trips:
        driven[trip.rows] = True
    return driven
