"""Heights by pressure: warm air and cold, and what speed does to the pressure at the sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factor_support import street
from fusion.frames import GRAVITY_MPS2
from fusion.pipeline import run_drive
from fusion.profile.barometer import (
    AIR_SIGMA_K,
    DEVICE_SIGMA_K,
    air_scale,
    pressure_heights,
    speed_head,
    standard_height,
)
from fusion.types import Floats, Pressure
from model_drives import gusts
from profile_support import hills, pressure_of, street_log

TIME_S = 1.7e9 + np.arange(900.0)
LAPSE_K_PER_M, GAS_CONSTANT = 0.0065, 287.053
BELIEF = AIR_SIGMA_K**2 / (AIR_SIGMA_K**2 + DEVICE_SIGMA_K**2)


def pressure_pa(height_m: Floats, sea_level_k: float) -> Floats:
    """Air whose temperature falls as in the standard atmosphere, but from another at sea level."""
    share = 1 - LAPSE_K_PER_M * height_m / sea_level_k
    return np.asarray(101_325.0 * share ** (GRAVITY_MPS2 / (GAS_CONSTANT * LAPSE_K_PER_M)))


def heights_of(pressure: Floats, temperature_c: float | Floats) -> Floats:
    temperature_k = np.broadcast_to(np.asarray(temperature_c, float) + 273.15, pressure.shape)
    table = Pressure.assemble(TIME_S[: len(pressure)], pressure_pa=pressure, temperature_k=temperature_k)
    return pressure_heights(table)[1]


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


TABLE = street(*[80.0] * 160)


def speeds(rng: np.random.Generator) -> Floats:
    """Between 2 and 25 m/s, with a braking or pulling away every half minute."""
    known = rng.uniform(2, 25, size=31)
    return np.interp(np.arange(900.0), np.arange(31) * 30.0 + rng.uniform(-8, 8, size=31), known)


@pytest.mark.parametrize("share", [0.1, 0.0, -0.1])
def test_the_share_of_the_dynamic_pressure_is_found(share: float) -> None:
    """Of a barometer beside Doppler, as surely as the report says."""
    z, sigmas = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        speed = speeds(rng)
        along = 5 + np.cumsum(speed) * 0.98 * TABLE.length_m.sum() / max(speed.sum(), TABLE.length_m.sum())
        speed = np.gradient(along, TIME_S)
        log = street_log(TIME_S, along, hills, rng, without=("attitude", "force", "altitude"))
        drift = np.cumsum(0.1 * rng.normal(size=len(along)))
        gust = gusts(rng, len(along), speed)
        shown = hills(along) - share * speed_head(speed) + drift + gust + 0.1 * rng.normal(size=len(along))
        report = run_drive(replace(log, pressure=pressure_of(TIME_S, shown)), TABLE, None)[1].report
        found = report["speed_pressure"]["found_share"]
        assert report["speed_pressure"]["share"] == found["value"]
        z.append((found["value"] - share) / found["sigma"])
        sigmas.append(found["sigma"])
    assert np.max(np.abs(z)) < 3
    assert np.max(sigmas) < 0.05
