"""Heights from air pressure: the air's temperature, and what driving does to the pressure at the sensor.

What a barometer feels of it, and its drift, which the weather makes, are the smoother's affair.
"""

from __future__ import annotations

import numpy as np

from fusion.frames import GRAVITY_MPS2
from fusion.types import Floats, Pressure

_ATMOSPHERE = (44_330.77, 101_325.0, 0.190263)
"""Scale (m), pressure at sea level (Pa) and exponent of the standard atmosphere's height (ICAO Doc 7488)."""
_SEA_LEVEL_K, _LAPSE_K_PER_M = 288.15, 0.0065
"""Its temperature at sea level, and how fast it falls with height."""
AIR_SIGMA_K = 10.0
"""How far the air is from the standard atmosphere's temperature: summers and winters of the middle latitudes."""
DEVICE_SIGMA_K = 5.0
"""How far a device's thermometer is from the air's temperature: it lies in the sun, in a cabin, or on a hand."""
PLAUSIBLE_K = (223.15, 323.15)
"""-50 to 50 degrees Celsius: what is outside is no air that anybody drives in."""


def standard_height(pressure_pa: Floats) -> Floats:
    """Height in the standard atmosphere, m."""
    scale, sea_level, exponent = _ATMOSPHERE
    with np.errstate(invalid="ignore"):
        return np.asarray(scale * (1 - (pressure_pa / sea_level) ** exponent))


def air_scale(temperature_k: Floats, height_m: float) -> float:
    """Metres of real air for a metre of the standard atmosphere's, about ``height_m``, by a device's temperatures (n,).

    The distance between two pressures grows with the temperature (hypsometric equation; Wallace and Hobbs 2006, 3.29).
    The device is believed by 80 %: as far as its thermometer tells more of the air than the calendar does.
    """
    low, high = PLAUSIBLE_K
    plausible = temperature_k[(temperature_k >= low) & (temperature_k <= high)]
    if not len(plausible):
        return 1.0
    standard = _SEA_LEVEL_K - _LAPSE_K_PER_M * height_m
    belief = AIR_SIGMA_K**2 / (AIR_SIGMA_K**2 + DEVICE_SIGMA_K**2)
    return 1 + belief * (float(np.median(plausible)) / standard - 1)


def pressure_heights(pressure: Pressure) -> tuple[Floats, Floats]:
    """Times (m,) and heights by pressure samples, in the log's own temperature if it states one.

    They are those of a vehicle that stands; the level is that of the standard atmosphere.
    """
    height = standard_height(pressure.pressure_pa)
    known = np.isfinite(height)
    time, height = pressure.time_s[known], height[known]
    if not len(time):
        return time, height
    middle = float(np.median(height))
    return time, middle + air_scale(pressure.temperature_k, middle) * (height - middle)


def speed_head(speed: Floats) -> Floats:
    """Height that the whole dynamic pressure, density * speed^2 / 2, amounts to in the same air: speed^2 / 2 g, m."""
    return np.asarray(speed**2 / (2 * GRAVITY_MPS2))
