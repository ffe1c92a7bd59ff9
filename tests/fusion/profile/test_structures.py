"""Bridges and tunnels: heights come from the drive where the elevation model shows the ground instead."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest

from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import structures
from fusion.terrain.dem import Dem
from profile_support import Outcome, World, coverage, inside

pytestmark = pytest.mark.slow

ENOUGH = 20
LUCK = 1.3
"""A root mean square of 20 to 50 errors is known to 10 to 15 %, and errors of neighbours are not independent."""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return World(tmp_path_factory.mktemp("profile"))


@pytest.fixture(scope="module")
def drives(world: World) -> list[SimulatedDrive]:
    """Some drives a town, each to what the ones before left out: bridges, the motorway and the tunnel."""
    found = []
    for seed in (1, 2, 3):
        town = world.town(seed)
        visits = np.zeros(len(town.roads), np.int64)
        for number, receiver in enumerate(("m8", "f9p", "m8")):
            found.append(
                simulate_drive(
                    town,
                    1000 * seed + number,
                    500.0,
                    receiver=receiver,
                    visits=visits,
                    first=structures(town),
                )
            )
    return found


@pytest.fixture(scope="module")
def outcomes(world: World, drives: list[SimulatedDrive]) -> list[Outcome]:
    return [world.outcome(drive) for drive in drives]


def squares(outcomes: list[Outcome], on: str) -> np.ndarray:
    picked = []
    for o in outcomes:
        mask = {
            "bridge": o.town.roads.bridge[o.segment],
            "tunnel": o.town.roads.tunnel[o.segment],
            "structure": o.structure,
            "open": ~o.structure,
        }[on]
        picked.append(o.error[mask] ** 2)
    return np.concatenate(picked)


def root(squares: np.ndarray) -> float:
    return float(np.sqrt(np.mean(squares)))


def test_the_drives_pass_bridges_and_tunnels_without_gnss(
    outcomes: list[Outcome], drives: list[SimulatedDrive]
) -> None:
    assert len(squares(outcomes, "structure")) >= ENOUGH
    assert len(squares(outcomes, "tunnel")) >= 3
    assert sum(int((~drive.has_gnss).sum()) for drive in drives) > 10
    assert coverage(outcomes) >= 0.97


def test_structures_are_as_good_as_the_open_road(outcomes: list[Outcome]) -> None:
    assert root(squares(outcomes, "structure")) <= LUCK * root(squares(outcomes, "open"))


def test_bridges_are_as_good_as_the_open_road(outcomes: list[Outcome]) -> None:
    assert root(squares(outcomes, "bridge")) <= LUCK * root(squares(outcomes, "open"))


def test_sigmas_are_true_on_structures(outcomes: list[Outcome]) -> None:
    errors = np.concatenate([o.error[o.structure] for o in outcomes])
    sigmas = np.concatenate([o.sigma[o.structure] for o in outcomes])
    assert np.mean(np.abs(errors) <= 1.96 * sigmas) > 0.85


def test_the_elevation_model_alone_is_several_times_worse(
    outcomes: list[Outcome], drives: list[SimulatedDrive], world: World
) -> None:
    by_dem = [world.outcome(drive, method="dem") for drive in drives]
    assert len(squares(by_dem, "structure")) >= ENOUGH
    assert root(squares(outcomes, "structure")) < root(squares(by_dem, "structure")) / 4


def straight_lines(drive: SimulatedDrive, dem: Dem) -> dict[int, float]:
    """What maps do: the ground's height at both ends of a structure, a straight line in between; by segment."""
    town = drive.town
    found: dict[int, float] = {}
    structure = town.roads.bridge | town.roads.tunnel
    for on_structure, group in groupby(drive.passes(), key=lambda p: bool(structure[p.segment])):
        run = list(group)
        if not on_structure:
            continue
        first, last = run[0], run[-1]
        a = town.start[first.segment] if first.forward else town.end[first.segment]
        b = town.end[last.segment] if last.forward else town.start[last.segment]
        height = dem.heights(town.node_lon_deg[[a, b]], town.node_lat_deg[[a, b]])
        grade = 100 * (height[1] - height[0]) / sum(town.length_m[p.segment] for p in run)
        found |= {p.segment: grade if p.forward else -grade for p in run}
    return found


def test_the_straight_line_between_the_ends_is_worse(
    outcomes: list[Outcome], drives: list[SimulatedDrive], world: World
) -> None:
    ours, line = [], []
    for outcome, drive in zip(outcomes, drives, strict=True):
        straight = straight_lines(drive, world.dem(drive.town.seed))
        for segment, error in zip(outcome.segment.tolist(), outcome.error.tolist(), strict=True):
            if np.isfinite(straight.get(segment, np.nan)):
                line.append(straight[segment] - drive.town.true_slope_percent[segment])
                ours.append(error)
    assert len(ours) >= ENOUGH
    assert root(np.square(ours)) < root(np.square(line)) / 4


def test_a_tunnel_does_not_spoil_what_comes_after(outcomes: list[Outcome]) -> None:
    """Segments that share a node with a tunnel are known as well as the others."""
    errors = []
    for o in outcomes:
        town = o.town
        portals = np.concatenate([town.start[town.roads.tunnel], town.end[town.roads.tunnel]])
        beside = np.isin(town.start[o.segment], portals) | np.isin(town.end[o.segment], portals)
        errors.append(o.error[beside & ~town.roads.tunnel[o.segment]])
    beside_errors = np.concatenate(errors)
    assert len(beside_errors) >= 2
    assert root(beside_errors**2) < 2 * root(squares(outcomes, "open"))
    assert inside(outcomes) > 0.88
