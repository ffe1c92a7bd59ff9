"""Heights by pressure: warm air and cold, and what speed does to the pressure at the sensor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.frames import GRAVITY_MPS2
from fusion.profile.barometer import (
    AIR_SIGMA_K,
    DEVICE_SIGMA_K,
    air_scale,
    pressure_heights,
    set_right_share,
    speed_pressure,
    standard_height,
)
from fusion.profile.blocks import NOTHING
from fusion.types import DriveLog, Floats, GnssFix, GnssVelocity, Pressure

TIME_S = 1.7e9 + np.arange(900.0)
LAPSE_K_PER_M, GAS_CONSTANT = 0.0065, 287.053
NONE = np.empty(0)
BELIEF = AIR_SIGMA_K**2 / (AIR_SIGMA_K**2 + DEVICE_SIGMA_K**2)


def pressure_pa(height_m: Floats, sea_level_k: float) -> Floats:
    """Air whose temperature falls as in the standard atmosphere, but from another at sea level."""
    share = 1 - LAPSE_K_PER_M * height_m / sea_level_k
    return np.asarray(101_325.0 * share ** (GRAVITY_MPS2 / (GAS_CONSTANT * LAPSE_K_PER_M)))


def heights_of(pressure: Floats, temperature_c: float | Floats) -> Floats:
    temperature_k = np.broadcast_to(np.asarray(temperature_c, float) + 273.15, pressure.shape)
    table = Pressure.assemble(TIME_S[: len(pressure)], pressure_pa=pressure, temperature_k=temperature_k)
    return pressure_heights(table, 0.0, NONE, NONE)[1]


def test_the_standard_atmosphere() -> None:
    """Pressures of the tables (ICAO Doc 7488)."""
    heights = standard_height(np.array([101_325.0, 89_874.6, 79_495.2, np.nan]))
    assert heights[:3] == pytest.approx([0, 1000, 2000], abs=0.5)
    assert np.isnan(heights[3])


@given(st.floats(-25, 40), st.floats(0, 2500))
def test_the_thickness_of_real_air_is_found_as_far_as_its_temperature_is_believed(
    air_c: float, base_m: float
) -> None:
    """``air_c`` at sea level; 60 m of climb."""
    true = base_m + np.linspace(0, 60, 200)
    there_c = air_c - LAPSE_K_PER_M * (base_m + 30)
    pressure = pressure_pa(true, air_c + 273.15)
    without, with_ = (np.ptp(heights_of(pressure, c)) - 60 for c in (np.nan, there_c))
    assert with_ == pytest.approx((1 - BELIEF) * without, abs=0.15)


def test_the_level_stays_that_of_the_standard_atmosphere() -> None:
    """Datums are not the barometer's affair, but they must not leap by tens of metres when a thermometer fails."""
    pressure = pressure_pa(1500 + np.linspace(0, 50, 200), 288.15)
    assert abs(np.median(heights_of(pressure, 35.0)) - np.median(heights_of(pressure, np.nan))) < 1


@pytest.mark.parametrize("broken_c", [85.0, -127.0, -273.15, np.nan])
def test_a_broken_thermometer_is_ignored(broken_c: float) -> None:
    pressure = pressure_pa(200 + np.linspace(0, 50, 200), 278.15)
    np.testing.assert_array_equal(heights_of(pressure, broken_c), heights_of(pressure, np.nan))
    some = np.where(np.arange(200) % 3 == 0, broken_c, 5.0)
    np.testing.assert_allclose(heights_of(pressure, some), heights_of(pressure, 5.0))


def test_a_device_in_the_sun_does_bounded_harm() -> None:
    """Whatever it states: less than a seventh of the heights."""
    for stated_c in np.linspace(-100, 100, 41):
        assert abs(air_scale(np.full(10, stated_c + 273.15), 0.0) - 1) < 0.2
    assert air_scale(np.full(10, 273.15 + 45), 0.0) < 1.1


def speeds(rng: np.random.Generator) -> Floats:
    """Between 2 and 25 m/s, with a braking or pulling away every half minute."""
    known = rng.uniform(2, 25, size=31)
    return np.interp(np.arange(900.0), np.arange(31) * 30.0 + rng.uniform(-8, 8, size=31), known)


