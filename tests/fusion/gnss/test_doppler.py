"""Velocities by Doppler: exact without noise, as sure as they say with it, and not led astray by one wrong rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.gnss.doppler import doppler_velocities
from simple_sky import sky


@given(st.floats(-80, 80), st.floats(-179, 179), st.floats(0, 60), st.integers(0, 99))
def test_exact_rates_give_the_velocity(lat: float, lon: float, speed: float, seed: int) -> None:
    one = sky(epochs=3, lat_deg=lat, lon_deg=lon, speed_mps=speed, seed=seed)
    found = doppler_velocities(one.measured, one.position_m)
    assert np.allclose(found.velocity_mps, one.velocity_mps, atol=1e-5)


def test_a_place_that_is_wrong_by_a_street_changes_little() -> None:
    one = sky(epochs=3)
    found = doppler_velocities(one.measured, one.position_m + 20.0)
    assert np.allclose(found.velocity_mps, one.velocity_mps, atol=0.02)


def test_sigmas_are_those_of_the_errors() -> None:
    one = sky(epochs=2000, rate_noise_mps=0.2, seed=3)
    found = doppler_velocities(one.measured, one.position_m)
    error = found.velocity_mps - one.velocity_mps
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    assert 2.0 < square.mean() < 4.5
    assert 0.85 < np.mean(square < 7.81) < 0.99


def test_one_wrong_rate_is_outvoted() -> None:
    one = sky(epochs=50, rate_noise_mps=0.05, satellites=10)
    rate = one.measured.range_rate_mps.copy()
    rate[3::10] += 15.0
    found = doppler_velocities(replace(one.measured, range_rate_mps=rate), one.position_m)
    assert np.abs(found.velocity_mps - one.velocity_mps).max() < 0.6


@pytest.mark.parametrize("satellites", [1, 3])
def test_too_few_rates_give_none(satellites: int) -> None:
    one = sky(epochs=4, satellites=satellites)
    found = doppler_velocities(one.measured, one.position_m)
    assert np.isnan(found.velocity_mps).all()
    assert np.isnan(found.covariance).all()


def test_satellites_in_one_plane_give_none() -> None:
    one = sky(epochs=2, satellites=6)
    flat = one.measured.satellite_m.copy()
    middle = one.position_m[one.measured.epoch]
    across = np.cross(flat[0] - middle[0], flat[1] - middle[0])
    across /= np.linalg.norm(across)
    sight = flat - middle
    flat = middle + sight - (sight @ across)[:, None] * across
    found = doppler_velocities(replace(one.measured, satellite_m=flat), one.position_m)
    assert np.isnan(found.velocity_mps).all()


def test_no_rates_and_no_place_give_none() -> None:
    one = sky(epochs=5, doppler=False)
    assert np.isnan(doppler_velocities(one.measured, one.position_m).velocity_mps).all()
    two = sky(epochs=5)
    place = two.position_m.copy()
    place[2] = np.nan
    found = doppler_velocities(two.measured, place).velocity_mps
    assert np.isnan(found[2]).all()
    assert np.isfinite(found[[0, 1, 3, 4]]).all()
