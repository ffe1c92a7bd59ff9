"""The benchmark of street canyons: what solvers are given, which satellites are followed, how figures are averaged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.published.canyon.drive import CanyonDrive
from published.positioning.rouen import rouen
from street_canyon import (
    ORDER,
    PUBLISHED,
    PUBLISHED_DENSITY,
    SCENES,
    describe,
    followed,
    interval,
    measurements_for,
    print_order,
)


@pytest.fixture(scope="module")
def drive() -> CanyonDrive:
    return rouen(2)


def test_published_figures_are_of_one_table() -> None:
    for mean, share, mut, mdt, mtbf in PUBLISHED.values():
        assert mtbf == pytest.approx(mut + mdt, abs=0.06)
        assert share == pytest.approx(mut / mtbf, abs=0.02)
        assert mean > 0
    assert ORDER == ("ekf", "pf", "jms-gmm", "rbpf-dpm")
    assert len(PUBLISHED_DENSITY) == 4


def test_solvers_are_given_no_rates_and_in_the_thesis_s_reading_no_more_than_it_says(
    drive: CanyonDrive,
) -> None:
    ours, none = measurements_for(drive, "ekf", "ours")
    assert none == {}
    assert np.isnan(ours.range_rate_mps).all()
    np.testing.assert_array_equal(ours.cn0_dbhz, drive.cn0_dbhz)
    blind, options = measurements_for(drive, "ekf", "thesis")
    assert len(np.unique(blind.cn0_dbhz)) == 1
    assert options == {"tau_s": 1.0}
    told, options = measurements_for(drive, "rbpf-dpm", "thesis")
    np.testing.assert_array_equal(told.cn0_dbhz < 40, drive.reflected)
    assert options["los_dof"] == 3.0
    same, _ = measurements_for(drive, "one-sided", "thesis")
    np.testing.assert_array_equal(same.cn0_dbhz, drive.cn0_dbhz)


def test_followed_satellites_are_the_most_and_least_reflected(drive: CanyonDrive) -> None:
    series = followed(drive)
    most, least = (np.mean(series[k].state == 2) for k in ("reflected most", "reflected least"))
    assert most > 0.15 > least
    assert all(len(s) >= 297 for s in series.values())


def test_an_interval_is_students() -> None:
    values = np.array([1.0, 2.0, 4.0, np.nan])
    mean, half = interval(values)
    low, high = stats.t.interval(0.95, 2, mean, stats.sem(values[:3]))
    assert (mean - half, mean + half) == pytest.approx((low, high))
    assert np.isnan(interval(np.array([np.nan]))[0])


def test_scenes_and_order_are_told(drive: CanyonDrive, capsys: pytest.CaptureFixture[str]) -> None:
    assert set(SCENES) == {"study", "blurred", "more", "urban"}
    assert "satellites tracked" in describe([drive])
    print_order({})
    assert capsys.readouterr().out == ""
