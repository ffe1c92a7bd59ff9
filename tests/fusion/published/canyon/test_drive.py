"""Canyon drives: measurements and signals that hold the truth and nothing else, and errors of the stated law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.gnss.orbits.satellites import states_when_sent
from fusion.published.canyon.drive import CanyonDrive, canyon_of
from fusion.published.canyon.radio import TOWN
from fusion.signals import LIGHT_MPS
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from published.positioning.rouen import BLURRED, STUDY, rouen


@pytest.fixture(scope="module")
def run() -> CanyonDrive:
    return rouen(1)


@pytest.fixture(scope="module")
def driven(town: Town) -> CanyonDrive:
    return canyon_of(simulate_drive(town, 5, 120.0), TOWN._replace(jumps=4))


def test_pseudoranges_are_range_clock_and_error(run: CanyonDrive) -> None:
    measured = run.measurements()
    where = run.ride.position_m[measured.epoch]
    rest = measured.pseudorange_m - np.linalg.norm(measured.satellite_m - where, axis=1)
    np.testing.assert_allclose(rest, run.error_m, atol=1e-6)
    assert len(measured) == 594
    assert measured.groups == ("GPS",)
    assert np.all(run.clock.bias_m == 0)


def test_direct_rays_err_by_unit_noise_and_reflected_ones_by_detours(run: CanyonDrive) -> None:
    noise = run.error_m[~run.reflected]
    assert stats.kstest(noise, "norm").pvalue > 0.01
    assert 0.03 < run.reflected.mean() < 0.4
    assert run.error_m[run.reflected].mean() > 3.0
    assert run.error_m[run.reflected].min() > -4.0


def test_in_the_study_cn0_tells_the_state(run: CanyonDrive) -> None:
    np.testing.assert_array_equal(run.cn0_dbhz < 40.0, run.reflected)
    blurred = rouen(1, BLURRED)
    right = ((blurred.cn0_dbhz < 40.0) == blurred.reflected).mean()
    assert 0.7 < right < 0.97


def test_the_open_road_has_no_reflection() -> None:
    clear = rouen(3, shares={"open": 1.0})
    assert not clear.reflected.any()
    np.testing.assert_array_equal(np.diff(clear.sky.first), clear.above)


def test_narrow_high_streets_reflect_more_than_a_suburb() -> None:
    urban, suburb = (rouen(4, shares={name: 1.0}) for name in ("urban", "residential"))
    assert urban.reflected.mean() > 2 * suburb.reflected.mean()
    assert len(urban.state) < len(suburb.state)


def test_doppler_follows_the_pseudorange(driven: CanyonDrive) -> None:
    """Of one satellite in one state, the range's step is the mean of its rates."""
    measured, step = driven.measurements(), []
    for satellite in range(len(measured.names)):
        rows = np.flatnonzero(measured.satellite == satellite)
        pair = (
            (np.diff(measured.epoch[rows]) == 1) & ~driven.reflected[rows[1:]] & ~driven.reflected[rows[:-1]]
        )
        a, b = rows[:-1][pair], rows[1:][pair]
        moved = measured.pseudorange_m[b] - measured.pseudorange_m[a]
        step.append(moved - 0.5 * (measured.range_rate_mps[a] + measured.range_rate_mps[b]))
    assert np.abs(np.median(np.concatenate(step))) < 0.1
    assert np.median(np.abs(np.concatenate(step))) < 1.5


def test_signals_are_the_measurements_with_all_that_corrections_take_off(driven: CanyonDrive) -> None:
    signals, measured = driven.signals(), driven.measurements()
    epoch = signals.epoch
    late = signals.gps_s - driven.ride.gps_s
    corrected = signals.pseudorange_m + LIGHT_MPS * driven.sky.clock_s
    air = corrected - driven.clock.jump_m[epoch] - measured.pseudorange_m
    assert 2.0 < air.min() < 12.0
    assert 15.0 < air.max() < 90.0
    assert np.corrcoef(air, 1 / np.sin(driven.sky.elevation_rad))[0, 1] > 0.95
    np.testing.assert_allclose(
        late * LIGHT_MPS, driven.clock.bias_m + driven.clock.jump_m, atol=0.5e-6 * LIGHT_MPS
    )
    jumps = np.diff(driven.clock.jump_m) / LIGHT_MPS * 1e3
    assert np.sum(np.abs(jumps) > 0.5) == 4
    np.testing.assert_allclose(jumps, np.round(jumps), atol=1e-9)
    raw = driven.raw()
    assert raw.navigation is driven.navigation
    assert len(raw.signals) == len(driven.ride)


def test_systems_have_biases_and_tunnels_no_signal(town: Town) -> None:
    drive = simulate_drive(town, 4, 900.0, outages=[(50.0, 20.0)], first=town.roads.tunnel)
    found = canyon_of(drive)
    assert np.all(np.diff(found.sky.first)[~drive.has_gnss] == 0)
    assert np.all(np.diff(found.sky.first)[drive.has_gnss] > 0)
    measured = found.measurements()
    assert measured.groups == ("GPS", "Galileo", "BeiDou")
    assert len({float(b) for b in found.system_bias_m}) == 3
    assert np.all(found.system_bias_m[measured.group == 0] == 0)


def test_a_seed_makes_one_drive() -> None:
    one, same, other = rouen(6), rouen(6), rouen(7)
    np.testing.assert_array_equal(one.error_m, same.error_m)
    assert len(one.error_m) != len(other.error_m)
    assert rouen(6, STUDY._replace(noise_m=0.0)).error_m[~rouen(6, STUDY).reflected].std() == 0


def test_signals_lead_back_to_the_true_range(driven: CanyonDrive) -> None:
    """Through the orbits as a solver takes them, by the receiver's own tag, jumps and all."""
    signals = driven.signals()
    received = signals.gps_s[signals.epoch]
    states = states_when_sent(
        driven.navigation, signals.system, signals.number, received, signals.pseudorange_m
    )
    np.testing.assert_allclose(states.position_m, driven.sky.sent_m, atol=5e-3)
    np.testing.assert_allclose(states.clock_s, driven.sky.clock_s, atol=1e-12)
