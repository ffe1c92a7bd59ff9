"""The earth that satellites are seen from: its constants, ECEF and geodetic places, local axes and directions."""

from __future__ import annotations

from functools import cache

import numpy as np
from pyproj import CRS, Transformer

from fusion.types import Floats

EARTH_RATE_RADPS = 7.2921151467e-5
"""Rotation of the earth, WGS 84 (IS-GPS-200)."""


@cache
def _transformer() -> Transformer:
    return Transformer.from_crs(CRS.from_epsg(4978), CRS.from_epsg(4979), always_xy=True)


def geodetic(position_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Longitude and latitude (degrees) and height above the ellipsoid (m), (n,) each, of ECEF places (n, 3)."""
    x, y, z = np.asarray(position_m, float).reshape(-1, 3).T
    lon, lat, height = _transformer().transform(x, y, z)
    return np.asarray(lon, float), np.asarray(lat, float), np.asarray(height, float)


def ecef(lon_deg: Floats, lat_deg: Floats, height_m: Floats) -> Floats:
    """ECEF places (n, 3) of geodetic ones, (n,) each."""
    x, y, z = _transformer().transform(
        np.asarray(lon_deg, float),
        np.asarray(lat_deg, float),
        np.asarray(height_m, float),
        direction="INVERSE",
    )
    return np.column_stack([x, y, z]).astype(float)


def local_axes(position_m: Floats) -> Floats:
    """Rotations (n, 3, 3) whose rows are east, north and up at ECEF places (n, 3)."""
    lon_deg, lat_deg, _ = geodetic(position_m)
    lon, lat = np.radians(lon_deg), np.radians(lat_deg)
    zero = np.zeros_like(lon)
    rows = [
        [-np.sin(lon), np.cos(lon), zero],
        [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
    ]
    return np.moveaxis(np.array(rows, float), (0, 1), (-2, -1))


def elevation_azimuth(user_m: Floats, satellite_m: Floats) -> tuple[Floats, Floats]:
    """Elevation and azimuth (clockwise from north, 0 to 2 pi), radians (n,), of satellites (n, 3) seen from (n, 3)."""
    user_m, satellite_m = np.broadcast_arrays(np.asarray(user_m, float), np.asarray(satellite_m, float))
    sight = satellite_m - user_m
    enu = np.einsum("nij,nj->ni", local_axes(user_m), sight / np.linalg.norm(sight, axis=1, keepdims=True))
    return np.arcsin(np.clip(enu[:, 2], -1, 1)), np.remainder(np.arctan2(enu[:, 0], enu[:, 1]), 2 * np.pi)
