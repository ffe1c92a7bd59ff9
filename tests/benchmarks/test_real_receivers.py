"""Holes in a recorded log: as many epochs as are to be gone, the others untouched."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np

import real_receivers
from accuracy.logs import read_columns, write_columns
from accuracy.sequences import Sequence
from fusion.roads.table import RoadTable


def test_holes_take_a_third_of_a_log(tmp_path: Path) -> None:
    time_s = 1.7e9 + np.arange(900.0)
    log = write_columns({"time_s": time_s, "lat_deg": 35 + 1e-6 * np.arange(900)}, tmp_path / "log.csv")  # type: ignore[dict-item]
    sequence = Sequence("street", {}, RoadTable.empty(), None, None, log)
    setup = real_receivers.Setup(sequence, ModuleType("roadtruth"), tmp_path)
    assert setup.with_holes(log, None) == log
    left = [read_columns(setup.with_holes(log, seed)) for seed in (1, 1, 2)]
    assert [len(columns["time_s"]) for columns in left] == [600, 600, 600]
    assert np.array_equal(left[0]["time_s"], left[1]["time_s"])
    assert not np.array_equal(left[0]["time_s"], left[2]["time_s"])
    same = np.isin(time_s, left[0]["time_s"])
    np.testing.assert_allclose(left[0]["lat_deg"], (35 + 1e-6 * np.arange(900))[same], atol=1e-9)
