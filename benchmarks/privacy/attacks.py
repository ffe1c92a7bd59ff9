"""What the attacker does on the live map and on editions, and what the guesser does: names for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accuracy.scoring import show_progress
from fusion.types import Bools, Floats, Ints
from privacy.city import City
from privacy.colluders import Colluders
from privacy.homes import behind_tips
from privacy.naming import Evidence, Known, name_drives
from privacy.reading import Eyes, Seen
from privacy.recording import Recorder
from privacy.service import Server, Service
from privacy.town import Town, map_of_all

GREW = 0.02
"""A sigma that fell by so much fell because somebody drove there: what neighbours pass on is less."""
REMOVED = 0.01
"""A sigma that rose by so much rose because somebody's drives were taken back."""


@dataclass(frozen=True, eq=False)
class Names:
    """What somebody named."""

    drives: list[Ints]
    homes: Floats
    """How many live at each node, as far as that is suggested, (nodes,)."""


@dataclass(frozen=True, eq=False)
class World:
    """What every run begins from."""

    server: Server
    city: City
    ids: Ints
    town: Town
    weeks: int
    seed: int

    def recorder(self) -> Recorder:
        """The receivers of the town."""
        return Recorder(self.city, self.seed)

    def owners_in(self, service: Service) -> list[int]:
        """The town's people as the service numbers them."""
        return [service.add_owner(f"owner {k}") for k in range(len(self.town.owners))]

    @property
    def per_week(self) -> list[int]:
        """Drives of each week."""
        return [len(self.town.of_week(week)) for week in range(self.weeks)]


def attack_live(world: World) -> Names:
    """Look before and after each drive: where drives are counted that were not, it was."""
    recorder, named = world.recorder(), list[Ints]()
    with world.server.service("live", world.ids) as service, service.public(public_map="live") as client:
        owners, eyes = world.owners_in(service), Eyes(client, world.ids)
        before = eyes.begin()
        for number, trip in enumerate(world.town.trips):
            show_progress(f"live: drive {number + 1} of {len(world.town.trips)}")
            service.store(owners[trip.owner], recorder.record(trip))
            service.solve()
            now = eyes.changes(before)
            named.append(np.flatnonzero(now.drives > before.drives))
            before = now
    masks = [_mask(world.city, rows) for rows in named]
    mass = behind_tips(world.city, masks, trimmed=False)
    return Names(named, mass)


@dataclass(frozen=True, eq=False)
class Taken:
    """After the removal of an owner: rows that the attacker takes for the owner's, and which of these are gone."""

    owner: int
    named: Ints
    gone: Ints


@dataclass(frozen=True, eq=False)
class Editions:
    """What was seen of a service that publishes editions."""

    seen: list[Seen]
    removals: list[Taken]


def publish_editions(
    world: World, name: str, accounts: int, removals: Sequence[int] = (), **settings: object
) -> Editions:
    """Weeks of drives, topped up by so many accounts before each edition; then these owners are removed, one an
    edition."""
    recorder = world.recorder()
    with world.server.service(name, world.ids) as service:
        owners = world.owners_in(service)
        colluders = Colluders(world.city, service, recorder, accounts)
        looks, wanted = [Seen.nothing(len(world.ids))], _mask(world.city, world.city.rows)
        with service.public(public_map="releases", **settings) as client:
            eyes = Eyes(client, world.ids)
            for week in range(world.weeks):
                show_progress(f"{name}: edition {week + 1} of {world.weeks}")
                for trip in world.town.of_week(week):
                    service.store(owners[trip.owner], recorder.record(trip))
                colluders.top_up(week, wanted)
                service.release(week, **settings)
                looks.append(eyes.everything())
                wanted = told_anew(looks[-2], looks[-1])
            taken, before = [], looks[-1]
            for number, who in enumerate(removals):
                show_progress(f"{name}: removal {number + 1} of {len(removals)}")
                service.remove(owners[who])
                service.release(world.weeks + number, **settings)
                now = eyes.everything()
                taken.append(Taken(who, *taken_back(before, now)))
                before = now
    return Editions(looks[1:], taken)


def told_anew(before: Seen, now: Seen) -> Bools:
    """Rows at which an edition tells passes that the one before did not."""
    with np.errstate(invalid="ignore"):
        surer = now.sigma < (1 - GREW) * before.sigma
    return np.asarray(now.told & (~before.told | surer | (now.drives > before.drives)))


def taken_back(before: Seen, now: Seen) -> tuple[Ints, Ints]:
    """Rows of which an edition no longer tells what the one before told, and those of them that are unknown now."""
    gone = before.told & ~now.told
    with np.errstate(invalid="ignore"):
        less_sure = now.sigma > (1 + REMOVED) * before.sigma
    less = gone | (before.told & (less_sure | (now.observations < before.observations)))
    return np.flatnonzero(less), np.flatnonzero(gone)


def attack_editions(world: World, editions: Editions, owners: int) -> Names:
    """Name from what each edition tells anew, that being of ``owners`` people at least."""
    empty = Seen.nothing(len(world.ids))
    anew = [told_anew(a, b) for a, b in zip([empty, *editions.seen], editions.seen, strict=False)]
    times = np.maximum(np.sum(anew, axis=0), 1)
    demand = [np.where(new, np.maximum(owners, editions.seen[-1].drives / times), 0.0) for new in anew]
    known = Known([Evidence(d, n) for d, n in zip(demand, world.per_week, strict=True)], trimmed=True)
    sets = [*anew, editions.seen[-1].told]
    return _names(world, known, behind_tips(world.city, sets, trimmed=True))


def guess_from_edition(world: World, last: Seen) -> Names:
    """Name from the last edition alone: the map of all, as everybody may read it."""
    known = Known([Evidence(last.drives.astype(float), len(world.town.trips))], trimmed=True)
    return _names(world, known, behind_tips(world.city, [last.told], trimmed=True))


def guess_from_roads(world: World) -> Names:
    """Name from which roads anybody drove, however few, to their ends; not who, when or how often."""
    driven = map_of_all(world.city, world.town.trips)
    known = Known([Evidence(driven.astype(float), len(world.town.trips))], trimmed=False)
    return _names(world, known, behind_tips(world.city, [driven], trimmed=False))


def _names(world: World, known: Known, mass: Floats) -> Names:
    drives = name_drives(world.city, known, np.random.default_rng(world.seed))
    return Names(drives, mass)


def withheld(world: World, owners: Sequence[int]) -> list[tuple[int, int, float, float]]:
    """For each number k of ``owners``: how many are needed, and the shares of driven rows and of driven length that are
    not to be seen after all weeks, without any account of an attacker."""
    driven, recorder = map_of_all(world.city, world.town.trips), world.recorder()
    length, out = world.city.length_m, []
    with world.server.service("withheld", world.ids) as service:
        numbers = world.owners_in(service)
        for trip in world.town.trips:
            service.store(numbers[trip.owner], recorder.record(trip))
        # From the most on: what many are told of, fewer would be told of as well.
        for edition, k in enumerate(sorted(owners, reverse=True)):
            show_progress(f"withheld at {k}")
            asked = {"public_map": "releases", "public_owners": k}
            service.release(edition, **asked)
            with service.public(**asked) as client:
                lost = driven & ~Eyes(client, world.ids).everything().told
            needed = service.settings.model_copy(update=asked).owners_needed
            out.append((k, needed, lost.sum() / driven.sum(), length[lost].sum() / length[driven].sum()))
    return out[::-1]


def _mask(city: City, rows: Ints) -> Bools:
    mask = np.zeros(len(city.length_m), bool)
    mask[rows] = True
    return mask
