"""How drives and homes are named, on a grid of quiet streets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from privacy import naming
from privacy.attacks import taken_back, told_anew
from privacy.city import City
from privacy.colluders import round_trip
from privacy.homes import BEHIND, behind_tips, name_homes
from privacy.naming import Evidence, Known, name_drives
from privacy.reading import Seen
from privacy.scoring import right_drives
from privacy.town import Trip, make_town
from web_fixtures import grid_roads

WINDOW = (8.39, 48.99, 8.43, 49.03)


@pytest.fixture(scope="module")
def city() -> City:
    roads = grid_roads()
    quiet = np.full(len(roads), "residential", object)
    return City(replace(roads, oneway=np.zeros(len(roads), np.int8), highway=quiet), WINDOW)


def corner_to_corner(city: City) -> np.ndarray:
    corners = city.nodes[np.argsort(city.place[city.nodes].sum(axis=1))[[0, -1]]]
    return city.ways(city.length_m).between(int(corners[0]), int(corners[1]))[0]


def test_ways_follow_each_other(city: City) -> None:
    ways = city.ways(city.length_m)
    one, other = int(city.nodes[0]), int(city.nodes[-1])
    rows, along = ways.between(one, other)
    tail = np.where(along, city.start[rows], city.end[rows])
    head = np.where(along, city.end[rows], city.start[rows])
    assert tail[0] == one
    assert head[-1] == other
    assert (head[:-1] == tail[1:]).all()
    assert city.metres(rows) == pytest.approx(ways.tree(one)[0][other])
    fan = ways.fan(one, np.array([one, other, int(city.nodes[5])]))
    assert len(fan[0]) == 0
    assert sorted(fan[1].tolist()) == sorted(rows.tolist())


def test_a_drive_that_alone_is_seen_is_named(city: City, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(naming, "MOST_ENDS", 20)
    rows = corner_to_corner(city)
    demand = np.zeros(len(city.length_m))
    demand[rows] = 1.0
    named = name_drives(city, Known([Evidence(demand, 1)], trimmed=False), np.random.default_rng(1))
    assert right_drives(named, [rows], city.length_m).all()


def test_homes_are_named_where_chains_end(city: City) -> None:
    rows = corner_to_corner(city)
    seen = np.zeros(len(city.length_m), bool)
    seen[rows] = True
    tips = [node for node, _ in city.tips(rows.tolist())]
    named = name_homes(city, behind_tips(city, [seen], trimmed=False), 2)
    apart = np.linalg.norm(named[:, None] - city.place[tips][None], axis=2)
    assert (apart.min(axis=0) < 200).all()


def test_homes_behind_what_is_left_out_are_in_reach_of_the_cut(city: City) -> None:
    middle = corner_to_corner(city)[4:-4]
    seen = np.zeros(len(city.length_m), bool)
    seen[middle] = True
    mass = behind_tips(city, [seen], trimmed=True)
    tips = [node for node, _ in city.tips(middle.tolist())]
    away = np.linalg.norm(city.place[:, None] - city.place[tips][None], axis=2).min(axis=1)
    assert mass.sum() == pytest.approx(2 * BEHIND)
    assert (away[mass > 0] <= 400).all()


def test_colluders_drive_every_road_once(city: City) -> None:
    wanted = np.zeros(len(city.length_m), bool)
    wanted[city.rows] = True
    assert sorted(round_trip(city, wanted).tolist()) == sorted(city.rows.tolist())


def test_what_is_told_anew_is_surer_and_what_is_taken_back_less_sure() -> None:
    counts = np.array([0, 5, 5, 5, 5])
    sigma = np.array([np.nan, 1.0, 1.0, 1.0, 1.0])
    before = Seen(counts, 10 * counts, np.zeros(5), sigma)
    now = Seen(np.array([5, 5, 5, 0, 5]), 10 * counts, np.zeros(5), np.array([1, 0.5, 0.999, np.nan, 1.5]))
    assert told_anew(before, now).tolist() == [True, True, False, False, False]
    less, gone = taken_back(before, now)
    assert less.tolist() == [3, 4]
    assert gone.tolist() == [3]


def test_the_town_is_the_same_for_the_same_seed() -> None:
    roads = grid_roads()
    kinds = np.where(np.arange(len(roads)) % 2 == 0, "residential", "tertiary").astype(object)
    city = City(replace(roads, oneway=np.zeros(len(roads), np.int8), highway=kinds), WINDOW)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("NEAREST_M", 300.0), ("WORK_PLACES", 5), ("SHOPS", 10)):
            patch.setattr(f"privacy.town.{name}", value)
        one, same = (make_town(city, 10, 20, 2, 3) for _ in range(2))
    assert [trip.rows.tolist() for trip in one.trips] == [trip.rows.tolist() for trip in same.trips]
    assert sum(len(one.of_week(week)) for week in range(2)) == len(one.trips)
    assert all(_ends_at_home(city, trip, one.owners[trip.owner].home) for trip in one.trips)


def _ends_at_home(city: City, trip: Trip, home: int) -> bool:
    ends = {int(n) for row in trip.rows[[0, -1]] for n in (city.start[row], city.end[row])}
    return home in ends
