"""Drives through the simulated town, read back from their files as a user's would be, and small networks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fusion.formats import read_log
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.types import DriveLog
from road_fixtures import make_network, make_table

__all__ = ["make_network", "make_table"]

MakeLog = Callable[..., DriveLog]


@pytest.fixture(scope="session")
def make_log(town: Town, tmp_path_factory: pytest.TempPathFactory) -> MakeLog:
    """``make_log(seed, **options of Town.drive)``, each made once."""
    folder = tmp_path_factory.mktemp("drives")
    made: dict[str, DriveLog] = {}

    def make(seed: int, **options: object) -> DriveLog:
        key = repr((seed, sorted(options.items())))
        if key not in made:
            path = folder / f"drive_{len(made)}.csv"
            write_csv(simulate_drive(town, seed, **options), path)  # type: ignore[arg-type]
            made[key] = read_log(path)
        return made[key]

    return make


@pytest.fixture(scope="session")
def town_dem(town: Town, tmp_path_factory: pytest.TempPathFactory) -> Dem:
    """The town's DEM, errors and voids included."""
    path: Path = tmp_path_factory.mktemp("dem") / "dem.tif"
    write_dem(town, path)
    return Dem.open([path])
