"""What a log tells of its errors, where it is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.gnss.error_models.likelihood import Law
from fusion.gnss.solvers import one_sided_learning as learning
from fusion.gnss.solvers import state
from town_drives import TownDrive, town_drive


@pytest.fixture(scope="module")
def drive() -> TownDrive:
    return town_drive(3, epochs=400)


def test_white_errors_are_alike_for_no_longer_than_the_least(drive: TownDrive) -> None:
    rows = state.Frame.around(drive.measured).rows(drive.measured, drive.measured.cn0_dbhz)
    errors = Law().errors(np.full(len(drive.measured.satellite), 50.0))
    noise = np.random.default_rng(1).normal(0, 3, len(errors.share))
    assert learning.correlation_s(rows, errors, drive.measured.time_s, noise, 4.0) == 4.0
    nothing = np.full_like(noise, np.nan)
    assert learning.correlation_s(rows, errors, drive.measured.time_s, nothing, 4.0) == 4.0


def test_lasting_errors_are_alike_for_twice_their_time(drive: TownDrive) -> None:
    measured = drive.measured
    rows = state.Frame.around(measured).rows(measured, measured.cn0_dbhz)
    errors = Law().errors(np.full(len(measured.satellite), 50.0))
    rng, kept = np.random.default_rng(1), np.exp(-1 / 5.0)
    table = np.zeros((len(measured), 16))
    for k in range(1, len(measured)):
        table[k] = kept * table[k - 1] + np.sqrt(1 - kept**2) * rng.normal(size=16)
    lasting = table[measured.epoch, measured.satellite]
    assert learning.correlation_s(rows, errors, measured.time_s, lasting, 1.0) == pytest.approx(
        10.0, rel=0.35
    )


def test_noise_is_measured_on_direct_signals_and_never_below_one() -> None:
    errors = Law().errors(np.full(3000, 48.0))
    rng = np.random.default_rng(2)
    sigma = np.sqrt(errors.variance_m2)
    assert learning.noise_level(errors, 2 * sigma * rng.normal(size=3000)) == pytest.approx(2.0, rel=0.1)
    assert learning.noise_level(errors, 0.3 * sigma * rng.normal(size=3000)) == 1.0
    assert learning.noise_level(errors, np.full(3000, np.nan)) == 1.0


def test_c_n0_is_counted_from_the_receivers_best(drive: TownDrive) -> None:
    law = learning.receiver_law(drive.measured)
    weak = learning.receiver_law(replace(drive.measured, cn0_dbhz=drive.measured.cn0_dbhz - 5))
    assert weak.midpoint_dbhz == pytest.approx(law.midpoint_dbhz - 5)
    silent = replace(drive.measured, cn0_dbhz=np.full_like(drive.measured.cn0_dbhz, np.nan))
    assert learning.receiver_law(silent) == Law()
