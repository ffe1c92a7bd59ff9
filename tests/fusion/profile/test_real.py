"""Recorded roads: receivers simulated over precise reference tracks, and one real log."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.pipeline import run_drive
from fusion.roads.osm import read_roads
from fusion.terrain.dem import Dem
from profile_support import identities

pytestmark = pytest.mark.slow

Key = tuple[int, int, int]
ROADS = {"00": "roads_00.osm", "09": "roads_09_10.osm", "10": "roads_09_10.osm"}


def folder_of(shared_data: Path, name: str) -> Path:
    folder = shared_data / name
    if not folder.is_dir():
        pytest.skip(f"the recorded data ../shared/data/{name} is not on this machine")
    return folder


def true_slopes(path: Path) -> dict[Key, float]:
    with path.open(newline="") as file:
        return {
            (int(r["osm_way_id"]), int(r["from_node"]), int(r["to_node"])): float(r["slope_percent"])
            for r in csv.DictReader(file)
        }


def score(log: Path, roads: Path, dem: Dem | None, truth: dict[Key, float]) -> tuple[float, float, float]:
    """Coverage, RMSE (%) and share of errors within 1.96 sigma."""
    network, result = run_drive(read_log(log), read_roads(roads), dem)
    keys = identities(network.table)
    got = {keys[s.segment]: s for s in result.slopes}
    both = [key for key in truth if key in got]
    error = np.array([got[key].slope_percent - truth[key] for key in both])
    sigma = np.array([got[key].slope_sigma_percent for key in both])
    inside = float(np.mean(np.abs(error) <= 1.96 * sigma))
    return len(both) / len(truth), float(np.sqrt(np.mean(error**2))), inside


@pytest.mark.parametrize("name", ROADS)
def test_karlsruhe(name: str, karlsruhe: Path, receiver_log: Callable[..., Path], tmp_path: Path) -> None:
    log = receiver_log(name, tmp_path / f"{name}.csv")
    with Dem.open(sorted(karlsruhe.glob("*.hgt"))) as dem:
        coverage, rmse, inside = score(
            log, karlsruhe / ROADS[name], dem, true_slopes(karlsruhe / f"truth_{name}.csv")
        )
    assert coverage >= 0.97
    assert rmse < 0.9
    assert inside > 0.85


def test_comma2k19(shared_data: Path) -> None:
    folder = folder_of(shared_data, "comma2k19")
    coverage, rmse, inside = score(
        folder / "log.csv", folder / "roads.osm", None, true_slopes(folder / "truth.csv")
    )
    assert coverage >= 0.97
    assert rmse < 0.8
    assert inside > 0.85
