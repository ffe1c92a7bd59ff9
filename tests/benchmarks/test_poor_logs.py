"""The rungs of the ladder leave columns that a log has, and no more than they say."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

import poor_logs
from accuracy.logs import low_passed
from accuracy.poor import RUNGS
from accuracy.scoring import Errors
from accuracy.sequences import NOISE_FREE
from accuracy.truth import TrueSlope, Truth
from fusion.formats.tables.header import COLUMNS

TRUTH: Truth = {(1, 1, 2): TrueSlope(2.0, 10.0, 10.0), (1, 2, 3): TrueSlope(-4.0, 50.0, 50.0)}


def test_rungs_leave_columns_of_a_log() -> None:
    for rung in RUNGS.values():
        assert set(rung.columns or ()) <= set(COLUMNS)
    left = RUNGS["altitude"].columns
    assert left is not None
    assert set(left) == {"time_s", "lat_deg", "lon_deg", "alt_msl_m"}
    assert RUNGS["positions and SRTM"].dem


def test_a_low_pass_comes_to_a_step_by_its_time_constant() -> None:
    time_s = np.array([0.0, 1.0, 2.0, 3.0, 5.0])
    shown = low_passed(time_s, np.array([0.0, 1.0, np.nan, 1.0, 1.0]), 2.0)
    assert np.isnan(shown[2])
    np.testing.assert_allclose(shown[[0, 1, 3, 4]], 1 - np.exp(-np.array([0.0, 0.5, 1.5, 2.5])))


def test_short_segments_have_a_figure_of_their_own() -> None:
    errors = Errors.of(TRUTH, {(1, 1, 2): (2.5, 1.0), (1, 2, 3): (-4.1, 1.0)})
    row = poor_logs.summarise({poor_logs.RECEIVER: [[errors]], NOISE_FREE: [[Errors.of(TRUTH, {})]]})
    assert np.isclose(row["short_rmse_percent"], 0.5)
    assert np.isclose(row["rmse_percent"], np.sqrt((0.25 + 0.01) / 2))
    assert row["noise_free_rmse_percent"] is None


def test_a_rung_that_yields_nothing_has_a_row() -> None:
    nothing = [[Errors.of(TRUTH, {})]]
    row = poor_logs.summarise({poor_logs.RECEIVER: nothing, NOISE_FREE: nothing})
    assert row["coverage"] == 0.0
    assert "rmse_percent" not in row


def test_tables_are_named(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="--tables takes some of ladder,streets,filtered"):
        poor_logs.run(Namespace(tables="ladder,towns"), tmp_path)
