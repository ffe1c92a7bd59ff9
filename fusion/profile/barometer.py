"""Heights from air pressure: the air's temperature, and what driving does to the pressure at the sensor.

The drift of a barometer, which the weather makes, is the smoother's affair.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from fusion.frames import GRAVITY_MPS2
from fusion.profile.blocks import NOTHING, Estimate, binned, blocks_of, crossed, inliers, jackknife
from fusion.types import DriveLog, Floats, Pressure

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
SPAN_S = 8.0
"""Changes of height are compared over this long. A vehicle brakes and pulls away in less time, and the errors of
heights, or of Doppler added up, are still smaller than what a braking shows."""
BLOCK_S = 60.0
"""In this time a barometer drifts evenly, and a change of speed begins and ends. Shorter blocks would cut half a minute
of pulling away in pieces, and each piece would go into the level of its block."""
LEAST_GAIN = 0.3
"""Heights that follow the barometer by a smaller factor are no measure of it."""
HOLE_S = 2.5
"""Samples farther apart have a hole between them."""
USUAL_SPEED_PRESSURE = 0.15
"""Share of the dynamic pressure that a sensor in or on a vehicle usually feels, of either sign. In a cabin it is 0.07:
100 km/h (4.6 hPa) make 0.3 hPa there. In the wind it is more."""
CLEAR = 2.0
"""Sigmas from which on that share is set right: hardly any sensor on a vehicle feels nothing of the pressure."""
MOST_SPEED_PRESSURE = 1.0
"""Nothing on a vehicle has more than the whole dynamic pressure, nor much less than minus that."""
SPEED_PRESSURE_FLOOR = 0.01
"""One sigma of the error of the comparison itself: 0.4 m between standing and 100 km/h."""


def pressure_heights(
    pressure: Pressure, share: float, speed_time: Floats, speed: Floats
) -> tuple[Floats, Floats]:
    """Times (m,) and heights by pressure samples, in the log's own temperature if it states one.

    ``share`` of the dynamic pressure at speeds (n,) at ``speed_time`` is taken off.
    """
    time, height = _still_air(pressure)
    if share:
        height = height + share * _head(np.interp(time, speed_time, speed))
    return time, height


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


def _still_air(pressure: Pressure) -> tuple[Floats, Floats]:
    """Times and heights of the samples as if the vehicle stood; the level is that of the standard atmosphere."""
    height = standard_height(pressure.pressure_pa)
    known = np.isfinite(height)
    time, height = pressure.time_s[known], height[known]
    if not len(time):
        return time, height
    middle = float(np.median(height))
    return time, middle + air_scale(pressure.temperature_k, middle) * (height - middle)


def _head(speed: Floats) -> Floats:
    """Height that the whole dynamic pressure, density * speed^2 / 2, amounts to in the same air: speed^2 / 2 g, m."""
    return np.asarray(speed**2 / (2 * GRAVITY_MPS2))


def speed_pressure(log: DriveLog, speed_time: Floats, speed: Floats) -> Estimate:
    """The share of the dynamic pressure that the sensor feels; 0 in still air.

    It is learned against heights by Doppler, else by GNSS. Over ``SPAN_S`` the drive rises more than the barometer
    says, in proportion to the growth of the speed's head. The regression also takes up what else may be wrong with
    the barometer: a scale, and a lag, which shows as a change of the climb.
    """
    time, shown = _still_air(log.pressure)
    if len(time) < 2 or len(speed_time) < 2:
        return NOTHING
    at, height, climb = _other_heights(log)
    head = _head(np.interp(at, speed_time, speed))
    columns = np.array([height, head, np.interp(at, time, shown), climb])
    keep = (at >= time[0]) & (at <= time[-1])
    for known in (time, speed_time):
        right = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
        keep &= known[right] - known[right - 1] < HOLE_S
    estimate = _share(at[keep], columns[:, keep]).with_floor(SPEED_PRESSURE_FLOOR)
    return estimate if abs(estimate.value) < MOST_SPEED_PRESSURE else NOTHING


def set_right_share(share: Estimate) -> float:
    """What of a share of the dynamic pressure is set right."""
    return share.worth(USUAL_SPEED_PRESSURE, CLEAR)


def _share(at: Floats, columns: Floats) -> Estimate:
    """Regression of changes of the first column (4, n) at instants (n,) on those of the others: that on the second."""
    if len(at) < 2:
        return NOTHING
    apart = max(1, round(SPAN_S / float(np.median(np.diff(at)))))
    unbroken = at[apart:] - at[:-apart] < 1.2 * SPAN_S
    change = (columns[:, apart:] - columns[:, :-apart])[:, unbroken]
    if not change.size:
        return NOTHING
    block = blocks_of(at[:-apart][unbroken], BLOCK_S)
    near = inliers(change, block)

    def share(total: Floats) -> float:
        # Noise of the barometer makes both coefficients too small by the same factor.
        speed, shown, _ = np.linalg.lstsq(total[1:, 1:], total[1:, 0], rcond=1e-9)[0]
        return float(speed / shown) if shown > LEAST_GAIN else float("nan")

    return jackknife(crossed(change[:, near], block[near]), share)


def _other_heights(log: DriveLog) -> tuple[Floats, Floats, Floats]:
    """Times, heights by Doppler, else by GNSS, and climb (m/s; 0 unknown), once a second."""
    v, fix = log.velocity, log.fix
    if v.has("vel_d_mps"):
        time, down = binned(v.time_s, 1.0, v.vel_d_mps)
        return time, cumulative_trapezoid(-down, time, initial=0.0), -down
    time, height = binned(fix.time_s, 1.0, fix.alt_msl_m if fix.has("alt_msl_m") else fix.height_ell_m)
    return time, height, np.zeros(len(time))
