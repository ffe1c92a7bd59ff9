"""Places and directions on the earth, against plain geometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.frames import geodetic, local_axes
from fusion.gnss.earth import ecef, elevation_azimuth

LON, LAT, HEIGHT = st.floats(-179.9, 179.9), st.floats(-89, 89), st.floats(-100, 9000)


def test_known_places() -> None:
    there = ecef(np.array([0.0, 90.0]), np.array([0.0, 0.0]), np.array([0.0, 10.0]))
    assert there == pytest.approx(np.array([[6378137.0, 0, 0], [0, 6378147.0, 0]]), abs=1e-6)


@given(LON, LAT, HEIGHT)
def test_there_and_back(lon: float, lat: float, height: float) -> None:
    found = geodetic(ecef(np.array([lon]), np.array([lat]), np.array([height])))
    assert [float(part[0]) for part in found] == pytest.approx([lon, lat, height], abs=1e-6)


@given(LON, LAT)
def test_axes_are_a_rotation_and_point_where_they_say(lon: float, lat: float) -> None:
    place = ecef(np.array([lon]), np.array([lat]), np.array([100.0]))
    axes = local_axes(place)[0]
    assert np.allclose(axes @ axes.T, np.eye(3))
    for axis, step in enumerate(([1e-5, 0, 0], [0, 1e-5, 0], [0, 0, 1.0])):
        moved = ecef(np.array([lon + step[0]]), np.array([lat + step[1]]), np.array([100.0 + step[2]]))
        way = (moved - place)[0]
        assert way @ axes[axis] > 0.999 * np.linalg.norm(way)


@given(LON, LAT, st.floats(0.05, 1.5), st.floats(0.01, 6.27))
def test_directions(lon: float, lat: float, elevation: float, azimuth: float) -> None:
    place = ecef(np.array([lon]), np.array([lat]), np.array([0.0]))
    sight = np.array(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )
    found = elevation_azimuth(place, place + 2e7 * sight @ local_axes(place)[0])
    assert [float(found[0][0]), float(found[1][0])] == pytest.approx([elevation, azimuth], abs=1e-6)