def log_with(
    share: float, seed: int, *, doppler: bool = True, noise: float = 1.0
) -> tuple[DriveLog, Floats, Floats]:
    """A hilly drive whose barometer feels a share of the dynamic pressure; its speeds and true heights."""
    rng = np.random.default_rng(seed)
    speed = speeds(rng)
    along = np.cumsum(speed)
    true = 200 + 8 * np.sin(along / 300 + seed) + 3 * np.sin(along / 90)
    climb = np.gradient(true, TIME_S)
    drift = np.cumsum(rng.normal(size=900)) * 0.02
    shown = true - share * speed**2 / (2 * GRAVITY_MPS2) + noise * (drift + 0.1 * rng.normal(size=900))
    walk = np.cumsum(rng.normal(size=900)) * 0.39
    unknown = np.full(900, np.nan)
    log = DriveLog(
        "csv",
        GnssFix.assemble(
            TIME_S,
            lat_deg=np.full(900, 49.0),
            lon_deg=np.full(900, 8.0),
            alt_msl_m=true + noise * (walk + 0.5 * rng.normal(size=900)),
        ),
        velocity=GnssVelocity.assemble(
            TIME_S,
            vel_n_mps=speed,
            vel_e_mps=0 * speed,
            vel_d_mps=-climb + noise * 0.1 * rng.normal(size=900) if doppler else unknown,
        ),
        pressure=Pressure.assemble(TIME_S, pressure_pa=pressure_pa(shown, 288.15)),
    )
    return log, speed, true


@given(st.integers(0, 500), st.floats(-0.4, 0.4))
@settings(max_examples=25)
def test_the_share_of_the_dynamic_pressure_is_found(seed: int, share: float) -> None:
    log, speed, _ = log_with(share, seed)
    found = speed_pressure(log, TIME_S, speed)
    assert found.value == pytest.approx(share, abs=max(0.02, 4 * found.sigma))
    assert found.sigma < 0.03  # by Cramér and Rao 0.006 to 0.010, and the floor of 0.01 beside it


@given(st.integers(0, 500), st.floats(-0.4, 0.4))
@settings(max_examples=15)
def test_gnss_heights_show_it_less_clearly(seed: int, share: float) -> None:
    log, speed, _ = log_with(share, seed, doppler=False)
    found = speed_pressure(log, TIME_S, speed)
    assert found.value == pytest.approx(share, abs=4.5 * found.sigma)
    assert 0.01 < found.sigma < 0.15


def test_heights_do_not_follow_the_speed() -> None:
    log, speed, true = log_with(0.15, 3, noise=0.3)
    share = set_right_share(speed_pressure(log, TIME_S, speed))
    right = pressure_heights(log.pressure, share, TIME_S, speed)[1] - true
    wrong = standard_height(log.pressure.pressure_pa) - true
    within = slice(100, 200)
    assert np.std(right[within]) < 0.3 * np.std(wrong[within])


def test_a_barometer_that_feels_nothing_is_left_alone() -> None:
    """Nearly always, and then the change is small: 0.03 of the dynamic pressure is 1 m at 100 km/h."""
    shares = []
    for seed in range(40):
        log, speed, _ = log_with(0.0, seed)
        shares.append(set_right_share(speed_pressure(log, TIME_S, speed)))
    assert np.count_nonzero(shares) <= 4
    assert np.max(np.abs(shares)) < 0.04


def test_a_scale_and_a_lag_of_the_barometer_are_no_speed_pressure() -> None:
    log, speed, true = log_with(0.0, 5, noise=0.2)
    late = np.interp(TIME_S - 1.5, TIME_S, true)
    for height in (true * 1.06, late):
        pressure = Pressure.assemble(TIME_S, pressure_pa=pressure_pa(height, 288.15))
        one = DriveLog("csv", log.fix, velocity=log.velocity, pressure=pressure)
        assert abs(speed_pressure(one, TIME_S, speed).value) < 0.02


def test_without_speeds_or_heights_nothing_is_known() -> None:
    log, speed, _ = log_with(0.2, 0)
    nothing = DriveLog("csv", GnssFix.empty(), pressure=log.pressure)
    assert speed_pressure(nothing, TIME_S, speed) == NOTHING
    assert speed_pressure(log, NONE, NONE) == NOTHING
    assert speed_pressure(DriveLog("csv", log.fix), TIME_S, speed) == NOTHING
    constant = DriveLog("csv", log.fix, velocity=log.velocity, pressure=log.pressure)
    assert set_right_share(speed_pressure(constant, TIME_S, np.full(900, 10.0))) == 0
