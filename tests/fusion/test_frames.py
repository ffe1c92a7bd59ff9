"""Geodesy and attitude against independent references."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod
from scipy.spatial.transform import Rotation

from fusion.frames import GRAVITY_MPS2, LocalProjection, acceleration_enu, body_to_ned, wrap_angle

angles = st.floats(-20, 20)


@given(lon=st.floats(-179, 179), lat=st.floats(-80, 80), dx=st.floats(-30e3, 30e3), dy=st.floats(-30e3, 30e3))
def test_the_plane_is_metric_and_goes_there_and_back(lon: float, lat: float, dx: float, dy: float) -> None:
    plane = LocalProjection(lon, lat)
    lon1, lat1 = plane.to_lonlat(np.array([dx]), np.array([dy]))
    x, y = plane.to_xy(lon1, lat1)
    assert x[0] == pytest.approx(dx, abs=1e-4)
    assert y[0] == pytest.approx(dy, abs=1e-4)
    geodesic = Geod(ellps="WGS84").inv(lon, lat, lon1[0], lat1[0])[2]
    assert np.hypot(dx, dy) == pytest.approx(geodesic, rel=2e-5, abs=1e-3)


def test_unknown_positions_stay_unknown() -> None:
    x, y = LocalProjection(8.4, 49.0).to_xy(np.array([np.nan, 8.4]), np.array([49.0, 49.0]))
    assert np.isnan(x[0])
    assert np.isnan(y[0])
    assert x[1] == pytest.approx(0, abs=1e-6)


@given(angles)
def test_wrapping_keeps_the_direction_and_the_range(angle: float) -> None:
    wrapped = float(wrap_angle(np.array([angle]))[0])
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)


@given(roll=angles, pitch=angles, yaw=angles)
def test_the_rotation_is_the_aerospace_zyx_rotation(roll: float, pitch: float, yaw: float) -> None:
    ours = body_to_ned(np.array([roll]), np.array([pitch]), np.array([yaw]))[0]
    reference = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    assert np.allclose(ours, reference, atol=1e-12)


def test_at_rest_on_a_slope_there_is_no_acceleration() -> None:
    """A sensor pitched up by 10 degrees, heading east, feels gravity forward and up; the vehicle stands still."""
    pitch = np.radians(10)
    force = GRAVITY_MPS2 * np.array([[np.sin(pitch), 0.0, np.cos(pitch)]])
    assert np.allclose(
        acceleration_enu(force, np.zeros(1), np.array([pitch]), np.array([np.pi / 2])), 0, atol=1e-12
    )


def test_braking_eastwards_and_turning_left_point_where_they_should() -> None:
    force = np.array([[-2.0, 1.0, GRAVITY_MPS2]])  # x forward, y left
    enu = acceleration_enu(force, np.zeros(1), np.zeros(1), np.array([np.pi / 2]))  # heading east
    assert np.allclose(enu, [[-2.0, 1.0, 0.0]], atol=1e-12)  # west, and to the left of east: north
