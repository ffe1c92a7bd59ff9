"""The network adjustment on simulated drives through the town: in any order, without one, and how far one reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.subnetwork import gap_rows
from fusion.network.terrain import Terrain
from fusion.network.unknowns import RoadUnknowns, knot_positions
from fusion.pipeline import run_drive
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem

pytestmark = pytest.mark.slow

SETTLED = 1e-9
"""What order and deletion may change, sigmas."""
ROUNDING = 1e-7
"""What the order of the equations themselves may change, sigmas."""
FAR_SIGMAS = {0.9: 0.05, 0.99: 0.4}
"""What a stretch of a further drive may change where it does not go: sigmas by share of the segments."""


@dataclass(frozen=True)
class Driven:
    """The town's roads and the factors of simulated drives over them."""

    table: RoadTable
    truth: np.ndarray
    height_m: np.ndarray
    drives: tuple[tuple[PassFactor, ...], ...]

    def solve(self, numbers: Sequence[int], **extra: Sequence[PassFactor]) -> tuple[np.ndarray, Adjustment]:
        """The rows of the town that are driven or lie in between, and the solution over them.

        Drives by their numbers, in the order given; ``extra`` come under higher numbers.
        """
        said = {n: self.drives[n] for n in numbers} | {100 + k: v for k, v in enumerate(extra.values())}
        driven = np.isin(np.arange(len(self.table)), [f.segment for d in said.values() for f in d])
        use = driven | gap_rows(self.table, driven)
        rows = np.flatnonzero(use)
        row_of = np.full(len(self.table), -1)
        row_of[rows] = np.arange(len(rows))
        own = {n: [replace(f, segment=int(row_of[f.segment])) for f in d] for n, d in said.items()}
        knots = np.repeat(use, RoadUnknowns(self.table).intervals + 1)
        return rows, adjust(self.table.subset(use), own, Terrain(self.height_m[knots]))


@pytest.fixture(scope="module")
def driven(town: Town, tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """Seven drives by mixed receivers; the first ones pass most of the town."""
    folder: Path = tmp_path_factory.mktemp("driven")
    write_dem(town, folder / "dem.tif")
    dem, visits = Dem.open([folder / "dem.tif"]), np.zeros(len(town.roads), np.int64)
    columns = ("osm_way_id", "from_node", "to_node")
    row_of = {
        key: row
        for row, key in enumerate(zip(*(getattr(town.roads, c).tolist() for c in columns), strict=True))
    }
    drives = []
    for seed, receiver in enumerate(("m8", "f9p", "phone", "m8", "f9p", "m8", "f9p")):
        simulated = simulate_drive(
            town, 100 + seed, 500.0, receiver=receiver, visits=visits if seed < 4 else None
        )
        write_csv(simulated, folder / "log.csv")
        network, result = run_drive(read_log(folder / "log.csv"), town.roads, dem, method="profile")
        rows = [
            row_of[key] for key in zip(*(getattr(network.table, c).tolist() for c in columns), strict=True)
        ]
        drives.append(tuple(replace(f, segment=rows[f.segment]) for f in result.factors))
    return Driven(
        town.roads, town.true_slope_percent, dem.heights(*knot_positions(town.roads)), tuple(drives)
    )


def apart(left: Adjustment, right: Adjustment) -> float:
    """The largest difference of slopes, sigmas."""
    return float(np.max(np.abs(left.slope_percent - right.slope_percent) / left.slope_sigma_percent))


def test_drives_solved_together_are_right_about_the_town_and_about_themselves(driven: Driven) -> None:
    rows, found = driven.solve(range(7))
    mine = found.passes > 0
    error = (found.slope_percent - driven.truth[rows])[mine]
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert np.mean(np.abs(error) <= 1.96 * found.slope_sigma_percent[mine]) > 0.9
    gaps = found.passes + found.rejected == 0
    off = np.abs(found.slope_percent - driven.truth[rows])[gaps]
    assert gaps.any()
    assert np.all(np.isfinite(found.slope_sigma_percent))
    assert np.mean(off <= 1.96 * found.slope_sigma_percent[gaps]) > 0.9


def test_passes_are_accepted_but_for_a_few(driven: Driven) -> None:
    _, found = driven.solve(range(7))
    assert np.mean([not good for good in found.accepted.values()]) < 0.02


def test_the_order_of_arrival_does_not_matter(driven: Driven) -> None:
    _, first = driven.solve(range(7))
    _, turned = driven.solve((4, 6, 1, 0, 5, 3, 2))
    assert apart(first, turned) < SETTLED
    assert first.accepted == turned.accepted


def test_the_numbers_of_drives_do_not_matter(driven: Driven) -> None:
    """They are the order in which the equations are written down: nothing but rounding may follow from it."""
    _, first = driven.solve(range(7))
    mirrored = replace(driven, drives=driven.drives[::-1])
    _, turned = mirrored.solve(range(7))
    assert apart(first, turned) < ROUNDING
    assert first.slope_sigma_percent == pytest.approx(turned.slope_sigma_percent, rel=ROUNDING)


def test_a_deleted_drive_leaves_no_trace(driven: Driven) -> None:
    _, start = driven.solve((0, 1, 2, 3))
    driven.solve((0, 1, 2, 3, 4))
    _, end = driven.solve((3, 2, 1, 0))
    assert apart(start, end) < SETTLED


@pytest.mark.parametrize("newest", range(7))
def test_a_further_drive_changes_hardly_anything_where_it_did_not_go(driven: Driven, newest: int) -> None:
    """A stretch of each drive in turn comes to all the others."""
    others = [k for k in range(7) if k != newest]
    stretch = driven.drives[newest][20:32]
    rows, before = driven.solve(others)
    rows_after, after = driven.solve(others, newest=stretch)
    was = dict(
        zip(rows.tolist(), zip(before.slope_percent, before.slope_sigma_percent, strict=True), strict=True)
    )
    touched = {f.segment for f in stretch}
    moved = {
        row: abs(slope - was[row][0]) / was[row][1]
        for row, slope in zip(rows_after.tolist(), after.slope_percent.tolist(), strict=True)
        if row in was
    }
    far = [m for row, m in moved.items() if row not in touched]
    for share, sigmas in FAR_SIGMAS.items():
        assert np.quantile(far, share) < sigmas
    assert max((moved[row] for row in touched & moved.keys()), default=1.0) > np.quantile(far, 0.9)
