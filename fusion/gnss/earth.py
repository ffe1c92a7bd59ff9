"""The earth that satellites are seen from: its constants, ECEF and geodetic places, local axes and directions."""

from __future__ import annotations

import numpy as np

from fusion.frames import ecef_to_geodetic, local_axes
from fusion.types import Floats

EARTH_RATE_RADPS = 7.2921151467e-5
"""Rotation of the earth, WGS 84 (IS-GPS-200)."""


def ecef(lon_deg: Floats, lat_deg: Floats, height_m: Floats) -> Floats:
    """ECEF places (n, 3) of geodetic ones, (n,) each."""
    x, y, z = ecef_to_geodetic().transform(
        np.asarray(lon_deg, float),
        np.asarray(lat_deg, float),
        np.asarray(height_m, float),
        direction="INVERSE",
    )
    return np.column_stack([x, y, z]).astype(float)


def elevation_azimuth(user_m: Floats, satellite_m: Floats) -> tuple[Floats, Floats]:
    """Elevation and azimuth (clockwise from north, 0 to 2 pi), radians (n,), of satellites (n, 3) seen from (n, 3)."""
    user_m, satellite_m = np.broadcast_arrays(np.asarray(user_m, float), np.asarray(satellite_m, float))
    sight = satellite_m - user_m
    enu = np.einsum("nij,nj->ni", local_axes(user_m), sight / np.linalg.norm(sight, axis=1, keepdims=True))
    return np.arcsin(np.clip(enu[:, 2], -1, 1)), np.remainder(np.arctan2(enu[:, 0], enu[:, 1]), 2 * np.pi)
