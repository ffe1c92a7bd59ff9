"""What the way through the atmosphere and the turn of the earth add to a pseudorange, in closed form.

Ionosphere: Klobuchar, IS-GPS-200 section 20.3.3.5.2.5 (Viandier 2011, algorithm 1, prints 0.22 for 0.022 and leaves out
the clamps). Troposphere: zenith delays of Saastamoinen (1972) in the standard atmosphere, brought to the elevation by
the mapping functions of Niell (1996); 1 / sin(elevation) would be 3 m too long at five degrees.
"""

from __future__ import annotations

import numpy as np

from fusion.gnss.earth import EARTH_RATE_RADPS
from fusion.signals import CARRIER_HZ, GPS, LIGHT_MPS
from fusion.types import Floats

DEFAULT_KLOBUCHAR = (1.118e-8, -7.451e-9, -5.961e-8, 1.192e-7, 1.167e5, -2.294e5, -1.311e5, 1.049e6)
"""What GPS broadcast at the beginning of 2004, at middling solar activity; for logs that bring no coefficients.

About half of the delay is taken off by any day's coefficients: 2 to 5 m of it stay in doubt at noon.
"""

DAY_S = 86_400.0
_NIGHT_S = 5e-9  # the delay at night
_NOON_S = 50_400.0  # local time of the greatest delay
_SHORTEST_PERIOD_S = 72_000.0
_NIGHT_PHASE_RAD = 1.57
_HIGHEST_LATITUDE = 0.416  # semicircles

HUMIDITY = 0.7
"""Relative humidity of the standard atmosphere; 0.2 more or less move the zenith's delay by 3 cm."""
HIGHEST_M = 10_000.0
"""Above this no road leads, and the standard atmosphere is not meant."""

# Niell (1996), tables 3 and 4: columns are latitudes 15, 30, 45, 60, 75 degrees; rows are the coefficients a, b, c.
_NIELL_LATITUDE_DEG = np.array([15.0, 30.0, 45.0, 60.0, 75.0])
_DRY_MEAN = np.array(
    [
        [1.2769934e-3, 1.2683230e-3, 1.2465397e-3, 1.2196049e-3, 1.2045996e-3],
        [2.9153695e-3, 2.9152299e-3, 2.9288445e-3, 2.9022565e-3, 2.9024912e-3],
        [62.610505e-3, 62.837393e-3, 63.721774e-3, 63.824265e-3, 64.258455e-3],
    ]
)
_DRY_SEASON = np.array(
    [
        [0.0, 1.2709626e-5, 2.6523662e-5, 3.4000452e-5, 4.1202191e-5],
        [0.0, 2.1414979e-5, 3.0160779e-5, 7.2562722e-5, 11.723375e-5],
        [0.0, 9.0128400e-5, 4.3497037e-5, 84.795348e-5, 170.37206e-5],
    ]
)
_WET = np.array(
    [
        [5.8021897e-4, 5.6794847e-4, 5.8118019e-4, 5.9727542e-4, 6.1641693e-4],
        [1.4275268e-3, 1.5138625e-3, 1.4572752e-3, 1.5007428e-3, 1.7599082e-3],
        [4.3472961e-2, 4.6729510e-2, 4.3908931e-2, 4.4626982e-2, 5.4736038e-2],
    ]
)
_HEIGHT = (2.53e-5, 5.49e-3, 1.14e-3)
_WINTER_DAY, _YEAR_DAYS = 28.0, 365.25


def klobuchar_delay_m(
    coefficients: tuple[float, ...],
    gps_s: Floats,
    lat_rad: Floats,
    lon_rad: Floats,
    elevation_rad: Floats,
    azimuth_rad: Floats,
    carrier_hz: Floats,
) -> Floats:
    """The ionosphere's delay of code, metres (n,), by alpha 0..3 and beta 0..3; falls with the carrier's square."""
    lat, lon, elevation = (x / np.pi for x in (lat_rad, lon_rad, elevation_rad))  # semicircles from here on
    away = 0.0137 / (elevation + 0.11) - 0.022
    pierced = np.clip(lat + away * np.cos(azimuth_rad), -_HIGHEST_LATITUDE, _HIGHEST_LATITUDE)
    pierced_lon = lon + away * np.sin(azimuth_rad) / np.cos(pierced * np.pi)
    magnetic = pierced + 0.064 * np.cos((pierced_lon - 1.617) * np.pi)
    local_s = np.remainder(DAY_S / 2.0 * pierced_lon + gps_s, DAY_S)
    powers = magnetic[:, None] ** np.arange(4)
    amplitude_s = np.maximum(powers @ np.array(coefficients[:4]), 0.0)
    period_s = np.maximum(powers @ np.array(coefficients[4:]), _SHORTEST_PERIOD_S)
    phase = 2.0 * np.pi * (local_s - _NOON_S) / period_s
    wave = np.where(np.abs(phase) < _NIGHT_PHASE_RAD, 1.0 - phase**2 / 2.0 + phase**4 / 24.0, 0.0)
    slant = 1.0 + 16.0 * (0.53 - elevation) ** 3
    return np.asarray(
        LIGHT_MPS * slant * (_NIGHT_S + amplitude_s * wave) * (CARRIER_HZ[GPS] / carrier_hz) ** 2
    )


