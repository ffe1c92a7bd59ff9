"""Corrections against an independent library to a centimetre, and by what they must obey."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyrtklib
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.gnss.corrections import (
    DEFAULT_KLOBUCHAR,
    HUMIDITY,
    klobuchar_delay_m,
    niell_mapping,
    troposphere_delay_m,
    turned_by_earth,
    zenith_delays_m,
)
from fusion.signals import CARRIER_HZ, GPS, LIGHT_MPS
from satellites.library import library_time

QUIET_2021 = (9.313e-9, 1.490e-8, -5.960e-8, -1.192e-7, 8.806e4, 4.915e4, -1.311e5, -3.277e5)

Place = tuple[float, float, float]
PLACES = st.tuples(st.floats(-89.0, 89.0), st.floats(-180.0, 180.0), st.floats(0.0, 9_000.0))
ELEVATIONS = st.floats(5.0, 90.0)
TIMES = st.floats(1.0e9, 1.6e9).map(np.floor)


def vector(*values: float) -> Any:
    """The library's array of numbers."""
    out = pyrtklib.Arr1Ddouble(len(values))
    for k, value in enumerate(values):
        out[k] = float(value)
    return out


@given(PLACES, ELEVATIONS, st.floats(0.0, 360.0), TIMES, st.sampled_from([DEFAULT_KLOBUCHAR, QUIET_2021]))
def test_klobuchar_agrees_with_the_library(
    place: Place, elevation: float, azimuth: float, gps_s: float, coefficients: tuple[float, ...]
) -> None:
    lat, lon, el, az = np.radians([place[0], place[1], elevation, azimuth])
    ours = klobuchar_delay_m(
        coefficients, *(np.array([x]) for x in (gps_s, lat, lon, el, az, CARRIER_HZ[GPS]))
    )
    theirs = pyrtklib.ionmodel(
        library_time(gps_s), vector(*coefficients), vector(lat, lon, place[2]), vector(az, el)
    )
    assert ours[0] == pytest.approx(theirs, abs=0.001)


def test_klobuchar_of_a_worked_example() -> None:
    """Latitude 40, longitude -100, elevation 20, azimuth 210 degrees, 2000-01-01 20:45: 23.784 m.

    The example of published implementations after Klobuchar (1987): M. Mahooti's for Matlab; Orekit states the figure.
    """
    coefficients = (3.82e-8, 1.49e-8, -1.79e-7, 0.0, 1.43e5, 0.0, -3.28e5, 1.13e5)
    lat, lon, el, az = np.radians([40.0, -100.0, 20.0, 210.0])
    delay = klobuchar_delay_m(
        coefficients, *(np.array([x]) for x in (593_100.0, lat, lon, el, az, CARRIER_HZ[GPS]))
    )
    assert delay[0] == pytest.approx(23.784, abs=0.01)


def test_the_ionosphere_falls_with_the_square_of_the_carrier_and_rests_at_night() -> None:
    at = [np.full(2, x) for x in (14.0 * 3600.0, 0.8, 0.0, 0.7, 1.0)]
    low, high = klobuchar_delay_m(QUIET_2021, *at, np.array([1_561.098e6, 1_602e6]))  # type: ignore[call-arg]
    assert low / high == pytest.approx((1_602 / 1_561.098) ** 2, rel=1e-12)
    night = [np.array([x]) for x in (2.0 * 3600.0, 0.8, 0.0, np.pi / 2, 1.0, CARRIER_HZ[GPS])]
    assert klobuchar_delay_m(QUIET_2021, *night)[0] == pytest.approx(5e-9 * LIGHT_MPS, rel=0.01)


@given(PLACES, TIMES)
def test_the_zenith_agrees_with_the_library(place: Place, gps_s: float) -> None:
    lat, lon = np.radians(place[:2])
    dry, wet = zenith_delays_m(np.array([lat]), np.array([place[2]]))
    theirs = pyrtklib.tropmodel(
        library_time(gps_s), vector(lat, lon, place[2]), vector(0.0, np.pi / 2), HUMIDITY
    )
    assert dry[0] + wet[0] == pytest.approx(theirs, abs=0.001)


@given(PLACES, ELEVATIONS, TIMES)
def test_slant_delays_agree_with_the_librarys_zenith_and_mapping(
    place: Place, elevation: float, gps_s: float
) -> None:
    lat, lon, el = np.radians([place[0], place[1], elevation])
    at = (np.array([lat]), np.array([place[2]]))
    dry, wet = zenith_delays_m(*at)
    ours = troposphere_delay_m(np.array([gps_s]), *at, np.array([el]))
    wet_times = vector(0.0)
    dry_times = pyrtklib.tropmapf(library_time(gps_s), vector(lat, lon, place[2]), vector(0.0, el), wet_times)
    assert ours[0] == pytest.approx(dry[0] * dry_times + wet[0] * wet_times[0], abs=0.01)


def test_mappings_are_one_at_the_zenith_and_below_the_flat_earths() -> None:
    elevation = np.radians(np.linspace(5.0, 90.0, 86))
    for times in niell_mapping(np.full(86, 1.3e9), np.full(86, 0.9), np.full(86, 100.0), elevation):
        assert times[-1] == pytest.approx(1.0, abs=1e-9)
        assert np.all(np.diff(times) < 0)
        assert np.all(times <= 1.0 / np.sin(elevation) + 1e-9)


def test_the_earths_turn_keeps_lengths_and_goes_eastward_under_the_satellite() -> None:
    place = np.array([[26e6, 0.0, 1e6]])
    turned = turned_by_earth(place, np.array([0.08]))
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(place), rel=1e-15)
    assert turned[0, 1] == pytest.approx(-26e6 * 7.2921151467e-5 * 0.08, rel=1e-9)
    theirs = pyrtklib.geodist(vector(*place[0]), vector(6.4e6, 1e5, 2e5), vector(0.0, 0.0, 0.0))
    far = np.linalg.norm(place[0] - [6.4e6, 1e5, 2e5])
    ours = np.linalg.norm(turned_by_earth(place, np.array([far / LIGHT_MPS]))[0] - [6.4e6, 1e5, 2e5])
    assert ours == pytest.approx(theirs, abs=0.001)
