"""Heights above the ellipsoid turned into heights above the sea, by a grid of the geoid where PROJ has one.

No grid comes with the library: EGM2008 or EGM96 is found wherever PROJ looks for its data.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pyproj import Transformer
from pyproj.exceptions import ProjError

from fusion.types import DriveLog, Floats

_GRIDS = (
    ("us_nga_egm08_25.tif", "EGM2008"),
    ("egm08_25.gtx", "EGM2008"),
    ("us_nga_egm96_15.tif", "EGM96"),
    ("egm96_15.gtx", "EGM96"),
)
"""In the order of preference, by the names that PROJ gives them."""
_ABOVE = (
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=vgridshift +grids={} +multiplier=1 "
    "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
)
_LEAST_SEPARATION_M = 1.0
"""Receivers that know no geoid write a separation of 0."""


class Geoid(NamedTuple):
    """A geoid by its ``name``: how far it is above the ellipsoid at places, ``height_m`` (n,); NaN beyond its grid."""

    name: str
    height_m: Floats


def geoid_at(lon_deg: ArrayLike, lat_deg: ArrayLike) -> Geoid | None:
    """The best geoid of which PROJ has a grid here that reaches one of the places (n,).

    Nothing is fetched, unless PROJ is told to (``PROJ_NETWORK``).
    """
    lon, lat = np.atleast_1d(lon_deg).astype(float), np.atleast_1d(lat_deg).astype(float)
    for grid, name in _GRIDS:
        try:
            heights = Transformer.from_pipeline(_ABOVE.format(grid))
        except ProjError:
            continue
        height = np.asarray(heights.transform(lon, lat, np.zeros(len(lon)))[2])
        if np.isfinite(height).any():
            return Geoid(name, np.where(np.isfinite(height), height, np.nan))
    return None


def separation_m(log: DriveLog) -> float | None:
    """How far the log itself says that the geoid is above the ellipsoid, as NMEA does; None where it does not."""
    apart = log.fix.height_ell_m - log.fix.alt_msl_m
    apart = apart[np.isfinite(apart)]
    middle = float(np.median(apart)) if len(apart) else 0.0
    return middle if abs(middle) >= _LEAST_SEPARATION_M else None


def taken_above_ellipsoid(log: DriveLog) -> DriveLog:
    """The log with its altitudes taken as heights above the ellipsoid, whatever it calls them.

    Altitudes above the sea are made of them by the geoid that is installed, else by the difference that the log itself
    states; where there is neither, the log has heights above the ellipsoid alone.
    """
    fix = log.fix
    stated = fix.alt_msl_m
    if not np.isfinite(stated).any():
        return log
    geoid, apart = geoid_at(fix.lon_deg, fix.lat_deg), separation_m(log)
    if geoid is not None:
        words, above = geoid
    elif apart is not None:
        above, words = np.full(len(fix), apart), f"{apart:.1f} m above the ellipsoid, as the log says"
    else:
        above, words = np.full(len(fix), np.nan), "unknown"
    height = np.where(np.isfinite(stated), stated, fix.height_ell_m)
    return replace(log, fix=replace(fix, alt_msl_m=stated - above, height_ell_m=height), geoid=words)
