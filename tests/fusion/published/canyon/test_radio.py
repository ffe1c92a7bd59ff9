"""The receiver's draws: C/N0 over elevation, noise, correlation, clock."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.published.canyon.radio import TOWN, run_clock, system_biases
from fusion.signals import LIGHT_MPS
from published.positioning.rouen import STUDY, rouen


def test_cn0_follows_the_line_of_table_3_2() -> None:
    run = rouen(2, shares={"open": 1.0})
    degrees = np.degrees(run.sky.elevation_rad)
    low = degrees < 18
    np.testing.assert_allclose(run.cn0_dbhz[low], 41.25 + degrees[low] / 18 * 1.07, atol=1e-9)
    assert run.cn0_dbhz.max() <= 49.7


def test_fading_lasts_as_long_as_stated() -> None:
    radio = STUDY._replace(fading_db=2.0, fading_s=3.0)
    run, still = rouen(2, radio, shares={"open": 1.0}), rouen(2, STUDY, shares={"open": 1.0})
    fading = run.cn0_dbhz - still.cn0_dbhz
    assert abs(fading.std() - 2.0) < 0.25
    satellite = run.measurements().satellite
    one = fading[satellite == np.bincount(satellite).argmax()]
    assert abs(np.corrcoef(one[1:], one[:-1])[0, 1] - np.exp(-1 / 3)) < 0.12


def test_a_weak_signal_is_noisier_or_lost() -> None:
    radio = TOWN._replace(multipath_m=0.0, noise_m=1.0, loss_db=15.0, lost_below_dbhz=28.0)
    run = rouen(1, radio)
    assert run.cn0_dbhz.min() >= 28.0
    direct = ~run.reflected
    scaled = run.error_m[direct] / 10 ** ((45.0 - run.cn0_dbhz[direct]) / 20)
    assert abs(scaled.std() - 1.0) < 0.05


def test_a_clock_drifts_smoothly_and_jumps_by_milliseconds() -> None:
    clock = run_clock(500, 1.0, TOWN._replace(jumps=30), np.random.default_rng(1))
    np.testing.assert_allclose(
        np.diff(clock.bias_m), 0.5 * (clock.drift_mps[1:] + clock.drift_mps[:-1]), atol=1e-9
    )
    steps = np.diff(clock.jump_m) / (1e-3 * LIGHT_MPS)
    assert np.count_nonzero(np.abs(steps) > 0.5) == 30
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert run_clock(1, 1.0, TOWN._replace(jumps=3), np.random.default_rng(1)).jump_m.tolist() == [0.0]


@pytest.mark.parametrize("systems", [[0], [0, 2, 3], [3, 2]])
def test_the_first_system_has_no_bias(systems: list[int]) -> None:
    biases = system_biases(np.array(systems), TOWN, np.random.default_rng(2))
    assert biases[min(systems)] == 0.0
    assert sorted(biases) == sorted(systems)
