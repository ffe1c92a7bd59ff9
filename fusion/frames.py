"""Geodesy and attitude: the local metric plane, and rotations between body, NED and ENU frames.

Pure geometry: no sensor, no road.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from pyproj import CRS, Transformer

from fusion.types import Floats

GRAVITY_MPS2 = 9.80665
"""Standard gravity."""
METRES_PER_DEGREE = 111_132.0
"""Of latitude, on the mean. For margins and for telling fine from coarse; measuring takes ``LocalProjection``."""
SHORTEST_DEGREE_M = 110_000.0
"""A little less than any degree of latitude has, so that boxes in degrees come out wider than asked for."""


@cache
def ecef_to_geodetic() -> Transformer:
    """From earth-centred coordinates (m) to longitude, latitude (degrees) and height above WGS 84 (m)."""
    return Transformer.from_crs(CRS.from_epsg(4978), CRS.from_epsg(4979), always_xy=True)


def geodetic(position_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Longitude and latitude (degrees) and height above the ellipsoid (m), (n,) each, of ECEF places (n, 3)."""
    x, y, z = np.asarray(position_m, float).reshape(-1, 3).T
    lon, lat, height = ecef_to_geodetic().transform(x, y, z)
    return np.asarray(lon, float), np.asarray(lat, float), np.asarray(height, float)


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


@dataclass(frozen=True)
class LocalProjection:
    """A transverse Mercator plane centred on (lon0_deg, lat0_deg): x east, y north, metres.

    Scale is exact on the central meridian and 5e-4 too large 200 km from it, far below any slope's sigma.
    """

    lon0_deg: float
    lat0_deg: float

    @classmethod
    def around(cls, lon_deg: Floats, lat_deg: Floats) -> LocalProjection:
        """Centre the plane on the middle of the extent, rounded to 0.01 degree so that it is reproducible."""
        lon0 = round((float(np.nanmin(lon_deg)) + float(np.nanmax(lon_deg))) / 2, 2)
        lat0 = round((float(np.nanmin(lat_deg)) + float(np.nanmax(lat_deg))) / 2, 2)
        return cls(lon0, lat0)

    @cached_property
    def _transformer(self) -> Transformer:
        plane = CRS.from_proj4(
            f"+proj=tmerc +lat_0={self.lat0_deg} +lon_0={self.lon0_deg} +k=1 +datum=WGS84 +units=m"
        )
        return Transformer.from_crs(CRS.from_epsg(4326), plane, always_xy=True)

    def to_xy(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """Degrees (any equal shapes) to metres east and north; NaN stays NaN."""
        x, y = self._transformer.transform(np.asarray(lon_deg, float), np.asarray(lat_deg, float))
        x, y = np.asarray(x, float), np.asarray(y, float)
        bad = ~(np.isfinite(x) & np.isfinite(y))
        return np.where(bad, np.nan, x), np.where(bad, np.nan, y)

    def to_lonlat(self, x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
        """Metres east and north to degrees (lon, lat); NaN stays NaN."""
        lon, lat = self._transformer.transform(
            np.asarray(x_m, float), np.asarray(y_m, float), direction="INVERSE"
        )
        lon, lat = np.asarray(lon, float), np.asarray(lat, float)
        bad = ~(np.isfinite(lon) & np.isfinite(lat))
        return np.where(bad, np.nan, lon), np.where(bad, np.nan, lat)


def wrap_angle(angle_rad: Floats) -> Floats:
    """Wrap radians to (-pi, pi]."""
    wrapped = np.remainder(np.asarray(angle_rad, float) + np.pi, 2 * np.pi) - np.pi
    return np.where(wrapped == -np.pi, np.pi, wrapped)


def body_to_ned(roll_rad: Floats, pitch_rad: Floats, yaw_rad: Floats) -> Floats:
    """Rotation matrices, shape (n, 3, 3), from body (x forward, y right, z down) to NED.

    Al Assaad 2020, annex A.2 and B.4: the transpose of C_X(roll) C_Y(pitch) C_Z(yaw).
    """
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    rows = [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
    return np.moveaxis(np.array(rows, float), (0, 1), (-2, -1))


def acceleration_enu(force_mps2: Floats, roll_rad: Floats, pitch_rad: Floats, yaw_rad: Floats) -> Floats:
    """Kinematic acceleration in ENU, shape (n, 3), from specific force in the sensor's body frame.

    ``force_mps2`` has shape (n, 3): x forward, y left, z up (+9.8 on z at rest). Its y and z are flipped,
    rotated to NED (annex B.4), turned to ENU, and gravity is taken off: the accelerometer measures
    specific force, which the thesis leaves unsaid.
    """
    flipped = np.asarray(force_mps2, float) * np.array([1.0, -1.0, -1.0])
    ned = np.einsum("nij,nj->ni", body_to_ned(roll_rad, pitch_rad, yaw_rad), flipped)
    enu = np.column_stack([ned[:, 1], ned[:, 0], -ned[:, 2]])
    enu[:, 2] -= GRAVITY_MPS2
    return enu
