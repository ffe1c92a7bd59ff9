"""Logs drawn from the very model that method ``profile`` and the network believe in.

Every sensor errs as ``fusion.profile.model`` and ``traversals`` say, and positions wander along the road by the
accuracy that they state. What is drawn is returned beside what was made of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accuracy.road_draws import PLANE, DrawnRoad, log_uniform
from fusion.frames import GRAVITY_MPS2
from fusion.network.pass_factor import BIAS, CONSTANT_SIGMA, PLACE_TAU_S, SQUAT
from fusion.profile.factors import PLACE_BOUND_M
from fusion.profile.levels import LEAST_HEIGHT_M
from fusion.profile.measurements import BARO, PERIOD_S
from fusion.profile.model import DRIFT_TAU_S, SLOW_MPS, Noise
from fusion.profile.prior import LOG_WANDER
from fusion.types import Attitude, DriveLog, Floats, GnssFix, GnssVelocity, Pressure, SpecificForce

SPEEDS_MPS = (5.0, 20.0)
ALTITUDE_M = (0.1, 1.5)
DRIFT_M2_PER_S = (0.01, 1.0)
RECEIVER_DRIFT_M2_PER_S, ALTIMETER_DRIFT_M2_PER_S = (0.09, 1.0), (0.001, 0.01)
"""Of altitudes whose accuracy is not stated: such as drift slowly are taken for an altimeter's, which is late."""
ALTIMETER_SHARE = 0.5
"""Share of altimeters among the altitudes whose accuracy is not stated."""
DOPPLER_MPS = (0.05, 0.4)
SPRINGS = (0.005, 0.02)
"""Noise of pitch and force as grades: sigma where it is Gaussian, scale where it is Student's t."""
BARO_M = (0.1, 0.5)
BARO_DRIFT_M2_PER_S = (0.001, 0.1)
H_ACC_M = (0.4, 4.0)
"""Stated accuracy of positions (horizontal 2-D)."""
MOUNT_DEG = 2.0
FREEDOM = 5.0
"""Degrees of freedom of the noise of pitch and force on half of the drives."""
FAST_SHARE, FAST_HZ = 0.25, 5.0
"""Share of the drives that are recorded at more than 1 Hz, and at how much."""
RATES = ("roughness", "drift", "baro_drift", "wander")
"""Levels that no averaging of samples changes."""
_DOPPLER_FLOOR = 0.002
_FIRST_S, _HOUR_S = 1.7e9, 3600.0
_POSITION_M = 0.01


@dataclass(frozen=True, eq=False)
class DrawnDrive:
    """A log, and the noise levels that it was made with: those of a sample, at ``rate_hz``.

    ``heavy``: pitch and force have Student's t noise, and their levels are its scale. ``late``: altitudes are late.
    """

    log: DriveLog
    noise: Noise
    rate_hz: float
    heavy: bool
    late: bool = False

    def level(self, name: str) -> float:
        """A noise level (a field of ``Noise``) as the method meets it, once it has averaged dense samples."""
        level: float = getattr(self.noise, name)
        return level if name in RATES else level * _left(self.rate_hz, name)


def _left(rate_hz: float, name: str) -> float:
    """What the mean over the method's slots leaves of the noise of samples."""
    period = {"altitude_m": PERIOD_S[0], "baro_m": PERIOD_S[BARO]}.get(name, PERIOD_S[1])
    if 1 / rate_hz >= 0.95 * period:
        return 1.0
    slot = np.floor(np.arange(1000) / rate_hz / period + 1e-6).astype(np.int64)
    return float(np.sqrt(np.mean(1 / np.bincount(slot)[:-1])))


