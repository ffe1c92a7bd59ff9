"""Places between which what is learned of roads goes over smoothly, wherever a network is cut."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.frames import METRES_PER_DEGREE
from fusion.network.pass_columns import PassColumns
from fusion.network.road_beliefs import PLACE_M, Places, RoadBeliefs
from network_draws import driven_town, town, within


def test_shares_add_up_to_one_and_a_constant_stays_what_it_is() -> None:
    table = town(12, 9)
    places = Places(table)
    assert places.share.min() >= 0
    rows = np.arange(len(table))
    assert places.at_rows(np.ones(places.share.shape[1])) == pytest.approx(np.ones(len(table)))
    assert places.sums(rows).sum() == pytest.approx(len(table))
    assert places.sums(rows, 3.0 * rows) == pytest.approx(3.0 * places.sums(rows, rows.astype(float)))


def test_what_grows_evenly_to_the_north_does_so_between_the_places() -> None:
    table = town(12, 9)
    places = Places(table)
    north = 0.5 * (table.lat0_deg + table.lat1_deg) * METRES_PER_DEGREE / PLACE_M
    of_place = np.linalg.lstsq(places.share.toarray(), north, rcond=None)[0]
    assert places.at_rows(of_place) == pytest.approx(north, abs=1e-6)


def test_the_sums_of_parts_are_those_of_the_whole() -> None:
    """Places stay where they are on earth: also what is learned of a part is, away from its edge."""
    table = town(30, 20)
    west = table.lon0_deg < 8.5 + 0.009
    whole, part = Places(table), Places(table.subset(west))
    value = np.random.default_rng(1).uniform(size=len(table))
    number = np.arange(len(table))
    here = whole.at_rows(whole.sums(number, value))[west]
    there = part.at_rows(part.sums(np.arange(int(west.sum())), value[west]))
    inner = table.lon0_deg[west] < 8.5 + 0.009 - 2.1 * PLACE_M / (METRES_PER_DEGREE * np.cos(np.radians(49)))
    assert inner.any()
    assert there[inner] == pytest.approx(here[inner], rel=1e-9)


def test_roads_begin_as_rough_as_the_drives_about_them_learned() -> None:
    """In a part of a network as in the whole, but for what a drive far away weighs."""
    table, drives = driven_town(40, 12, 6, 5000.0)
    rows = table.lon0_deg < 8.516
    part, inside, _ = within(table, drives, rows)
    whole = RoadBeliefs(table, PassColumns.of(drives))
    own = RoadBeliefs(part, PassColumns.of(inside))
    near = part.lon0_deg < 8.516 - 2.1 * PLACE_M / (METRES_PER_DEGREE * np.cos(np.radians(49)))
    assert near.any()
    assert own.usual[near] == pytest.approx(whole.usual[rows][near], rel=0.02)
