"""What is believed of a drive's noise levels before the drive itself is learned from (``levels``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.frames import GRAVITY_MPS2
from fusion.network.pass_factor import USUAL_SPEED_PRESSURE
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, TERRAIN, Measurements
from fusion.profile.model import DRIFT_TAU_S, GUST_MPS, WANDER_SIGMA, Noise

WHITE = {ALTITUDE: "altitude_m", DOPPLER: "doppler", PITCH: "pitch", FORCE: "force", BARO: "baro_m"}
"""The white level of each sensor."""
LOG_ROUGHNESS = (float(np.log(3e-5)), 1.5)
"""Mean and sigma of the log of the roughness (1/m): flat towns have 3e-7, hills 1e-4 (spec 7)."""
LOG_GRADE_LENGTH = (float(np.log(60.0)), 1.0)
"""Mean and sigma of the log of the length (m) over which grades go back to level: towns have 10, hills 300."""
LOG_WANDER = (float(np.log(WANDER_SIGMA)), 0.4)
"""The same for the wander of the attitude: most vehicles are alike, and a short drive can't tell the wander from the
road's grades."""
LOG_SPREAD, LOG_RATE_SPREAD = 1.0, 1.5
"""Sigma of the logs of white levels and of rates about where they start: receivers differ by ten times."""
USUAL_V_ACC_M = 4.0
"""Accuracy of altitudes of a log that states none."""


class UsualDrift(NamedTuple):
    """The rate (m^2/s) at which the error of a kind of altitudes drifts, and the sigma of its log that is allowed when
    a drive is learned from which does not tell it (``tells_drift``)."""

    rate: float
    log_spread: float


RECEIVER_DRIFT = UsualDrift(2 * USUAL_V_ACC_M**2 / DRIFT_TAU_S, 0.3)
"""Receivers' altitudes; white noise and jumps say a little of it."""
ALTIMETER_DRIFT = UsualDrift(0.006, 0.05)
"""Altimeters' heights, which say nothing of it: left free, it comes out between 0.0006 and 0.5 for rides over one road
whose errors are alike. The air's pressure has 0.001 (0.8 m in ten minutes), and the best receivers that fix no carrier
phase have 0.01 (0.8 m for two minutes); this lies above the middle, for too small is worse than too large."""


@dataclass(frozen=True)
class Prior:
    """What is believed of a drive's levels before it is learned from: most likely ``noise``, and the sigma of the log
    of the rate of the altitudes' drift about that of ``noise``."""

    noise: Noise
    log_drift_spread: float = LOG_RATE_SPREAD

    def of(self, name: str) -> tuple[float, float]:
        """Mean and sigma of the log of a level."""
        if name == "roughness":
            return LOG_ROUGHNESS
        if name == "wander":
            return LOG_WANDER
        if name == "grade_length_m":
            return LOG_GRADE_LENGTH
        spread = LOG_SPREAD if name in WHITE.values() else LOG_RATE_SPREAD
        return float(np.log(getattr(self.noise, name))), self.log_drift_spread if name == "drift" else spread


def prior_of(measured: Measurements, usual_drift: UsualDrift | None = None) -> Prior:
    """Where learning starts: what the log says about itself, in bounds, else an ordinary receiver's.

    ``usual_drift`` is for altitudes whose drift the log itself does not tell.
    """
    stated = measured.stated_sigma[(measured.sensor == ALTITUDE) & np.isfinite(measured.stated_sigma)]
    v_acc = float(np.clip(np.median(stated), 0.3, 12.0)) if len(stated) else USUAL_V_ACC_M
    noise = Noise(
        altitude_m=float(np.clip(v_acc / 6, 0.1, 1.5)),
        drift=2 * v_acc**2 / DRIFT_TAU_S if usual_drift is None else usual_drift.rate,
        gust_m=_gust(measured),
        dem_m=_dem_sigma(measured),
    )
    return Prior(noise, LOG_RATE_SPREAD if usual_drift is None else usual_drift.log_spread)


def tells_drift(measured: Measurements) -> bool:
    """Whether a log tells how fast its altitudes' error drifts: by their accuracy, or by anything to hold them against.
    True without altitudes, of which nothing is asked then.

    Altitudes alone do not, once a receiver's filter has smoothed them: then their error is as smooth as a road.
    """
    altitude = measured.sensor == ALTITUDE
    others = ~(altitude | (measured.sensor == TERRAIN))
    stated = np.isfinite(measured.stated_sigma[altitude]).any()
    return bool(not altitude.any() or others.any() or stated)


def _gust(measured: Measurements) -> float:
    """What gusts add to a barometer's height, m: they change the dynamic pressure in proportion to the speed."""
    pressed = measured.sensor == BARO
    speed = float(np.median(measured.speed_mps[pressed])) if pressed.any() else 0.0
    return USUAL_SPEED_PRESSURE * max(speed, 1.0) * GUST_MPS / GRAVITY_MPS2


def _dem_sigma(measured: Measurements) -> float:
    """Robust scatter of DEM heights about the altitudes; unknown datums shift both alike."""
    terrain, altitude = measured.sensor == TERRAIN, measured.sensor == ALTITUDE
    if not terrain.any() or not altitude.any():
        return Noise.dem_m
    excess = measured.value[terrain] - np.interp(
        measured.time_s[terrain], measured.time_s[altitude], measured.value[altitude]
    )
    spread = 1.4826 * float(np.median(np.abs(excess - np.median(excess))))
    return float(np.clip(spread, 3.0, 100.0))
