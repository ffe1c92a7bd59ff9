"""Altitudes that cannot be what the log calls them: off the ground by a constant, in feet, or below the sea."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fusion.terrain.datum import MEAN_SEA_LEVEL, datum_of_log
from fusion.terrain.geoid import geoid_at, separation_m
from fusion.types import DriveLog, Floats, Ints

OFFSET_M = 20.0
"""Altitudes that are farther off the elevation model all along are no error of either: models are within 9 m in nine of
ten places (SRTM), receivers within a few metres in the middle of a drive. Barometers that nobody set are off by up to
100 m, and the ellipsoid is 15 to 50 m from mean sea level in most of Europe and North America."""
LEAST_RELIEF_M, SCALE_GAIN = 3.0, 3.0
"""Altitudes are taken for feet if that explains them so many times better, where the ground rises and falls enough."""
FOOT_M = 0.3048
BELOW_SEA_M = 10.0
"""Roads so far below the sea are few: around the Dead Sea, the Caspian Sea and in some deserts."""
ALIKE_M = 15.0
"""What altitudes are off by fits the geoid where it is so near to it: the model and the receiver are not exact."""


class OffGround(NamedTuple):
    """Altitudes against the ground: ``off_m`` above it in the middle, and whether that is so all along."""

    off_m: float
    is_constant: bool
    in_feet: bool


def off_ground(log: DriveLog, row: Ints, height_m: Floats) -> OffGround | None:
    """The altitudes of some rows of the log's positions against the ground's heights there (n,), m, NaN: unknown.

    None where they are near it, or are not said to be above the sea: heights that the log states above the ellipsoid
    are another datum by right.
    """
    if datum_of_log(log) != MEAN_SEA_LEVEL:
        return None
    altitude = log.fix.alt_msl_m[row]
    both = np.isfinite(altitude) & np.isfinite(height_m)
    if not both.any():
        return None
    altitude, height = altitude[both], height_m[both]
    above = altitude - height
    off, spread = float(np.median(above)), _spread(above)
    if abs(off) < OFFSET_M:
        return None
    feet = _spread(height) > LEAST_RELIEF_M and SCALE_GAIN * _spread(altitude * FOOT_M - height) < spread
    return OffGround(off, spread <= 0.5 * abs(off), feet)


def height_doubt(log: DriveLog, row: Ints | None, height_m: Floats | None) -> dict[str, Any] | None:
    """What makes the log's altitudes doubtful, and whether they are above the ellipsoid; JSON-serialisable.

    ``row`` and ``height_m`` as in ``off_ground``; None, or no height: then altitudes below the sea are doubtful.
    ``above_model_m``, ``above_sea_m``: what is odd, metres. ``geoid``: the grid that is installed, ``geoid_m``: by it,
    or as the log says, how far the sea is above the ellipsoid here. ``fits``: whether heights above the ellipsoid would
    be off like that; null where nothing tells. None: there is no doubt.
    """
    off = None
    if row is not None and height_m is not None and np.isfinite(height_m).any():
        found = off_ground(log, row, height_m)
        off = found.off_m if found is not None and found.is_constant and not found.in_feet else None
        sea = None
    else:
        sea = _below_sea_m(log)
    if off is None and sea is None:
        return None
    geoid = geoid_at(np.median(log.fix.lon_deg), np.median(log.fix.lat_deg))
    apart = separation_m(log) if geoid is None else float(geoid.height_m[0])
    return {
        "above_model_m": off,
        "above_sea_m": sea,
        "geoid": None if geoid is None else geoid.name,
        "geoid_m": apart,
        "fits": None if apart is None else _fits(off, sea, apart),
    }


def _fits(off: float | None, sea: float | None, apart: float) -> bool:
    """Whether the ellipsoid's heights would be like that, where the sea is ``apart`` above it."""
    if off is not None:
        return abs(off - apart) < ALIKE_M
    return sea is not None and sea - apart > -BELOW_SEA_M


def _below_sea_m(log: DriveLog) -> float | None:
    altitude = log.fix.alt_msl_m[np.isfinite(log.fix.alt_msl_m)]
    if datum_of_log(log) != MEAN_SEA_LEVEL or not len(altitude):
        return None
    middle = float(np.median(altitude))
    return middle if middle < -BELOW_SEA_M else None


def _spread(values: Floats) -> float:
    """Half of the values lie so far or farther from the middle one."""
    return float(np.median(np.abs(values - np.median(values))))