def zenith_delays_m(lat_rad: Floats, height_m: Floats) -> tuple[Floats, Floats]:
    """Saastamoinen's dry and wet delay at the zenith, metres (n,), in the standard atmosphere at a height.

    Heights are taken from 0 to 10 km; of the geoid is meant, and the ellipsoid's serve: 50 m are 1.5 cm.
    """
    height = np.clip(height_m, 0.0, HIGHEST_M)
    pressure_hpa = 1_013.25 * (1.0 - 2.2557e-5 * height) ** 5.2568
    kelvin = 288.16 - 6.5e-3 * height
    vapour_hpa = 6.108 * HUMIDITY * np.exp((17.15 * kelvin - 4_684.0) / (kelvin - 38.45))
    gravity = 1.0 - 0.00266 * np.cos(2.0 * lat_rad) - 0.00028e-3 * height
    return 0.0022768 * pressure_hpa / gravity, 0.002277 * (1_255.0 / kelvin + 0.05) * vapour_hpa


def niell_mapping(
    gps_s: Floats, lat_rad: Floats, height_m: Floats, elevation_rad: Floats
) -> tuple[Floats, Floats]:
    """How many times the zenith's dry and wet delays the slant ones are, (n,); elevations above 0."""
    # GPS days begin with a Sunday, 1980-01-06: the day of the year, to a day, is all that the season needs.
    day = np.remainder(gps_s / DAY_S + 5.0, _YEAR_DAYS)
    lat_deg = np.degrees(lat_rad)
    season = np.cos(2.0 * np.pi * ((day - _WINTER_DAY) / _YEAR_DAYS + np.where(lat_deg < 0.0, 0.5, 0.0)))
    sine = np.sin(elevation_rad)

    def along(rows: Floats) -> list[Floats]:
        return [np.interp(np.abs(lat_deg), _NIELL_LATITUDE_DEG, row) for row in rows]

    dry = [mean - swing * season for mean, swing in zip(along(_DRY_MEAN), along(_DRY_SEASON), strict=True)]
    higher = 1.0 / sine - _continued_fraction(sine, *_HEIGHT)
    return (
        _continued_fraction(sine, *dry) + higher * np.clip(height_m, 0.0, HIGHEST_M) / 1_000.0,
        _continued_fraction(sine, *along(_WET)),
    )


def troposphere_delay_m(gps_s: Floats, lat_rad: Floats, height_m: Floats, elevation_rad: Floats) -> Floats:
    """The troposphere's delay at an elevation above 0, metres (n,)."""
    dry, wet = zenith_delays_m(lat_rad, height_m)
    dry_times, wet_times = niell_mapping(gps_s, lat_rad, height_m, elevation_rad)
    return dry * dry_times + wet * wet_times


def turned_by_earth(vector: Floats, flight_s: Floats) -> Floats:
    """ECEF vectors (n, 3) of the moment of transmission in the frame of reception, ``flight_s`` (n,) later (Sagnac)."""
    angle = EARTH_RATE_RADPS * flight_s
    s, c = np.sin(angle), np.cos(angle)
    x, y, z = vector.T
    return np.column_stack([c * x + s * y, c * y - s * x, z])


def _continued_fraction(sine: Floats, a: Floats | float, b: Floats | float, c: Floats | float) -> Floats:
    """Marini's, scaled to 1 at the zenith."""
    top = 1.0 + a / (1.0 + b / (1.0 + c))
    return np.asarray(top / (sine + a / (sine + b / (sine + c))))
