"""Several drives solved together: sigmas that are true of one drive stay true of eight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions
from fusion.pipeline import run_drive
from fusion.profile.method import adjusted_slopes
from fusion.roads.network import RoadNetwork
from fusion.simulate.drive import simulate_drive
from fusion.simulate.motion.routes import structures
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns
from profile_support import World, identities, log_of, whole

pytestmark = pytest.mark.slow

TOWNS = (1, 2)
DRIVES = 8
RECEIVERS = ("m8", "phone", "f9p", "m8")


@dataclass(frozen=True, eq=False)
class Together:
    """Eight drives of a town: errors and sigmas of each by itself, and of all of them solved together."""

    town: Town
    alone: list[tuple[np.ndarray, np.ndarray]]
    together: tuple[np.ndarray, np.ndarray]
    averaged: np.ndarray
    passes: np.ndarray


def solved(town: Town, drives: dict[int, list[PassFactor]], world: World) -> Adjustment:
    return adjust(town.roads, drives, Terrain(world.dem(town.seed).heights(*knot_positions(town.roads))))


@pytest.fixture(scope="module")
def towns(tmp_path_factory: pytest.TempPathFactory) -> list[Together]:
    world = World(tmp_path_factory.mktemp("profile"))
    return [drive_town(world, seed) for seed in TOWNS]


def drive_town(world: World, seed: int) -> Together:
    town = world.town(seed)
    row_of = {key: row for row, key in enumerate(identities(town.roads))}
    visits = np.zeros(len(town.roads), np.int64)
    everything: dict[int, list[PassFactor]] = {}
    alone, sums, known = [], np.zeros((2, len(town.roads))), set()
    for number in range(DRIVES):
        drive = simulate_drive(
            town,
            1000 * seed + number,
            400.0,
            receiver=RECEIVERS[number % len(RECEIVERS)],
            visits=visits if number < DRIVES // 2 else None,
            first=structures(town),
        )
        network, result = run_drive(log_of(csv_columns(drive)), town.roads, world.dem(seed))
        rows = np.array([row_of[key] for key in identities(network.table)])
        everything[number] = [in_town(f, rows) for f in result.factors]
        wanted = set(whole(town, drive))
        known |= wanted
        mine = [s for s in result.slopes if int(rows[s.segment]) in wanted]
        at = rows[[s.segment for s in mine]]
        slope = np.array([s.slope_percent for s in mine])
        sigma = np.array([s.slope_sigma_percent for s in mine])
        alone.append((slope - town.true_slope_percent[at], sigma))
        sums[0, at] += slope / sigma**2
        sums[1, at] += 1 / sigma**2
    solution = solved(town, everything, world)
    sure = np.array(sorted(known))
    error = solution.slope_percent[sure] - town.true_slope_percent[sure]
    averaged = sums[0, sure] / sums[1, sure] - town.true_slope_percent[sure]
    return Together(town, alone, (error, solution.slope_sigma_percent[sure]), averaged, solution.passes[sure])


def in_town(factor: PassFactor, rows: np.ndarray) -> PassFactor:
    """The factor with the town's number of its segment, by way of its bytes as it is stored."""
    return PassFactor.decode(factor.encode(), int(rows[factor.segment]), factor.sequence)


def share_inside(parts: list[tuple[np.ndarray, np.ndarray]]) -> float:
    return float(np.mean(np.concatenate([np.abs(e) <= 1.96 * s for e, s in parts])))


def test_each_drive_by_itself_is_calibrated(towns: list[Together]) -> None:
    assert 0.88 <= share_inside([part for one in towns for part in one.alone]) <= 1.0


def test_all_drives_together_are_calibrated(towns: list[Together]) -> None:
    parts = [one.together for one in towns]
    assert 0.88 <= share_inside(parts) <= 1.0
    assert share_inside([(e, 0.4 * s) for e, s in parts]) < 0.97, "sigmas that hold anything"


def test_segments_passed_often_are_calibrated_too(towns: list[Together]) -> None:
    """Errors that all drives share show where many passes meet."""
    often = [(one.together[0][one.passes >= 3], one.together[1][one.passes >= 3]) for one in towns]
    assert sum(len(e) for e, _ in often) > 50
    assert share_inside(often) >= 0.88


def test_together_is_better_than_alone_and_than_the_average(towns: list[Together]) -> None:
    def root(errors: list[np.ndarray]) -> float:
        return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))

    joint = root([one.together[0] for one in towns])
    assert joint < 0.9 * root([error for one in towns for error, _ in one.alone])
    assert joint < 1.05 * root([one.averaged for one in towns])
    assert all(np.all(np.isfinite(one.together[0])) for one in towns)


def test_a_drive_s_own_slopes_are_its_factors_solved_alone(tmp_path_factory: pytest.TempPathFactory) -> None:
    world = World(tmp_path_factory.mktemp("profile"))
    drive = world.drive(1, duration_s=200.0)
    network, result = run_drive(log_of(csv_columns(drive)), drive.town.roads, world.dem(1))
    assert isinstance(network, RoadNetwork)
    assert adjusted_slopes(network, result.factors, world.dem(1)) == result.slopes
    assert adjusted_slopes(network, (), None) == ()
