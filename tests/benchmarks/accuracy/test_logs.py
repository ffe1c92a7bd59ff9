"""Logs made poorer: which epochs are left, what a barometer shows, that columns survive being written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accuracy.logs import (
    BAROMETER_DRIFT_M,
    BAROMETER_DRIFT_S,
    BAROMETER_WHITE_M,
    Columns,
    drop_columns,
    only,
    outside_blocks,
    read_columns,
    thinned,
    with_barometer,
    write_columns,
)
from fusion.formats import read_log


def log_of(time_s: np.ndarray) -> Columns:
    return {"time_s": time_s, "lat_deg": np.full(len(time_s), 49.0), "lon_deg": 8 + 1e-5 * time_s % 1}


def test_thinning_keeps_the_first_epoch_of_each_slot() -> None:
    columns = log_of(1e9 + 0.3 + np.arange(23.0))
    assert thinned(columns, 5.0)["time_s"].tolist() == (1e9 + 0.3 + np.arange(0, 23, 5.0)).tolist()
    assert len(thinned(columns, 1.0)["time_s"]) == 23


def test_thinning_bears_clocks_that_waver_and_gaps() -> None:
    time_s = np.array([0.0, 0.999, 2.001, 3.0, 4.0, 5.001, 6.0, 31.0, 32.0, 36.0])
    assert thinned(log_of(time_s), 5.0)["time_s"].tolist() == [0.0, 5.001, 31.0, 36.0]


def test_columns_that_are_not_there_are_not_missed() -> None:
    assert list(only(log_of(np.arange(3.0)), ("time_s", "lat_deg", "alt_msl_m"))) == ["time_s", "lat_deg"]


def test_columns_are_dropped_and_cells_stay_as_they_are(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time_s,pressure_hpa,note\n1.50,1000.00000001,a\n2,,b\n")
    left = drop_columns(log, ("pressure_hpa", "v_acc_m"), tmp_path / "left.csv")
    assert left.read_text().splitlines() == ["time_s,note", "1.50,a", "2,b"]


def test_blocks_take_out_the_share_that_is_asked_for() -> None:
    time_s = np.arange(900.0)
    keep = outside_blocks(time_s, 1 / 3, (20.0, 60.0), np.random.default_rng(1))
    assert np.count_nonzero(~keep) == 300
    edges = np.flatnonzero(np.diff(np.r_[True, keep, True].astype(int)))
    lengths = np.diff(edges)[::2]
    assert np.sum(lengths < 20) <= 1 + np.sum(lengths > 60)  # the last is cut short, others may meet
    assert lengths.sum() == 300
    other = outside_blocks(time_s, 1 / 3, (20.0, 60.0), np.random.default_rng(2))
    assert not np.array_equal(keep, other)


def test_nothing_is_taken_out_of_a_share_of_nothing() -> None:
    assert outside_blocks(np.arange(50.0), 0.0, (20.0, 60.0), np.random.default_rng(0)).all()


def test_a_barometer_shows_the_height_with_its_noise_and_drift() -> None:
    columns = log_of(np.arange(601.0))
    height = 200 + 30 * np.sin(columns["time_s"] / 40)
    ends, steps = [], []
    for seed in range(200):
        shown = with_barometer(columns, height, np.random.default_rng(seed))["pressure_hpa"]
        error = 44_330.77 * (1 - (shown / 1013.25) ** 0.190263) - height
        ends.append(error[-1] - error[0])
        steps.append(np.diff(error))
    walk = BAROMETER_DRIFT_M * np.sqrt(600 / BAROMETER_DRIFT_S)
    assert np.std(ends) == pytest.approx(np.hypot(walk, BAROMETER_WHITE_M * 2**0.5), rel=0.15)
    assert np.std(steps) == pytest.approx(BAROMETER_WHITE_M * 2**0.5, rel=0.05)


def test_columns_survive_being_written(tmp_path: Path) -> None:
    columns = log_of(1.7e9 + np.arange(6.0)) | {"alt_msl_m": np.array([1.0, np.nan, 3.25, 4, 5, 6])}
    path = write_columns(columns, tmp_path / "log.csv")
    again = read_columns(path)
    assert list(again) == list(columns)
    for name, values in columns.items():
        np.testing.assert_allclose(again[name], values, atol=1e-9)
    log = read_log(path)
    assert len(log.fix) == 6
    assert np.isnan(log.fix.alt_msl_m[1])
