"""Several logs solved together without a database; what goes through ``run_drive`` is tested with each method."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from fusion.pipeline import solve_network
from fusion.simulate.scene.town import Town
from network_support import factor_of


def test_a_log_that_contradicts_the_others_is_counted(town: Town) -> None:
    """Rejected are segments on which no pass of a log is accepted; logs without factors have none."""
    rows = np.arange(len(town.roads))

    def log(begin_s: float, slopes: dict[int, list[float]]) -> Any:
        said = tuple(factor_of(town.roads, row, slope, 0.3) for row, each in slopes.items() for slope in each)
        track = SimpleNamespace(time_s=np.array([begin_s]))
        return SimpleNamespace(rows=rows, result=SimpleNamespace(factors=said, track=track))

    logs = [
        log(40.0, {0: [9.0], 1: [9.0, 2.0], 2: [2.0]}),  # wrong; wrong once of twice; right
        log(10.0, {}),
        log(30.0, {0: [2.0], 1: [2.0], 2: [2.0]}),
        log(20.0, {0: [2.1], 1: [2.1], 2: [2.1]}),
    ]
    solved = solve_network(town.roads, None, logs)
    assert solved.rejected == [1, 0, 0, 0]
    assert [solved.parts[row][0].drives for row in range(3)] == [2, 3, 3]
    assert solve_network(town.roads, None, logs[1:2]) == ({}, [0])
