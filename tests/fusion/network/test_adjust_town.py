"""The network adjustment on simulated drives through the town: what a further drive changes, and how far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from factor_support import (
    evidence_of,
)
from fusion.formats import read_log
from fusion.network.adjust import adjust
from fusion.network.evidence import SegmentEvidence
from fusion.network.pass_factor import PassFactor
from fusion.network.window import PUBLISH_RADIUS_M, WINDOW_RADIUS_M, gap_rows, neighbourhood
from fusion.pipeline import run_drive
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes

pytestmark = pytest.mark.slow

SLOPE_PERCENT, SIGMA_SHARE = 0.005, 0.02
"""What the place where the network is cut may change: the contract of the service."""


@dataclass(frozen=True)
class Driven:
    """The town's roads and the factors of simulated drives over them."""

    table: RoadTable
    truth: np.ndarray
    terrain: np.ndarray
    drives: tuple[tuple[PassFactor, ...], ...]

    def evidence(self, drives: Sequence[Sequence[PassFactor]]) -> dict[int, SegmentEvidence]:
        return evidence_of([f for drive in drives for f in drive])

    def solve(self, known: dict[int, SegmentEvidence], use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slope and sigma by row of the town, NaN where not solved."""
        rows = np.flatnonzero(use)
        found = adjust(self.table.subset(use), [known.get(r) for r in rows.tolist()], self.terrain[use], rows)
        out = np.full((2, len(self.table)), np.nan)
        out[:, rows] = found.slope_percent, found.slope_sigma_percent
        return out[0], out[1]

    def mask(self, rows: object) -> np.ndarray:
        return np.isin(np.arange(len(self.table)), list(rows))  # type: ignore[call-overload]

    def open(self, known: dict[int, SegmentEvidence]) -> np.ndarray:
        """Driven rows and gaps between them."""
        driven = self.mask(known)
        return driven | gap_rows(self.table, driven)


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
        drives.append(tuple(replace(f, segments=tuple(rows[s] for s in f.segments)) for f in result.factors))
    return Driven(town.roads, town.true_slope_percent, dem_slopes(dem, town.roads), tuple(drives))


def test_drives_solved_together_are_right_about_the_town_and_about_themselves(driven: Driven) -> None:
    known = driven.evidence(driven.drives)
    slope, sigma = driven.solve(known, driven.open(known))
    error = (slope - driven.truth)[driven.mask(known)]
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert np.mean(np.abs(error) <= 1.96 * sigma[driven.mask(known)]) > 0.9


@pytest.mark.parametrize("newest", range(7))
def test_a_further_drive_changes_its_surroundings_only_and_solving_those_is_enough(
    driven: Driven, newest: int
) -> None:
    """A stretch of each drive in turn comes to all the others: solved around it, and everywhere."""
    others = [drive for k, drive in enumerate(driven.drives) if k != newest]
    stretch = driven.drives[newest][20:32]
    before, after = driven.evidence(others), driven.evidence([*others, stretch])
    open_rows = driven.open(after)
    touched = driven.mask([f.segments[-1] for f in stretch])
    window = neighbourhood(driven.table, open_rows, touched, WINDOW_RADIUS_M)
    published = neighbourhood(driven.table, open_rows, touched, PUBLISH_RADIUS_M)
    was, _ = driven.solve(before, driven.open(before))
    slope, sigma = driven.solve(after, open_rows)
    near_slope, near_sigma = driven.solve(after, window)
    outside = driven.mask(before) & ~published
    assert np.abs(slope - was)[outside].max() < SLOPE_PERCENT
    inside = driven.mask(after) & published
    assert np.abs(near_slope - slope)[inside].max() < SLOPE_PERCENT
    assert np.abs(near_sigma / sigma - 1)[inside].max() < SIGMA_SHARE
    assert np.abs(slope - was)[touched & driven.mask(before)].max(initial=1.0) > SLOPE_PERCENT