def draw_drive(rng: np.random.Generator, road: DrawnRoad, number: int, lag_s: float = 0.0) -> DrawnDrive:
    """A drive over the whole road in either direction; drives of different ``number`` are an hour apart.

    Altitudes that are an altimeter's show where the vehicle was ``lag_s`` ago; beyond its ends the road goes on as it
    is there. Those of a receiver are not late, nor is the air's pressure.
    """
    rate = FAST_HZ if rng.random() < FAST_SHARE else 1.0
    forward, heavy = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    stated = bool(rng.random() < 0.5)
    late = not stated and bool(rng.random() < ALTIMETER_SHARE)
    unstated = ALTIMETER_DRIFT_M2_PER_S if late else RECEIVER_DRIFT_M2_PER_S
    noise = Noise(
        roughness=road.roughness,
        altitude_m=_height_level(rng, ALTITUDE_M, rate, "altitude_m"),
        drift=float(log_uniform(rng, DRIFT_M2_PER_S if stated else unstated)),
        doppler=1.0,
        pitch=float(log_uniform(rng, SPRINGS)),
        force=float(log_uniform(rng, SPRINGS)),
        wander=float(np.exp(rng.normal(*LOG_WANDER))),
        baro_m=_height_level(rng, BARO_M, rate, "baro_m"),
        baro_drift=float(log_uniform(rng, BARO_DRIFT_M2_PER_S)),
    )
    t, along_m, speed, acceleration = _motion(rng, float(road.node_m[-1]), 1 / rate)
    along = along_m if forward else road.node_m[-1] - along_m
    height, grade = road.height_and_grade(along)
    grade = grade if forward else -grade
    behind = late * (lag_s * speed - 0.5 * lag_s**2 * acceleration)
    altitude, _ = road.height_and_grade(along - behind if forward else along + behind)
    time = _FIRST_S + _HOUR_S * number + t
    n = len(t)
    fix, course = _fixes(rng, road, time, along, forward, altitude, noise, stated)
    white = float(log_uniform(rng, DOPPLER_MPS))
    climb = speed * grade + np.hypot(white, _DOPPLER_FLOOR * speed) * rng.normal(size=n)
    velocity = GnssVelocity.assemble(
        time,
        vel_e_mps=speed * np.sin(course),
        vel_n_mps=speed * np.cos(course),
        vel_d_mps=-climb,
        s_acc_mps=np.full(n, white),
    )
    level = np.sqrt(1 + (SLOW_MPS / speed) ** 2)
    pitch_noise, force_noise = (rng.standard_t(FREEDOM, n) if heavy else rng.normal(size=n) for _ in range(2))
    mounted = grade + np.tan(np.radians(MOUNT_DEG)) * rng.normal()
    segment = np.clip(np.searchsorted(road.node_m, along, side="right") - 1, 0, len(road.table) - 1)
    wander = (noise.wander * rng.normal(size=len(road.table)))[segment]
    squat = CONSTANT_SIGMA[SQUAT] * rng.normal() * acceleration
    pitch = np.arctan(mounted + wander + squat + noise.pitch * level * pitch_noise)
    bias = CONSTANT_SIGMA[BIAS] * rng.normal()
    felt = np.sin(np.arctan(mounted + wander + bias + noise.force * level * force_noise))
    walk = 30 * rng.normal() + np.cumsum(np.sqrt(noise.baro_drift / rate) * rng.normal(size=n))
    shown = height + walk + noise.baro_m * rng.normal(size=n)
    log = DriveLog(
        "csv",
        fix,
        velocity=velocity,
        attitude=Attitude.assemble(time, pitch_rad=pitch, yaw_rad=course),
        force=SpecificForce.assemble(time, acc_x_mps2=GRAVITY_MPS2 * felt + acceleration),
        pressure=Pressure.assemble(time, pressure_pa=101_325.0 * (1 - shown / 44_330.77) ** (1 / 0.190263)),
    )
    return DrawnDrive(log, noise, rate, heavy, late)


def _height_level(rng: np.random.Generator, bounds: tuple[float, float], rate_hz: float, name: str) -> float:
    """The noise of samples whose means are not surer than it is believed of any height."""
    return max(float(log_uniform(rng, bounds)), LEAST_HEIGHT_M / _left(rate_hz, name))


def _motion(
    rng: np.random.Generator, length_m: float, step_s: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Times from 0 (s), ways gone, speeds and accelerations, as long as the vehicle is on the road."""
    low, high = SPEEDS_MPS
    mean = rng.uniform(low, high)
    swing = rng.uniform(0, 1) * min(mean - low, high - mean)
    pace, phase = 2 * np.pi / rng.uniform(30, 90), rng.uniform(0, 2 * np.pi)
    t = np.arange(0.0, length_m / low + 1, step_s)
    along_m = mean * t - swing / pace * (np.cos(pace * t + phase) - np.cos(phase)) + rng.uniform(0, 2)
    speed = mean + swing * np.sin(pace * t + phase)
    acceleration = swing * pace * np.cos(pace * t + phase)
    on = along_m < length_m
    return t[on], along_m[on], speed[on], acceleration[on]


def _fixes(
    rng: np.random.Generator,
    road: DrawnRoad,
    time_s: Floats,
    along_m: Floats,
    forward: bool,
    height_m: Floats,
    noise: Noise,
    stated: bool,
) -> tuple[GnssFix, Floats]:
    """Positions on the road, wrong along it by what they state, with drifting altitudes, and the course."""
    n = len(time_s)
    h_acc = float(log_uniform(rng, H_ACC_M))
    sigma = min(h_acc / np.sqrt(2), PLACE_BOUND_M)
    shown = along_m + _wander(rng, time_s, sigma, PLACE_TAU_S)
    x, y = (
        np.interp(shown, road.node_m, road.node_xy_m[:, k]) + _POSITION_M * rng.normal(size=n) for k in (0, 1)
    )
    lon, lat = PLANE.to_lonlat(x, y)
    segment = np.clip(np.searchsorted(road.node_m, along_m, side="right") - 1, 0, len(road.table) - 1)
    east, north = np.diff(road.node_xy_m, axis=0)[segment].T
    course = np.mod(np.arctan2(east, north) + (0.0 if forward else np.pi), 2 * np.pi)
    variance = 0.5 * noise.drift * DRIFT_TAU_S
    drift = _wander(rng, time_s, float(np.sqrt(variance)), DRIFT_TAU_S)
    v_acc = np.sqrt(variance + noise.altitude_m**2) if stated else np.nan
    fix = GnssFix.assemble(
        time_s,
        lat_deg=lat,
        lon_deg=lon,
        alt_msl_m=height_m + drift + noise.altitude_m * rng.normal(size=n),
        h_acc_m=np.full(n, h_acc),
        v_acc_m=np.full(n, v_acc),
    )
    return fix, course


def _wander(rng: np.random.Generator, time_s: Floats, sigma: float, tau_s: float) -> Floats:
    """A Gauss-Markov process of this size and correlation time."""
    decay = np.exp(-np.diff(time_s) / tau_s)
    out = sigma * rng.normal(size=len(time_s))
    for k in range(1, len(out)):
        out[k] = decay[k - 1] * out[k - 1] + np.sqrt(1 - decay[k - 1] ** 2) * out[k]
    return np.asarray(out)
