"""Drives that several tests look at."""

from __future__ import annotations

import pytest

from fusion.simulate.demonstration import Demonstration, write_all
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import Town, make_town


@pytest.fixture(scope="session", params=(3, 4))
def perfect(request: pytest.FixtureRequest) -> SimulatedDrive:
    """A drive without any error, sampled densely."""
    return simulate_drive(make_town(2), request.param, 300.0, receiver="perfect", rate_hz=20.0)


@pytest.fixture(scope="session")
def several(town: Town) -> list[SimulatedDrive]:
    return [simulate_drive(town, 100 + k, 300.0, rate_hz=10.0) for k in range(8)]


@pytest.fixture(scope="session")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("bundle"), drives=6, seed=3, duration_s=240.0)
